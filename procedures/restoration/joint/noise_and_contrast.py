"""Noise and contrast of the sharp picture, estimated from a restored picture and its residual.

They determine the weight of the picture's prior: lambda_u = sigma^2 / G, G the mean squared gradient, both at the
frequencies where the weight decides between them.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft2, rfft2
from scipy.ndimage import map_coordinates

from procedures.outcome import Refused
from procedures.restoration.joint.data_term import DataTerm
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.joint.priors import diffuse
from procedures.restoration.masks.array_loops import most_threads
from procedures.restoration.masks.blur_operator import Array, MaskStack

DECILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles at the centres of five equal parts of the distribution of w."""
SIZE = 64
"""Frequencies along each axis at which transfer functions are averaged; larger than the masks."""
DETERMINED = 1 / 6
"""Fraction of the curvature over w that counts, as the picture takes some and texture is sparse: with this value, the
degrees of freedom agree with those of restored random photographs."""
BANDS = 8
"""Rings of frequencies in which noise and contrast are separated: both may fall by a factor of a hundred over them."""


@dataclass(frozen=True)
class Moments:
    """Variances, white = 1.

    noise : of the photographs, over all frequencies; deciding, contrast : of the noise, and the mean squared gradient
    of the sharp picture, both at the frequencies where the prior's weight decides: their ratio is the weight of the
    smallest expected error.
    """

    noise: float
    deciding: float
    contrast: float


def moments(
    stacks: list[MaskStack], depths: Array, weights: Array, residual: Array, gradient: Array, fitted: float = 0.0,
    least_noise: float = 1e-5,
) -> Moments:  # fmt: skip
    """Noise and contrast estimated from a restoration.

    depths : w of equal parts of the frame; weights : effective weights of the quadratic prior in every band, see
    `effective_weights`; left, gradient : powers of one photograph's residual, and of the restored picture's gradient,
    in every band, see `band_powers`; fitted : noise fitted by the depth, see `depth_freedom`; least_noise : smallest
    standard deviation, of 16-bit photographs.

    Where masks pass S = sum |H|^2 and the prior is L, the residual holds noise and the part of the picture suppressed
    by the prior, the gradient the rest of it and amplified noise; both are linear in the band's noise N and squared
    gradient g. Noise of real photographs is not white: inaccurate masks leave noise correlated with the picture,
    samples are interpolated, and lenses suppress high frequencies. The expected error of a picture restored with weight
    l, sum (lL)^2 P + S N over (S + lL)^2 with g = L P, is smallest for l = sum V N / sum V g, V = S L / (S + lL)^3.
    """
    parts = [responses(stacks, float(w)) for w in depths]
    L, rings = parts[0][1], rings_of((SIZE, SIZE))
    noise, slopes = np.zeros((2, BANDS))
    for band in range(BANDS):
        noise[band], slopes[band] = separated(
            [(S[rings == band], L[rings == band]) for S, _ in parts],
            weights[band], len(stacks), fitted, len(stacks) * residual[band], gradient[band],
        )  # fmt: skip
    noise = np.maximum(noise, least_noise**2)
    weight = float(np.median(weights))
    for _ in range(20):
        deciding = np.mean([S * L / (S + weight * L + 1e-12) ** 3 for S, _ in parts], axis=0)
        share = np.array([deciding[rings == band].sum() for band in range(BANDS)])
        share /= share.sum()
        variance, contrast = float(share @ noise), max(float(share @ slopes), 0.1 * float(share @ gradient), 1e-8)
        weight = variance / contrast
    return Moments(float(noise[rings[rings >= 0]].mean()), variance, contrast)


def separated(
    parts: list[tuple[Array, Array]], weight: float, count: int, fitted: float, residual: float, gradient: float,
    *, fixed: bool = False,
) -> tuple[float, float]:  # fmt: skip
    """Noise and squared gradient of a band, from residual and restored gradient; parts : S and L here, by part of the
    frame; fixed : the squared gradient is the restored one, and all of the residual noise."""
    S, L = (np.concatenate(spectra) for spectra in zip(*parts, strict=True))
    kept, lost = S / (S + weight * L + 1e-12), weight * L / (S + weight * L + 1e-12)
    free = max(count - 1 + float(np.mean(lost**2)) - fitted, 0.2)
    if fixed:
        return residual / free, gradient
    system = np.array(
        [
            [free, np.mean(kept * lost) * weight],
            [np.mean(L * kept / (S + weight * L + 1e-12)), np.mean(kept**2) + 1e-12],
        ]
    )
    noise, slopes = np.linalg.solve(system, np.array([residual, gradient]))
    # a wrong depth leaves a residual outside this model
    return max(float(noise), 0.1 * residual / free), max(float(slopes), 0.0)


