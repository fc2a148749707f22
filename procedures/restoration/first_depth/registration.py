"""Shift and light between photographs that their masks do not contain, found through the masks and taken up.

At the true depth w and shift d, z1 * h2 moved by d equals z2 * h1, however unlike the masks are: the shift is sought
where this relation, its noise made white, fails least. That is one correlation for every depth, in tiles, each of which
may have a depth of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter, minimum_filter
from scipy.ndimage import shift as moved
from scipy.signal import fftconvolve

from procedures.outcome import Refused
from procedures.restoration.first_depth.similarity import Similarity, similarity, turned_back
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.checks import check_shift
from procedures.restoration.masks.mask_fields import MaskField, Masks


@dataclass(frozen=True)
class RegistrationSettings:
    """How shift and light between photographs are looked for, and what is believed of them.

    Attributes
    ----------
    level_step : float
        Pixels of w between the depths at which a shift is looked for.
    most_tiles : int
        Parts of the frame that are looked at, those with most texture.
    least_gain : float
        Part of what the relation leaves that a shift must take away to be believed.
    least_shift : float
        Pixels; less may be what levels of depth 0.3 pixels apart leave where blurs lie beside their middle.
    least_light, most_light, any_light : float
        Difference of light from which it is taken up; up to which it is whatever else differs; and the greatest factor
        that is taken up where the photographs agree but for it.
    agree, bent : float
        What a factor leaves, over the contrast, up to which photographs agree; and what it leaves over what a curve
        leaves, from which light is not proportional: 1.0 for linear photographs, 2.6 and more for a gamma of 1.1 and
        black levels apart by 5 % of white.
    light_levels, light_part : int
        Depths at which light is compared, and the side of the frame's middle where that is done, pixels.
    """

    level_step: float = 0.3
    most_tiles: int = 16
    least_gain: float = 0.04
    least_shift: float = 0.2
    least_light: float = 0.01
    most_light: float = 0.3
    any_light: float = 4.0
    agree: float = 0.3
    bent: float = 2.0
    light_levels: int = 9
    light_part: int = 512


@dataclass(frozen=True)
class Displacement:
    """Shift (x, y) of photograph 2, pixels, and the part of the disagreement that it explains."""

    x: float
    y: float
    gain: float

    def believed(self, s: RegistrationSettings | None = None) -> bool:
        """Whether the photographs ask for it."""
        s = s or RegistrationSettings()
        return self.gain > s.least_gain and bool(np.hypot(self.x, self.y) > s.least_shift)


def displacement(z: Array, stacks: Sequence[Masks], s: RegistrationSettings | None = None) -> Displacement:
    """How far photograph z[1] is shifted against z[0] beyond what the masks say. z : (2, C, H, W)."""
    return _common([cost for cost, _ in _costs(z, stacks, s or RegistrationSettings())])


Costs = list[tuple[Array, tuple[float, float]]]
"""What every shift of a part of the frame leaves, and where its middle lies."""


def _costs(z: Array, stacks: Sequence[Masks], s: RegistrationSettings) -> Costs:
    grey = z.mean(axis=1)
    # what is smooth tells no shift, and the tiles' windows would take its slope for one
    tiles = _tiles(grey - gaussian_filter(grey, (0, stacks[0].R / 2, stacks[0].R / 2)), stacks[0].R, s.most_tiles)
    fields = [MaskField.of(one) for one in stacks]
    return [(_tile_cost(tile, [one.near(*place) for one in fields], s), place) for tile, place in tiles]


def _common(costs: Sequence[Array]) -> Displacement:
    """The shift that all the parts agree on."""
    cost = np.sum(costs, axis=0)
    size = np.array(cost.shape)
    middle = size // 2
    place = np.array(np.unravel_index(cost.argmin(), cost.shape)).clip(1, size - 2)
    (dy, dx), deeper = _valley(cost[place[0] - 1 : place[0] + 2, place[1] - 1 : place[1] + 2])
    y, x = place + np.array([dy, dx]) - middle
    least = cost[tuple(place)] - deeper
    return Displacement(float(x), float(y), float(1 - least / max(cost[tuple(middle)], 1e-30)))


def _tiles(grey: Array, R: int, most: int) -> list[tuple[Array, tuple[float, float]]]:
    """Windowed parts (2, n, n) of both photographs, overlapping by half; where they are many, the most textured.

    Each with where its middle lies, in parts of the frame's height and width.
    """
    n = min(*grey.shape[1:], max(96, 8 * R))
    hann = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    starts = [np.linspace(0, size - n, max(1, round(2 * size / n) - 1)).astype(int) for size in grey.shape[1:]]
    height, width = grey.shape[1:]
    parts = [
        (grey[:, y : y + n, x : x + n], ((y + n / 2) / height, (x + n / 2) / width))
        for y in starts[0]
        for x in starts[1]
    ]
    parts = sorted(parts, key=lambda part: -float(part[0].var()))[:most]
    window = np.outer(hann, hann)
    return [((part - part.mean(axis=(1, 2), keepdims=True)) * window, place) for part, place in parts]


def _tile_cost(tile: Array, stacks: list[MaskStack], s: RegistrationSettings) -> Array:
    """What the relation leaves of a tile for every shift, at the depth that suits it best; shift 0 in the middle."""
    R = stacks[0].R
    size = next_fast_len(tile.shape[1] + 2 * R, True)
    one, two = rfft2(tile, (size, size))
    least: Array | None = None
    for w in np.arange(s.level_step, min(one.max_w for one in stacks), s.level_step):
        h1, h2 = (rfft2(one.at(float(w)), (size, size)) for one in stacks)
        a, b = one * h2, two * h1
        noise = np.abs(h1) ** 2 + np.abs(h2) ** 2 + 1e-3
        energy = irfft2((np.abs(a) ** 2 + np.abs(b) ** 2) / noise, (size, size))[0, 0]
        left = energy - 2 * irfft2(np.conj(a) * b / noise, (size, size))
        least = left if least is None else np.minimum(least, left)
    assert least is not None
    return np.asarray(np.fft.fftshift(least))


def _valley(cost: Array) -> tuple[Array, float]:
    """Where (y, x) the paraboloid through costs (3, 3) about their middle is least, and how much deeper than there.

    Its mixed term counts: where both masks pass little across one direction, the valley is long and lies aslant.
    """
    slope = np.array([cost[2, 1] - cost[0, 1], cost[1, 2] - cost[1, 0]]) / 2
    mixed = (cost[2, 2] - cost[2, 0] - cost[0, 2] + cost[0, 0]) / 4
    down, across = cost[2, 1] + cost[0, 1] - 2 * cost[1, 1], cost[1, 2] + cost[1, 0] - 2 * cost[1, 1]
    bend = np.array([[down, mixed], [mixed, across]])
    if down <= 0 or across <= 0 or np.linalg.det(bend) <= 0:
        return np.zeros(2), 0.0
    at = np.clip(-np.linalg.solve(bend, slope), -0.75, 0.75)
    return at, -float(slope @ at + at @ bend @ at / 2)


@dataclass(frozen=True)
class Registered:
    """Photographs (P, C, H, W) and trust (P, 1, H, W) brought to the first, and what was taken up.

    shifts : (P, 2) x, y against the first, pixels; light : (P,) over the first's; turns, zooms : (P,) radians from x to
    y, and over the first's size.
    """

    z: Array
    trust: Array
    shifts: Array
    light: Array
    turns: Array
    zooms: Array


def registered(
    z: Array, trust: Array, stacks: Sequence[Masks], settings: RegistrationSettings | None = None
) -> Registered:
    """Photographs with every turn, zoom, shift and difference of light against the first taken up.

    z : (P, C, H, W); trust : (P, 1, H, W).

    Raises
    ------
    Refused
        If a photograph is shifted by more than the masks can hold.
    """
    s = settings or RegistrationSettings()
    z, trust = z.copy(), trust.copy()
    shifts, light = np.zeros((len(z), 2)), np.ones(len(z))
    turns, zooms = np.zeros(len(z)), np.ones(len(z))
    for n in range(1, len(z)):
        pair = [stacks[0], stacks[n]]
        costs = _costs(z[[0, n]], pair, s)
        alike = _similarity(costs, z.shape[2:])
        if alike.believed:
            z[n], trust[n] = turned_back(z[n], trust[n], alike)
            turns[n], zooms[n] = alike.turn, alike.zoom
            costs = _costs(z[[0, n]], pair, s)
        found = _common([cost for cost, _ in costs])
        if found.believed(s):
            check_shift(n + 1, found.x, found.y, pair[0].R)
            # the tiles saw other parts of the scene; what they miss for that is seen once they are in place
            rest = displacement(np.stack([z[0], taken_up(z[n], trust[n], found.x, found.y)[0]]), pair, s)
            shifts[n] = found.x + rest.x, found.y + rest.y
            z[n], trust[n] = taken_up(z[n], trust[n], *shifts[n])
        more = relative_light(z[[0, n]], pair, s, trust[[0, n]])
        check_tone(n + 1, more, s)
        if more.believed(s):
            light[n] = more.factor
            z[n] /= more.factor
    return Registered(z, trust, shifts, light, turns, zooms)


def similarities(z: Array, stacks: Sequence[Masks], settings: RegistrationSettings | None = None) -> list[Similarity]:
    """Turn and zoom of each of the photographs (P, C, H, W) after the first, against it."""
    s = settings or RegistrationSettings()
    return [_similarity(_costs(z[[0, n]], [stacks[0], stacks[n]], s), z.shape[2:]) for n in range(1, len(z))]


def _similarity(costs: Costs, shape: tuple[int, ...]) -> Similarity:
    """Turn and zoom, by the shift of every part of the frame."""
    each = [_common([cost]) for cost, _ in costs]
    shifts = np.array([[one.x, one.y] for one in each])
    return similarity([place for _, place in costs], shifts, (shape[0], shape[1]))


@dataclass(frozen=True)
class Light:
    """Light of one photograph over another's.

    Attributes
    ----------
    factor : float
    left, left_by_curve : float
        Root mean square of what the factor leaves, and of what a parabola leaves, over the contrast.
    curvature, offset : float
        Of the parabola: how its slope changes over the levels, half of it over its mean; its value in the dark over the
        mean level.
    """

    factor: float
    left: float
    left_by_curve: float
    curvature: float
    offset: float

    def believed(self, s: RegistrationSettings) -> bool:
        """Whether it is to be taken up."""
        if abs(self.factor - 1) < s.most_light:
            return abs(self.factor - 1) > s.least_light
        return 1 / s.any_light < self.factor < s.any_light and self.left < s.agree


def check_tone(n: int, light: Light, s: RegistrationSettings) -> None:
    """Refuse a photograph whose light is not proportional to the first's.

    Raises
    ------
    Refused
        If a curve explains much more than a factor does.
    """
    if light.left_by_curve < s.agree and light.left > s.bent * light.left_by_curve:
        raise Refused(
            f"photograph {n} has another tone curve or black level than photograph 1: between their levels "
            f"lies a curve that begins at {light.offset:+.0%} of the mean and bends by {light.curvature:+.0%}",
            "take both with the same settings, and give both as linear light, unprocessed",
        )


def relative_light(
    z: Array, stacks: Sequence[Masks], s: RegistrationSettings | None = None, trust: Array | None = None
) -> Light:
    """Light of photograph z[1] over that of z[0]: between z1 * h2 and z2 * h1 at the depth that suits best.

    trust : (2, 1, H, W), 0 for samples that do not count, as do none that their light is spread to
    """
    s, R = s or RegistrationSettings(), stacks[0].R
    y, x = (slice(max(0, (size - s.light_part) // 2), None) for size in z.shape[2:])
    one, two = z.mean(axis=1)[:, y, x][:, : s.light_part, : s.light_part]
    known = np.ones(one.shape, bool)
    if trust is not None:
        known = minimum_filter(trust.min(axis=(0, 1)), 2 * R + 1)[y, x][: s.light_part, : s.light_part] > 0
    counted = known[R:-R, R:-R] if known[R:-R, R:-R].sum() > 100 else np.s_[:]
    largest = min(stack.max_w for stack in stacks)
    tried = []
    for w in np.linspace(largest / s.light_levels, largest, s.light_levels):
        h1, h2 = (stack.at(float(w)) for stack in stacks)
        a, b = (fftconvolve(*both, mode="valid")[counted].ravel() for both in ((one, h2), (two, h1)))
        tried.append((_left(a, b, 1), a, b))
    return _light(*min(tried, key=lambda level: level[0])[1:])


def _light(a: Array, b: Array) -> Light:
    """Levels b over levels a."""
    constant, slope, bend = _curve(a, b)
    low, high = np.percentile(a, (2, 98))
    curvature = bend * (high - low) / max(abs(slope + bend * (high + low)), 1e-9)
    contrast = max(float(b.std()), 1e-9)
    left, by_curve = (float(np.sqrt(_left(a, b, degree))) / contrast for degree in (1, 2))
    return Light(_factor(a, b), left, by_curve, float(curvature), constant / max(float(b.mean()), 1e-9))


def _left(a: Array, b: Array, degree: int) -> float:
    """Mean square that a factor (degree 1) or a parabola (2) leaves of levels b over levels a."""
    if degree == 1:
        return float(np.mean((b - _factor(a, b) * a) ** 2))
    return float(np.mean((b - np.polynomial.polynomial.polyval(a, _curve(a, b))) ** 2))


def _factor(a: Array, b: Array) -> float:
    """Levels b over levels a."""
    return float(np.vdot(a, b)) / max(float(np.vdot(a, a)), 1e-30)


def _curve(a: Array, b: Array) -> tuple[float, float, float]:
    """The parabola of levels b over levels a: constant, slope, bend."""
    found = np.polynomial.polynomial.polyfit(a, b, 2)
    return float(found[0]), float(found[1]), float(found[2])


def taken_up(photograph: Array, trust: Array, x: float, y: float) -> tuple[Array, Array]:
    """Photograph (C, H, W) and its trust (1, H, W) moved back by x, y pixels; what nobody saw is not trusted."""
    back = (0.0, -y, -x)
    z = moved(photograph, back, order=3, mode="nearest")
    # a sample counts where all that it is interpolated from did
    known = moved(trust, back, order=1, mode="constant", cval=0.0) > 0.999
    return np.asarray(z), np.asarray(known, dtype=trust.dtype)
