"""The sensor's plane from the PSFs of a focus bracket: tilt, backfocus, curvature, and the correcting turns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
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
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Check, Outcome, Quantity, Verdict, verdict_of, with_refusal
from procedures.psf_field import Node
from procedures.tilt.plane import (
    Positions,
    Screws,
    TiltedPlane,
    Turns,
    behind_lens_um,
    fit_plane,
    magnification,
    turns_for,
)

UNLIKELY = 0.001  # probability of larger residuals below which they are not noise alone
LARGE_UM = 5.0  # uncertainty of the tilt over the frame above which it is doubtful
SIGNIFICANT = 2.0  # standard uncertainties from which an offset is significant


@dataclass(frozen=True)
class TiltParameters:
    """Parameters of camera, bracket and screws.

    pixel_pitch_um : pitch of the sensor
    positions : meaning of the bracket's positions in mm
    distance_mm : distance of the chart from the lens, where the positions do not give it
    position_uncertainty_mm : standard uncertainty of each position
    chart_tilt_deg : standard uncertainty of the chart's squareness to the lens's axis, about each of two axes: the
        image of a tilted chart is tilted by the magnification times as much
    nominal_mm : position at which the sensor should be in focus; None for the tilt alone
    nominal_uncertainty_mm : its standard uncertainty, common to all heights
    frequency : frequency of the followed MTF, in cycles per pixel of the plane
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
    """The sensor relative to the surface of best focus, and its correction.

    astigmatism : (N,), distance of sagittal focus behind meridional focus at the places, in um; with_focus : whether
    the nominal position is known, so that the offset is meaningful; chart_slope : `chart_slope`, in um/mm.
    """

    sensor: TiltedPlane
    astigmatism: Array
    screws: Screws
    turns: Turns
    with_focus: bool
    chart_slope: float = 0.0

    def numbers(self) -> dict[str, Quantity]:
        """Tilt over width and height, of the whole frame, backfocus and its shim, and the lens's curvature."""
        plane, n = self.sensor, len(self.sensor.heights_um)
        (width, height), half = plane.size_mm, float(np.hypot(*plane.size_mm)) / 2
        rows: dict[str, tuple[Array, str]] = {
            TILT_HORIZONTAL: (np.array([0, width, 0]), "height at the photograph's right edge over that at its left"),
            TILT_VERTICAL: (np.array([0, 0, height]), "height at the photograph's lower edge over that at its upper"),
        }
        if self.with_focus:
            rows[BACKFOCUS] = np.array([1.0, 0, 0]), "the sensor behind best focus at the nominal position, mean"
            rows[SHIM] = np.array([-1.0, 0, 0]), "required increase of a shim under the lens's mount, for the mean"
        numbers = {name: _linear(plane.plane, plane.covariance, *row, n) for name, row in rows.items()}
        if self.with_focus:
            height, variance = plane.centre
            method = "the same at the frame's centre"
            numbers[BACKFOCUS_CENTRE] = Quantity(height, "um", float(np.sqrt(variance)), method, n)
        corner = np.array([0.0, *plane.corners_mm[int(np.argmax(plane.corners_mm @ plane.plane[1:]))]])
        method = "height of the highest corner over the centre"
        numbers[TILT_CORNER] = _linear(plane.plane, plane.covariance, corner, method, n)
        bend, method = np.array([0.5, 0, 0.5]) * half**2, "mean quadratic at half the diagonal"
        numbers[FIELD_CURVATURE] = _linear(plane.curvature, plane.curvature_covariance, bend, method, n)
        return {**numbers, RMS_BEFORE: self.turns.before, RMS_AFTER: self.turns.after}

    @property
    def corner_budget(self) -> dict[str, float]:
        """Standard uncertainty in um of the highest corner, by noise and positions, and by the chart's squareness."""
        squareness = self.chart_slope * float(np.hypot(*self.sensor.size_mm)) / 2
        whole = self.numbers()[TILT_CORNER].uncertainty
        return {"noise": float(np.sqrt(max(whole**2 - squareness**2, 0.0))), "squareness": squareness}


def _linear(values: Array, covariance: Array, row: Array, method: str, n: int) -> Quantity:
    return Quantity(float(row @ values), "um", float(np.sqrt(row @ covariance @ row)), method, n)


