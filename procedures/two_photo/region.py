"""The part of the wall that both photographs show, and the far photograph's samples there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.warps import apply_homography
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

MOST_SAMPLES = 150_000  # a PSF is local: of a larger common region the middle is taken


@dataclass(frozen=True)
class Samples:
    """The far photograph's samples used.

    Attributes
    ----------
    rows, columns : (m,) int64
        Pixels, relative to the window's first one.
    points : (m, 2) float64
        The same as (x, y) of the far photograph.
    y : (m,) float64
    """

    rows: Indices
    columns: Indices
    points: Array
    y: Array

    def kept(self, which: npt.NDArray[np.bool_]) -> Samples:
        """Those of the samples."""
        return Samples(self.rows[which], self.columns[which], self.points[which], self.y[which])


def common_region(
    near: Array32, far: Array32, H_near_far: Array, s: int, k: int
) -> tuple[Samples, tuple[int, int], tuple[int, int]]:
    """The far samples whose whole kernel falls on the near photograph; their window's corner (x, y) and shape.

    Raises
    ------
    Refused
        If they are too few for k^2 unknowns.
    """
    rows, columns = np.indices(far.shape)
    points = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    reach = (k // 2 + 2) / s
    limit = np.array(near.shape[::-1]) - 3.0
    inside = np.ones(len(points), dtype=bool)
    for corner in ((-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)):
        seen = apply_homography(H_near_far, points + corner)
        inside &= ((seen >= 2) & (seen <= limit)).all(axis=1)
    inside = _middle(points, inside)
    needed = int(1.5 * k * k + 100)
    if inside.sum() < needed:
        raise Refused(
            f"{k * k} kernel values need {needed} far samples of the common region; it has {int(inside.sum())}",
            "let more of the near photograph's wall be seen in the far one, or lower k",
        )
    points = points[inside]
    low, high = points.min(axis=0).astype(int), points.max(axis=0).astype(int)
    x, y = points.astype(np.int64).T
    samples = Samples(y - low[1], x - low[0], points, far[y, x].astype(np.float64))
    return samples, (int(low[0]), int(low[1])), (int(high[1] - low[1] + 1), int(high[0] - low[0] + 1))


def _middle(points: Array, inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Of the points inside, at most the most samples wanted: a square about their middle."""
    if inside.sum() <= MOST_SAMPLES:
        return inside
    away = np.abs(points - points[inside].mean(axis=0)).max(axis=1)
    return np.asarray(inside & (away <= np.sort(away[inside])[MOST_SAMPLES]))
