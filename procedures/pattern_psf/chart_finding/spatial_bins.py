"""Spatial index of saddles: sorted into square bins, so that neighbours are contiguous in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.int64]

FAR = 1e9
"""Greatest coordinate, as homographies can map points arbitrarily far."""


class Field(NamedTuple):
    """Saddles sorted by bins, one row of bins after the other.

    Attributes
    ----------
    points, axes : (n,) complex128
        As in `marks.Saddles`.
    merits : (n,) float64
        Merit by which saddles compete: strength, for those of a chart.
    starts : (rows columns + 1,) int64
        Index of the first saddle of each bin.
    left, top : float
        Origin of the first bin, in pixels.
    side : float
        Side of a bin, in pixels.
    """

    points: Complex
    axes: Complex
    merits: Array
    starts: Indices
    rows: int
    columns: int
    left: float
    top: float
    side: float


def field_of(points: Complex, axes: Complex, merits: Array, side: float) -> tuple[Field, Indices]:
    """Sort saddles (n > 0,) into bins; return them with their original indices."""
    left, top = float(points.real.min()), float(points.imag.min())
    rows, columns = int((points.imag.max() - top) / side) + 1, int((points.real.max() - left) / side) + 1
    order, starts = _sorted_into_bins(points, left, top, side, rows, columns)
    return Field(points[order], axes[order], merits[order], starts, rows, columns, left, top, side), order


@compiled
def _sorted_into_bins(
    points: Complex, left: float, top: float, side: float, rows: int, columns: int
) -> tuple[Indices, Indices]:
    """Permutation (n,) that sorts the saddles by bins, and the start of each bin in it."""
    bins, starts = np.empty(len(points), np.int64), np.zeros(rows * columns + 1, np.int64)
    for n in range(len(points)):
        bins[n] = np.int64((points[n].imag - top) / side) * columns + np.int64((points[n].real - left) / side)
        starts[bins[n] + 1] += 1
    following = np.empty(len(starts), np.int64)
    for b in range(len(starts)):
        starts[b] += starts[b - 1] if b > 0 else 0
        following[b] = starts[b]
    order = np.empty(len(points), np.int64)
    for n in range(len(points)):
        order[following[bins[n]]] = n
        following[bins[n]] += 1
    return order, starts


@compiled
def bins_within(field: Field, place: complex, reach: float) -> tuple[int, int, int, int]:
    """First and last row, first and last column of bins within `reach` of a place; last < first for none."""
    if not (abs(place) < FAR):
        return 0, -1, 0, -1
    x, y = (place.real - field.left) / field.side, (place.imag - field.top) / field.side
    r = reach / field.side
    top, bottom = max(np.floor(y - r), 0.0), min(np.floor(y + r), field.rows - 1.0)
    first, last = max(np.floor(x - r), 0.0), min(np.floor(x + r), field.columns - 1.0)
    if last < first:
        return 0, -1, 0, -1
    return int(top), int(bottom), int(first), int(last)


@compiled
def alike(field: Field, i: int, j: int, same_axis: float, same_merit: float) -> bool:
    """Whether two saddles have nearly the same axis, and merits within a ratio."""
    a, b = field.merits[i], field.merits[j]
    cosine = (field.axes[i] * field.axes[j].conjugate()).real
    return bool(cosine > same_axis and a < same_merit * b and b < same_merit * a)


@compiled
def nearest(field: Field, place: complex, reach: float, like: int, same_axis: float, same_merit: float) -> int:
    """Nearest saddle within reach of a place that is similar to a given one; -1 for none."""
    best, found = reach * reach, -1
    top, bottom, first, last = bins_within(field, place, reach)
    for row in range(top, bottom + 1):
        for n in range(field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]):
            d = field.points[n] - place
            distance = d.real * d.real + d.imag * d.imag
            if distance <= best and alike(field, n, like, same_axis, same_merit):
                best, found = distance, n
    return found


@compiled
def all_nearest(
    field: Field, places: Complex, reaches: Array, likes: Indices, same_axis: float, same_merit: float
) -> Indices:
    """`nearest` for places (n, m), with reaches (n,) and similar to the saddles of indices (n,)."""
    out = np.empty(places.shape, np.int64)
    for i in range(places.shape[0]):
        for j in range(places.shape[1]):
            out[i, j] = nearest(field, places[i, j], reaches[i], likes[i], same_axis, same_merit)
    return out


@compiled
def non_maximum_suppression(field: Field, radius: float, same_axis: float) -> npt.NDArray[np.bool_]:
    """Mask of the saddles with no better one of similar axis within a radius; the last of equal ones."""
    alone = np.empty(len(field.points), np.bool_)
    for i in range(len(field.points)):
        place, alone[i] = field.points[i], True
        top, bottom, first, last = bins_within(field, place, radius)
        for row in range(top, bottom + 1):
            for j in range(field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]):
                more = field.merits[j] > field.merits[i] or (field.merits[j] == field.merits[i] and j > i)
                d = field.points[j] - place
                if more and d.real * d.real + d.imag * d.imag <= radius * radius:
                    alone[i] &= (field.axes[i] * field.axes[j].conjugate()).real <= same_axis
    return alone