@with_refusal
def estimate_tilt(
    bracket: Mapping[float, Sequence[Node]], shape: tuple[int, int], pitch: int, parameters: TiltParameters
) -> Outcome[Tilt]:
    """The sensor's plane from nodes at known focus positions.

    Raises BadParameter if the focal length is required and unknown, or the distance of a tilted chart.

    bracket : mapping of position in mm to nodes; of one plane; charts at about the same place of the frame are combined
    shape : rows and columns of the plane, with pixels `pitch` sensor pixels wide

    Returns
    -------
    Outcome[Tilt]
        Refused where fewer than seven places have their best focus within the bracket.
    """
    in_um = {_behind(position, parameters): nodes for position, nodes in bracket.items()}
    side = pitch * parameters.pixel_pitch_um / 1000
    size = (shape[1] * side, shape[0] * side)
    places = best_focus(in_um, shape, frequency=parameters.frequency)
    zero_um = 0.0 if parameters.nominal_mm is None else _behind(parameters.nominal_mm, parameters)
    # heights (N,) of the sensor behind the image in um, and covariance (N, N): noise of the PSFs, and the positions'
    # errors, common to a photograph's charts
    sources = sorted({name for place in places for optimum in place.optima for name in optimum.sensitivities})
    J = np.array([[sum(o.sensitivities.get(name, 0.0) for o in one.optima) / 2 for name in sources] for one in places])
    noise = np.array([place.covariance.mean() for place in places])
    best = np.array([sum(o.at for o in place.optima) / 2 for place in places])
    # standard uncertainty of the positions behind the lens, at the middle of the bracket
    middle, u = float(np.median(list(bracket))), parameters.position_uncertainty_mm
    position_um = abs(_behind(middle + u, parameters) - _behind(middle, parameters)) if u else 0.0
    heights, covariance = zero_um - best, np.diag(noise) + position_um**2 * J @ J.T
    centre = (np.array([shape[1], shape[0]]) - 1) / 2
    at = (np.array([place.position for place in places]) - centre) * side
    sensor = fit_plane(at, heights, covariance, size)
    slope = chart_slope(list(bracket), parameters)
    sensor = sensor.widened(slope**2, nominal_um(parameters) ** 2)
    with_focus = parameters.nominal_mm is not None
    turns = turns_for(sensor, parameters.screws, with_focus=with_focus)
    astigmatism = np.array([place.optima[1].at - place.optima[0].at for place in places])
    tilt = Tilt(sensor, astigmatism, parameters.screws, turns, with_focus, slope)
    return verdict_of(_checks(tilt, set(in_um), places), tilt)


def _behind(position_mm: float, parameters: TiltParameters) -> float:
    return behind_lens_um(position_mm, parameters.positions, parameters.focal_length_mm)


def nominal_um(parameters: TiltParameters) -> float:
    """Standard uncertainty of the nominal position, behind the lens, in um."""
    at, u = parameters.nominal_mm, parameters.nominal_uncertainty_mm
    return 0.0 if at is None or not u else abs(_behind(at + u, parameters) - _behind(at, parameters))


def chart_slope(positions_mm: Sequence[float], parameters: TiltParameters) -> float:
    """Standard uncertainty of the image's slopes by the chart's, in um/mm. Raises BadParameter if distance or focal
    length is unknown."""
    if not parameters.chart_tilt_deg:
        return 0.0
    by_positions = float(np.median(positions_mm)) if parameters.positions is not Positions.LENS else None
    distance, focal = parameters.distance_mm or by_positions, parameters.focal_length_mm
    if distance is None or focal is None:
        raise BadParameter(
            "the effect of a tilted chart requires its distance and the focal length, which are not known",
            "give --distance-mm and --focal-length-mm, or --chart-tilt-deg 0 for an exactly square chart",
        )
    return 1000 * magnification(focal, distance) * float(np.tan(np.radians(parameters.chart_tilt_deg)))


def _checks(tilt: Tilt, positions: set[float], places: Sequence[PlaceFocus]) -> list[Check]:
    doubtful, sensor, numbers = Verdict.DOUBTFUL, tilt.sensor, tilt.numbers()
    uncertain = max(numbers[name].uncertainty for name in (TILT_HORIZONTAL, TILT_VERTICAL))
    z = np.sort(list(positions))
    low, high = (z[0] + z[1]) / 2, (z[-1] + z[-2]) / 2
    best = [optimum.at for place in places for optimum in place.optima]
    return [
        Check("misfit", -ndtri(sensor.chance), -ndtri(UNLIKELY), doubtful,
              f"best focus differs from a smooth surface by {sensor.misfit:.1f} times its uncertainty",
              "take the bracket again; the cause is a chart that is not flat, or a lens that was touched"),
        Check("uncertainty", uncertain, LARGE_UM, doubtful,
              f"the tilt over the frame is known to {uncertain:.1f} um only",
              "square the chart more exactly and give --chart-tilt-deg, or photograph more charts, nearer to the "
              "corners"),
        Check("bracket", min(best) < low or max(best) > high, 0, doubtful,
              "at some places the best focus lies at the bracket's end", "extend the bracket on that side"),
    ]  # fmt: skip


def shim_words(tilt: Tilt) -> str:
    """Required change of the shim as a sentence without full stop, the image moving with it; "" without a nominal
    focus."""
    shim = tilt.numbers().get(SHIM)
    if shim is None:
        return ""
    size = f"{abs(shim.value):.1f} ± {shim.uncertainty:.1f} um"
    if abs(shim.value) < SIGNIFICANT * shim.uncertainty:
        return f"the backfocus of {size} does not differ from zero: do not change the shim"
    where, change, way = ("behind", "thinner", "towards") if shim.value < 0 else ("before", "thicker", "away from")
    turn = abs(shim.value) / (1000 * tilt.screws.pitch_mm)
    return (
        f"the sensor stands {size} {where} best focus: take a shim under the lens's mount that is {change} by that, or "
        f"turn every screw by {turn:.3f} {way} the lens, which their turns include; not both"
    )
