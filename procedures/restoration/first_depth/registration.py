"""Registration of photographs with different masks: shift, rotation, zoom and light beyond the masks are corrected.

At the true depth w and shift d, z1 * h2 moved by d equals z2 * h1 for any masks. The shift minimises the violation of
this relation with whitened noise: one correlation for every depth, in tiles with independent depths.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter, minimum_filter, shift
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.first_depth.similarity import Similarity, rotate_back, similarity
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.checks import check_shift
from procedures.restoration.masks.mask_fields import MaskField, Masks

LEVEL_PX = 0.3
"""Step of w between the depths at which a shift is estimated, pixels."""
MOST_TILES = 16
"""Maximum number of parts of the frame, those with most texture."""
LEAST_GAIN, LEAST_SHIFT_PX = 0.04, 0.2
"""Fraction of the residual that a significant shift must remove, and its smallest length; depth levels 0.3 pixels apart
cause smaller ones where blurs are not centred."""
LEAST_LIGHT, MOST_LIGHT, ANY_LIGHT = 0.01, 0.3, 4.0
"""Difference of light above which it is corrected; up to which it is corrected in any case; and the largest factor that
is corrected where the photographs otherwise agree."""
AGREE, BENT = 0.3, 2.0
"""Residual over contrast, after a factor, up to which photographs agree; and that residual over the residual after a
curve, above which light is not proportional: 1.0 for linear photographs, 2.6 and more for a gamma of 1.1 and for black
levels that differ by 5 % of white."""
LIGHT_LEVELS, LIGHT_PART_PX = 9, 512
"""Number of depths at which light is compared, and side of the frame's central part used for it."""


@dataclass(frozen=True)
class Displacement:
    """Shift (x, y) of photograph 2, pixels, and the fraction of the disagreement that it explains."""

    x: float
    y: float
    gain: float

    def significant(self) -> bool:
        """Whether the shift is significant."""
        return self.gain > LEAST_GAIN and bool(np.hypot(self.x, self.y) > LEAST_SHIFT_PX)


def displacement(z: Array, stacks: Sequence[Masks]) -> Displacement:
    """Shift of photograph z[1] relative to z[0] beyond the masks. z : (2, C, H, W)."""
    return _common([cost for cost, _ in _costs(z, stacks)])


Costs = list[tuple[Array, tuple[float, float]]]
"""Residuals of a part of the frame for every shift, and the position of its centre."""


def _costs(z: Array, stacks: Sequence[Masks]) -> Costs:
    grey = z.mean(axis=1)
    # smooth structure determines no shift, and the tiles' windows would mistake its slope for one
    tiles = _tiles(grey - gaussian_filter(grey, (0, stacks[0].R / 2, stacks[0].R / 2)), stacks[0].R)
    fields = [MaskField.of(stack) for stack in stacks]
    return [(_tile_cost(tile, [field.near(*place) for field in fields]), place) for tile, place in tiles]


def _common(costs: Sequence[Array]) -> Displacement:
    cost = np.sum(costs, axis=0)
    size = np.array(cost.shape)
    middle = size // 2
    place = np.array(np.unravel_index(cost.argmin(), cost.shape)).clip(1, size - 2)
    (dy, dx), deeper = _valley(cost[place[0] - 1 : place[0] + 2, place[1] - 1 : place[1] + 2])
    y, x = place + np.array([dy, dx]) - middle
    least = cost[tuple(place)] - deeper
    return Displacement(float(x), float(y), float(1 - least / max(cost[tuple(middle)], 1e-30)))


def _tiles(grey: Array, R: int) -> list[tuple[Array, tuple[float, float]]]:
    """Windowed, half overlapping parts (2, n, n) with most texture, and the positions of their centres as fractions."""
    n = min(*grey.shape[1:], max(96, 8 * R))
    hann = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    starts = [np.linspace(0, size - n, max(1, round(2 * size / n) - 1)).astype(int) for size in grey.shape[1:]]
    height, width = grey.shape[1:]
    parts = [
        (grey[:, y : y + n, x : x + n], ((y + n / 2) / height, (x + n / 2) / width))
        for y in starts[0]
        for x in starts[1]
    ]
    parts = sorted(parts, key=lambda part: -float(part[0].var()))[:MOST_TILES]
    window = np.outer(hann, hann)
    return [((part - part.mean(axis=(1, 2), keepdims=True)) * window, place) for part, place in parts]