def band_powers(images: Array, others: Array | None = None) -> Array:
    """Mean power of images (..., H, W) in every band of frequencies, (BANDS,), or cross power with others. Raises
    Refused if they are too small for frequencies in every band."""
    H, W = images.shape[-2:]
    spectra = rfft2(_windowed(images), workers=most_threads())
    other = spectra if others is None else rfft2(_windowed(others), workers=most_threads())
    mean = (spectra.real * other.real + spectra.imag * other.imag).reshape(-1, H, W // 2 + 1).mean(axis=0)
    twice = np.full(mean.shape, 2.0)  # the spectrum of a real image is symmetric
    twice[:, 0] = twice[:, W // 2 + W % 2 :] = 1.0
    ring = rings_of((H, W))[:, : W // 2 + 1].ravel() + 1
    power, count = (np.bincount(ring, of.ravel(), BANDS + 1)[1:] for of in (twice * mean, twice))
    if not count.all():
        reason = f"a picture of {W} x {H} pixels has no frequencies in one of {BANDS} bands"
        raise Refused(reason, "give larger photographs")
    return np.asarray(power / count)


def _windowed(images: Array) -> Array:
    """Images (..., H, W) without their mean, under a window of mean square 1 / (H W)."""
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in images.shape[-2:]))
    window /= np.sqrt(np.sum(window**2))
    level = np.sum(images * window, axis=(-2, -1), keepdims=True) / window.sum()
    return np.asarray((images - level) * window)


SECTORS = 4
"""Directions of frequencies in which a picture's contrast is distinguished: across, down, and both diagonals."""


@dataclass(frozen=True, eq=False)
class TilePowers:
    """Power of images at every frequency, (Y, X, SIZE, SIZE), of tiles of a frame (H, W) at `centres`."""

    powers: NDArray[np.float32]
    centres: tuple[NDArray[np.intp], NDArray[np.intp]]
    frame: tuple[int, int]

    def over_frame(self, values: Array) -> Array:
        """Values of the tiles (Y, X), interpolated over the frame, (H, W)."""
        at = [np.interp(np.arange(n), c, np.arange(len(c))) for n, c in zip(self.frame, self.centres, strict=True)]
        return np.asarray(map_coordinates(values, np.meshgrid(*at, indexing="ij"), order=1))

    def means(self, image: Array) -> Array:
        """Mean of an image (H, W) over each tile, weighted as its power is, (Y, X)."""
        along, wide = np.hanning(SIZE + 2)[1:-1] ** 2, _whole_tiles(image)
        (rows, columns), weights = (c - SIZE // 2 for c in self.centres), np.outer(along, along) / along.sum() ** 2
        tiles = [[wide[y : y + SIZE, x : x + SIZE] for x in columns] for y in rows]
        return np.array([[np.sum(weights * tile) for tile in row] for row in tiles])


def _whole_tiles(image: Array) -> Array:
    """An image (..., H, W), mirrored if it is smaller than a tile."""
    missing = [(0, max(SIZE - n, 0)) for n in image.shape[-2:]]
    return np.pad(image, [(0, 0)] * (image.ndim - 2) + missing, mode="symmetric")


def tile_powers(*images: Array) -> TilePowers:
    """Sum of the powers of images (..., H, W), over overlapping tiles. Tiles that reach beyond the frame would need
    mirrored images, whose frequencies have other directions."""
    frame = (images[0].shape[-2], images[0].shape[-1])
    spare = [max(n - SIZE, 0) for n in frame]
    starts = [np.linspace(0, n, 1 + -(-2 * n // SIZE)).astype(np.intp) for n in spare]
    powers = np.zeros((len(starts[0]), len(starts[1]), SIZE, SIZE), np.float32)
    for image in images:
        wide = _whole_tiles(image.astype(np.float64))
        for (i, y), (j, x) in product(*(enumerate(along) for along in starts)):
            spectra = np.abs(fft2(_windowed(wide[..., y : y + SIZE, x : x + SIZE]), workers=most_threads())) ** 2
            powers[i, j] += spectra.reshape(-1, SIZE, SIZE).mean(axis=0)
    return TilePowers(powers, (starts[0] + SIZE // 2, starts[1] + SIZE // 2), frame)


def effective_weights(u: Array, downhill: Array) -> Array:
    """Effective prior weight of a picture in every band (BANDS,): the data term's gradient `downhill` over the prior's;
    larger for incomplete iterations, first at high frequencies."""
    steep = diffuse(u)
    return np.maximum(band_powers(steep, downhill) / np.maximum(band_powers(steep), 1e-30), 1e-9)


def gradient_powers(u: Array) -> Array:
    """Mean power of the gradient of a picture (C, H, W) in every band of frequencies, (BANDS,)."""
    return band_powers(np.diff(u, axis=-2)) + band_powers(np.diff(u, axis=-1))


@cache
def rings_of(shape: tuple[int, int], count: int = BANDS) -> NDArray[np.intp]:
    """The ring of every frequency, one of a `count` as wide as a band, the last to the corners; -1 for the lowest ones,
    which depend on the frame's rim."""
    down, across = (np.fft.fftfreq(n) for n in shape)
    radius = np.hypot(down[:, None], across)
    rings = np.minimum((radius * 2 * BANDS).astype(np.intp), count - 1)
    return np.where(radius < 1.5 / min(*shape, SIZE), -1, rings)


def sectors_of(shape: tuple[int, int]) -> NDArray[np.intp]:
    """The direction of every frequency, one of `SECTORS`."""
    down, across = (np.fft.fftfreq(n) for n in shape)
    direction = np.arctan2(down[:, None], across[None]) / np.pi * SECTORS
    return np.asarray(np.round(direction).astype(np.intp) % SECTORS)


def depth_freedom(data: DataTerm, u: Array, weights: PriorWeights) -> float:
    """Degrees of freedom that w takes from the noise, per pixel and channel, for a data term focused on w and prior
    weights."""
    probe = np.zeros((len(u) + 1, *data.extended), u.dtype)
    probe[-1] = np.random.default_rng(0).choice([-1.0, 1.0], data.extended)
    curvature = DETERMINED * float((data.change(u, probe) ** 2).sum(axis=(0, 1)).mean())
    L = laplacian()
    prior = weights.depth * (weights.tilt * L + weights.bend * L**2)
    # where w is undetermined, as in a frame that is sharp all over, nothing is fitted
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
    """Noise gain of the restoration at one w, as a ratio of standard deviations of white noise."""
    S, L = responses(stacks, w)
    return float(np.sqrt(np.mean(S / (S + weight * L + 1e-12) ** 2)))
