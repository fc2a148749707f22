"""Detection of stuck pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def no_pixels() -> npt.NDArray[np.intp]:
    """Empty list of pixels."""
    return np.empty((0, 2), dtype=np.intp)


def stuck_pixels(samples: npt.NDArray[np.float32], zero: float) -> npt.NDArray[np.intp]:
    """[row, column] of pixels at white whose eight neighbours are all below half of it, and of pixels at the digital
    number 0 whose neighbours all exceed 10 % of white; none if over 1 % qualify, which is detail of the picture."""
    white, dead = np.float32(1 - 1e-6), np.float32(zero + 1e-6)
    bad = [_isolated(samples, samples >= white, lambda near: near.max(axis=0) < 0.5)]
    bad += [_isolated(samples, samples <= dead, lambda near: near.min(axis=0) > 0.1)]
    return np.concatenate(bad)


def _isolated(samples: npt.NDArray[np.float32], chosen: npt.NDArray[np.bool_], differs: Any) -> npt.NDArray[np.intp]:
    rows, columns = samples.shape
    places = np.column_stack(np.divmod(np.flatnonzero(chosen), columns))
    if len(places) == 0 or len(places) > samples.size / 100:
        return no_pixels()
    row, column = places.T
    places = places[(row > 0) & (row < rows - 1) & (column > 0) & (column < columns - 1)]
    around = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    near = np.stack([samples[places[:, 0] + r, places[:, 1] + c] for r, c in around])
    isolated: npt.NDArray[np.intp] = places[differs(near)]
    return isolated