def _tile_cost(tile: Array, stacks: list[MaskStack]) -> Array:
    """Residual of the relation in a tile for every shift, at the best depth; shift 0 in the middle."""
    R = stacks[0].R
    size = next_fast_len(tile.shape[1] + 2 * R, True)
    one, two = rfft2(tile, (size, size))
    least: Array | None = None
    for w in np.arange(LEVEL_PX, min(stack.max_w for stack in stacks), LEVEL_PX):
        h1, h2 = (rfft2(stack.at(float(w)), (size, size)) for stack in stacks)
        a, b = one * h2, two * h1
        noise = np.abs(h1) ** 2 + np.abs(h2) ** 2 + 1e-3
        energy = irfft2((np.abs(a) ** 2 + np.abs(b) ** 2) / noise, (size, size))[0, 0]
        residual = energy - 2 * irfft2(np.conj(a) * b / noise, (size, size))
        least = residual if least is None else np.minimum(least, residual)
    assert least is not None
    return np.asarray(np.fft.fftshift(least))


def _valley(cost: Array) -> tuple[Array, float]:
    """Minimum (y, x) of the paraboloid through costs (3, 3), and its depth below the centre; it may be oblique, so the
    mixed term counts."""
    slope = np.array([cost[2, 1] - cost[0, 1], cost[1, 2] - cost[1, 0]]) / 2
    mixed = (cost[2, 2] - cost[2, 0] - cost[0, 2] + cost[0, 0]) / 4
    down, across = cost[2, 1] + cost[0, 1] - 2 * cost[1, 1], cost[1, 2] + cost[1, 0] - 2 * cost[1, 1]
    bend = np.array([[down, mixed], [mixed, across]])
    if down <= 0 or across <= 0 or np.linalg.det(bend) <= 0:
        return np.zeros(2), 0.0
    at = np.clip(-np.linalg.solve(bend, slope), -0.75, 0.75)
    return at, -float(slope @ at + at @ bend @ at / 2)


@dataclass(frozen=True)
class PhotographRegistration:
    """Photographs (P, C, H, W) and trust (P, 1, H, W) registered to the first, and the corrections.

    shifts : (P, 2) x, y relative to the first, pixels; light : (P,) relative to the first; turns, zooms : (P,) radians
    from x to y, and ratio of size.
    """

    z: Array
    trust: Array
    shifts: Array
    light: Array
    turns: Array
    zooms: Array


def register(z: Array, trust: Array, stacks: Sequence[Masks]) -> PhotographRegistration:
    """Register photographs to the first, and correct rotation, zoom, shift and light.

    z : (P, C, H, W); trust : (P, 1, H, W).

    Raises Refused if a photograph is shifted by more than the masks can hold.
    """
    z, trust = z.copy(), trust.copy()
    shifts, light = np.zeros((len(z), 2)), np.ones(len(z))
    turns, zooms = np.zeros(len(z)), np.ones(len(z))
    for n in range(1, len(z)):
        pair = [stacks[0], stacks[n]]
        costs = _costs(z[[0, n]], pair)
        rotation = _similarity(costs, z.shape[2:])
        if rotation.significant:
            z[n], trust[n] = rotate_back(z[n], trust[n], rotation)
            turns[n], zooms[n] = rotation.turn, rotation.zoom
            costs = _costs(z[[0, n]], pair)
        common = _common([cost for cost, _ in costs])
        if common.significant():
            check_shift(n + 1, common.x, common.y, pair[0].R)
            # the tiles showed different parts of the scene; the resulting error is estimated after the correction
            rest = displacement(np.stack([z[0], shift_back(z[n], trust[n], common.x, common.y)[0]]), pair)
            shifts[n] = common.x + rest.x, common.y + rest.y
            z[n], trust[n] = shift_back(z[n], trust[n], *shifts[n])
        more = relative_light(z[[0, n]], pair, trust[[0, n]])
        check_tone(n + 1, more)
        if more.significant():
            light[n] = more.factor
            z[n] /= more.factor
    return PhotographRegistration(z, trust, shifts, light, turns, zooms)


def similarities(z: Array, stacks: Sequence[Masks]) -> list[Similarity]:
    """Rotation and zoom of each of the photographs (P, C, H, W) after the first, relative to it."""
    return [_similarity(_costs(z[[0, n]], [stacks[0], stacks[n]]), z.shape[2:]) for n in range(1, len(z))]


def _similarity(costs: Costs, shape: tuple[int, ...]) -> Similarity:
    each = [_common([cost]) for cost, _ in costs]
    shifts = np.array([[one.x, one.y] for one in each])
    return similarity([place for _, place in costs], shifts, (shape[0], shape[1]))


