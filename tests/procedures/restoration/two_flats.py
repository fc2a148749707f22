"""A flat object in front of a flat ground, with each ray through the lens or from the path traced to its first hit.

Light from behind the near object passes its edge, as in a real camera. The restoration's masks, which ignore occlusion,
are not used.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.blur_models import LINE, path_shape, pillbox

Array = np.ndarray
PAD, SUB = 16, 4


@dataclass(frozen=True)
class Opening:
    """Entrance of the rays: points (n, 2) within a half-width of 1, the shape given to the restoration, and w of that
    shape per pixel of half-width."""

    points: Array
    shape: Array
    per_px: float


def lens(n: int = 11) -> Opening:
    """A round aperture."""
    at = (np.arange(n) + 0.5) / n * 2 - 1
    grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    return Opening(grid[np.hypot(*grid.T) <= 1], pillbox(), 1.0)


def wandering(seed: int) -> Opening:
    """A closed path of a rig; a shape's half-width includes the width of the line."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 2 * np.pi, 161)[:-1]
    c = rng.standard_normal((2, 3, 2)) / np.arange(1, 4)[None, :, None]
    waves = [np.stack([np.cos(k * t), np.sin(k * t)]) for k in (1, 2, 3)]
    path = np.stack([sum(c[d, k] @ waves[k] for k in range(3)) for d in (0, 1)], axis=1)
    path = path - (path.max(axis=0) + path.min(axis=0)) / 2
    path /= np.abs(path).max()
    return Opening(path, path_shape(-path), 1 / (1 - 3 * LINE))


def cover(shape: tuple[int, int]) -> Array:
    """Fraction of each pixel that the near object covers: a rectangle and a disc."""
    h, w = shape
    y, x = np.mgrid[0 : h * SUB, 0 : w * SUB] / SUB
    near = ((np.abs(x - 0.3 * w) < 0.13 * w) & (np.abs(y - 0.5 * h) < 0.28 * h)) | (
        np.hypot(x - 0.72 * w, y - 0.45 * h) < 0.2 * h
    )
    return near.reshape(h, SUB, w, SUB).mean(axis=(1, 3)).astype(np.float32)


@dataclass(frozen=True)
class TwoFlats:
    """Photographs (P, 1, H, W), the sharp picture (H, W) and the half-width (H, W) of its blur in photograph 1."""

    z: Array
    sharp: Array
    w: Array


def two_flats(
    draw: Callable[[tuple[int, int], np.random.Generator], Array],
    shape: tuple[int, int],
    widths_px: tuple[float, float],
    openings: tuple[tuple[Opening, float], ...],
    noise_db: float,
    seed: int,
) -> TwoFlats:
    """Photographs of a scene whose near object and ground are blurred by these half-widths.

    draw : gives the texture of either; openings : of each photograph, and its half-widths relative to the first's
    """
    whole = (shape[0] + 2 * PAD, shape[1] + 2 * PAD)
    near, far = (
        gaussian_filter(draw(whole, np.random.default_rng(10 * seed + i)), 0.8).astype(np.float32) for i in (1, 2)
    )
    covered, rng, z = cover(whole), np.random.default_rng(seed), []
    for opening, ratio in openings:
        clean = _cut(_traced(near, far, covered, ratio * widths_px[0], ratio * widths_px[1], opening.points))
        z.append((clean + clean.std() * 10 ** (-noise_db / 20) * rng.standard_normal(shape))[None])
    w = np.where(_cut(covered) > 0.5, *widths_px) * openings[0][0].per_px
    return TwoFlats(np.stack(z), _cut(covered * near + (1 - covered) * far), w)


def _traced(near: Array, far: Array, covered: Array, near_px: float, far_px: float, points: Array) -> Array:
    out = np.zeros(near.shape)
    for x, y in points:
        a = _seen(covered, near_px * x, near_px * y).clip(0, 1)
        out += a * _seen(near, near_px * x, near_px * y) + (1 - a) * _seen(far, far_px * x, far_px * y)
    return out / len(points)


def _seen(flat: Array, dx: float, dy: float) -> Array:
    matrix = np.array([[1, 0, dx], [0, 1, dy]], dtype=float)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(flat, matrix, flat.shape[::-1], flags=flags, borderMode=cv2.BORDER_REFLECT))


def _cut(flat: Array) -> Array:
    return flat[PAD:-PAD, PAD:-PAD]
