"""Expected error of the restored picture, from its residual.

Errors of the masks leave a residual like noise and are treated as noise of that power. The part in which the
photographs contradict each other is observed, and the part in which they agree is assumed equally large and in the
picture.
"""

import math
from collections.abc import Mapping, Sequence
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
RINGS = 11
"""Rings of frequencies, as wide as a band, in which contrast is estimated, up to the corners."""
FALL, KEPT, VARIED, FIRST = -0.4, 0.5, 0.28, 0.5
"""Logarithm of the squared gradient in a ring relative to the ring below, in 39 photographs: its mean, the share of the
ring below's that it keeps, and the standard deviations of the rest, and of the first."""
ALIKE, LOCAL, APART = 0.92, 0.42, 2.0
"""Tiles relative to their frame: share of the ring below's that is kept, deviations of the rest, and of the lowest."""
COSINES, CORRELATED, OVERLAP = (1 / 6, 2 / 3, 1 / 6), 7.6, 2.0
"""Power of a window of cosines at its lowest frequencies; the variance of a mean power under it, relative to that of
independent frequencies, as half are conjugates and neighbours are correlated by 2/3; tiles for each independent one."""
STEPS = 12
"""Steps of scoring towards the largest likelihood."""

Spectra = tuple[Array, ...]
"""Powers, their part passed and the amplified noise, at some frequencies."""


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
    N is estimated for the frame, X for each tile of it and each direction of frequencies, as a ring's resembles that of
    the ring below, with the masks at the tile's w; within a tile, detail is lost as the squared gradient is restored.
    The best weight for N leaves 1 / (S / N + 1 / X).
    """
    rim = stacks[0].R  # determined by part of the light, with less noise
    inside = (..., slice(rim, -rim), slice(rim, -rim))
    across = [np.diff(sharp.astype(np.float64), axis=n, append=sharp.take([-1], axis=n)) for n in (1, 2)]
    slopes = tile_powers(*(each[inside] for each in across))
    count, sectors = len(stacks), sectors_of((SIZE, SIZE))
    rings, narrow = rings_of((SIZE, SIZE)), rings_of((SIZE, SIZE), RINGS)
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
    suppressed, level = weight**2 * L / whole**2, np.abs(w[..., None] - depths).argmin(axis=-1)
    shares = np.stack([slopes.means((level == n)[inside]) for n in range(len(depths))], axis=-1)
    lost, X = np.zeros(steep.shape[:2]), np.zeros_like(L)
    for sector in range(SECTORS):
        places = [(narrow == ring) & (sectors == sector) for ring in range(RINGS)]
        terms = [(steep[..., where], shares @ passed[:, where], shares @ amplified[:, where]) for where in places]
        for where, contrast in zip(places, np.moveaxis(_contrasts(terms), -1, 0), strict=True):
            lost += contrast * (shares @ suppressed[:, where].sum(axis=1))
            X[where] = contrast.mean()
    used = rings >= 0
    of_restored = (suppressed * X)[:, used].sum(axis=1) / ((passed * X + amplified)[:, used].sum(axis=1) + 1e-30)
    S, L, X, noise, whole = S[:, used], L[used], X[used] + 1e-30, noise[used] + 1e-30, whole[:, used]
    each = (max((responses([one], float(w))[0] for one in stacks), key=lambda power: power.mean()) for w in depths)
    best = np.minimum([one[used] for one in each], 1.0)  # of the mask that blurs least
    random = min(1.0, sigma**2 / float(noise.mean()))
    now, then = (np.sum(1 / (S / (part * noise) + L / X)) for part in (1.0, 1 - 0.75 * random))
    local = of_restored[level] * uniform_filter(np.sum(np.square(across), axis=(0, 1)), 2 * rim + 1) + 1e-30
    of_local = slopes.over_frame(lost / used.sum() / slopes.means(local[inside]))
    return PictureError(
        float(np.sqrt(np.mean(noise * S / whole**2))), np.sqrt(np.pad(of_local, rim, mode="edge") * local),
        float(np.sqrt(np.mean(X * (1 - np.sqrt(best)) ** 2 / L))), random, float(np.sqrt(then / now)),
    )  # fmt: skip


def _windowed(spectra: Array) -> Array:
    """Power spectra (..., SIZE, SIZE) as those of images under a window of cosines."""
    return np.asarray(convolve1d(convolve1d(spectra, COSINES, -2, mode="wrap"), COSINES, -1, mode="wrap"))


def _contrasts(terms: Sequence[Spectra]) -> Array:
    """Squared gradient X of the sharp picture in each tile and ring (Y, X, RINGS), from powers of the restored gradient
    (Y, X, n) in every ring, whose expectation is X passed + amplified."""
    tiles = terms[0][0].shape[:2]
    fall = np.diff(np.eye(RINGS), axis=0)
    usual, innovations = np.full(RINGS - 1, (1 - KEPT) * FALL / VARIED), fall / VARIED
    innovations[1:] -= KEPT * fall[:-1] / VARIED
    innovations[0], usual[0] = fall[0] / FIRST, FALL / FIRST
    first = np.log(terms[0][0].mean() + 1e-30) + FALL * np.arange(RINGS)
    means = [tuple(part.mean(axis=(0, 1)) for part in each) for each in terms]
    frame, known = _likeliest(first, innovations, usual, means, math.prod(tiles) / OVERLAP / CORRELATED)
    local = (np.eye(RINGS) - ALIKE * np.eye(RINGS, k=-1)) / LOCAL
    local[0] *= LOCAL / APART
    start = np.broadcast_to(frame, (*tiles, RINGS))
    each, spread = _likeliest(start, local, local @ frame, terms, 1 / CORRELATED)
    X = np.exp(each + spread / 2)
    return np.asarray(X * np.exp(frame + known / 2) / (X.mean(axis=(0, 1)) + 1e-30))


def _likeliest(
    log: Array, prior: Array, expected: Array, terms: Sequence[Spectra], weight: float
) -> tuple[Array, Array]:
    """Logarithms of X (..., RINGS) of the largest posterior density, from a start, and their variances.

    terms : for each ring powers (..., n), exponentially distributed about X passed + amplified; weight : independent
    powers for each; prior : its products with the logarithms are independent about `expected`, of unit variance.
    """
    for _ in range(STEPS):
        score, information = np.zeros(log.shape), np.zeros(log.shape)
        for ring, (powers, passed, amplified) in enumerate(terms):
            part = np.exp(log[..., ring, None]) * passed
            mean = part + amplified + 1e-30
            score[..., ring] = np.sum(part / mean * (powers / mean - 1), axis=-1)
            information[..., ring] = np.sum((part / mean) ** 2, axis=-1)
        curvature = prior.T @ prior + weight * information[..., None] * np.eye(RINGS)
        downhill = weight * score - (log @ prior.T - expected) @ prior
        log = log + np.clip(np.linalg.solve(curvature, downhill[..., None])[..., 0], -1, 1)
    return log, np.diagonal(np.linalg.inv(curvature), axis1=-2, axis2=-1)


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
