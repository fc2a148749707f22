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
    DECILES,
    SECTORS,
    SIZE,
    laplacian,
    responses,
    rings_of,
    sectors_of,
    separated,
    tile_powers,
)
from procedures.restoration.masks.blur_operator import Array, MaskStack

WINDOW = 15
"""Side of the places in which residual, texture and light are compared, pixels."""
SMOOTH = 0.25
"""Texture of the smoothest tenth of places, relative to the mean, up to which noise and mask errors can be
separated."""

NOISE, MISMATCH, DETAIL = "noise", "shapes", "detail"
"""Terms of the budget."""


FALLS, VARIED, LEAST = 0.78, 0.5, 0.03
"""Squared gradient in a band relative to that in the band below: its mean over 22 photographs, its relative standard
deviation in a tile or frame, and its smallest value."""
COSINES, CORRELATED, OVERLAP = (1 / 6, 2 / 3, 1 / 6), 7.6, 2.0
"""Power of a window of cosines at its lowest frequencies; the variance of a mean power under it, relative to that of
independent frequencies, as half are conjugates and neighbours are correlated by 2/3; tiles for each independent one."""
STEPS = 8
"""Steps of scoring towards the largest likelihood."""


@dataclass(frozen=True, eq=False)
class PictureError:
    """Root mean squares, white = 1.

    noise : expected error of the restored picture due to amplified noise with mask errors; lost : (H, W) that due to
    the prior, larger where there is texture; blurred : error of the least blurred photograph; random : share of the
    photographs' noise in the power of the first, the rest is disagreement of masks and photographs; gain : error with
    four times the light over that now.
    """

    noise: float
    lost: Array
    blurred: float
    random: float
    gain: float

    @property
    def std(self) -> float:
        """Expected error of the picture over the frame."""
        return float(np.sqrt(self.noise**2 + np.mean(self.lost**2)))

    @property
    def budget(self) -> Mapping[str, float]:
        """Independent parts: amplified noise, disagreement of masks and photographs, detail suppressed by the prior."""
        lost = float(np.sqrt(np.mean(self.lost**2)))
        return {NOISE: self.noise * self.random**0.5, MISMATCH: self.noise * (1 - self.random) ** 0.5, DETAIL: lost}

    @property
    def brighter(self) -> float:
        """The expected error with four times the light."""
        return self.gain * self.std


def picture_error(
    stacks: list[MaskStack], w: Array, weights: Array, residual: Array, sharp: Array, sigma: float,
    fitted: float = 0.0, *, as_restored: bool = False,
) -> PictureError:  # fmt: skip
    """The expected error of a picture (C, H, W) with the given `residual` (P, C, H, W).

    w : (H, W) depth; weights : effective weights of the prior in every band, see
    `effective_weights`; sigma : noise of the photographs, what exceeds it is a disagreement; fitted : noise fitted by
    the depth; as_restored : X is that of the restored picture, for estimated masks, which share a part with the picture
    and make it too sharp.

    Where masks pass S = sum |H|^2 and the prior is L, the picture errs by (S N + (weight L)^2 X) / (S + weight L)^2: N
    the power of one photograph's residual from masks and noise, X that of the picture. The residual holds P - 1 of P
    parts of N and a part suppressed by the prior, the restored picture the rest of X and amplified noise (`separated`).
    N is estimated for the frame, X for each tile of it and each direction of frequencies, as a band's resembles that of
    the band below, with the masks at the tile's w. The best weight for N leaves 1 / (S / N + 1 / X).
    """
    rim = stacks[0].R  # determined by part of the light, with less noise
    inside = (..., slice(rim, -rim), slice(rim, -rim))
    slopes = tile_powers(*(np.diff(sharp, axis=n, append=sharp.take([-1], axis=n))[inside] for n in (1, 2)))
    rings, sectors, count = rings_of((SIZE, SIZE)), sectors_of((SIZE, SIZE)), len(stacks)
    depths = np.quantile(w, DECILES)
    S, L = np.stack([responses(stacks, float(depth))[0] for depth in depths]), laplacian()
    noises, left, steep = np.zeros(BANDS), tile_powers(residual[inside]).powers, slopes.powers
    for band in range(BANDS):
        powers = (float(part[..., rings == band].mean()) for part in (count * left, steep))
        parts = [(s[rings == band], L[rings == band]) for s in S]
        noises[band], _ = separated(parts, weights[band], count, fitted, *powers, fixed=as_restored)
    noise, weight = noises[rings], weights[rings]
    whole = S + weight * L + 1e-12
    passed, amplified = _windowed((S / whole) ** 2), _windowed(noise * S * L / whole**2)
    if as_restored:
        passed, amplified = np.ones_like(S), np.zeros_like(S)
    suppressed, nearest = weight**2 * L / whole**2, slopes.nearest(w[inside], depths)
    lost, X = np.zeros(steep.shape[:2]), np.zeros_like(L)
    for sector in range(SECTORS):
        contrast = steep[..., (rings == 0) & (sectors == sector)].mean(axis=-1)
        for band in range(BANDS):
            where = (rings == band) & (sectors == sector)
            contrast = _contrasts(contrast, steep[..., where], passed[:, where][nearest], amplified[:, where][nearest])
            lost += contrast * suppressed[:, where].sum(axis=1)[nearest]
            X[where] = contrast.mean()
    used = rings >= 0
    S, L, X, noise, whole = S[:, used], L[used], X[used] + 1e-30, noise[used] + 1e-30, whole[:, used]
    best = np.stack([_of_best(stacks, float(depth))[used] for depth in depths])
    random = min(1.0, sigma**2 / float(noise.mean()))
    now, then = (np.sum(1 / (S / (part * noise) + L / X)) for part in (1.0, 1 - 0.75 * random))
    lost = np.pad(np.sqrt(slopes.over_frame(lost / used.sum())), rim, mode="edge")
    return PictureError(
        float(np.sqrt(np.mean(noise * S / whole**2))), lost,
        float(np.sqrt(np.mean(X * (1 - np.sqrt(best)) ** 2 / L))), random, float(np.sqrt(then / now)),
    )  # fmt: skip


