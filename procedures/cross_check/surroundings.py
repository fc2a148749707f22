"""Stray light on an edge's plains, from other printed areas through the PSF's far tail.

The slanted-edge method assumes an edge between two unbounded plains. On the chart the frame is close, and the black
area ends: a few thousandths of the contrast, which would be mistaken for the edge's own tail.
"""

from __future__ import annotations

import numpy as np

from procedures.numerics import transforms
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.ordered import quantile
from procedures.slanted_edge.strip import Strip

AROUND_PX = 64
"""Width of the surroundings included around a strip: the tail's light from beyond is uniform over it."""


def without_surroundings(samples: Array32, strip: Strip, course: Array, density_px: float) -> Array:
    """Samples (n, m) of a strip corrected to unbounded plains.

    Parameters
    ----------
    samples : (rows, columns) float32 the plane, including the surroundings
    strip : valid samples cover the edge and its plains only
    course : (n, 2) points (x, y) of the plane along the edge
    density_px : coefficient A of the tail A / r^3, per square pixel, of a PSF of sum 1; r in pixels
    """
    roi = strip.roi
    x0, y0 = max(roi.x - AROUND_PX, 0), max(roi.y - AROUND_PX, 0)
    part = samples[y0 : roi.y + roi.height + AROUND_PX, x0 : roi.x + roi.width + AROUND_PX].astype(np.float64)
    top, left = roi.y - y0, roi.x - x0
    inside = np.zeros(part.shape, dtype=np.bool_)
    inside[top : top + roi.height, left : left + roi.width] = strip.usable.T if strip.turned else strip.usable
    y, x = np.mgrid[: part.shape[0], : part.shape[1]]
    u, v = (x + x0, y + y0) if strip.turned else (y + y0, x + x0)
    along, across = course.T if strip.turned else course.T[::-1]
    line = np.polyfit(along, across, 1)
    beyond = v > np.polyval(line, u)
    levels = [quantile(part[inside & side], 0.5) for side in (~beyond, beyond)]
    deviation = np.where(inside, 0.0, part - np.where(beyond, levels[1], levels[0]))
    stray_light = _through_tail(deviation, density_px)[top : top + roi.height, left : left + roi.width]
    return strip.samples - (stray_light.T if strip.turned else stray_light)


def _through_tail(picture: Array, density_px: float) -> Array:
    """Picture (rows, columns) convolved with A / r^3; zero beyond its border."""
    shape = [transforms.next_fast_len(2 * n) for n in picture.shape]
    r = np.hypot(*(transforms.fftfreq(n, 1 / n).reshape(s) for n, s in zip(shape, ((-1, 1), (1, -1)), strict=True)))
    kernel = np.where(r > 0, density_px / np.maximum(r, 1) ** 3, 0.0)
    product = transforms.rfft2(picture, shape) * transforms.rfft2(kernel)
    return np.asarray(transforms.irfft2(product, shape)[: picture.shape[0], : picture.shape[1]])
