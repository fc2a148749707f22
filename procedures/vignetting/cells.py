"""Averages of a flat over cells of the frame, with their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import Refused
from procedures.raw import Plane

COLUMNS = 32  # cells along the longer side: vignetting is smooth over many of them
LEAST_SIDE = 4  # minimum number of samples along a cell's side
CLIPPED, MOST_CLIPPED = 0.98, 1e-3  # level of a clipped sample, and the accepted share of them
DARK = 0.02  # minimum of a flat's median on the scale


@dataclass(frozen=True, eq=False)
class LightCells:
    """Averages over cells.

    place : (n, 2), (x, y) of the cells' centres, in pixels of the plane
    level : (n,), sigma : (n,); mean, and its standard deviation by the noise of the samples, including fixed pattern
    """

    place: Array
    level: Array
    sigma: Array


def cells_of(plane: Plane, source: str) -> LightCells:
    """The cells of a flat's plane. Raises Refused if it is clipped, dark, or too small."""
    rows, columns = plane.samples.shape
    side = max(rows, columns) // COLUMNS
    if side < LEAST_SIDE or min(rows, columns) < 6 * side:
        raise Refused(
            f"{source}: a flat needs {COLUMNS * LEAST_SIDE} pixels along its longer side; {plane.name} is "
            f"{columns} x {rows}",
            "give whole photographs of the sensor",
        )
    _check_light(plane, source)
    ny, nx = rows // side, columns // side
    top, left = (rows - ny * side) // 2, (columns - nx * side) // 2
    part = plane.samples[top : top + ny * side, left : left + nx * side].astype(np.float64)
    blocks = part.reshape(ny, side, nx, side)
    level = blocks.mean(axis=(1, 3))
    steps = np.diff(blocks, axis=3)
    variance = np.mean(steps**2, axis=(1, 3)) / 2 + plane.quantisation**2 / 12
    y, x = np.meshgrid(
        top + side * np.arange(ny) + (side - 1) / 2, left + side * np.arange(nx) + (side - 1) / 2, indexing="ij"
    )
    place = np.column_stack([x.ravel(), y.ravel()])
    return LightCells(place, level.ravel(), np.sqrt(variance.ravel()) / side)


def _check_light(plane: Plane, source: str) -> None:
    clipped = float(np.mean(plane.samples >= CLIPPED))
    if clipped > MOST_CLIPPED:
        raise Refused(f"{source}: {clipped:.1%} of {plane.name} are clipped", "expose a flat to half of the scale")
    middle = float(np.median(plane.samples))
    if middle < DARK:
        raise Refused(
            f"{source}: {plane.name} is at {middle:.1%} of the scale, too dark for a flat",
            "expose a flat to half of the scale",
        )