def _windowed(spectra: Array) -> Array:
    """Power spectra (..., SIZE, SIZE) as those of images under a window of cosines."""
    return np.asarray(convolve1d(convolve1d(spectra, COSINES, -2, mode="wrap"), COSINES, -1, mode="wrap"))


def _contrasts(below: Array, powers: Array, passed: Array, amplified: Array) -> Array:
    """Squared gradient of the sharp picture in each tile (Y, X) at some frequencies, from powers of the restored
    gradient (Y, X, n), whose expectation is X passed + amplified; below : that of the band below."""
    usual = FALLS * below.mean() + 1e-30
    frame = _likeliest(usual, powers.ravel(), passed.ravel(), amplified.ravel(), OVERLAP)
    tiles = _likeliest(FALLS * below * (frame / usual), powers, passed, amplified, 1.0)
    return np.asarray(tiles * (frame / (tiles.mean() + 1e-30)))


def _likeliest(expected: Array, powers: Array, passed: Array, amplified: Array, overlap: float) -> Array:
    """X of the largest likelihood of powers (..., n), which are exponentially distributed about X passed + amplified,
    drawn to an expected X (...) by the variances of both."""
    X = expected
    for _ in range(STEPS):
        mean = X[..., None] * passed + amplified + 1e-30
        share = passed / mean**2
        information = np.sum(share * passed, axis=-1) + 1e-30
        likely = X + np.sum(share * (powers - mean), axis=-1) / information
        known = 1 / (1 + CORRELATED * overlap / information / ((VARIED * expected) ** 2 + 1e-30))
        X = np.maximum(expected + known * (likely - expected), LEAST * expected)
    return np.asarray(X)


def _of_best(stacks: list[MaskStack], w: float) -> Array:
    """Squared transfer function of the mask that blurs least."""
    each = [responses([stack], w)[0] for stack in stacks]
    return np.minimum(max(each, key=lambda one: float(one.mean())), 1.0)


def error_map(error: PictureError, residual: Array, window: int) -> Array:
    """The picture's expected error at every pixel, (H, W): its part by noise is distributed as the local residual."""
    power = uniform_filter((residual.astype(np.float64) ** 2).mean(axis=(0, 1)), window, mode="reflect")
    return np.asarray(np.sqrt(error.noise**2 * power / max(float(power.mean()), 1e-30) + error.lost**2))


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
