"""What a restored picture and its residual say of the noise and of the sharp picture's contrast.

Both are what the weight of the picture's prior is made of: lambda_u = sigma^2 / G, G the mean squared gradient, each
where the weight decides between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.joint.data_term import DataTerm
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.joint.priors import diffuse
from procedures.restoration.masks.blur_operator import Array, MaskStack

SIZE = 64
"""Frequencies along each axis at which transfer functions are averaged; masks are smaller."""
BANDS = 8
"""Rings of frequencies in which noise and contrast are told apart: both may fall by factors of a hundred over them."""


@dataclass(frozen=True)
class Moments:
    """Variances, white = 1.

    noise : of the photographs, over all frequencies; deciding, contrast : of the noise, and the mean squared gradient
    of the sharp picture, both at the frequencies where the prior's weight decides: their ratio is the weight that costs
    the restored picture least.
    """

    noise: float
    deciding: float
    contrast: float


def moments(
    stacks: list[MaskStack],
    depths: Array,
    weights: Array,
    left: Array,
    gradient: Array,
    fitted: float = 0.0,
    least_noise: float = 1e-5,
) -> Moments:
    """Noise and contrast that a restoration tells of.

    depths : w of equal parts of the frame; weights : of the quadratic prior that the picture stands with in every
    band, see `standing_weights`; left, gradient : powers of one photograph's residual, and of the restored picture's
    gradient, in every band, see `band_powers`; fitted : noise fitted by the depth, see `fitted_by_depth`; least_noise :
    standard deviation under which no photograph of 16 bits is.

    Where masks pass S = sum |H|^2 and the prior is L, the residual holds noise and what the prior took from the
    picture, the gradient the rest of it and noise amplified; both are linear in the band's noise N and squared gradient
    g. Real photographs' noise is not white: masks that err a little leave noise shaped as the picture, samples are
    interpolated, and a lens leaves pictures little of high frequencies. The expected error of a picture restored with
    weight l, sum (lL)^2 P + S N over (S + lL)^2 with g = L P, is least where l = sum V N / sum V g,
    V = S L / (S + lL)^3.
    """
    parts = [responses(stacks, float(w)) for w in depths]
    L, rings = parts[0][1], rings_of((SIZE, SIZE))
    noise, slopes = np.zeros((2, BANDS))
    for band in range(BANDS):
        noise[band], slopes[band] = _told_apart(
            [(S[rings == band], L[rings == band]) for S, _ in parts],
            weights[band], len(stacks), fitted, len(stacks) * left[band], gradient[band],
        )  # fmt: skip
    noise = np.maximum(noise, least_noise**2)
    found = float(np.median(weights))
    for _ in range(20):
        deciding = np.mean([S * L / (S + found * L + 1e-12) ** 3 for S, _ in parts], axis=0)
        share = np.array([deciding[rings == band].sum() for band in range(BANDS)])
        share /= share.sum()
        variance, contrast = float(share @ noise), max(float(share @ slopes), 0.1 * float(share @ gradient), 1e-8)
        found = variance / contrast
    return Moments(float(noise[rings[rings >= 0]].mean()), variance, contrast)


def _told_apart(
    parts: list[tuple[Array, Array]], weight: float, count: int, fitted: float, left: float, gradient: float
) -> tuple[float, float]:
    """Noise and squared gradient of a band, from what is left over of all photographs and the restored gradient.

    parts : S and L at these frequencies, for every part of the frame.
    """
    S, L = (np.concatenate(one) for one in zip(*parts, strict=True))
    kept, taken = S / (S + weight * L + 1e-12), weight * L / (S + weight * L + 1e-12)
    free = max(count - 1 + float(np.mean(taken**2)) - fitted, 0.2)
    system = np.array(
        [
            [free, np.mean(kept * taken) * weight],
            [np.mean(L * kept / (S + weight * L + 1e-12)), np.mean(kept**2) + 1e-12],
        ]
    )
    noise, slopes = np.linalg.solve(system, np.array([left, gradient]))
    # a depth that is still wrong leaves more than this model knows of
    return max(float(noise), 0.1 * left / free), max(float(slopes), 0.0)


def band_powers(images: Array, others: Array | None = None) -> Array:
    """Mean power of images (..., H, W) in every band of frequencies, (BANDS,); or what they and others share of it."""
    shape = (images.shape[-2], images.shape[-1])
    one = _spectra(images)
    other = one if others is None else _spectra(others)
    rings, mean = rings_of(shape), (one * other.conj()).real.reshape(-1, *shape).mean(axis=0)
    return np.array([mean[rings == band].mean() for band in range(BANDS)])


def _spectra(images: Array) -> NDArray[np.complex128]:
    """Of images (..., H, W) under a window of mean square 1 / (H W), their level taken away."""
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in images.shape[-2:]))
    window /= np.sqrt(np.sum(window**2))
    level = np.sum(images * window, axis=(-2, -1), keepdims=True) / window.sum()
    return np.asarray(np.fft.fft2((images - level) * window))


def standing_weights(u: Array, downhill: Array) -> Array:
    """Weight of the quadratic prior that a picture (C, H, W) stands with in every band of frequencies, (BANDS,).

    downhill : the data term's gradient, blur's adjoint of the residual, (C, H, W). Where the cost is least it is
    weight times the prior's; iterations that have not come so far leave what a larger weight would, high frequencies
    first.
    """
    steep = diffuse(u)
    return np.maximum(band_powers(steep, downhill) / np.maximum(band_powers(steep), 1e-30), 1e-9)


def gradient_powers(u: Array) -> Array:
    """Mean power of the gradient of a picture (C, H, W) in every band of frequencies, (BANDS,)."""
    return band_powers(np.diff(u, axis=-2)) + band_powers(np.diff(u, axis=-1))


def rings_of(shape: tuple[int, int]) -> NDArray[np.intp]:
    """The band of every frequency; -1 for those of nearly the whole frame, which its rim sets."""
    down, across = (np.fft.fftfreq(n) for n in shape)
    radius = np.hypot(down[:, None], across)
    rings = np.minimum((radius * 2 * BANDS).astype(np.intp), BANDS - 1)
    return np.where(radius < 1.5 / min(*shape, SIZE), -1, rings)


def fitted_by_depth(data: DataTerm, u: Array, weights: PriorWeights, determined: float = 1 / 6) -> float:
    """Degrees of freedom that w takes from the photographs' noise, per pixel and channel.

    data : focused on w; weights : of the priors; determined : part of the curvature over w that counts, as the picture
    takes some and texture is sparse: with this, degrees of freedom agree
    with those of random photographs restored. A random change of w tells the curvature of the data term.
    """
    probe = np.zeros((len(u) + 1, *data.extended), u.dtype)
    probe[-1] = np.random.default_rng(0).choice([-1.0, 1.0], data.extended)
    curvature = determined * float((data.change(u, probe) ** 2).sum(axis=(0, 1)).mean())
    L = laplacian()
    prior = weights.depth * (weights.tilt * L + weights.bend * L**2)
    # where w tells nothing, as in a frame that is sharp all over, there is nothing fitted
    return float(np.mean(curvature / (curvature + prior + 1e-30))) / len(u)


def laplacian() -> Array:
    """The quadratic prior of neighbours' differences, per frequency, (64, 64)."""
    across = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(SIZE))
    return np.asarray(across[:, None] + across[None, :])


def responses(stacks: list[MaskStack], w: float) -> tuple[Array, Array]:
    """Sum of the squared transfer functions of all photographs at one depth, and the Laplacian's, (64, 64)."""
    power = sum(np.abs(np.fft.fft2(s.at(w), (SIZE, SIZE))) ** 2 for s in stacks)
    return np.asarray(power), laplacian()


def noise_gain(stacks: list[MaskStack], w: float, weight: float) -> float:
    """How much the restoration at one w amplifies white noise, standard deviation over standard deviation."""
    S, L = responses(stacks, w)
    return float(np.sqrt(np.mean(S / (S + weight * L + 1e-12) ** 2)))
