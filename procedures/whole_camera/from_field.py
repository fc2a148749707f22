"""Parts of a camera from a field's charts: the PSF's numbers at every place, lateral colour, geometry."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.field.conclusion import FieldResult
from procedures.field.estimate import MeasuredChart
from procedures.field.maps import LateralColour
from procedures.geometry.chart_bins.photographs import on_sensor
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.uncertainty import camera_response
from procedures.geometry.views import ChartView
from procedures.numerics.arrays import Array
from procedures.outcome import Outcome, Verdict
from procedures.psf_field import Node, prior_sensitivity
from procedures.sensor.photon_transfer import GainAndNoise
from procedures.vignetting.estimate import NAMES, UNITS, JointFormula

ChartKey = tuple[str, str, int]  # plane, photograph and number of a chart in it

COMPUTED, ZERO = "computed", "zero"
ROUNDING = 1e-12  # eigenvalues below this, relative to the largest, are 0


@dataclass(frozen=True, eq=False)
class CameraPart:
    """Numbers of one estimate.

    values : (m,) float64
    covariance : (m, m) float64
    origin : the photographs used
    by_charts : mapping of ChartKey to (m, P + 2)
        Derivatives by the P parameters of a chart's PSF and by the position (x, y) of its centre in the plane.
    with_charts : mapping of ChartKey to (m, P + 2)
        Covariance with these, for numbers derived otherwise from the same samples.
    independent_of : names of parts from other photographs used in this estimate, and why their covariance is zero
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    origin: str
    by_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    with_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    independent_of: Mapping[str, str] = field(default_factory=dict)

    @property
    def charts(self) -> set[ChartKey]:
        """The charts used."""
        return set(self.by_charts) | set(self.with_charts)


@dataclass(frozen=True)
class CovarianceBlock:
    """Covariance of two parts: `how` is "computed" or "zero", `why` its source or reason."""

    first: str
    second: str
    how: str
    why: str


