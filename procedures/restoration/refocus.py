"""Depth of focus changed after a restoration: the sharp picture through another aperture, focused elsewhere.

The picture is the mean of the views from the points of the aperture. In the view from the point a, in units of the
aperture's radius, a pixel is displaced by a times the radius of its blur circle (4.5), and hides what is behind it.
What no view shows, because the sharp picture does not contain it, has no part in the mean.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.numbers import DEPTH_OF_FIELD_FAR, DEPTH_OF_FIELD_NEAR
from procedures.numerics.arrays import Array
from procedures.numerics.compiled import jitted
from procedures.outcome import BadParameter, Quantity
from procedures.restoration.masks.thin_lens import CameraSetting
from procedures.restoration.metres import CameraUncertainty

VIEWS_PER_PX, FEWEST, MOST = 16.0, 1024, 8192
"""Views per pixel of the largest blur circle, and the bounds of their number."""
PLASTIC = 1.32471795724474602596
"""Root of x^3 = x + 1: n / x and n / x^2 modulo 1 fill the square evenly."""
SHARP_PX = 0.5
"""Radius of the largest blur circle within the depth of field: a disc one pixel wide."""
MOST_RADIUS_PX = 64.0


@dataclass(frozen=True, eq=False)
class RefocusedPicture:
    """A picture (C, H, W), the signed half-width of its blur (H, W) in pixels, positive in front of the plane of focus,
    the setting, and the limits of its depth of field in metres."""

    picture: Array
    radius_px: Array
    setting: CameraSetting
    numbers: dict[str, Quantity]


def refocus(
    sharp: NDArray[np.floating[Any]], metres: NDArray[np.floating[Any]], setting: CameraSetting, shape: Array
) -> RefocusedPicture:
    """The picture that a camera with this setting would have taken.

    Raises BadParameter if sizes differ, a distance is not positive, or a blur circle would be wider than 128 pixels.

    sharp : (C, H, W), linear
    metres : (H, W) distance from the lens; infinity is allowed
    setting : aperture and focus of the new picture
    shape : (n, n) of the aperture's blur, see `blur_models`
    """
    if sharp.ndim != 3 or sharp.shape[1:] != metres.shape:
        raise BadParameter(
            f"picture (C, H, W) and distances (H, W) must have one size; got {sharp.shape} and {metres.shape}",
            "give those of one restoration",
        )
    if not np.all(metres > 0):
        raise BadParameter("distances must be positive; NaN, 0 or less was given", "give metres from the lens")
    radius = setting.blur_radius_px(1000 * np.asarray(metres, np.float64))
    widest = float(np.abs(radius).max())
    if widest > MOST_RADIUS_PX:
        raise BadParameter(
            f"blur circles must be at most {2 * MOST_RADIUS_PX:.0f} pixels wide; they would be {2 * widest:.0f}",
            "give a higher --f-number, or focus nearer to the scene",
        )
    return RefocusedPicture(_mean_of_views(sharp, radius, shape), radius, setting, _depth_of_field(setting))


def _mean_of_views(sharp: NDArray[np.floating[Any]], radius: Array, shape: Array) -> Array:
    """The mean of the views from points of the aperture, weighted by its shape."""
    points, weights = _aperture(shape, float(np.abs(radius).max()))
    light = np.ascontiguousarray(sharp.reshape(len(sharp), -1).T, np.float64)
    mean = _add_views(light, np.ascontiguousarray(radius), points, weights)
    return np.asarray(mean.T.reshape(sharp.shape))


def _aperture(shape: Array, radius_px: float) -> tuple[Array, Array]:
    """Points (n, 2) of the aperture, y and x in -1...1, and the shape's value at each."""
    count = int(np.clip(VIEWS_PER_PX * np.pi * radius_px**2, FEWEST, MOST))
    points = 2 * (np.arange(1, count + 1)[:, None] / (PLASTIC, PLASTIC**2) % 1) - 1
    values = shape[tuple(np.rint((points.T + 1) / 2 * (len(shape) - 1)).astype(int))]
    return points[values > 0], values[values > 0]


@jitted()
def _add_views(light: Array, radius: Array, points: Array, weights: Array) -> Array:
    """The weighted mean (H W, C) of the views: in each, a pixel is displaced, and the nearest one is visible."""
    rows, columns = radius.shape
    total, cover = np.zeros(light.shape), np.zeros(light.shape[0])
    nearest, source = np.empty(light.shape[0]), np.empty(light.shape[0], np.int64)
    for n in range(len(points)):
        source[:] = -1
        for y in range(rows):
            for x in range(columns):
                r = radius[y, x]
                to_y = y + int(np.floor(points[n, 0] * r + 0.5))
                to_x = x + int(np.floor(points[n, 1] * r + 0.5))
                if 0 <= to_y < rows and 0 <= to_x < columns:
                    to = to_y * columns + to_x
                    if source[to] < 0 or r > nearest[to]:
                        source[to], nearest[to] = y * columns + x, r
        for to in range(len(source)):
            if source[to] >= 0:
                cover[to] += weights[n]
                for c in range(light.shape[1]):
                    total[to, c] += weights[n] * light[source[to], c]
    for to in range(len(cover)):
        for c in range(light.shape[1]):
            total[to, c] /= max(cover[to], 1e-12)
    return total


def _depth_of_field(setting: CameraSetting) -> dict[str, Quantity]:
    """Distances between which the blur circle is at most a pixel wide; the far one only if it is finite."""
    known, setting = CameraUncertainty(), replace(setting, spread=1.0)
    numbers: dict[str, Quantity] = {}
    for name, radius in ((DEPTH_OF_FIELD_NEAR, SHARP_PX), (DEPTH_OF_FIELD_FAR, -SHARP_PX)):
        metres = float(setting.distance_mm(radius)) / 1000
        inverse = np.hypot(known.scale * SHARP_PX / setting.scale_px_mm, known.focus / setting.focus_mm)
        if np.isfinite(metres):
            method = "blur circle one pixel wide, by Gaussian optics"
            numbers[name] = Quantity(metres, "m", float(1000 * metres**2 * inverse), method, 1)
    return numbers
