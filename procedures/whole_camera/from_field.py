"""The parts of a camera that a field's charts tell: the PSF's numbers at every place, lateral colour, geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.field.chromatic import LateralColour
from procedures.field.conclusion import FieldResult
from procedures.field.estimate import MeasuredChart
from procedures.geometry.chart_bins.photographs import on_sensor
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.uncertainty import camera_response
from procedures.geometry.views import ChartView
from procedures.outcome import Outcome, Verdict
from procedures.psf_field import Node, prior_sensitivity
from procedures.whole_camera.joint import ChartKey, JointNumbers, Part, join

Array = npt.NDArray[np.float64]

CHARTS = "the charts"
"""Where these parts come from."""
SENSOR = "sensor"
"""What the part of the sensor's numbers is called, and the term of a budget that its response adds."""


@dataclass(frozen=True, eq=False)
class WholeCamera:
    """What one session tells of a camera.

    Attributes
    ----------
    numbers : JointNumbers
    places : tuple of (str, MeasuredChart)
        Plane and chart of every place at which the PSF's numbers are told, in their order.
    colours : tuple of LateralColour
        Whose polynomials' coefficients are told.
    geometry : Outcome[Geometry]
        Refused where the charts do not tell it.
    """

    numbers: JointNumbers
    places: tuple[tuple[str, MeasuredChart], ...]
    colours: tuple[LateralColour, ...]
    geometry: Outcome[Geometry]


def whole_camera(
    found: FieldResult, cell_mm: float, others: Sequence[Part] = (), views: Sequence[ChartView] = ()
) -> WholeCamera:
    """The camera of a field.

    Parameters
    ----------
    found : FieldResult
    cell_mm : float
        Side of a printed cell: distances hang on it, the camera does not.
    others : sequence of Part
        What other photographs tell.
    views : sequence of ChartView
        The same chart in photographs for the geometry alone, turned away or elsewhere.
    """
    charts = charts_of(found)
    geometry = field_geometry(found, charts[found.reference], cell_mm, views)
    parts = []
    if geometry.value is not None:
        parts.append(geometry_part(found, geometry.value, charts[found.reference]))
    parts += [psf_part(name, seen) for name, seen in charts.items() if seen]
    parts += [colour_part(colour, found.measured.planes[colour.plane].pitch, charts) for colour in found.colours]
    parts = [resting(one, charts) for one in parts]
    known = {_key(name, one.node): one.joint_covariance for name, seen in charts.items() for one in seen}
    places = tuple((name, one) for name, seen in charts.items() for one in seen)
    return WholeCamera(join([*parts, *others], known), places, found.colours, geometry)


def charts_of(found: FieldResult) -> dict[str, list[MeasuredChart]]:
    """By plane the charts that its field is made of; none where it was refused.

    They are known by photograph and number: the field's nodes are others where supports were widened to one size.
    """
    kept = {}
    for name, outcome in found.planes.items():
        nodes = () if outcome.value is None else outcome.value.interpolation.field.nodes
        known = {_key(name, one.node): one for one in found.measured.charts.get(name, ())}
        kept[name] = [known[key] for node in nodes if (key := _key(name, node)) in known]
    return kept


def _key(plane: str, node: Node) -> ChartKey:
    return plane, node.source, node.number


def resting(part: Part, charts: Mapping[str, Sequence[MeasuredChart]]) -> Part:
    """The same; where its charts were estimated with the sensor's own result, with what that means for their blocks.

    Weights move no expected value. The response's error does: of a number's variance that is the square of the budget's
    term, and so a correlation with whatever the ladder tells of as much of its uncertainty at the most.
    """
    seen = [one for plane, charted in charts.items() for one in charted if _key(plane, one.node) in part.charts]
    terms = [
        (one.budgets[name][SENSOR], number.uncertainty)
        for one in seen
        for name, number in one.numbers.items()
        if one.budgets.get(name, {}).get(SENSOR, 0.0) > 0
    ]
    if not terms:
        return part
    most = max(term / max(whole, 1e-300) for term, whole in terms)
    why = (
        "other photographs, though the charts were straightened and weighed by what the ladder tells: weights move no "
        f"expected value, and the response's error is {most:.2g} of an uncertainty of the PSF's at the most"
    )
    return replace(part, rests_on={SENSOR: why})


# --- PSF ---------------------------------------------------------------------------------------------------------


def psf_part(plane: str, charts: Sequence[MeasuredChart]) -> Part:
    """The headline numbers of a plane at all its places, with what noise and priors have in common among them."""
    names, units, values, slopes, moves = [], [], [], [], []
    for i, one in enumerate(charts, 1):
        names += [f"{i}.{name}" for name in one.numbers]
        units += [number.unit for number in one.numbers.values()]
        values += [number.value for number in one.numbers.values()]
        slope = _slopes(one)
        slopes.append(slope)
        moves.append(slope @ prior_sensitivity(one.node.psf))
    ends = np.cumsum([0, *(len(slope) for slope in slopes)])
    covariance, by_charts = np.zeros((ends[-1], ends[-1])), {}
    for i, one in enumerate(charts):
        own = slice(ends[i], ends[i + 1])
        for j in range(i):
            common = moves[i] @ moves[j].T
            covariance[own, ends[j] : ends[j + 1]], covariance[ends[j] : ends[j + 1], own] = common, common.T
        covariance[own, own] = _own_covariance(one, slopes[i])
        rows = np.zeros((ends[-1], slopes[i].shape[1] + 2))
        rows[own, :-2] = slopes[i]
        by_charts[_key(plane, one.node)] = rows
    return Part(f"psf.{plane}", tuple(names), tuple(units), np.array(values), covariance, CHARTS, by_charts)


