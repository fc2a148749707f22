"""Interpolation of functions over the disc of a pupil's shifts, tabulated over root and angle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


@compiled
def read(table: Complex, sx: Array, sy: Array) -> Complex:
    """The function at shifts (sx, sy), flat, by the cubic through four values along both axes; 0 from 2 on.

    Parameters
    ----------
    table : (rows, 1) or (rows, turn + 3) complex128
        Along rows t from 0 to 1, shift = 2 (1 - t^2). Along columns nothing, or the angle from -pi on in equal steps,
        `turn` of them to the turn, with one column more before them and two after.
    """
    rows, turn = table.shape[0], table.shape[1] - 3
    out = np.zeros(sx.size, np.complex128)
    for i in range(sx.size):
        shift = np.hypot(sx[i], sy[i])
        if shift >= 2:
            continue
        t = np.sqrt(1 - shift / 2) * (rows - 1)
        first = min(max(int(t) - 1, 0), rows - 4)
        if turn < 0:
            for m, weight in enumerate(through_four(t - first)):
                out[i] += weight * table[first + m, 0]
            continue
        a = (np.arctan2(sy[i], sx[i]) / (2 * np.pi) + 0.5) * turn
        left = min(int(a), turn - 1)
        p, q, r, s = through_four(a - left + 1)
        for m, weight in enumerate(through_four(t - first)):
            row = table[first + m]
            out[i] += weight * (p * row[left] + q * row[left + 1] + r * row[left + 2] + s * row[left + 3])
    return out


@compiled
def through_four(x: float) -> tuple[float, float, float, float]:
    """Lagrange's weights of values at 0, 1, 2 and 3 for the value at x."""
    a, b, c, d = x, x - 1, x - 2, x - 3
    return -b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6
