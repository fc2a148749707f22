"""Masks of every depth from a shape of blur: defocus, motion path, any measured shape.

A shape is an odd square array of samples on [-1, 1] x [-1, 1], row 0 at y = -1. A mask of half-width w is the shape
stretched to [-w, w] and integrated over pixels (4.12, 5.3).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, BadParameter
from procedures.reading.arrays import LARGEST, SMALLEST, checked_array
from procedures.reading.text import read_numbers
from procedures.restoration.masks.blur_operator import MaskStack

SHAPE_SIZE = 257
"""Samples of a model shape along each axis: ten for each pixel at a half-width of 12."""
SAMPLES = 11
"""Samples of a shape per pixel of a mask along each axis: they centre a symmetric shape to 0.05 pixel."""
FINE, COARSE = 0.25, 0.5
"""Spacings in pixels below and above which samples of a shape are interpolated and taken as cells; blended between."""
STEP = 0.05
"""Step of w between masks, pixels: interpolation errs by less than 0.1 % of the mask's change per pixel."""
LINE = 0.02
"""Sigma of a path's line, relative to the half-width."""
GAUSSIAN, POLYGON = "gaussian", "polygon:"
REACH = 3.0
"""Half-width of a Gaussian's mask over its sigma."""
MOST_BLADES = 64
"""Maximum number of blades: more are indistinguishable from a circle at the shape's sampling."""


def _axes(size: int = SHAPE_SIZE) -> tuple[Array, Array]:
    t = np.linspace(-1, 1, size)
    x, y = np.meshgrid(t, t)
    return x, y


def pillbox() -> Array:
    """Blur circle of radius 1 (4.7)."""
    x, y = _axes()
    return (x**2 + y**2 <= 1).astype(np.float64)


def gaussian() -> Array:
    """Gaussian truncated at its half-width, 3 sigma (4.17)."""
    x, y = _axes()
    r2 = x**2 + y**2
    return np.where(r2 <= 1, np.exp(-r2 * REACH**2 / 2), 0.0)


def spread_of(name: str) -> float:
    """Half-width of an aperture's blur over the radius of the blur circle: 3 k for "gaussian:k" of sigma = k r (4.18),
    1 for others. k is 0.5 where it is not given, the standard deviation of a disc. Raises BadParameter."""
    if name.partition(":")[0] != GAUSSIAN:
        return 1.0
    _, _, given = name.partition(":")
    try:
        k = float(given or 0.5)
    except ValueError:
        k = math.nan
    if not 0 < k < math.inf:
        raise BadParameter(f"sigma = k r needs k > 0; got {name!r}", 'write it like "gaussian:0.5"')
    return REACH * k


def polygon(blades: int, angle_rad: float = 0.0) -> Array:
    """Regular polygonal aperture, corners on the circle of radius 1; the first corner at `angle_rad` from x."""
    if blades < 3:
        raise BadParameter(f"an aperture needs 3 blades or more, got {blades}", "count the diaphragm's blades")
    x, y = _axes()
    middles = angle_rad + np.pi * (2 * np.arange(blades) + 1) / blades
    sides = x[..., None] * np.cos(middles) + y[..., None] * np.sin(middles)
    return np.asarray(sides.max(axis=-1) <= np.cos(np.pi / blades), dtype=np.float64)


def path_shape(path: Array, extent: float | None = None) -> Array:
    """Shape of a rig's path (n, 2) at equal times, about its origin, scaled to its half-width (5.3) or a common
    `extent`."""
    extent = float(np.abs(path).max()) if extent is None else extent
    if extent == 0:
        raise BadInput("the motion path does not move", "record the rig while it vibrates, or use a defocus model")
    places = (path / extent * (1 - 3 * LINE) + 1) / 2 * (SHAPE_SIZE - 1)
    times = np.linspace(0, len(places) - 1, 16 * SHAPE_SIZE)
    fine = np.stack([np.interp(times, np.arange(len(places)), places[:, k]) for k in (0, 1)], axis=1)
    grid = np.arange(SHAPE_SIZE)
    sigma = LINE / 2 * (SHAPE_SIZE - 1)
    columns = np.exp(-((grid[None, :] - fine[:, :1]) ** 2) / (2 * sigma**2))
    rows = np.exp(-((grid[None, :] - fine[:, 1:]) ** 2) / (2 * sigma**2))
    return np.asarray(rows.T @ columns, dtype=np.float64)


