"""Where in the frame to measure, in order, and how a rig brings a chart there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from procedures.numerics.scattered import monomials
from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]

MARGIN = 0.12
"""How near to the frame's sides the chart's centre comes, in fractions of the frame."""
CANDIDATES = 25
"""Places along the longer side from which the chosen ones are taken."""


@dataclass(frozen=True)
class Location:
    """Where a chart's centre shall be, in fractions of the frame's width and height from the top left."""

    x: float
    y: float

    def in_pixels(self, shape: tuple[int, int]) -> tuple[float, float]:
        """(x, y) in pixels of a plane with that many rows and columns."""
        return self.x * shape[1] - 0.5, self.y * shape[0] - 0.5


def grid_locations(columns: int, rows: int, margin: float = MARGIN) -> list[Location]:
    """A grid, row by row, every other row from right to left: the shortest way for a rig.

    Raises
    ------
    BadParameter
        If there is no column or row, or the margin leaves nothing of the frame.
    """
    if columns < 1 or rows < 1 or not 0 <= margin < 0.5:
        raise BadParameter(
            f"a grid needs columns, rows and a margin below one half; got {columns} x {rows}, margin {margin}",
            "choose for example 5 x 5 and 0.12",
        )
    x, y = (np.linspace(margin, 1 - margin, n) if n > 1 else np.array([0.5]) for n in (columns, rows))
    return [Location(float(a), float(b)) for i, b in enumerate(y) for a in (x if i % 2 == 0 else x[::-1])]


def chosen_locations(n: int, aspect: float = 1.5, margin: float = MARGIN) -> list[Location]:
    """The n places that determine a smooth surface best, in an order with short ways.

    They are the pivots of the QR decomposition of the monomials over a fine grid (approximate Fekete points), of the
    highest degree that n determine; what n exceeds these by goes where the largest gaps are.

    Parameters
    ----------
    aspect : float
        Width over height of the frame.

    References
    ----------
    Sommariva, Vianello, Computing approximate Fekete points by QR factorizations of Vandermonde matrices, 2009.
    """
    if n < 3:
        raise BadParameter(f"a surface needs three places or more; got {n}", "choose 6 or more")
    columns, rows = CANDIDATES, max(round(CANDIDATES / aspect), 3)
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    candidates = np.column_stack([x.ravel(), y.ravel()])
    degree = 0
    while (degree + 2) * (degree + 3) // 2 <= n:
        degree += 1
    V = monomials(candidates, degree)
    pivots = scipy.linalg.qr(V.T, mode="r", pivoting=True)[1][: V.shape[1]]
    chosen: list[int] = pivots.tolist()
    while len(chosen) < n:
        apart = (candidates[:, None] - candidates[chosen]) * [aspect, 1.0]
        chosen.append(int(np.argmax(np.hypot(*apart.T).min(axis=0))))
    places = 0.5 + candidates[chosen] * (0.5 - margin)
    return [Location(float(a), float(b)) for a, b in _short_way(places)]


def _short_way(places: Array) -> Array:
    """The places in bands from top to bottom, every other band from right to left."""
    bands = max(round(np.sqrt(len(places))), 1)
    order = np.array_split(np.argsort(places[:, 1], kind="stable"), bands)
    ways = [part[np.argsort(places[part, 0])][:: 1 if i % 2 == 0 else -1] for i, part in enumerate(order)]
    return np.asarray(places[np.concatenate(ways)])


AHEAD: Array = np.array([0.0, 0.0, 1.0])


def ray(location: Location, shape: tuple[int, int], principal_px: float) -> Array:
    """The direction, of length 1, in which the camera sees a place of its frame: x right, y down, z ahead.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the sensor or of a plane.
    principal_px : float
        Distance of the lens's image from the sensor in the same pixels: focal length over pitch.
    """
    x, y = location.in_pixels(shape)
    seen = np.array([x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2, principal_px])
    return np.asarray(seen / np.linalg.norm(seen))


def direction(seen: Array, pan_deg: float, tilt_deg: float) -> Array:
    """Where a ray of the camera points for the head, R_y(pan) R_x(tilt) of it: both right-handed, y down."""
    (cp, sp), (ct, st) = ((np.cos(a), np.sin(a)) for a in np.radians([pan_deg, tilt_deg]))
    R_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    R_x = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    return np.asarray(R_y @ R_x @ seen)


def pan_tilt_deg(
    location: Location, shape: tuple[int, int], principal_px: float, towards: Array = AHEAD
) -> tuple[float, float]:
    """Pan and tilt with which the chart appears at a place in the frame.

    A camera that is panned (about its vertical), then tilted (about its horizontal) sees the direction d as the ray
    t = R^-1 d. Turned back by the tilt, t keeps its x; turned by the pan, d keeps its y: R_x(tilt) t = R_y(pan)^-1 d
    is two equations, in x for the pan and in y for the tilt.

    Parameters
    ----------
    shape, principal_px
        As in `ray`.
    towards : (3,) float64
        The direction of the chart's centre, in the axes of a head at rest.
    """
    t, d = ray(location, shape, principal_px), towards / np.linalg.norm(towards)
    pan = np.arctan2(d[0], d[2]) - np.arcsin(t[0] / np.hypot(d[0], d[2]))
    tilt = np.arctan2(t[1], t[2]) - np.arcsin(d[1] / np.hypot(t[1], t[2]))
    return float(np.degrees(pan)), float(np.degrees(tilt))


def rail_mm(location: Location, shape: tuple[int, int], principal_px: float, distance_mm: float) -> tuple[float, float]:
    """How far the camera moves to the right and down so that a chart on the axis appears at a place in the frame."""
    x, y = location.in_pixels(shape)
    scale = distance_mm / principal_px
    return -(x - (shape[1] - 1) / 2) * scale, -(y - (shape[0] - 1) / 2) * scale
