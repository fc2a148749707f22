"""From the PSFs of a focus bracket to the sensor's plane: tilt, backfocus, curvature, and the turns that mend them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from procedures.field.focus import FREQUENCY, PlaceFocus, best_focus
from procedures.numbers import (
    BACKFOCUS,
    BACKFOCUS_CENTRE,
    FIELD_CURVATURE,
    RMS_AFTER,
    RMS_BEFORE,
    SHIM,
    TILT_CORNER,
    TILT_HORIZONTAL,
    TILT_VERTICAL,
)
from procedures.outcome import BadParameter, Check, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.psf_field import Node
from procedures.tilt.plane import SensorPlane, fit_plane
from procedures.tilt.positions import Positions, behind_lens_um, magnification
from procedures.tilt.screws import Screws, Turns, turns_for

Array = npt.NDArray[np.float64]

UNLIKELY = 0.001
"""Chance of residuals as large below which something else than noise is in them."""
LARGE_UM = 5.0
"""A tilt over the frame known less well than that is doubted."""


@dataclass(frozen=True)
class TiltParameters:
    """What is known of camera, bracket and screws.

    Attributes
    ----------
    pixel_pitch_um : float
        Of the sensor's pixels.
    positions : Positions
        What the bracket's positions, in mm, tell.
    focal_length_mm : float or None
    distance_mm : float or None
        Of the chart from the lens, where the positions do not tell it.
    position_uncertainty_mm : float
        Standard uncertainty of each position, in its own unit.
    chart_tilt_deg : float
        Standard uncertainty of the chart's squareness to the lens's axis, about each of two axes: the image of a chart
        that is tilted is tilted too, by the magnification less.
    nominal_mm : float or None
        The position at which the sensor should be in focus; None where only the tilt is asked for.
    nominal_uncertainty_mm : float
        Its standard uncertainty: all heights share it, the tilt does not.
    screws : Screws
    frequency : float
        In cycles per pixel of the plane, at which the MTF is followed.
    """

    pixel_pitch_um: float
    positions: Positions = Positions.LENS
    focal_length_mm: float | None = None
    distance_mm: float | None = None
    position_uncertainty_mm: float = 0.0
    chart_tilt_deg: float = 0.3
    nominal_mm: float | None = None
    nominal_uncertainty_mm: float = 0.0
    screws: Screws = field(default_factory=Screws)
    frequency: float = FREQUENCY


@dataclass(frozen=True, eq=False)
class Tilt:
    """The sensor against the surface of best focus, and what mends it.

    Attributes
    ----------
    sensor : SensorPlane
    astigmatism : (N,) float64
        At the places: how far sagittal detail is in focus behind meridional, in um.
    screws : Screws
    turns : Turns
        Of these screws.
    with_focus : bool
        Whether the nominal position was told, so that the offset means something.
    """

    sensor: SensorPlane
    astigmatism: Array
    screws: Screws
    turns: Turns
    with_focus: bool

    def numbers(self) -> dict[str, Quantity]:
        """Tilt over width and height, of the whole frame, backfocus and its shim, and the lens's curvature."""
        found, n = self.sensor, len(self.sensor.heights_um)
        (width, height), half = found.size_mm, float(np.hypot(*found.size_mm)) / 2
        rows: dict[str, tuple[Array, str]] = {
            TILT_HORIZONTAL: (np.array([0, width, 0]), "height at the photograph's right edge over that at its left"),
            TILT_VERTICAL: (np.array([0, 0, height]), "height at the photograph's lower edge over that at its upper"),
        }
        if self.with_focus:
            rows[BACKFOCUS] = np.array([1.0, 0, 0]), "the sensor behind best focus at the nominal position, mean"
            rows[SHIM] = np.array([-1.0, 0, 0]), "what a shim under the lens's mount has to be thicker, for the mean"
        numbers = {name: _linear(found.plane, found.covariance, *row, n) for name, row in rows.items()}
        if self.with_focus:
            height, variance = found.centre
            method = "the same at the frame's centre"
            numbers[BACKFOCUS_CENTRE] = Quantity(height, "um", float(np.sqrt(variance)), method, n)
        corner = found.corners_mm[int(np.argmax(found.corners_mm @ found.plane[1:]))]
        row = np.array([0.0, *corner])
        numbers[TILT_CORNER] = _linear(
            found.plane, found.covariance, row, "height of the highest corner over the centre", n
        )
        bend = np.array([0.5, 0, 0.5]) * half**2
        numbers[FIELD_CURVATURE] = _linear(
            found.curvature, found.curvature_covariance, bend, "mean quadratic at half the diagonal", n
        )
        return {**numbers, RMS_BEFORE: self.turns.before, RMS_AFTER: self.turns.after}


def _linear(values: Array, covariance: Array, row: Array, method: str, n: int) -> Quantity:
    return Quantity(float(row @ values), "um", float(np.sqrt(row @ covariance @ row)), method, n)


