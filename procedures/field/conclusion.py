"""Results of many photographs' nodes: each plane's field, maps and numbers, lateral colour, best focus."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.choice import UNSEEN, Budget, combined, with_modes
from procedures.field.estimate import MeasuredChart, mean_budgets, mean_modes, median_subject
from procedures.field.focus import FocusSurface, focus_surface, sharpest
from procedures.field.interpolate import Interpolation, interpolate
from procedures.field.maps import FieldMap, LateralColour, derive, lateral_colour
from procedures.field.measuring import MeasuredFrames
from procedures.field.photosite import Photosite, WithoutPhotosite
from procedures.numbers import ERROR_INTERPOLATION, ERROR_NOISE, MTF50_RADIAL
from procedures.outcome import Check, Miss, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane

Limit = Callable[[Plane], Diffraction | None]  # diffraction limit of a plane, None where it is not known
REFERENCE = "G1"  # preferred reference plane of lateral colour
LARGE_ERROR = 0.1  # interpolation error, relative to the PSF's norm, above which a field is doubtful
SMALL_SHARE = 0.3  # share of the frame inside the nodes' hull below which a field is doubtful
MAX_DOUBTFUL_SHARE = 0.2
"""Accepted share of doubtful charts: one in a tour of nine, but not two of its four corners, which no other chart
outweighs."""


@dataclass(frozen=True, eq=False)
class PlaneField:
    """Results of one plane.

    centre, quality : the PSF at the frame's centre, and its numbers
    numbers : of the whole field: the axis of the lens, and the median of each map
    pitch : sensor pixels per pixel of the plane
    budgets : of the numbers at one chart, see `mean_budgets`
    subject : see `median_subject`
    """

    centre: Psf
    quality: Quality
    interpolation: Interpolation
    maps: tuple[FieldMap, ...]
    numbers: Mapping[str, Quantity]
    pitch: int = 1
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    subject: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FieldResult:
    """Results of all planes; `reference` is that of `focus` and of lateral colour, `photosite` is removed in the
    additional maps."""

    measured: MeasuredFrames
    planes: Mapping[str, Outcome[PlaneField]]
    colours: tuple[LateralColour, ...]
    reference: str
    focus: FocusSurface | None
    focus_refusal: str = ""
    photosite: Photosite | None = None


def conclude(
    measured: MeasuredFrames, focus: Mapping[str, float] | None = None, limit: Limit = lambda plane: None,
    at: Sequence[float] = (), photosite: Photosite | None = None,
) -> FieldResult:  # fmt: skip
    """Field, maps and numbers of every plane, lateral colour between them, best focus where positions are known.

    Raises Refused if no photograph gave any node.

    focus : mapping of photograph's name to focus position in mm; the field is then that of the sharpest position
    at : frequencies in cycles per pixel of the plane at which the MTF of the frame's centre is reported
    photosite : sagittal and meridional MTF50 are also mapped without it
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
        charts = [chart for chart in measured.charts.get(name, ()) if chart.node.source in sources]
        planes[name] = _plane_field(measured.planes[name], nodes, charts, limit, at, photosite)
    surface, refusal = None, ""
    if focus:
        try:
            surface = focus_surface(brackets[reference], _shape(measured.planes[reference]))
        except Refused as error:
            refusal = f"{error.reason}; {error.remedy}"
    colours = []
    for name, nodes in kept.items():
        plane = measured.planes[name]
        if name != reference:
            try:
                colours.append(lateral_colour(name, nodes, reference, kept[reference], _shape(plane), plane.pitch))
            except Refused:
                continue  # the plane's own record reports that there are too few
    return FieldResult(measured, planes, tuple(colours), reference, surface, refusal, photosite)


def _bracket(nodes: Sequence[Node], focus: Mapping[str, float]) -> dict[float, list[Node]]:
    """Nodes by focus position: all at 0 where none is known; otherwise without those of unknown position."""
    bracket: dict[float, list[Node]] = {}
    for node in nodes:
        if not focus or node.source in focus:
            bracket.setdefault(focus.get(node.source, 0.0), []).append(node)
    return bracket


def _shape(plane: Plane) -> tuple[int, int]:
    rows, columns = plane.samples.shape
    return int(rows), int(columns)


