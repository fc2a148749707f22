"""The far photograph's samples of the part of the wall that is common to both photographs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.warps import apply_homography
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

MOST_SAMPLES = 150_000  # a PSF is local: the middle of a larger common region is used


@dataclass(frozen=True)
class FarSamples:
    """Samples of the far photograph.

    Attributes
    ----------
    rows, columns : (m,) int64
        Pixels, relative to the window's corner.
    points : (m, 2) float64
        The same as (x, y) of the far photograph.
    y : (m,) float64
    """

    rows: Indices
    columns: Indices
    points: Array
    y: Array

    def kept(self, mask: npt.NDArray[np.bool_]) -> FarSamples:
        """The selected samples."""
        return FarSamples(self.rows[mask], self.columns[mask], self.points[mask], self.y[mask])


def common_region(
    near: Array32, far: Array32, H_near_far: Array, s: int, k: int
) -> tuple[FarSamples, tuple[int, int], tuple[int, int]]:
    """The far samples whose kernel lies entirely in the near photograph; corner (x, y) and shape of their window.

    Raises
    ------
    Refused
        If there are too few for k^2 unknowns.
    """
    rows, columns = np.indices(far.shape)
    points = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    reach = (k // 2 + 2) / s
    limit = np.array(near.shape[::-1]) - 3.0
    inside = np.ones(len(points), dtype=bool)
    for corner in ((-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)):
        mapped = apply_homography(H_near_far, points + corner)
        inside &= ((mapped >= 2) & (mapped <= limit)).all(axis=1)
    if inside.sum() > MOST_SAMPLES:  # a square about the middle
        away = np.abs(points - points[inside].mean(axis=0)).max(axis=1)
        inside &= away <= np.sort(away[inside])[MOST_SAMPLES]
    needed = int(1.5 * k * k + 100)
    if inside.sum() < needed:
        raise Refused(
            f"{k * k} kernel values need {needed} far samples of the common region; it has {int(inside.sum())}",
            "let more of the near photograph's wall be seen in the far one, or lower k",
        )
    points = points[inside]
    low, high = points.min(axis=0).astype(int), points.max(axis=0).astype(int)
    x, y = points.astype(np.int64).T
    samples = FarSamples(y - low[1], x - low[0], points, far[y, x].astype(np.float64))
    return samples, (int(low[0]), int(low[1])), (int(high[1] - low[1] + 1), int(high[0] - low[0] + 1))