@dataclass(frozen=True, eq=False)
class JointNumbers:
    """All numbers of all parts.

    covariance : (n, n), of the concatenated values of the parts; symmetric, positive semidefinite within rounding
    blocks : one for each pair of parts
    """

    parts: tuple[CameraPart, ...]
    covariance: Array
    blocks: tuple[CovarianceBlock, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers: part, a dot, the name in it."""
        return tuple(f"{part.name}.{name}" for part in self.parts for name in part.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers."""
        return tuple(unit for part in self.parts for unit in part.units)

    @property
    def values(self) -> Array:
        """The numbers (n,)."""
        return np.concatenate([part.values for part in self.parts]) if self.parts else np.zeros(0)

    def block(self, first: str, second: str) -> Array:
        """Covariance of two parts. Raises KeyError for an unknown part."""
        return self.covariance[self._places(first), self._places(second)]

    def _places(self, name: str) -> slice:
        start = 0
        for part in self.parts:
            if part.name == name:
                return slice(start, start + len(part.values))
            start += len(part.values)
        raise KeyError(name)


def join(parts: Sequence[CameraPart], charts: Mapping[ChartKey, Array]) -> JointNumbers:
    """Joint numbers of the parts.

    charts : mapping of ChartKey to (P + 2, P + 2); covariance of every chart's PSF and centre
    """
    ends = np.cumsum([0, *(len(part.values) for part in parts)])
    covariance, blocks = np.zeros((ends[-1], ends[-1])), []
    for i, a in enumerate(parts):
        own = slice(ends[i], ends[i + 1])
        covariance[own, own] = a.covariance
        for j, b in enumerate(parts[:i]):
            other, shared = slice(ends[j], ends[j + 1]), _shared(a, b, charts)
            if shared is not None:
                covariance[own, other], covariance[other, own] = shared, shared.T
            blocks.append(_block(b, a, computed=shared is not None))
    return JointNumbers(tuple(parts), _positive((covariance + covariance.T) / 2), tuple(blocks))


def _shared(a: CameraPart, b: CameraPart, charts: Mapping[ChartKey, Array]) -> Array | None:
    """Covariance of two parts; None where they have no chart in common."""
    if not a.charts & b.charts:
        return None
    shared = np.zeros((len(a.values), len(b.values)))
    for key in sorted(a.charts & b.charts):
        if key in a.by_charts and key in b.by_charts:
            shared += a.by_charts[key] @ charts[key] @ b.by_charts[key].T
        elif key in b.by_charts:
            shared += a.with_charts[key] @ b.by_charts[key].T
        elif key in a.by_charts:
            shared += a.by_charts[key] @ b.with_charts[key].T
    return shared


def _block(a: CameraPart, b: CameraPart, *, computed: bool) -> CovarianceBlock:
    if computed:
        return CovarianceBlock(
            a.name, b.name, COMPUTED, f"from the samples of {len(a.charts & b.charts)} charts in both"
        )
    if why := a.independent_of.get(b.name) or b.independent_of.get(a.name):
        return CovarianceBlock(a.name, b.name, ZERO, why)
    if a.origin != b.origin:
        return CovarianceBlock(a.name, b.name, ZERO, f"other photographs: {a.origin}, and {b.origin}")
    return CovarianceBlock(a.name, b.name, ZERO, "other photosites: the noise of different planes is independent")


def _positive(covariance: Array) -> Array:
    """The covariance without negative eigenvalues, which separate linearisations may cause, with the same variances."""
    spread = np.sqrt(np.diag(covariance))
    scale = np.where(spread > 0, spread, 1.0)
    correlation = covariance / np.outer(scale, scale)
    with contextlib.suppress(np.linalg.LinAlgError):  # usually definite: a tenth of the time of the eigenvalues
        np.linalg.cholesky(correlation + ROUNDING * np.eye(len(scale)))
        return covariance
    values, vectors = np.linalg.eigh(correlation)
    if not len(values) or values[0] >= -ROUNDING * values[-1]:
        return covariance
    lifted = (vectors * np.maximum(values, 0)) @ vectors.T
    again = scale * np.sqrt(np.diag(covariance) / scale**2 / np.maximum(np.diag(lifted), ROUNDING))
    lifted = lifted * np.outer(again, again)
    return np.asarray((lifted + lifted.T) / 2)


FLATS, LADDER = "the flats", "the sensor's ladder of light"


def vignetting_parts(formula: JointFormula) -> list[CameraPart]:
    """The radial formulas of all planes, correlated by the slope of the flats' light."""
    if not formula.planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in formula.planes for name in NAMES)
    return [CameraPart("vignetting", names, UNITS * len(formula.planes), formula.values, formula.covariance, FLATS)]


def sensor_parts(planes: Mapping[str, GainAndNoise]) -> list[CameraPart]:
    """Gain and dark noise of all planes, independent between planes."""
    if not planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in planes for name in GainAndNoise.NAMES)
    values = np.array([value for one in planes.values() for value in one.values])
    covariance = np.zeros((len(values), len(values)))
    for i, one in enumerate(planes.values()):
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = one.covariance
    return [CameraPart("sensor", names, GainAndNoise.UNITS * len(planes), values, covariance, LADDER)]


CHARTS = "the charts"  # origin of these parts
SENSOR = "sensor"  # name of the part of the sensor's numbers, and of the term of its response in a budget


@dataclass(frozen=True, eq=False)
class WholeCamera:
    """Results of one session with a camera.

    places : plane and chart of every place of the PSF's numbers, in their order
    geometry : refused where the charts do not determine it
    """

    numbers: JointNumbers
    places: tuple[tuple[str, MeasuredChart], ...]
    colours: tuple[LateralColour, ...]
    geometry: Outcome[Geometry]


