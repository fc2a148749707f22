"""Shift and light between photographs that their masks do not contain, found through the masks and taken up.

At the true depth w and shift d, z1 * h2 moved by d equals z2 * h1, however unlike the masks are: the shift is sought
where this relation, its noise made white, fails least. That is one correlation for every depth, in tiles, each of which
may have a depth of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter
from scipy.ndimage import shift as moved
from scipy.signal import fftconvolve

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
    least_light, most_light : float
        Difference of light from which it is taken up, and beyond which the photographs are not of one scene.
    light_levels, light_part : int
        Depths at which light is compared, and the side of the frame's middle where that is done, pixels.
    """

    level_step: float = 0.3
    most_tiles: int = 16
    least_gain: float = 0.04
    least_shift: float = 0.2
    least_light: float = 0.01
    most_light: float = 0.3
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
    s = s or RegistrationSettings()
    grey = z.mean(axis=1)
    # what is smooth tells no shift, and the tiles' windows would take its slope for one
    tiles = _tiles(grey - gaussian_filter(grey, (0, stacks[0].R / 2, stacks[0].R / 2)), stacks[0].R, s.most_tiles)
    fields = [MaskField.of(one) for one in stacks]
    cost = np.sum([_tile_cost(tile, [one.near(*place) for one in fields], s) for tile, place in tiles], axis=0)
    size = np.array(cost.shape)
    middle = size // 2
    place = np.array(np.unravel_index(cost.argmin(), cost.shape)).clip(1, size - 2)
    lines = [cost[:, place[1]], cost[place[0]]]
    (dy, deeper), (dx, yet) = (_valley(line, k) for line, k in zip(lines, place, strict=True))
    y, x = place + np.array([dy, dx]) - middle
    least = cost[tuple(place)] - deeper - yet
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


def _valley(line: NDArray[np.floating], k: np.intp) -> tuple[float, float]:
    """How far from k the parabola through line[k] and its neighbours is least, and how much deeper than there."""
    a, b, c = line[k - 1 : k + 2]
    bend = a - 2 * b + c
    if bend <= 0:
        return 0.0, 0.0
    at = float(np.clip((a - c) / (2 * bend), -0.5, 0.5))
    return at, at**2 * float(bend) / 2


@dataclass(frozen=True)
class Registered:
    """Photographs (P, C, H, W) and trust (P, 1, H, W) brought to the first, and what was taken up.

    shifts : (P, 2) x, y against the first, pixels; light : (P,) over the first's.
    """

    z: Array
    trust: Array
    shifts: Array
    light: Array


def registered(
    z: Array, trust: Array, stacks: Sequence[Masks], settings: RegistrationSettings | None = None
) -> Registered:
    """Photographs with every shift and difference of light against the first taken up.

    z : (P, C, H, W); trust : (P, 1, H, W).

    Raises
    ------
    Refused
        If a photograph is shifted by more than the masks can hold.
    """
    s = settings or RegistrationSettings()
    z, trust = z.copy(), trust.copy()
    shifts, light = np.zeros((len(z), 2)), np.ones(len(z))
    for n in range(1, len(z)):
        pair = [stacks[0], stacks[n]]
        found = displacement(z[[0, n]], pair, s)
        if found.believed(s):
            check_shift(n + 1, found.x, found.y, pair[0].R)
            # the tiles saw other parts of the scene; what they miss for that is seen once they are in place
            rest = displacement(np.stack([z[0], taken_up(z[n], trust[n], found.x, found.y)[0]]), pair, s)
            shifts[n] = found.x + rest.x, found.y + rest.y
            z[n], trust[n] = taken_up(z[n], trust[n], *shifts[n])
        more = relative_light(z[[0, n]], pair, s)
        if s.least_light < abs(more - 1) < s.most_light:
            light[n] = more
            z[n] /= more
    return Registered(z, trust, shifts, light)


def relative_light(z: Array, stacks: Sequence[Masks], s: RegistrationSettings | None = None) -> float:
    """Light of photograph z[1] over that of z[0]: factor between z1 * h2 and z2 * h1 at the depth that suits best."""
    s, (H, W) = s or RegistrationSettings(), z.shape[2:]
    y, x = max(0, (H - s.light_part) // 2), max(0, (W - s.light_part) // 2)
    one, two = z.mean(axis=1)[:, y : y + s.light_part, x : x + s.light_part]
    best, least = 1.0, np.inf
    largest = min(stack.max_w for stack in stacks)
    for w in np.linspace(largest / s.light_levels, largest, s.light_levels):
        h1, h2 = (stack.at(float(w)) for stack in stacks)
        a, b = fftconvolve(one, h2, mode="valid"), fftconvolve(two, h1, mode="valid")
        factor = float(np.vdot(a, b) / max(np.vdot(a, a), 1e-30))
        left = float(np.mean((b - factor * a) ** 2))
        if left < least:
            best, least = factor, left
    return best


def taken_up(photograph: Array, trust: Array, x: float, y: float) -> tuple[Array, Array]:
    """Photograph (C, H, W) and its trust (1, H, W) moved back by x, y pixels; what nobody saw is not trusted."""
    back = (0.0, -y, -x)
    z = moved(photograph, back, order=3, mode="nearest")
    # a sample counts where all that it is interpolated from did
    known = moved(trust, back, order=1, mode="constant", cval=0.0) > 0.999
    return np.asarray(z), np.asarray(known, dtype=trust.dtype)
