"""Nodes from a photograph of one or several charts: the PSF of every plane at every chart, and its position."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np

from procedures.choice import UNSEEN, Budget, combined
from procedures.clipping import SensorModel
from procedures.field.interpolate import interpolate
from procedures.numbers import (
    FWHM_HORIZONTAL,
    FWHM_VERTICAL,
    MTF50_HORIZONTAL,
    MTF50_RADIAL,
    MTF50_VERTICAL,
    PIXELS_PER_PATTERN,
)
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, Miss, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.pattern_psf.registration import Registration
from procedures.pattern_psf.solution import SharedErrors
from procedures.psf import Psf
from procedures.psf_field import Node, PsfField
from procedures.raw import FrameLike, Plane, RawFrame, as_frame

FIELD = PatternParameters(s=4)
"""Default sampling of a field's nodes, which must all have the same s. A small aperture and a corner's aberrations need
wider supports than the frame's centre, so k is free."""
BRACKET = PatternParameters(s=4, k=17)  # sampling through focus, where only the sharpness of many charts is needed
SYSTEMATIC_TERMS, MAX_SYSTEMATIC_SHARE = ("mismatch", "choice"), 0.95
"""Terms of the budgets that are not noise of the samples, and the largest share of a number's variance counted."""
HEADLINE: tuple[str, ...] = (MTF50_HORIZONTAL, MTF50_VERTICAL, MTF50_RADIAL, FWHM_HORIZONTAL, FWHM_VERTICAL)
"""Numbers reported for every chart."""
Sensors = Mapping[str, SensorModel]  # models of the planes' sensor; a plane without one is estimated without
NO_SENSORS: Sensors = MappingProxyType({})
Job = tuple[Plane, int, ChartSighting]


@dataclass(frozen=True, eq=False)
class MeasuredChart:
    """One chart in one plane of one photograph.

    numbers : those of `HEADLINE` that the PSF has
    gradients : mapping of str to (P,); derivatives of the numbers by the PSF's parameters
    correspondences : in pixels of the plane
    budgets : uncertainty budgets of the numbers
    modes : see `PatternPsf`
    subject : its width in pixels of the plane, and the noise over its contrast
    """

    node: Node
    numbers: Mapping[str, Quantity]
    gradients: Mapping[str, Array]
    registration: Registration
    correspondences: Correspondences
    shared: SharedErrors
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    modes: Mapping[str, Array] = field(default_factory=dict)
    subject: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, estimate: PatternPsf, node: Node) -> "MeasuredChart":
        """The part of an estimate that is kept."""
        quality = estimate.quality
        names = [name for name in HEADLINE if name in quality.numbers]
        numbers = {name: quality.numbers[name] for name in names}
        gradients = {name: quality.gradients[name] for name in names}
        budgets = {name: quality.budgets[name] for name in names}
        return cls(
            node,
            numbers,
            gradients,
            estimate.registration,
            estimate.correspondences,
            estimate.shared,
            budgets,
            estimate.modes,
            {PIXELS_PER_PATTERN: estimate.pixels_per_pattern, "noise": estimate.diagnostics["noise"]},
        )

    @property
    def joint_covariance(self) -> Array:
        """Covariance (P + 2, P + 2) of the PSF's parameters and of the position of the chart's centre."""
        shared = self.shared.centre
        return np.block([[self.node.psf.parameter_covariance, shared], [shared.T, self.node.position_covariance]])


def mean_budgets(charts: Sequence[MeasuredChart]) -> dict[str, dict[str, float]]:
    """Uncertainty budgets of the numbers at one chart: root mean squares over the charts, without terms that are 0."""
    mean: dict[str, dict[str, float]] = {}
    for name in HEADLINE:
        budgets = [chart.budgets[name] for chart in charts if name in chart.budgets]
        terms = dict.fromkeys(term for budget in budgets for term, size in budget.items() if size > 0)
        if terms:
            mean[name] = {
                term: float(np.sqrt(np.mean([budget.get(term, 0.0) ** 2 for budget in budgets]))) for term in terms
            }
    return mean