def _plane_field(
    plane: Plane, nodes: Sequence[Node], charts: Sequence[MeasuredChart], limit: Limit, at: Sequence[float],
    photosite: Photosite | None,
) -> Outcome[PlaneField]:  # fmt: skip
    rows, columns = shape = _shape(plane)
    try:
        interpolation = interpolate(plane.name, shape, nodes)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    maps = derive(interpolation.field, without=WithoutPhotosite(photosite, plane.pitch) if photosite else None)
    centre = interpolation.field.at((columns - 1) / 2, (rows - 1) / 2)
    diffraction = limit(plane)
    quality = with_modes(assess(centre, n=len(nodes), diffraction=diffraction, at=at), centre, mean_modes(charts))
    # check of the share of doubtful nodes, with the most frequent remedy
    doubtful = [node for node in nodes if node.caveat]
    remedy = next((remedy for remedy, _ in Counter(node.remedy for node in doubtful).most_common(1)), "")
    example = next((node.caveat for node in doubtful if node.remedy == remedy), "")
    reason = f"{len(doubtful)} of the {len(nodes)} charts are doubtful, for example: {example}"
    doubtful_nodes = Check("nodes", len(doubtful), MAX_DOUBTFUL_SHARE * len(nodes), Verdict.DOUBTFUL, reason, remedy)
    checks = [*_checks(interpolation, maps), doubtful_nodes, *beyond_diffraction(quality, diffraction)]
    # corruptions that the charts do not exclude: all places share them, so that a difference of two is free of them
    unseen = combined({term: size for term, size in quality.budgets.get(MTF50_RADIAL, {}).items() if term in UNSEEN})
    maps = tuple(
        replace(one, uncertainty=np.hypot(one.uncertainty, unseen))
        if one.uncertainty is not None and one.name.startswith("mtf50_")
        else one
        for one in maps
    )
    numbers = _numbers(interpolation, maps)
    spread, subject = mean_budgets(charts), median_subject(charts)
    return verdict_of(checks, PlaneField(centre, quality, interpolation, maps, numbers, plane.pitch, spread, subject))


def _checks(interpolation: Interpolation, maps: Sequence[FieldMap]) -> list[Check]:
    by_name = {one.name: one for one in maps}
    error = by_name[ERROR_INTERPOLATION].median(by_name[ERROR_INTERPOLATION].value)
    enclosed = by_name[ERROR_NOISE].share
    rows, columns = interpolation.field.shape
    centred = bool(interpolation.field.inside(np.array([[(columns - 1) / 2, (rows - 1) / 2]]))[0])
    return [
        interpolation.curvature,
        Check("centre", not centred, 0, Verdict.DOUBTFUL,
              "the frame's centre lies beyond the nodes: its PSF is that of the nearest place among them",
              "photograph the chart on all sides of the centre"),
        Check("interpolation", error, LARGE_ERROR, Verdict.DOUBTFUL,
              f"between the nodes the PSF is known to {error:.0%} of its norm only",
              "photograph the chart at more places"),
        Check("coverage", enclosed, SMALL_SHARE, Verdict.DOUBTFUL, f"the nodes enclose {enclosed:.0%} of the frame",
              "photograph the chart nearer to the frame's corners too", least=True),
    ]  # fmt: skip


def _numbers(interpolation: Interpolation, maps: Sequence[FieldMap]) -> dict[str, Quantity]:
    n, axis, numbers = len(interpolation.field.nodes), interpolation.axis, {}
    if axis is not None:
        half = float(np.hypot(*interpolation.field.shape)) / 2
        for name, at, variance in zip("xy", axis.position, np.diag(axis.covariance), strict=True):
            method = "axis of symmetry of the PSFs, from the frame's centre"
            error = float(np.sqrt(variance)) * half
            numbers[f"decentring_{name}"] = Quantity(float(at) * half, "pixel", error, method, n)
    for one in maps:
        if one.uncertainty is not None and np.isfinite(one.median(one.value)):
            value, spread = one.median(one.value), one.median(one.uncertainty)
            method = "median over the field, and of the uncertainty"
            numbers[f"{one.name}_median"] = Quantity(value, one.unit, spread, method, n)
    return numbers
