"""What the positions of a focus bracket mean behind the lens: how far from it the sensor stands, in micrometres."""

from __future__ import annotations

from enum import StrEnum

from procedures.outcome import BadParameter


class Positions(StrEnum):
    """What was changed between the photographs, and what the table's millimetres tell.

    LENS: the lens's distance from the sensor, from any zero. SET: the distance that the lens is set to. CHART: the
    chart's distance from the lens, which keeps its setting.
    """

    LENS = "lens"
    SET = "set"
    CHART = "chart"


def behind_lens_um(position_mm: float, kind: Positions, focal_length_mm: float | None) -> float:
    """How far behind the lens the sensor stands, from any zero, at a position of the bracket.

    Of CHART it is against the chart's image, which moves instead. Thin lens: 1 / image + 1 / object = 1 / focal length.

    Raises
    ------
    BadParameter
        If a distance is asked of a lens whose focal length is not known, or of one that is not nearer than it.
    """
    if kind is Positions.LENS:
        return 1000 * position_mm
    if focal_length_mm is None:
        raise BadParameter(
            "distances before the lens need its focal length, which the photographs do not record",
            "give --focal-length-mm",
        )
    if position_mm <= focal_length_mm:
        raise BadParameter(
            f"a distance of {position_mm:g} mm is not beyond the focal length of {focal_length_mm:g} mm",
            "give distances in millimetres, or use --positions lens if the lens's own position is given",
        )
    image_um = 1000 * focal_length_mm * position_mm / (position_mm - focal_length_mm)
    return image_um if kind is Positions.SET else -image_um


def magnification(focal_length_mm: float, distance_mm: float) -> float:
    """Of the image against the chart at a distance from the lens."""
    return focal_length_mm / (distance_mm - focal_length_mm)