def whole_camera(
    result: FieldResult, cell_mm: float, others: Sequence[CameraPart] = (), views: Sequence[ChartView] = ()
) -> WholeCamera:
    """The camera of a field.

    cell_mm : side of a printed cell: scale of the distances, without effect on the camera
    others : from other photographs
    views : further views of the chart, for the geometry alone
    """
    charts = charts_of(result)
    geometry = field_geometry(result, charts[result.reference], cell_mm, views)
    parts = []
    if geometry.value is not None:
        parts.append(geometry_part(result, geometry.value, charts[result.reference]))
    parts += [psf_part(name, measured) for name, measured in charts.items() if measured]
    parts += [colour_part(colour, result.measured.planes[colour.plane].pitch, charts) for colour in result.colours]
    parts = [with_sensor_reason(part, charts) for part in parts]
    places = tuple((name, chart) for name, measured in charts.items() for chart in measured)
    covariances = {_key(name, chart.node): chart.joint_covariance for name, chart in places}
    return WholeCamera(join([*parts, *others], covariances), places, result.colours, geometry)


def charts_of(result: FieldResult) -> dict[str, list[MeasuredChart]]:
    """The charts of each plane's field; empty where it was refused.

    They are identified by photograph and number, as the field's nodes may have wider supports.
    """
    kept = {}
    for name, outcome in result.planes.items():
        nodes = () if outcome.value is None else outcome.value.interpolation.field.nodes
        known = {_key(name, one.node): one for one in result.measured.charts.get(name, ())}
        kept[name] = [known[key] for node in nodes if (key := _key(name, node)) in known]
    return kept


def _key(plane: str, node: Node) -> ChartKey:
    return plane, node.source, node.number


def with_sensor_reason(part: CameraPart, charts: Mapping[str, Sequence[MeasuredChart]]) -> CameraPart:
    """The part; if the sensor's model was used for its charts, with the reason why their covariance is neglected.

    Weights do not change expected values. The response's error does: its share of a number's variance is the square of
    the budget's term, and bounds the correlation with the ladder's numbers.
    """
    used = [one for plane, charted in charts.items() for one in charted if _key(plane, one.node) in part.charts]
    terms = [
        (one.budgets[name][SENSOR], number.uncertainty)
        for one in used
        for name, number in one.numbers.items()
        if one.budgets.get(name, {}).get(SENSOR, 0.0) > 0
    ]
    if not terms:
        return part
    most = max(term / max(whole, 1e-300) for term, whole in terms)
    why = (
        "other photographs; the ladder's response and noise were used for the charts, but weights change no expected "
        f"value, and the response's error is at most {most:.2g} times an uncertainty of the PSF"
    )
    return replace(part, independent_of={SENSOR: why})


# --- PSF ---


def psf_part(plane: str, charts: Sequence[MeasuredChart]) -> CameraPart:
    """The headline numbers of a plane at all its places, with their covariance by noise and priors."""
    names, units, values, slopes, by_priors = [], [], [], [], []
    for i, chart in enumerate(charts, 1):
        names += [f"{i}.{name}" for name in chart.numbers]
        units += [number.unit for number in chart.numbers.values()]
        values += [number.value for number in chart.numbers.values()]
        slope = _slopes(chart)
        slopes.append(slope)
        by_priors.append(slope @ prior_sensitivity(chart.node.psf))
    ends = np.cumsum([0, *(len(slope) for slope in slopes)])
    covariance, by_charts = np.zeros((ends[-1], ends[-1])), {}
    for i, chart in enumerate(charts):
        own = slice(ends[i], ends[i + 1])
        for j in range(i):
            common = by_priors[i] @ by_priors[j].T
            covariance[own, ends[j] : ends[j + 1]], covariance[ends[j] : ends[j + 1], own] = common, common.T
        covariance[own, own] = _own_covariance(chart, slopes[i])
        rows = np.zeros((ends[-1], slopes[i].shape[1] + 2))
        rows[own, :-2] = slopes[i]
        by_charts[_key(plane, chart.node)] = rows
    return CameraPart(f"psf.{plane}", tuple(names), tuple(units), np.array(values), covariance, CHARTS, by_charts)


