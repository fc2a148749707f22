"""Lateral colour: where one plane shows a point, less where another does, over the frame.

The marks keep each plane's PSF centred where that plane shows them, so the planes' PSFs say nothing about it: it is the
difference of their registrations, at the charts' centres, in pixels of the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.field.maps import COLUMNS, FieldMap, grid, radius_direction
from procedures.field.surfaces import Surface, fit_surface
from procedures.numerics.scattered import Hull
from procedures.outcome import Refused
from procedures.psf_field import Node, in_half_diagonals

Array = npt.NDArray[np.float64]

FEWEST = 6
DEGREES = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class LateralColour:
    """How far a plane's picture lies from that of a reference, in pixels of the sensor.

    Attributes
    ----------
    plane, reference : str
    shape : (int, int)
        Rows and columns of a plane.
    positions : (N, 2) float64
        Where it was measured, in pixels of the plane.
    shift : (N, 2) float64, covariance : (N, 2, 2) float64
        (x, y) as measured.
    surface : Surface
        Of the shift, over places in half diagonals.
    charts : tuple of (str, int)
        Which charts were compared: source and number of their nodes; empty where a file does not tell.
    """

    plane: str
    reference: str
    shape: tuple[int, int]
    positions: Array
    shift: Array
    covariance: Array
    surface: Surface
    charts: tuple[tuple[str, int], ...] = ()

    def at(self, points: Array) -> tuple[Array, Array]:
        """Shift (n, 2) and its covariance (n, 2, 2) at points (n, 2) of the plane."""
        places = in_half_diagonals(np.asarray(points, dtype=np.float64), self.shape)
        return self.surface.at(places), self.surface.covariance(places)

    def shift_at(self, points: Array) -> Array:
        """The shift alone, (n, 2), at points (n, 2) of the plane; beyond the charts that of the nearest place."""
        nearest = Hull(self.positions).nearest(np.asarray(points, dtype=np.float64))
        return np.asarray(self.surface.at(in_half_diagonals(nearest, self.shape)))

    def maps(self, columns: int = COLUMNS) -> tuple[FieldMap, FieldMap]:
        """The shift along the radius, outwards positive, and across it, from x towards y positive."""
        x, y = grid(self.shape, columns)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = Hull(self.positions).holds(points)
        shift, covariance = self.at(points)
        turn = np.array([radius_direction(self.shape, *point) for point in points])
        maps = []
        for what, angle in (("radial", turn), ("tangential", turn + np.pi / 2)):
            u = np.column_stack([np.cos(angle), np.sin(angle)])
            value = np.where(inside, np.sum(u * shift, axis=1), np.nan)
            spread = np.where(inside, np.sqrt(np.einsum("na,nab,nb->n", u, covariance, u)), np.nan)
            title = f"{self.plane} against {self.reference}, {what} shift"
            pictures = (v.reshape(len(y), len(x)) for v in (value, spread))
            maps.append(FieldMap(f"lateral_colour_{what}", title, "sensor pixel", x, y, *pictures))
        return maps[0], maps[1]


def lateral_colour(
    plane: str, nodes: Sequence[Node], reference: str, against: Sequence[Node], shape: tuple[int, int], pitch: int
) -> LateralColour:
    """Lateral colour from two planes' nodes; those of the same chart in the same photograph belong together.

    Parameters
    ----------
    pitch : int
        Sensor pixels per pixel of a plane.

    Raises
    ------
    Refused
        If fewer than six charts were measured in both planes.
    """
    known = {(node.source, node.number): node for node in against}
    pairs = [(node, known[node.source, node.number]) for node in nodes if (node.source, node.number) in known]
    if len(pairs) < FEWEST:
        raise Refused(
            f"lateral colour needs {FEWEST} charts measured in both planes; {plane} and {reference} have {len(pairs)}",
            "photograph the chart at more places",
        )
    positions = np.array([a.position for a, _ in pairs])
    shift = np.array([a.sensor_position - b.sensor_position for a, b in pairs])
    covariance = np.array([pitch**2 * (a.position_covariance + b.position_covariance) for a, b in pairs])
    try:
        surface = fit_surface(in_half_diagonals(positions, shape), shift, covariance, DEGREES)
    except ValueError as error:
        raise Refused(f"lateral colour of {plane}: {error}", "spread the places over the frame") from error
    charts = tuple((a.source, a.number) for a, _ in pairs)
    return LateralColour(plane, reference, shape, positions, shift, covariance, surface, charts)
