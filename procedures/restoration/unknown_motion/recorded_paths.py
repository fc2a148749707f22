"""Prototype masks from recorded motion: the inertial unit gives each path's form, the photographs its size and
position.

The record lacks the distance of the flat part, which scales both paths, and the pose between the exposures, which
shifts one mask relative to the other. Both follow from the cross relation z1 * h2 = z2 * h1.
"""

from pathlib import Path

import numpy as np
from scipy.ndimage import shift

from procedures.outcome import BadInput
from procedures.reading.text import read_numbers
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.line_rasterisation import path_mask
from procedures.restoration.unknown_motion.blind import cross_relation

SIZE_STEP_PX, MOST_SHIFT = 0.25, 3
"""Step of the half-widths tried, and range of whole-pixel shifts tried each way, refined by quarters of a pixel."""


def read_path(path: Path) -> Array:
    """A path from a text file: (n, 2), x and y at equal times. Raises BadInput."""
    return read_numbers(path, "path file", (None, 2))


def recorded_masks(parts: Array, paths: list[Array], largest: int) -> Array:
    """Masks (2, K, K), K = 2 largest + 1, of a flat part from the rig's paths (n, 2). Raises BadInput if these are not
    two that move."""
    if len(paths) != 2 or any(p.ndim != 2 or p.shape[1] != 2 or len(p) < 2 for p in paths):
        raise BadInput("two recorded paths of x and y are needed", "give one text array of two columns per photograph")
    extent = [float(np.abs(p - _middle(p)).max()) for p in paths]
    if min(extent) == 0:
        raise BadInput("a recorded path does not move", "record the rig while it vibrates")
    relation = cross_relation(parts, largest)
    most = largest - 1.0
    sizes = np.arange(1.0, most + SIZE_STEP_PX / 2, SIZE_STEP_PX) / max(extent)
    whole = np.arange(-MOST_SHIFT, MOST_SHIFT + 1.0)
    best = min((_candidate(relation, paths, s, largest, whole) for s in sizes), key=lambda candidate: candidate[0])
    fine = np.arange(-0.75, 1.0, 0.25)
    return _candidate(relation, paths, best[2], largest, fine, best[3])[1]


def _middle(path: Array) -> Array:
    return np.asarray((path.max(axis=0) + path.min(axis=0)) / 2)


def _candidate(
    relation: Array, paths: list[Array], size: float, R: int, steps: Array, about: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, Array, float, tuple[float, float]]:
    """Least cross relation of one size over shifts of the second mask: its value, masks, size and shift."""
    first, second = (path_mask((p - _middle(p)) * size, R) for p in paths)
    best: tuple[float, Array, float, tuple[float, float]] | None = None
    for dy in about[0] + steps:
        for dx in about[1] + steps:
            shifted = np.clip(shift(second, (dy, dx), order=1), 0, None)
            if shifted.sum() < 0.99:  # outside the masks
                continue
            h = np.concatenate([first.ravel(), shifted.ravel() / shifted.sum()])
            # a small mask satisfies the relation trivially: compare with the value expected for the masks' size
            value = float(h @ relation @ h) / float(h @ h)
            if best is None or value < best[0]:
                best = (value, np.stack([first, shifted / shifted.sum()]), size, (float(dy), float(dx)))
    if best is None:
        return np.inf, np.stack([first, second]), size, about
    return best
