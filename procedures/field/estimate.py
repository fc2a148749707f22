"""From a photograph of one or several charts to nodes: the PSF of every plane at every chart, and where that is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from procedures.field.interpolate import interpolate
from procedures.field.seen_charts import HEADLINE, SeenChart, seen_chart_of
from procedures.outcome import BadInput, Miss, Outcome, Refused, Verdict
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.psf import Psf
from procedures.psf_field import Node, PsfField
from procedures.raw import FrameLike, Plane, RawFrame, as_frame
from procedures.sensor_model import SensorModel

Array = npt.NDArray[np.float64]

FIELD = PatternParameters(s=4)
"""How the nodes of a field are sampled where nothing else is asked for: they must all have the same s. A small aperture
and a corner's aberrations need wider supports than the frame's centre."""
BRACKET = PatternParameters(s=4, k=17)
"""The same through focus, where sharpness alone is asked, of many charts."""
LEFT_OVER, MOST_OVER = ("mismatch", "choice"), 0.95
"""Terms of the budgets that are no noise of the samples, and their share of a number's variance that counts at most."""
MIDDLE: Array = np.full((1, 2), CELLS / 2)
"""The chart's centre, in cells: the node's place."""


@dataclass(frozen=True, eq=False)
class FrameNodes:
    """What one photograph gives.

    Attributes
    ----------
    nodes : mapping of plane to nodes
    shapes : mapping of plane to (rows, columns)
    misses : sequence of Miss
    charts : mapping of plane to what each node's chart tells beside it
    """

    nodes: Mapping[str, Sequence[Node]]
    shapes: Mapping[str, tuple[int, int]]
    misses: Sequence[Miss]
    charts: Mapping[str, Sequence[SeenChart]] = field(default_factory=dict)


Sensors = Mapping[str, SensorModel]
"""What is known of the planes' sensor; a plane that is not named is estimated without."""
NO_SENSORS: Sensors = MappingProxyType({})
Job = tuple[Plane, int, ChartSighting]
Estimated = Outcome[PatternPsf]


class MapLike(Protocol):
    """Does something to each of some things and gives the answers in order, as `map` does: here or side by side."""

    def __call__(self, function: Callable[[Job], Estimated], jobs: Sequence[Job], /) -> Iterable[Estimated]:
        """The answers."""
        ...


def measure_frame(
    frame: RawFrame, chart: Chart, parameters: PatternParameters, each: MapLike = map, sensors: Sensors = NO_SENSORS
) -> FrameNodes:
    """The nodes of all charts in all planes of a photograph.

    The charts are found in one plane, green where there is one; the others show them in the same places.

    Parameters
    ----------
    each : MapLike
        How the charts are gone through; `map` takes one after the other.
    sensors : Sensors
        Whose response is undone and whose noise weighs the samples.

    Raises
    ------
    Refused
        If there is no chart in it.
    """
    source = frame.path.name
    guide = frame.planes.get("G1", next(iter(frame.planes.values())))
    sightings = _in_order(find_charts(guide.samples))
    if not sightings:
        raise Refused(
            f"{source}: no chart in the photograph",
            "show the whole chart, sharp and evenly lit, its noise region 60 to 300 pixels wide",
        )
    jobs: list[Job] = []
    for plane in frame.planes.values():
        x, y = ((a - b) / plane.pitch for a, b in zip(guide.origin, plane.origin, strict=True))
        jobs += [(plane, number, sighting.moved(x, y)) for number, sighting in enumerate(sightings, 1)]

    def estimated(job: Job) -> Estimated:
        plane, _, sighting = job
        return estimate_psf(plane, chart, parameters, sighting=sighting, sensor=sensors.get(plane.name))

    outcomes = each(estimated, jobs)
    charts: dict[str, list[SeenChart]] = {name: [] for name in frame.planes}
    misses = []
    for (plane, number, sighting), outcome in zip(jobs, outcomes, strict=True):
        if outcome.value is None:
            place = "({:.0f}, {:.0f})".format(*sighting.centre())
            misses.append(Miss(source, outcome.reason, outcome.remedy, plane.name, place))
        else:
            node = node_of(outcome.value, plane, source, number)
            if outcome.verdict is Verdict.DOUBTFUL:
                psf = _with_left_over(outcome.value)
                node = replace(node, psf=psf, doubt=outcome.reason, remedy=outcome.remedy)
            charts[plane.name].append(seen_chart_of(outcome.value, node))
    shapes = {name: (plane.samples.shape[0], plane.samples.shape[1]) for name, plane in frame.planes.items()}
    nodes = {name: [one.node for one in seen] for name, seen in charts.items()}
    return FrameNodes(nodes, shapes, misses, charts)


