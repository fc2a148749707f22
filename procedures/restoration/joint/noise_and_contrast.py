"""What a restored picture and its residual say of the noise and of the sharp picture's contrast.

Both are what the weight of the picture's prior is made of: lambda_u = sigma^2 / G, G the mean squared gradient.
"""

from __future__ import annotations

import numpy as np

from procedures.restoration.joint.data_term import DataTerm
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.masks.blur_operator import Array, MaskStack

SIZE = 64
"""Frequencies along each axis at which transfer functions are averaged; masks are smaller."""


def moments(
    stacks: list[MaskStack],
    w: float,
    weight: float,
    residual: float,
    gradient: float,
    fitted: float = 0.0,
    least_noise: float = 1e-5,
) -> tuple[float, float]:
    """Noise sigma^2 and mean squared gradient G of the sharp picture, from those of a restoration at depth w.

    residual : mean square of one photograph's residual; gradient : mean over pixels of |grad u|^2 of the restored
    picture; weight : of its quadratic prior; fitted : noise fitted by the depth, see `fitted_by_depth`; least_noise :
    standard deviation under which no photograph of 16 bits is. Where masks
    pass S = sum |H|^2 and the prior is L, the residual holds noise and what the prior took from the picture, the
    gradient the rest of it and noise amplified; both are linear in sigma^2 and G.
    """
    S, L = responses(stacks, w)
    kept, taken = S / (S + weight * L + 1e-12), weight * L / (S + weight * L + 1e-12)
    count = len(stacks)
    system = np.array(
        [
            [max(count - 1 + np.mean(taken**2) - fitted, 0.2), np.mean(kept * taken) * weight],
            [np.mean(L * kept / (S + weight * L + 1e-12)), np.mean(kept**2)],
        ]
    )
    noise, contrast = np.linalg.solve(system, [count * residual, gradient])
    # a depth that is still wrong leaves more than this model knows of
    least = 0.1 * count * residual / system[0, 0]
    return max(float(noise), least, least_noise**2), max(float(contrast), 0.2 * gradient, 1e-8)


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
    return float(np.mean(curvature / (curvature + prior))) / len(u)


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


def picture_uncertainty(stacks: list[MaskStack], w: float, weight: float, noise: float) -> float:
    """Standard deviation of the sharp picture restored at one w, at least: what noise makes, and what its prior takes.

    The posterior variance noise^2 / (S + weight L) of every frequency, averaged. `noise` is that of the photographs
    with what wrong masks leave over: these raise it, but what they bend in the picture alike is not seen.
    """
    S, L = responses(stacks, w)
    return float(noise * np.sqrt(np.mean(1 / (S + weight * L + 1e-12))))