def uniform_motion(angle_rad: float = 0.0) -> Array:
    """Uniform motion along a line of half-length 1 in the direction `angle_rad` from x (5.5)."""
    direction = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    return path_shape(np.linspace(-1, 1, 4 * SHAPE_SIZE)[:, None] * direction)


def named(name: str) -> Array | None:
    """The shape of an aperture by name, pillbox, gaussian[:K] or polygon:BLADES[:DEGREES]; None for others. Raises
    BadParameter."""
    if name == "pillbox":
        return pillbox()
    if name == GAUSSIAN or name.startswith(f"{GAUSSIAN}:"):
        spread_of(name)  # checks K
        return gaussian()
    return _polygon(name) if name.startswith(POLYGON) else None


def _polygon(name: str) -> Array:
    """Aperture with straight blades: "polygon:7", or "polygon:7:15" rotated by 15 degrees."""
    blades, _, turned = name.removeprefix(POLYGON).partition(":")
    try:
        count, angle = int(blades), float(turned or 0.0)
    except ValueError as error:
        reason = f"a polygon is given by its blades and its rotation in degrees; got {name!r}"
        raise BadParameter(reason, 'write it like "polygon:7" or "polygon:7:15"') from error
    if not math.isfinite(angle) or count > MOST_BLADES:
        reason = f"a polygon has 3 to {MOST_BLADES} blades and a finite rotation; got {name!r}"
        raise BadParameter(reason, "count the diaphragm's blades; for many, pillbox is equivalent")
    return polygon(count, math.radians(angle))


def read_shape(path: Path) -> Array:
    """A shape from a text file. Raises BadInput if it is unreadable, no odd square, negative or empty."""
    return check_shape(read_numbers(path, "shape file"), f"the shape {path}")


def check_shape(shape: NDArray[np.floating[Any]], name: str = "the shape") -> Array:
    """The shape as float64. Raises BadInput as `odd_square`, and if a number is negative."""
    return odd_square(shape, name, low=0.0, remedy="resample it, clip its noise")


def odd_square(values: object, what: str, *, low: float = -LARGEST, remedy: str) -> Array:
    """Samples about a centre as float64.

    Raises BadInput if they are not an odd square of finite numbers with a positive sum.
    """
    square: Array = checked_array(values, what, ("k", "k"), low=low, remedy=remedy)
    if len(square) < 3 or len(square) % 2 == 0:
        raise BadInput(f"{what} must have an odd number of rows, 3 or more; got {len(square)}", remedy)
    if square.sum() < SMALLEST:
        raise BadInput(f"{what} must have a positive sum; got {square.sum():.3g}", remedy)
    return square


def mask(shape: Array, w: float, R: int) -> Array:
    """The mask of half-width w, (2R + 1, 2R + 1), sum 1: the stretched shape, summed over each pixel (4.12).

    Fine samples are interpolated linearly. Samples half a pixel apart and more are cells of uniform light, as in a
    kernel measured with the sensor's pixels, which is reproduced exactly at w = (n - 1) / 2.
    """
    pitch = 2 * w / (len(shape) - 1)
    coarse = float(np.clip((pitch - FINE) / (COARSE - FINE), 0, 1))
    out = np.zeros((2 * R + 1, 2 * R + 1))
    if w > 0 and coarse < 1:
        out += (1 - coarse) * unit(_interpolated(shape, w, R))
    if coarse > 0:
        out += coarse * unit(_cells(shape, pitch, R))
    return unit(out)


