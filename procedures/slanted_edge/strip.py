"""Region of an edge: a rectangle of a plane, transposed so that the edge runs along its rows."""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array, Array32, Mask
from procedures.outcome import BadParameter
from procedures.slanted_edge.tail import Tail

MIN_SIDE = 8  # least side of a rectangle, in pixels


@dataclass(frozen=True)
class Roi:
    """A rectangle of a plane: first pixel (x, y) and size, in pixels of the plane."""

    x: int
    y: int
    width: int
    height: int

    @classmethod
    def whole(cls, samples: Array32) -> "Roi":
        """All of a plane."""
        rows, columns = samples.shape
        return cls(0, 0, columns, rows)

    def cut(self, samples: Array32) -> Array:
        """Samples of the rectangle, (height, width). Raises BadParameter if it is not in the plane, or below 8 x 8."""
        rows, columns = samples.shape
        inside = self.x >= 0 and self.y >= 0 and self.x + self.width <= columns and self.y + self.height <= rows
        if not inside:
            raise BadParameter(
                f"the region must lie in the plane of {columns} x {rows} pixels; got {self}",
                "give --roi X,Y,W,H in pixels of the plane: a Bayer plane has half the sensor's columns and rows",
            )
        if min(self.width, self.height) < MIN_SIDE:
            raise BadParameter(
                f"the region must have {MIN_SIDE} x {MIN_SIDE} pixels or more; got {self}", "give a larger --roi"
            )
        part = samples[self.y : self.y + self.height, self.x : self.x + self.width]
        return np.asarray(part, dtype=np.float64)

    def __str__(self) -> str:
        return f"{self.width} x {self.height} pixels at ({self.x}, {self.y})"


@dataclass(frozen=True)
class EdgeLine:
    """Expected edge: within `near_px` of x = middle + slope t, t along the edge from the strip's centre."""

    middle: float
    slope: float
    near_px: float = 4.0


@dataclass(frozen=True)
class Strip:
    """Samples around an edge, the edge running along axis 0.

    samples : (n, m) n pixels along the edge, m across
    roi : their rectangle in the plane
    turned : whether they are transposed: the edge is nearer to horizontal
    reach_px : distance from the edge at which its plains end
    valid : (n, m) bool or None; samples of the edge and its plains; None for all
    tail : prior of the approach to the plains, where there is one
    quantisation : one digital number, in units of the samples
    raw : whether they come from a RAW file or a dump: no program has processed them
    mirrored : (n, m) the plane mirrored through its centre and blurred, as a ghost of it lies there; None if not known
    """

    samples: Array
    roi: Roi
    turned: bool
    reach_px: float = np.inf
    valid: Mask | None = None
    tail: Tail | None = None
    quantisation: float = 0.0
    raw: bool = False
    mirrored: Array | None = None

    @property
    def usable(self) -> Mask:
        """Samples of the edge and its plains, whatever their distance, (n, m)."""
        return np.ones(self.samples.shape, dtype=np.bool_) if self.valid is None else self.valid

    @property
    def along(self) -> Array:
        """Position of each row along the edge, (n,), 0 in the middle."""
        n = len(self.samples)
        return np.arange(n, dtype=np.float64) - (n - 1) / 2


def strip_of(samples: Array32, roi: Roi, *, turned: bool | None = None, reach_px: float = np.inf) -> Strip:
    """The strip of a rectangle; its gradients show the direction of the edge where `turned` is not given."""
    part = roi.cut(samples)
    if turned is None:
        down, across = (_structure(np.diff(part, axis=axis)) for axis in (0, 1))
        turned = down > across
    return Strip(np.ascontiguousarray(part.T if turned else part), roi, turned, reach_px)


def _structure(steps: Array) -> float:
    """Mean product of neighbouring steps: white noise contributes nothing on average."""
    return float(np.mean(steps[1:] * steps[:-1]) + np.mean(steps[:, 1:] * steps[:, :-1]))