@dataclass(frozen=True)
class RelativeLight:
    """Light of one photograph relative to another.

    residual, residual_of_curve : root mean square over contrast, after fitting a factor, and after fitting a parabola;
    curvature, offset : of the parabola: half the change of its slope over the levels relative to its mean, and its
    value at zero relative to the mean level.
    """

    factor: float
    residual: float
    residual_of_curve: float
    curvature: float
    offset: float

    def significant(self) -> bool:
        """Whether it is to be corrected."""
        if abs(self.factor - 1) < MOST_LIGHT:
            return abs(self.factor - 1) > LEAST_LIGHT
        return 1 / ANY_LIGHT < self.factor < ANY_LIGHT and self.residual < AGREE


def check_tone(n: int, light: RelativeLight) -> None:
    """Refuse a photograph that is not linear relative to the first: raises Refused if a curve explains more than a
    factor."""
    if light.residual_of_curve < AGREE and light.residual > BENT * light.residual_of_curve:
        raise Refused(
            f"photograph {n} has another tone curve or black level than photograph 1: the curve between their levels "
            f"begins at {light.offset:+.0%} of the mean and bends by {light.curvature:+.0%}",
            "take both with the same settings, and give both as linear light, unprocessed",
        )


def relative_light(z: Array, stacks: Sequence[Masks], trust: Array | None = None) -> RelativeLight:
    """Light of z[1] relative to z[0], from z1 * h2 and z2 * h1 at the best depth; trust : (2, 1, H, W), 0 excludes all
    that a sample reaches."""
    R = stacks[0].R
    y, x = (slice(max(0, (size - LIGHT_PART_PX) // 2), None) for size in z.shape[2:])
    one, two = z.mean(axis=1)[:, y, x][:, :LIGHT_PART_PX, :LIGHT_PART_PX]
    valid = np.ones(one.shape, bool)
    if trust is not None:
        valid = minimum_filter(trust.min(axis=(0, 1)), 2 * R + 1)[y, x][:LIGHT_PART_PX, :LIGHT_PART_PX] > 0
    used = valid[R:-R, R:-R] if valid[R:-R, R:-R].sum() > 100 else np.s_[:]
    largest = min(stack.max_w for stack in stacks)
    tried = []
    for w in np.linspace(largest / LIGHT_LEVELS, largest, LIGHT_LEVELS):
        h1, h2 = (stack.at(float(w)) for stack in stacks)
        a, b = (fftconvolve(*pair, mode="valid")[used].ravel() for pair in ((one, h2), (two, h1)))
        tried.append((_residual(a, b, 1), a, b))
    return _light(*min(tried, key=lambda level: level[0])[1:])


def _light(a: Array, b: Array) -> RelativeLight:
    constant, slope, bend = _curve(a, b)
    low, high = np.percentile(a, (2, 98))
    curvature = bend * (high - low) / max(abs(slope + bend * (high + low)), 1e-9)
    contrast = max(float(b.std()), 1e-9)
    residual, of_curve = (float(np.sqrt(_residual(a, b, degree))) / contrast for degree in (1, 2))
    return RelativeLight(_factor(a, b), residual, of_curve, float(curvature), constant / max(float(b.mean()), 1e-9))


def _residual(a: Array, b: Array, degree: int) -> float:
    """Mean square residual of levels b after a factor (degree 1) or a parabola (2) of levels a."""
    if degree == 1:
        return float(np.mean((b - _factor(a, b) * a) ** 2))
    return float(np.mean((b - np.polynomial.polynomial.polyval(a, _curve(a, b))) ** 2))


def _factor(a: Array, b: Array) -> float:
    return float(np.vdot(a, b)) / max(float(np.vdot(a, a)), 1e-30)


def _curve(a: Array, b: Array) -> tuple[float, float, float]:
    constant, slope, bend = np.linalg.lstsq(np.vander(a, 3, increasing=True), b, rcond=None)[0].tolist()
    return constant, slope, bend


def shift_back(photograph: Array, trust: Array, x: float, y: float) -> tuple[Array, Array]:
    """Photograph (C, H, W) and its trust (1, H, W) shifted back by x, y pixels; pixels from outside have no trust."""
    back = (0.0, -y, -x)
    z = shift(photograph, back, order=3, mode="nearest")
    # a sample is valid where all samples from which it is interpolated are
    valid = shift(trust, back, order=1, mode="constant", cval=0.0) > 0.999
    return np.asarray(z), np.asarray(valid, dtype=trust.dtype)