def median_subject(charts: Sequence[MeasuredChart]) -> dict[str, float]:
    """Medians of the charts' `subject`."""
    known = [chart.subject for chart in charts if chart.subject]
    return {name: float(np.median([subject[name] for subject in known])) for name in known[0]} if known else {}


@dataclass(frozen=True, eq=False)
class FrameNodes:
    """Results of one photograph, by plane. shapes : rows and columns; misses : charts without a result."""

    nodes: Mapping[str, Sequence[Node]]
    shapes: Mapping[str, tuple[int, int]]
    misses: Sequence[Miss]
    charts: Mapping[str, Sequence[MeasuredChart]] = field(default_factory=dict)


class MapLike(Protocol):
    """Apply a function to each job and return the results in order, as `map` does: serially or in parallel."""

    def __call__(
        self, function: Callable[[Job], Outcome[PatternPsf]], jobs: Sequence[Job], /
    ) -> Iterable[Outcome[PatternPsf]]:
        """Results in the order of the jobs."""


def measure_frame(
    frame: RawFrame, chart: Chart, parameters: PatternParameters, each: MapLike = map, sensors: Sensors = NO_SENSORS
) -> FrameNodes:
    """The nodes of all charts in all planes of a photograph.

    The charts are detected in one plane, green where there is one, and have the same positions in the others. Raises
    Refused if there is no chart in it.

    each : how the charts are processed; `map` takes one after the other
    sensors : their response is inverted, and their noise weights the samples
    """
    source = frame.path.name
    guide = frame.guide
    sightings = _in_order(find_charts(guide.samples))
    if not sightings:
        raise Refused(
            f"{source}: no chart in the photograph",
            "show the whole chart, sharp and evenly lit, its noise region 45 to 300 pixels wide",
        )
    jobs: list[Job] = []
    for plane in frame.planes.values():
        x, y = ((a - b) / plane.pitch for a, b in zip(guide.origin, plane.origin, strict=True))
        jobs += [(plane, number, sighting.moved(x, y)) for number, sighting in enumerate(sightings, 1)]

    def estimated(job: Job) -> Outcome[PatternPsf]:
        plane, _, sighting = job
        return estimate_psf(plane, chart, parameters, sighting=sighting, sensor=sensors.get(plane.name))

    charts: dict[str, list[MeasuredChart]] = {name: [] for name in frame.planes}
    misses = []
    for (plane, number, sighting), outcome in zip(jobs, each(estimated, jobs), strict=True):
        if outcome.value is None:
            place = "({:.0f}, {:.0f})".format(*sighting.centre())
            misses.append(Miss(source, outcome.reason, outcome.remedy, plane.name, place))
        else:
            charts[plane.name].append(MeasuredChart.of(outcome.value, _node(outcome, plane, source, number)))
    shapes = {name: (plane.samples.shape[0], plane.samples.shape[1]) for name, plane in frame.planes.items()}
    nodes = {name: [chart.node for chart in measured] for name, measured in charts.items()}
    return FrameNodes(nodes, shapes, misses, charts)


