"""Positions of the chart in the frame, their order, and the moves of a rig that bring the chart there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from procedures.numerics.arrays import Array
from procedures.numerics.scattered import monomials
from procedures.outcome import BadParameter

CANDIDATES = 25  # candidate positions along the longer side
AHEAD: Array = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Location:
    """Position of a chart's centre, in fractions of the frame's width and height from the top left."""

    x: float
    y: float

    def in_pixels(self, shape: tuple[int, int]) -> tuple[float, float]:
        """(x, y) in pixels of a plane with that many rows and columns."""
        return self.x * shape[1] - 0.5, self.y * shape[0] - 0.5


def chosen_locations(n: int, aspect: float = 1.5) -> list[Location]:
    """The n positions, up to the frame's sides, that determine a smooth surface best, in an order with short moves.

    They are the pivots of the QR decomposition of the monomials over a fine grid (approximate Fekete points), of the
    highest degree that n determine; further ones are placed in the largest gaps.

    aspect : width over height of the frame

    Source: Sommariva, Vianello, Computing approximate Fekete points by QR factorizations of Vandermonde matrices, 2009.
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
    chosen: list[int] = scipy.linalg.qr(V.T, mode="r", pivoting=True)[1][: V.shape[1]].tolist()
    while len(chosen) < n:
        apart = (candidates[:, None] - candidates[chosen]) * [aspect, 1.0]
        chosen.append(int(np.argmax(np.hypot(*apart.T).min(axis=0))))
    return [Location(float(a), float(b)) for a, b in _boustrophedon(0.5 + candidates[chosen] / 2)]


def _boustrophedon(places: Array) -> Array:
    """The positions in bands from top to bottom, every other band from right to left."""
    bands = max(round(np.sqrt(len(places))), 1)
    order = np.array_split(np.argsort(places[:, 1], kind="stable"), bands)
    ways = [part[np.argsort(places[part, 0])][:: 1 if i % 2 == 0 else -1] for i, part in enumerate(order)]
    return np.asarray(places[np.concatenate(ways)])


def ray(location: Location, shape: tuple[int, int], principal_px: float) -> Array:
    """Unit vector (3,) from the camera to a position of its frame: x right, y down, z ahead.

    shape : rows and columns of the sensor or of a plane; principal_px : distance of the image from the lens in the same
    pixels: focal length over pitch.
    """
    x, y = location.in_pixels(shape)
    towards = np.array([x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2, principal_px])
    return np.asarray(towards / np.linalg.norm(towards))


def direction(ray: Array, pan_deg: float, tilt_deg: float) -> Array:
    """A ray of the camera in the axes of the head, R_y(pan) R_x(tilt) ray: both right-handed, y down."""
    (cp, sp), (ct, st) = ((np.cos(a), np.sin(a)) for a in np.radians([pan_deg, tilt_deg]))
    R_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    R_x = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    return np.asarray(R_y @ R_x @ ray)


def pan_tilt_deg(
    location: Location, shape: tuple[int, int], principal_px: float, towards: Array = AHEAD
) -> tuple[float, float]:
    """Pan and tilt at which the chart appears at a position of the frame.

    A camera that is panned (about its vertical), then tilted (about its horizontal) sees the direction d as the ray
    t = R^-1 d. Rotated back by the tilt, t keeps its x; rotated by the pan, d keeps its y: R_x(tilt) t = R_y(pan)^-1 d
    is two equations, in x for the pan and in y for the tilt.

    shape, principal_px : as in `ray`; towards : (3,) direction of the chart's centre, in the axes of a head at rest.
    """
    t, d = ray(location, shape, principal_px), towards / np.linalg.norm(towards)
    pan = np.arctan2(d[0], d[2]) - np.arcsin(t[0] / np.hypot(d[0], d[2]))
    tilt = np.arctan2(t[1], t[2]) - np.arcsin(d[1] / np.hypot(t[1], t[2]))
    return float(np.degrees(pan)), float(np.degrees(tilt))


def rail_mm(location: Location, shape: tuple[int, int], principal_px: float, distance_mm: float) -> tuple[float, float]:
    """Moves of the camera to the right and down by which a chart on the axis appears at a position of the frame."""
    x, y = location.in_pixels(shape)
    scale = distance_mm / principal_px
    return -(x - (shape[1] - 1) / 2) * scale, -(y - (shape[0] - 1) / 2) * scale