def _slopes(chart: MeasuredChart) -> Array:
    """Derivatives (m, P) of a chart's numbers, reduced where they imply more than the stated uncertainty."""
    slope = np.array([chart.gradients[name] for name in chart.numbers]).reshape(len(chart.numbers), -1)
    propagated = np.sqrt(np.einsum("ij,jk,ik->i", slope, chart.node.psf.parameter_covariance, slope))
    stated = np.array([number.uncertainty for number in chart.numbers.values()])
    return np.asarray(slope * np.minimum(1.0, stated / np.maximum(propagated, 1e-300))[:, None])


def _own_covariance(chart: MeasuredChart, slope: Array) -> Array:
    """Covariance of one chart's numbers; further stated uncertainties are independent."""
    covariance = slope @ chart.node.psf.parameter_covariance @ slope.T
    stated = np.array([number.uncertainty**2 for number in chart.numbers.values()])
    return np.asarray(covariance + np.diag(np.maximum(stated - np.diag(covariance), 0)))


# --- lateral colour ---


def colour_part(colour: LateralColour, pitch: int, charts: dict[str, list[MeasuredChart]]) -> CameraPart:
    """The coefficients of a plane's lateral colour: first of the shift along x, then along y.

    Errors of the reference plane's positions are common to the lateral colour of all others.
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
    units = ("pixel of the sensor",) * len(names)
    return CameraPart(f"lateral_colour.{colour.plane}", names, units, values, covariance, CHARTS, by_charts)


def monomial_names(degree: int) -> list[str]:
    """Names of the polynomial's terms in the order of `numerics.scattered.monomials`: x2y is x^2 y."""
    return [(_power("x", d - b) + _power("y", b)) or "1" for d in range(degree + 1) for b in range(d + 1)]


def _power(letter: str, exponent: int) -> str:
    return "" if exponent == 0 else letter if exponent == 1 else f"{letter}{exponent}"


# --- geometry ---


def field_geometry(
    result: FieldResult, charts: Sequence[MeasuredChart], cell_mm: float, more: Sequence[ChartView] = ()
) -> Outcome[Geometry]:
    """The geometry from the charts of the reference plane, one view per photograph, and from more views."""
    sources = [chart.node.source for chart in charts]
    if len(set(sources)) < len(sources):
        reason = "photographs with several charts give no geometry: every print has a different shape"
        return Outcome(None, Verdict.REFUSED, reason, "photograph one chart in many poses, see the plan geometry")
    plane = result.measured.planes[result.reference]
    rows, columns = plane.samples.shape
    views = [*(on_sensor(chart.correspondences, plane, chart.node.source) for chart in charts), *more]
    return calibrate_geometry(views, (columns * plane.pitch, rows * plane.pitch), GeometryParameters(cell_mm))


def geometry_part(result: FieldResult, geometry: Geometry, charts: Sequence[MeasuredChart]) -> CameraPart:
    """Intrinsics and distortion, with their covariance with PSF and centre of the charts."""
    plane = result.measured.planes[result.reference]
    by_source = {chart.node.source: chart for chart in charts}
    with_charts = {}
    views = (one.view for one in geometry.views)
    for view, response in zip(views, camera_response(geometry.adjustment), strict=True):
        if (one := by_source.get(view.source)) is None:
            continue
        points = plane.pitch * one.shared.of_points(one.registration, one.correspondences.points)
        shared = geometry.residual_scale * np.einsum("pna,nac->pc", response, points)
        with_charts[_key(result.reference, one.node)] = shared
    camera = geometry.camera
    return CameraPart(
        "geometry", camera.names, camera.units, camera.params, geometry.covariance, CHARTS, {}, with_charts
    )
