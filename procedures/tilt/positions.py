"""Distance of the sensor behind the lens for the positions of a focus bracket."""

from __future__ import annotations

from enum import StrEnum

from procedures.outcome import BadParameter


class Positions(StrEnum):
    """Meaning of the bracket's positions in millimetres.

    LENS: distance of the lens from the sensor, with any zero. SET: distance setting of the lens. CHART: distance of the
    chart from the lens, whose setting is unchanged.
    """

    LENS = "lens"
    SET = "set"
    CHART = "chart"


def behind_lens_um(position_mm: float, kind: Positions, focal_length_mm: float | None) -> float:
    """Distance of the sensor behind the lens in um, with any zero, at a position of the bracket.

    For CHART it is relative to the chart's image, which moves instead. Thin lens: 1 / image + 1 / object = 1 / focal
    length.

    Raises BadParameter if the focal length of a distance is not known, or not smaller than it.
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
    """Magnification of a chart at a distance from the lens."""
    return focal_length_mm / (distance_mm - focal_length_mm)
