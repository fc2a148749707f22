"""What the nodes of many photographs say together: each plane's field, maps and numbers, lateral colour, best focus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from procedures.budget import Budget
from procedures.field.chromatic import LateralColour, lateral_colour
from procedures.field.focus import FocusSurface, focus_surface, sharpest
from procedures.field.interpolate import Interpolation, interpolate
from procedures.field.maps import FieldMap, derive
from procedures.field.measuring import MeasuredFrames, Told, silent
from procedures.field.photosite import Photosite, WithoutPhotosite
from procedures.field.seen_charts import SeenChart, usual_budgets
from procedures.numbers import ERROR_INTERPOLATION, ERROR_NOISE
from procedures.outcome import Check, Miss, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane

Limit = Callable[[Plane], Diffraction | None]
"""The diffraction limit of a plane, None where it is not known."""
REFERENCE = "G1"
"""The plane that lateral colour is told against."""
LARGE_ERROR = 0.1
"""Of the PSF's norm: an interpolation that errs by more is doubted."""
SMALL_SHARE = 0.3
"""Of the frame: nodes that enclose less are doubted."""
MANY_DOUBTS = 0.2
"""Share of the charts that may be doubtful under a field that is trusted: one of a tour of nine, not two corners of
its four, whose places no other chart outvotes."""


@dataclass(frozen=True, eq=False)
class PlaneField:
    """What the nodes of one plane say together.

    Attributes
    ----------
    centre, quality : the PSF at the frame's centre, and what it says
    numbers : of the whole field: the axis of the lens, and the median of each map
    pitch : sensor pixels per pixel of the plane
    budgets : of the numbers at one chart, see `usual_budgets`
    """

    centre: Psf
    quality: Quality
    interpolation: Interpolation
    maps: tuple[FieldMap, ...]
    numbers: Mapping[str, Quantity]
    pitch: int = 1
    budgets: Mapping[str, Budget] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FieldResult:
    """The whole answer, by plane; `reference` is the plane that lateral colour and focus are told of.

    `photosite` is the one that maps are told without, beside the camera's.
    """

    measured: MeasuredFrames
    planes: Mapping[str, Outcome[PlaneField]]
    colours: tuple[LateralColour, ...]
    reference: str
    focus: FocusSurface | None
    focus_refusal: str = ""
    photosite: Photosite | None = None


def conclude(
    measured: MeasuredFrames, focus: Mapping[str, float] | None = None, limit: Limit = lambda plane: None,
    told: Told = silent, at: Sequence[float] = (), photosite: Photosite | None = None,
) -> FieldResult:  # fmt: skip
    """Field, maps and numbers of every plane, lateral colour between them, best focus where positions are known.

    Parameters
    ----------
    focus : mapping of photograph's name to focus position in mm, optional
        The field is then that of the sharpest position.
    at : sequence of float
        Frequencies in cycles per pixel of the plane at which the MTF of the frame's centre is told.
    photosite : Photosite, optional
        Maps of sagittal and meridional MTF50 are told without it too.

    Raises
    ------
    Refused
        If no photograph gave any node.
    """
    if not any(measured.nodes.values()):
        why = measured.misses[0] if measured.misses else Miss("", "there is none", "")
        raise Refused(f"none of {len(measured.failed)} photographs gives a PSF; the first: {why.reason}", why.remedy)
    reference = REFERENCE if REFERENCE in measured.nodes else next(iter(measured.nodes))
    brackets = {name: _bracket(nodes, focus or {}) for name, nodes in measured.nodes.items()}
    if not brackets[reference]:
        reason = f"none of the photographs that give a PSF of {reference} has a focus position"
        raise Refused(reason, "add their names and positions to the table")
    best = sharpest(brackets[reference]) if focus else 0.0
    kept = {name: bracket.get(best, []) for name, bracket in brackets.items()}
    planes = {}
    for name, nodes in kept.items():
        sources = {node.source for node in nodes}
        charts = [one for one in measured.charts.get(name, ()) if one.node.source in sources]
        planes[name] = _plane_field(measured.planes[name], nodes, charts, limit, at, photosite)
        told(f"field of {name}")
    surface, refusal = None, ""
    if focus:
        try:
            surface = focus_surface(brackets[reference], _shape(measured.planes[reference]))
        except Refused as error:
            refusal = f"{error.reason}; {error.remedy}"
    colours = _colours(measured, kept, reference)
    return FieldResult(measured, planes, colours, reference, surface, refusal, photosite)


