"""Types of arrays, quantiles by sorting, and a spatial index of saddles in square bins, contiguous in memory."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt


class BinnedSaddles(NamedTuple):
    """Saddles sorted by bins, one row of bins after the other.

    points, axes : (n,) complex128 as in `marks.Saddles`
    merits : (n,) merit by which saddles compete: strength, for those of a chart
    starts : (rows columns + 1,) int64 index of the first saddle of each bin
    left, top : origin of the first bin, in pixels
    side : side of a bin, in pixels
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


class LayoutRules(NamedTuple):
    """Limits that decide which saddles may be x-corners of one chart, for `loops.layouts`.

    min_step, max_step : range of lattice steps, in pixels
    along_axis : least cosine of twice the angle between a lattice direction and the axes, or across them
    same_axis : least cosine of twice the angle between similar axes
    same_merit : greatest ratio of similar merits
    collinear : greatest distance of a third x-corner from its extrapolation by two, in steps
    middle_radius : radius about the middle of a step, in steps; a finer lattice has a similar saddle there in every
        step
    square : greatest distance of an x-corner from its prediction by a side of a square, in steps
    level_slope : slope below which a line is tested in both directions
    min_near, min_near_crowded : least number of hits of the five x-corners nearest to a triple, without and with a
        saddle in the middle of one of its steps, which is common in textures
    """

    min_step: float
    max_step: float
    along_axis: float
    same_axis: float
    same_merit: float
    collinear: float
    middle_radius: float
    square: float
    level_slope: float
    min_near: int
    min_near_crowded: int


def field_of(points: Complex, axes: Complex, merits: Array, side: float) -> tuple[BinnedSaddles, Indices]:
    """Sort saddles (n > 0,) into bins; return them with their original indices."""
    left, top = float(points.real.min()), float(points.imag.min())
    rows, columns = int((points.imag.max() - top) / side) + 1, int((points.real.max() - left) / side) + 1
    bins = ((points.imag - top) / side).astype(np.int64) * columns + ((points.real - left) / side).astype(np.int64)
    starts = np.concatenate([[0], np.cumsum(np.bincount(bins, minlength=rows * columns))])
    order = np.argsort(bins, kind="stable")
    return BinnedSaddles(points[order], axes[order], merits[order], starts, rows, columns, left, top, side), order


# --- Quantiles and distinct values by sorting: NumPy's own import masked arrays, a tenth of a whole command's time ---

Value = TypeVar("Value", bound=np.generic)


def quantile(values: npt.NDArray[np.floating[Any]], share: float) -> float:
    """Quantile of the values (n > 0,), with linear interpolation."""
    place = share * (len(values) - 1)
    below = int(place)
    above = min(below + 1, len(values) - 1)
    low, high = np.partition(values, (below, above))[[below, above]].tolist()
    return float(low + (high - low) * (place - below))


def distinct(values: npt.NDArray[Value]) -> npt.NDArray[Value]:
    """Distinct values of (n,), in ascending order."""
    ordered = np.sort(values)
    new = np.ones(len(ordered), dtype=np.bool_)
    new[1:] = ordered[1:] != ordered[:-1]
    return np.asarray(ordered[new])


# --- Types of arrays, by their numbers ---

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
