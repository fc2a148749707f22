"""What else is printed around an edge, seen through the PSF's far tail: light on its plains that is not its own.

A slanted edge is meant to lie between two endless plains. On the chart the frame stands before it, and its black area
ends: some thousandths of the contrast, which a window would take for a tail of the edge's own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics import transforms
from procedures.numerics.ordered import quantile
from procedures.slanted_edge.strip import Strip

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

AROUND_PX = 64
"""How far around a strip things are looked at: a tail's light from beyond is flat over it."""


def without_surroundings(samples: Array32, strip: Strip, course: Array, density_px: float) -> Array:
    """The strip's samples as they would be between endless plains, (n, m).

    Parameters
    ----------
    samples : (rows, columns) float32
        The plane, which itself shows what lies around.
    strip : Strip
        Its valid samples show the edge and its plains alone.
    course : (n, 2) float64
        Points (x, y) of the plane along the edge.
    density_px : float
        A of the tail A / r^3, per square pixel, of a PSF of sum 1; r in pixels.
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
    other = np.where(inside, 0.0, part - np.where(beyond, levels[1], levels[0]))
    seen = _through_tail(other, density_px)[top : top + roi.height, left : left + roi.width]
    return strip.samples - (seen.T if strip.turned else seen)


def _through_tail(picture: Array, density_px: float) -> Array:
    """A picture convolved with A / r^3, (rows, columns); nothing lies beyond its border."""
    shape = [transforms.next_fast_len(2 * n) for n in picture.shape]
    r = np.hypot(*(transforms.fftfreq(n, 1 / n).reshape(s) for n, s in zip(shape, ((-1, 1), (1, -1)), strict=True)))
    kernel = np.where(r > 0, density_px / np.maximum(r, 1) ** 3, 0.0)
    product = transforms.rfft2(picture, shape) * transforms.rfft2(kernel)
    return np.asarray(transforms.irfft2(product, shape)[: picture.shape[0], : picture.shape[1]])
