"""A wall under two vibrations: flat in its left part, approaching in its right part."""

import numpy as np
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.blur_models import mask_stack
from procedures.restoration.masks.blur_operator import Array, BlurOperator
from procedures.restoration.unknown_motion import motion_splines

FLAT_W = 2.0
# x, y, width, height of the flat part
BOX = (0, 0, 72, 96)


def curve(turns: int) -> Array:
    """Control points of a smooth closed curve of half-width 2 about the centre."""
    t = 2 * np.pi * np.arange(motion_splines.POINTS) / (motion_splines.POINTS - 1)
    points = np.stack([np.cos(t) + 0.6 * np.sin(turns * t), np.sin(t) + 0.5 * np.cos(turns * t)], axis=1)
    points -= (points.max(axis=0) + points.min(axis=0)) / 2
    return points * FLAT_W / motion_splines.half_width(points)


def curves() -> Array:
    """Both motions, (2, POINTS, 2)."""
    return np.stack([curve(2), curve(3)[:, ::-1]])


def photographs(slope: float = 0.02) -> list[Array]:
    """Two photographs of 96 x 144 at 40 dB; `slope` is the growth of w beyond the flat part, per pixel."""
    rng = np.random.default_rng(4)
    shape, R = (96, 144), 5
    extended = (shape[0] + 2 * R, shape[1] + 2 * R)
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal(extended), 2)) + 0.03 * rng.standard_normal(extended)
    w = FLAT_W + slope * np.clip(np.arange(extended[1]) - 80.0, 0, None)
    z = []
    for one in motion_splines.shapes_of(curves()):
        blur = BlurOperator(mask_stack(one, 4.0, R=R), shape)
        blur.focus(np.broadcast_to(w, extended).copy())
        z.append(blur.blur(u))
    return [a[None] + rng.standard_normal(shape) * a.std() / 100 for a in z]