def _interpolated(shape: Array, w: float, R: int) -> Array:
    """The stretched shape, linear between its samples, summed over each pixel, one axis after the other."""
    offsets = (np.arange((2 * R + 1) * SAMPLES) + 0.5) / SAMPLES - R - 0.5
    last = len(shape) - 1
    at = (offsets / w + 1) * last / 2
    within = np.flatnonzero((at >= 0) & (at <= last))
    at, pixels = at[within], within // SAMPLES
    left = np.minimum(at.astype(int), last - 1)
    shares = np.zeros((2 * R + 1, last + 1))
    np.add.at(shares, (pixels, left), 1 - (at - left))
    np.add.at(shares, (pixels, left + 1), at - left)
    return np.asarray(shares @ shape @ shares.T)


def _cells(shape: Array, pitch: float, R: int) -> Array:
    """The shape's samples as squares of `pitch` pixels, distributed over the pixels."""
    edges = np.arange(2 * R + 2) - R - 0.5
    centres = (np.arange(len(shape)) - len(shape) // 2) * pitch
    shares = np.diff(np.clip((edges[:, None] - centres) / pitch + 0.5, 0, 1), axis=0)
    return np.asarray(shares @ shape @ shares.T)


def unit(mask: NDArray[np.floating[Any]]) -> Array:
    """The mask with sum 1."""
    total = mask.sum()
    if total <= 0:  # the blur is too small for any sample of the shape: the mask is sharp
        mask = np.zeros_like(mask)
        mask[len(mask) // 2, len(mask) // 2] = total = 1
    return np.asarray(mask / total)


def mask_stack(shape: Array, max_w: float, *, ratio: float = 1.0, offset: float = 0.0, R: int = 0) -> MaskStack:
    """Masks of a photograph whose half-width is `ratio` w + `offset` (4.8, 4.14), for w from 0 to `max_w`.

    R : half-size of the masks; 0 for the smallest that holds the largest.
    """
    if not (0 < ratio < np.inf and max_w > 0 and np.isfinite(offset)):
        raise BadParameter(f"ratio {ratio} and max w {max_w} must be positive", "give w in pixels, ratio as a number")
    need = reach(max_w, ratio, offset)
    if R and need > R:
        raise BadParameter(f"w up to {max_w} needs masks of half-size {need}, got {R}", "lower --max-w")
    levels = np.arange(int(np.ceil(max_w / STEP)) + 2) * STEP
    return MaskStack(masks_of(shape, ratio * levels + offset, R or need), STEP)


def reach(max_w: float, ratio: float = 1.0, offset: float = 0.0) -> int:
    """Half-size of the masks that hold half-widths `ratio` w + `offset` for w from 0 to `max_w`."""
    return int(np.ceil(max(abs(ratio * max_w + offset), abs(offset)) + 0.5))


def masks_of(shape: Array, half_widths: NDArray[np.floating[Any]], R: int) -> Array:
    """Masks (n, 2R + 1, 2R + 1) of signed half-widths; in front of the plane of focus, upside down: light has not
    crossed yet."""
    return np.stack([mask(shape if half >= 0 else shape[::-1, ::-1], abs(half), R) for half in half_widths])


@dataclass(frozen=True)
class DepthUnit:
    """Unit of w: its name, and its value per pixel."""

    name: str = "pixel"
    per_pixel: float = 1.0


def as_shape(mask: Array, half_width: float) -> Array:
    """The mask as a shape on [-1, 1], half-width 1, constant over pixels, so that it is reproduced at its size; (5.3)
    stretches it to other depths."""
    R = mask.shape[0] // 2
    at = np.clip(np.floor(np.linspace(-1, 1, SHAPE_SIZE) * half_width + R + 0.5), 0, 2 * R).astype(int)
    return np.asarray(np.clip(mask[np.ix_(at, at)], 0, None))