def estimate_field(
    frames: Iterable[FrameLike], chart: Chart, parameters: PatternParameters | None = None, each: MapLike = map
) -> dict[str, Outcome[PsfField]]:
    """The PSF over the frame, by plane, from photographs that show the chart at six places or more between them.

    Parameters
    ----------
    frames : iterable of RawFrame, or of (rows, columns) arrays
        Of one camera, lens, aperture and focus. They may be read while they are gone through: none is kept.
    parameters : PatternParameters, optional
        By default s = 4 and k as wide as each chart asks. All nodes need the same s.
    each : MapLike
        How the charts of a photograph are gone through; `map` takes one after the other.

    Returns
    -------
    dict of str to Outcome[PsfField]
        Refused for a plane whose nodes are too few, on one line or not alike.

    Raises
    ------
    Refused
        If there is no chart in a photograph, or no photograph.
    BadInput
        If the photographs have different planes or sizes.
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
        for name, found in measured.nodes.items():
            nodes.setdefault(name, []).extend(found)
    if not shapes:
        raise Refused("a field needs photographs; there is none", "give photographs of the chart")
    return {name: _field_of(name, shapes[name], nodes[name]) for name in shapes}


def _field_of(plane: str, shape: tuple[int, int], nodes: Sequence[Node]) -> Outcome[PsfField]:
    try:
        return Outcome(interpolate(plane, shape, nodes).field)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)


def node_of(found: PatternPsf, plane: Plane, source: str, number: int) -> Node:
    """The node of an estimate: its place is where a mark at the chart's centre is seen."""
    offset = mark_offset(found.psf.h, found.psf.s, found.registration.jacobian())
    position = found.registration.to_sensor(MIDDLE)[0] + offset
    on_sensor = plane.pitch * position + np.array(plane.origin, dtype=np.float64)
    return Node(position, found.centre_covariance, on_sensor, found.psf, source, number)


def _with_left_over(found: PatternPsf) -> Psf:
    """The PSF, its covariance as much larger as what model, s and k leave over makes the variances of its numbers.

    Of a doubtful chart, so that the others outvote it. Of good ones it is small, and no noise that nodes average.
    """
    budgets = [found.quality.budgets[name] for name in HEADLINE if name in found.quality.budgets]
    over = [sum(one.get(term, 0.0) ** 2 for term in LEFT_OVER) / sum(v**2 for v in one.values()) for one in budgets]
    if not any(over):
        return found.psf
    psf, wider = found.psf, float(np.mean([1 / (1 - min(share, MOST_OVER)) for share in over]))
    C = psf.parameter_covariance
    return Psf.of(psf.parameters, wider * C, psf.k, psf.s, (wider - 1) * C)


def _in_order(sightings: Sequence[ChartSighting]) -> list[ChartSighting]:
    """Row by row: charts whose centres are within half a chart of each other's height are in one row."""
    left = sorted(sightings, key=lambda one: float(one.centre()[1]))
    ordered: list[ChartSighting] = []
    while left:
        reach = left[0].centre()[1] + left[0].widths().mean() / 2
        row = [one for one in left if one.centre()[1] < reach]
        ordered += sorted(row, key=lambda one: float(one.centre()[0]))
        left = left[len(row) :]
    return ordered