def _bracket(nodes: Sequence[Node], focus: Mapping[str, float]) -> dict[float, list[Node]]:
    """Nodes by focus position; all at 0 where none is known, those of photographs without one left out otherwise."""
    found: dict[float, list[Node]] = {}
    for node in nodes:
        if not focus or node.source in focus:
            found.setdefault(focus.get(node.source, 0.0), []).append(node)
    return found


def _colours(measured: MeasuredFrames, kept: Mapping[str, Sequence[Node]], reference: str) -> tuple[LateralColour, ...]:
    """Lateral colour of every plane against the reference, as far as there are charts enough."""
    found = []
    for name, nodes in kept.items():
        plane = measured.planes[name]
        if name != reference:
            try:
                found.append(lateral_colour(name, nodes, reference, kept[reference], _shape(plane), plane.pitch))
            except Refused:
                continue  # the plane's own record says that there are too few
    return tuple(found)


def _shape(plane: Plane) -> tuple[int, int]:
    rows, columns = plane.samples.shape
    return int(rows), int(columns)


def _plane_field(
    plane: Plane,
    nodes: Sequence[Node],
    charts: Sequence[SeenChart],
    limit: Limit,
    at: Sequence[float],
    photosite: Photosite | None,
) -> Outcome[PlaneField]:
    shape = _shape(plane)
    try:
        found = interpolate(plane.name, shape, nodes)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    without = WithoutPhotosite(photosite, plane.pitch) if photosite else None
    maps = derive(found.field, without=without)
    centre = found.field.at((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    diffraction = limit(plane)
    quality = assess(centre, n=len(nodes), diffraction=diffraction, at=at)
    checks = [*_checks(found, maps), _doubted(nodes), *beyond_diffraction(quality, diffraction)]
    told = PlaneField(centre, quality, found, maps, _numbers(found, maps), plane.pitch, usual_budgets(charts))
    return verdict_of(checks, told)


def _checks(found: Interpolation, maps: Sequence[FieldMap]) -> list[Check]:
    """What makes a field doubtful."""
    by_name = {one.name: one for one in maps}
    error = by_name[ERROR_INTERPOLATION].median(by_name[ERROR_INTERPOLATION].value)
    enclosed = by_name[ERROR_NOISE].share
    rows, columns = found.field.shape
    centred = bool(found.field.inside(np.array([[(columns - 1) / 2, (rows - 1) / 2]]))[0])
    return [
        Check("centre", not centred, 0, Verdict.DOUBTFUL,
              "the frame's centre lies beyond the nodes: its PSF is that of the nearest place among them",
              "photograph the chart on all sides of the centre"),
        Check("interpolation", error, LARGE_ERROR, Verdict.DOUBTFUL,
              f"between the nodes the PSF is known to {error:.0%} of its norm only",
              "photograph the chart at more places"),
        Check("coverage", enclosed, SMALL_SHARE, Verdict.DOUBTFUL, f"the nodes enclose {enclosed:.0%} of the frame",
              "photograph the chart nearer to the frame's corners too", least=True),
    ]  # fmt: skip


def _doubted(nodes: Sequence[Node]) -> Check:
    """A field rests on its nodes: where many are doubted, so is the field; the commonest remedy comes first."""
    doubted = [node for node in nodes if node.doubt]
    commonest = Counter(node.remedy for node in doubted).most_common(1)
    remedy = commonest[0][0] if commonest else ""
    example = next((node.doubt for node in doubted if node.remedy == remedy), "")
    reason = f"{len(doubted)} of the {len(nodes)} charts are doubtful, for example: {example}"
    return Check("nodes", len(doubted), MANY_DOUBTS * len(nodes), Verdict.DOUBTFUL, reason, remedy)


def _numbers(found: Interpolation, maps: Sequence[FieldMap]) -> dict[str, Quantity]:
    """What is told of a plane in figures: the axis of its lens, and the median of each map."""
    field, n = found.field, len(found.field.nodes)
    numbers = {}
    if found.axis is not None:
        half = float(np.hypot(*field.shape)) / 2
        for i, name in enumerate("xy"):
            numbers[f"decentring_{name}"] = Quantity(
                float(found.axis.position[i]) * half,
                "pixel",
                float(np.sqrt(found.axis.covariance[i, i])) * half,
                "axis of symmetry of the PSFs, from the frame's centre",
                n,
            )
    for one in maps:
        if one.uncertainty is not None and np.isfinite(one.median(one.value)):
            spread, method = one.median(one.uncertainty), "median over the field, and of the uncertainty"
            numbers[f"{one.name}_median"] = Quantity(one.median(one.value), one.unit, spread, method, n)
    return numbers