def estimate_tilt(
    bracket: Mapping[float, Sequence[Node]], shape: tuple[int, int], pitch: int, parameters: TiltParameters
) -> Outcome[Tilt]:
    """The sensor's plane from nodes at known focus positions.

    Parameters
    ----------
    bracket : mapping of position in mm to nodes
        Of one plane; charts at about the same place of the frame belong together.
    shape : (int, int)
        Rows and columns of the plane, whose pixels are `pitch` of the sensor's wide.

    Returns
    -------
    Outcome[Tilt]
        Refused where fewer than seven places have their best focus within the bracket.

    Raises
    ------
    BadParameter
        If distances are asked of a lens of unknown focal length, or a chart's tilt of one of unknown distance.
    """
    in_um = {_behind(position, parameters): nodes for position, nodes in bracket.items()}
    side = pitch * parameters.pixel_pitch_um / 1000
    size = (shape[1] * side, shape[0] * side)
    try:
        places = best_focus(in_um, shape, frequency=parameters.frequency)
        heights, covariance = heights_of(places, _zero_um(parameters), _position_um(bracket, parameters))
        centre = (np.array([shape[1], shape[0]]) - 1) / 2
        at = (np.array([one.position for one in places]) - centre) * side
        found = fit_plane(at, heights, covariance, size)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    found = found.widened(chart_slope(list(bracket), parameters) ** 2, nominal_um(parameters) ** 2)
    with_focus = parameters.nominal_mm is not None
    turns = turns_for(found, parameters.screws, with_focus=with_focus)
    astigmatism = np.array([one.optima[1].at - one.optima[0].at for one in places])
    tilt = Tilt(found, astigmatism, parameters.screws, turns, with_focus)
    return verdict_of(_checks(tilt, set(in_um), places), tilt)


def heights_of(places: Sequence[PlaceFocus], zero_um: float, position_um: float) -> tuple[Array, Array]:
    """Heights (N,) of the sensor behind the image in um, with their covariance (N, N).

    The noise of the PSFs is each place's own; the errors of the positions are common to all charts of a photograph.
    """
    sources = sorted({name for one in places for top in one.optima for name in top.sensitivities})
    sways = np.array(
        [[sum(top.sensitivities.get(name, 0.0) for top in one.optima) / 2 for name in sources] for one in places]
    )
    noise = np.array([sum(top.variance for top in one.optima) / 4 for one in places])
    best = np.array([sum(top.at for top in one.optima) / 2 for one in places])
    return zero_um - best, np.diag(noise) + position_um**2 * sways @ sways.T


def _behind(position_mm: float, parameters: TiltParameters) -> float:
    return behind_lens_um(position_mm, parameters.positions, parameters.focal_length_mm)


def _zero_um(parameters: TiltParameters) -> float:
    return 0.0 if parameters.nominal_mm is None else _behind(parameters.nominal_mm, parameters)


def nominal_um(parameters: TiltParameters) -> float:
    """Standard uncertainty of the nominal position, behind the lens."""
    at, u = parameters.nominal_mm, parameters.nominal_uncertainty_mm
    return 0.0 if at is None or not u else abs(_behind(at + u, parameters) - _behind(at, parameters))


def _position_um(bracket: Mapping[float, Sequence[Node]], parameters: TiltParameters) -> float:
    """Standard uncertainty of the positions behind the lens, at the middle of the bracket."""
    middle, u = float(np.median(list(bracket))), parameters.position_uncertainty_mm
    return abs(_behind(middle + u, parameters) - _behind(middle, parameters)) if u else 0.0


def chart_slope(positions_mm: Sequence[float], parameters: TiltParameters) -> float:
    """Standard uncertainty of the image's slopes that comes from the chart's, in um/mm.

    Raises
    ------
    BadParameter
        If the chart's distance or the focal length is not known.
    """
    if not parameters.chart_tilt_deg:
        return 0.0
    told = float(np.median(positions_mm)) if parameters.positions is not Positions.LENS else None
    distance, focal = parameters.distance_mm or told, parameters.focal_length_mm
    if distance is None or focal is None:
        raise BadParameter(
            "what a tilted chart does to the image depends on its distance and the focal length, which are not known",
            "give --distance-mm and --focal-length-mm, or --chart-tilt-deg 0 for a chart that is square for certain",
        )
    return 1000 * magnification(focal, distance) * float(np.tan(np.radians(parameters.chart_tilt_deg)))


def _checks(tilt: Tilt, positions: set[float], places: Sequence[PlaceFocus]) -> list[Check]:
    doubtful, found, numbers = Verdict.DOUBTFUL, tilt.sensor, tilt.numbers()
    uncertain = max(numbers[name].uncertainty for name in (TILT_HORIZONTAL, TILT_VERTICAL))
    z = np.sort(list(positions))
    low, high = (z[0] + z[1]) / 2, (z[-1] + z[-2]) / 2
    tops = [top.at for one in places for top in one.optima]
    return [
        Check("misfit", -ndtri(found.chance), -ndtri(UNLIKELY), doubtful,
              f"best focus differs from a smooth surface by {found.misfit:.1f} times its uncertainty",
              "take the bracket again; a chart that is not flat, or a lens that was touched, makes this"),
        Check("uncertainty", uncertain, LARGE_UM, doubtful,
              f"the tilt over the frame is known to {uncertain:.1f} um only",
              "hang the chart squarer and say so by --chart-tilt-deg, or photograph more charts, nearer to the "
              "corners"),
        Check("bracket", min(tops) < low or max(tops) > high, 0, doubtful,
              "at some places the best focus lies at the bracket's end", "extend the bracket on that side"),
    ]  # fmt: skip