def _slopes(one: MeasuredChart) -> Array:
    """Derivatives (m, P) of a chart's numbers, shortened where a number is known better than its covariance says."""
    slope = np.array([one.gradients[name] for name in one.numbers]).reshape(len(one.numbers), -1)
    carried = np.sqrt(np.einsum("ij,jk,ik->i", slope, one.node.psf.parameter_covariance, slope))
    stated = np.array([number.uncertainty for number in one.numbers.values()])
    return np.asarray(slope * np.minimum(1.0, stated / np.maximum(carried, 1e-300))[:, None])


def _own_covariance(one: MeasuredChart, slope: Array) -> Array:
    """Covariance of one chart's numbers: what is stated of each beside the PSF's covariance is its own."""
    covariance = slope @ one.node.psf.parameter_covariance @ slope.T
    stated = np.array([number.uncertainty**2 for number in one.numbers.values()])
    return np.asarray(covariance + np.diag(np.maximum(stated - np.diag(covariance), 0)))


# --- lateral colour ----------------------------------------------------------------------------------------------


def colour_part(colour: LateralColour, pitch: int, charts: dict[str, list[MeasuredChart]]) -> Part:
    """The coefficients of a plane's lateral colour: first all of the shift along x, then along y.

    The places of the reference plane are in the lateral colour of all others: so are their errors.
    """
    S, surface = colour.surface.solution(), colour.surface
    count = len(S)
    covariance = np.einsum("ci,iab,di->acbd", S, surface.covariances, S).reshape(2 * count, 2 * count)
    covariance += np.kron(np.diag(surface.lack), S @ S.T)
    by_charts: dict[ChartKey, Array] = {}
    for plane, sign in ((colour.plane, pitch), (colour.reference, -pitch)):
        known = {(one.node.source, one.node.number): one for one in charts[plane]}
        for i, chart in enumerate(colour.charts):
            if chart in known:
                rows = np.zeros((2 * count, len(known[chart].node.psf.parameters) + 2))
                rows[:, -2:] = sign * np.kron(np.eye(2), S[:, i : i + 1])
                by_charts[plane, *chart] = rows
    terms = monomial_names(surface.degree)
    names = tuple(f"{axis}.{term}" for axis in "xy" for term in terms)
    values = np.asarray((S @ surface.values).T.ravel())
    return Part(f"lateral_colour.{colour.plane}", names, ("pixel of the sensor",) * len(names), values, covariance,
                CHARTS, by_charts)  # fmt: skip


def monomial_names(degree: int) -> list[str]:
    """What the polynomial's terms are called, in the order of `numerics.scattered.monomials`: x2y is x^2 y."""
    return [
        (_power("x", d - b) + _power("y", b)) or "1" for d in range(degree + 1) for b in range(d + 1)
    ]  # fmt: skip


def _power(letter: str, exponent: int) -> str:
    return "" if exponent == 0 else letter if exponent == 1 else f"{letter}{exponent}"


# --- geometry ----------------------------------------------------------------------------------------------------


def field_geometry(
    found: FieldResult, charts: Sequence[MeasuredChart], cell_mm: float, more: Sequence[ChartView] = ()
) -> Outcome[Geometry]:
    """The camera from the bins of the charts of the reference plane, each photograph a view, and from more views."""
    sources = [one.node.source for one in charts]
    if len(set(sources)) < len(sources):
        reason = "photographs with several charts tell no geometry: every print has a shape of its own"
        return Outcome(None, Verdict.REFUSED, reason, "photograph one chart in many poses, see the plan geometry")
    plane = found.measured.planes[found.reference]
    rows, columns = plane.samples.shape
    views = [*(on_sensor(one.correspondences, plane, one.node.source) for one in charts), *more]
    return calibrate_geometry(views, (columns * plane.pitch, rows * plane.pitch), GeometryParameters(cell_mm))


def geometry_part(found: FieldResult, geometry: Geometry, charts: Sequence[MeasuredChart]) -> Part:
    """Intrinsics and distortion, with what they share with PSF and centre of the charts whose bins they come of."""
    plane = found.measured.planes[found.reference]
    seen = {one.node.source: one for one in charts}
    with_charts = {}
    views = (one.view for one in geometry.views)
    for view, response in zip(views, camera_response(geometry.adjustment), strict=True):
        if (one := seen.get(view.source)) is None:
            continue
        points = plane.pitch * one.shared.of_points(one.registration, one.correspondences.points)
        shared = geometry.residual_scale * np.einsum("pna,nac->pc", response, points)
        with_charts[_key(found.reference, one.node)] = shared
    camera = geometry.camera
    return Part("geometry", camera.names, camera.units, camera.params, geometry.covariance, CHARTS, {}, with_charts)