def estimate_field(
    frames: Iterable[FrameLike], chart: Chart, parameters: PatternParameters | None = None, each: MapLike = map
) -> dict[str, Outcome[PsfField]]:
    """PSF over the frame, by plane, from photographs with charts at six positions or more in total.

    frames : iterable of RawFrame, or of (rows, columns) arrays
        Of one camera, lens, aperture and focus. They may be read while they are gone through: none is kept.
    parameters : PatternParameters, default: s = 4, and k by chart. All nodes need the same s.
    each : MapLike, how the charts of a photograph are processed; `map` takes one after the other

    Returns
    -------
    dict of str to Outcome[PsfField]
        Refused for a plane whose nodes are too few, on one line or sampled differently.

    Raises Refused if there is no chart in a photograph, or no photograph; BadInput if the photographs have different
    planes or sizes.
    """
    nodes: dict[str, list[Node]] = {}
    shapes: Mapping[str, tuple[int, int]] = {}
    for number, image in enumerate(frames, 1):
        frame = as_frame(image, f"photograph {number}")
        measured = measure_frame(frame, chart, parameters or FIELD, each)
        if shapes and measured.shapes != shapes:
            raise BadInput(
                f"the photographs of a field need the same planes and sizes; {frame.path.name} has others",
                "give photographs of one camera, in one format",
            )
        shapes = measured.shapes
        for name, new in measured.nodes.items():
            nodes.setdefault(name, []).extend(new)
    if not shapes:
        raise Refused("a field needs photographs; there is none", "give photographs of the chart")
    fields: dict[str, Outcome[PsfField]] = {}
    for name, shape in shapes.items():
        try:
            interpolation = interpolate(name, shape, nodes[name])
            fields[name] = verdict_of([interpolation.curvature], interpolation.field)
        except Refused as refusal:
            fields[name] = Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return fields


def _node(outcome: Outcome[PatternPsf], plane: Plane, source: str, number: int) -> Node:
    """The node of an estimate, at the apparent position of a mark at the chart's centre; a doubtful one has less
    weight."""
    estimate = outcome.result()
    offset = mark_offset(estimate.psf.h, estimate.psf.s, estimate.registration.jacobian())
    position = estimate.registration.to_sensor(np.full((1, 2), CELLS / 2))[0] + offset
    on_sensor = plane.pitch * position + np.array(plane.origin, dtype=np.float64)
    node = Node(position, estimate.centre_covariance, on_sensor, estimate.psf, source, number)
    if outcome.verdict is not Verdict.DOUBTFUL:
        return node
    return replace(node, psf=_enlarged(estimate), caveat=outcome.reason, remedy=outcome.remedy)


def _enlarged(estimate: PatternPsf) -> Psf:
    """The PSF, its covariance enlarged by the share of systematic terms, which are small for good charts and which
    nodes do not average."""
    psf, all_budgets = estimate.psf, estimate.quality.budgets
    budgets = [all_budgets[name] for name in HEADLINE if name in all_budgets]
    shares = [sum(b.get(term, 0.0) ** 2 for term in SYSTEMATIC_TERMS) / combined(_own_terms(b)) ** 2 for b in budgets]
    if not any(shares):
        return psf
    factor = float(np.mean([1 / (1 - min(share, MAX_SYSTEMATIC_SHARE)) for share in shares]))
    C = psf.parameter_covariance
    return Psf.of(psf.parameters, factor * C, psf.k, psf.s, (factor - 1) * C)


def _own_terms(budget: Budget) -> Budget:
    """Terms of a budget without those of corruptions, which a field adds for all charts together."""
    return {term: size for term, size in budget.items() if term not in UNSEEN}


def mean_modes(charts: Sequence[MeasuredChart]) -> dict[str, Array]:
    """Root mean squares of the charts' modes, which no number of charts lowers."""
    known = [chart.modes for chart in charts if chart.modes]
    terms = dict.fromkeys(term for modes in known for term in modes)
    return {term: np.sqrt(sum(np.asarray(modes.get(term, 0.0)) ** 2 for modes in known) / len(known)) for term in terms}


def _in_order(sightings: Sequence[ChartSighting]) -> list[ChartSighting]:
    """Charts row by row: centres within half a chart's height of each other are in one row."""
    remaining = sorted(sightings, key=lambda sighting: float(sighting.centre()[1]))
    ordered: list[ChartSighting] = []
    while remaining:
        reach = remaining[0].centre()[1] + remaining[0].widths().mean() / 2
        row = [sighting for sighting in remaining if sighting.centre()[1] < reach]
        ordered += sorted(row, key=lambda sighting: float(sighting.centre()[0]))
        remaining = remaining[len(row) :]
    return ordered
