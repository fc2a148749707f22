"""Expected error of the restored picture, from its residual.

Errors of the masks leave a residual like noise and are treated as noise of that power. The part in which the
photographs contradict each other is observed, and the part in which they agree is assumed equally large and in the
picture.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, uniform_filter
from scipy.optimize import nnls

from procedures.restoration.joint.noise_and_contrast import (
    BANDS,
    SIZE,
    band_powers,
    gradient_powers,
    responses,
    rings_of,
    separated,
)
from procedures.restoration.masks.blur_operator import Array, MaskStack

WINDOW = 15
"""Side of the places in which residual, texture and light are compared, pixels."""
SMOOTH = 0.25
"""Texture of the smoothest tenth of places, relative to the mean, up to which noise and mask errors can be
separated."""

NOISE, MISMATCH, DETAIL = "noise", "shapes", "detail"
"""Terms of the budget."""


@dataclass(frozen=True)
class PictureError:
    """Root mean squares, white = 1.

    std : expected error of the restored picture; budget : its independent parts, amplified noise, disagreement of masks
    and photographs, and detail suppressed by the prior; brighter : the error with four times the light; blurred : error
    of the least blurred photograph.
    """

    std: float
    budget: Mapping[str, float]
    brighter: float
    blurred: float


def picture_error(
    stacks: list[MaskStack], depths: Array, weights: Array, residual: Array, sharp: Array, sigma: float,
    fitted: float = 0.0, *, as_restored: bool = False,
) -> PictureError:  # fmt: skip
    """The expected error of a picture (C, H, W) with the given `residual` (P, C, H, W).

    depths : w of equal parts of the frame; weights : effective weights of the prior in every band, see
    `effective_weights`; sigma : noise of the photographs, what exceeds it is a disagreement; fitted : noise fitted by
    the depth; as_restored : X is that of the restored picture, for estimated masks, which share a part with the picture
    and make it too sharp.

    Where masks pass S = sum |H|^2 and the prior is L, the picture errs by (S N + (weight L)^2 X) / (S + weight L)^2: N
    the power of one photograph's residual from masks and noise, X that of the picture. The residual holds P - 1 of P
    parts of N and a part suppressed by the prior, the restored picture the rest of X and amplified noise (`separated`).
    The best weight for N leaves N / (S + N / X).
    """
    power, slopes = band_powers(residual.astype(np.float64)), gradient_powers(sharp.astype(np.float64))
    rings, count = rings_of((SIZE, SIZE)), len(stacks)
    inside = rings >= 0
    bands = rings[inside]
    each = [(S[inside], L[inside], responses_of_best(stacks, float(w))[inside])
            for w in depths for S, L in [responses(stacks, float(w))]]  # fmt: skip
    N, contrast = np.array([
        separated([(S[bands == i], L[bands == i]) for S, L, _ in each], weights[i], count, fitted, count * power[i],
                  slopes[i], fixed=as_restored)
        for i in range(BANDS)
    ]).T[:, bands]  # fmt: skip
    random = min(1.0, sigma**2 / max(float(N.mean()), 1e-30))
    less, parts = N * (1 - 0.75 * random), np.zeros(5)
    for S, L, best in each:
        X, soft = contrast / L + 1e-30, weights[bands] * L
        damped = S + soft + 1e-12
        terms = N * S / damped**2, X * (soft / damped) ** 2, X * (1 - np.sqrt(best)) ** 2
        parts += [term.mean() / len(each) for term in (*terms, N / (S + N / X), less / (S + less / X))]
    amplified, lost, blurred, now, then = (float(part) for part in parts)
    std = float(np.sqrt(amplified + lost))
    budget = {NOISE: amplified * random, MISMATCH: amplified * (1 - random), DETAIL: lost}
    return PictureError(
        std, {term: part**0.5 for term, part in budget.items()}, std * (then / max(now, 1e-30)) ** 0.5, blurred**0.5
    )


def responses_of_best(stacks: list[MaskStack], w: float) -> Array:
    """Squared transfer function of the mask that blurs least."""
    each = [responses([stack], w)[0] for stack in stacks]
    return np.minimum(max(each, key=lambda one: float(one.mean())), 1.0)


def error_map(std: float, residual: Array, window: int) -> Array:
    """The picture's expected error at every pixel, (H, W), distributed as the local residual."""
    power = uniform_filter((residual.astype(np.float64) ** 2).mean(axis=(0, 1)), window, mode="reflect")
    return np.asarray(std * np.sqrt(power / max(float(power.mean()), 1e-30)))


def noise_upper_bound(z: Array) -> float:
    """Upper bound of any photograph's white noise, from it alone: upper quartile (dark ground may be clipped) of second
    differences along both axes (Immerkaer 1996)."""
    bend = np.array([1.0, -2.0, 1.0])
    rough = np.abs(convolve1d(convolve1d(z, bend, axis=-2), bend, axis=-1)) / 6
    quartile = np.percentile(rough.reshape(len(z), -1), 75, axis=1)
    return float(quartile.max() / 1.150)


def residual_noise(z: Array, residual: Array, sharp: Array, R: int) -> float:
    """Standard deviation of photographs' noise (P, C, H, W), white or not, from the residual of a picture.

    Noise of processed photographs exceeds that at their highest frequencies; it is estimated from the residual where
    there is no texture, which holds P - 1 of P parts of it.

    z, residual : (P, C, H, W); sharp : (C, H, W); R : half-size of the masks. Noise grows with light, errors of the
    masks with texture within their reach: local variances are regressed on both. 0 where no place is smooth.
    """
    wide = 2 * R + 1
    down, across = np.gradient(sharp.astype(np.float64), axis=(-2, -1))
    steep = (down**2 + across**2).mean(axis=0)
    maps = (z.mean(axis=(0, 1)), uniform_filter(steep, wide), (residual.astype(np.float64) ** 2).mean(axis=(0, 1)))
    step = slice(R, -R or None, WINDOW // 2)
    light, texture, power = (uniform_filter(image, WINDOW)[step, step].ravel() for image in maps)
    if np.percentile(texture, 10) > SMOOTH * texture.mean() or texture.size < 30:
        return 0.0
    design = np.column_stack([np.ones_like(light), light.clip(0), texture / texture.mean()])
    coefficients, trust = np.zeros(3), 1 / np.maximum(power, 1e-3 * power.mean() + 1e-30)
    for _ in range(4):
        coefficients = nnls(design * trust[:, None], power * trust)[0]
        trust = 1 / np.maximum(design @ coefficients, 1e-3 * power.mean() + 1e-30)
    return float(np.sqrt(np.mean(design[:, :2] @ coefficients[:2]))) * float(np.sqrt(len(z) / (len(z) - 1)))
