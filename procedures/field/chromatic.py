"""Lateral colour: the displacement of one plane's image relative to another's, over the frame.

The marks centre each plane's PSF on that plane's own image, so the PSFs do not contain it. It is the difference of the
planes' registrations at the charts' centres, in pixels of the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.field.maps import COLUMNS, FieldMap, grid, mesh, radius_direction, surface_maps
from procedures.field.surfaces import Surface, fit_surface
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Hull
from procedures.outcome import Refused
from procedures.psf_field import Node, in_half_diagonals

FEWEST = 6
DEGREES = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class LateralColour:
    """Displacement of a plane's image relative to a reference, in pixels of the sensor.

    shape : rows and columns of a plane
    positions : (N, 2), positions of the charts, in pixels of the plane
    shift : (N, 2), covariance : (N, 2, 2); measured (x, y)
    surface : the shift as a function of the position in half diagonals
    charts : source and number of the compared nodes; empty where read from a file
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
        """Shift (n, 2) at points (n, 2) of the plane; beyond the charts that of the nearest position among them."""
        return self.at(Hull(self.positions).nearest(np.asarray(points, dtype=np.float64)))[0]

    def maps(self, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
        """Shift along the radius, positive outwards, and perpendicular to it, positive from x towards y."""
        angle = np.array([radius_direction(self.shape, *point) for point in mesh(*grid(self.shape, columns))])
        return surface_maps(
            self.surface, self.positions, self.shape, columns, "sensor pixel",
            [(f"lateral_colour_{name}", f"{self.plane} against {self.reference}, {name} shift",
              np.column_stack([np.cos(turned), np.sin(turned)]))
             for name, turned in (("radial", angle), ("tangential", angle + np.pi / 2))],
        )  # fmt: skip


def lateral_colour(
    plane: str, nodes: Sequence[Node], reference: str, against: Sequence[Node], shape: tuple[int, int], pitch: int
) -> LateralColour:
    """Lateral colour from two planes' nodes, matched by photograph and chart.

    pitch : sensor pixels per pixel of a plane. Raises Refused if fewer than six charts were measured in both planes.
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
