"""The PSF over the whole frame from a folder of photographs: measured one by one, put together by plane."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from procedures.field.chromatic import LateralColour, lateral_colour
from procedures.field.estimate import Each, FrameNodes, Miss, measure_frame
from procedures.field.focus import FocusSurface, focus_surface, sharpest
from procedures.field.interpolate import Interpolation, interpolate
from procedures.field.maps import FieldMap, derive
from procedures.outcome import ProcedureError, Quantity, Refused, Rule, Verdict, verdict_of
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.psf_field import Node
from procedures.quality import assess
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.sensor_dump import DumpLayout
from station.calibration.plane_records import Limit
from station.common.progress import Progress, silent
from station.results.result_files import PlaneRecord

REFERENCE = "G1"
"""The plane that lateral colour is told against."""
LARGE_ERROR = 0.1
"""Of the PSF's norm: an interpolation that errs by more is doubted."""
SMALL_SHARE = 0.3
"""Of the frame: nodes that enclose less are doubted."""


@dataclass(frozen=True, eq=False)
class Measured:
    """All nodes of all photographs.

    Attributes
    ----------
    frames : list of (path, SHA-256)
        That gave nodes.
    planes : mapping of name to Plane
        Of the first photograph: pitch, origin and shape; its samples are not kept.
    exposures : list of RawFrame
        What the camera noted, without samples.
    nodes : mapping of plane to nodes
    misses : what gave no node, and why
    failed : names of the photographs that gave none at all
    doubts : number of nodes whose verdict was doubtful
    """

    frames: list[tuple[Path, str]] = field(default_factory=list)
    planes: dict[str, Plane] = field(default_factory=dict)
    exposures: list[RawFrame] = field(default_factory=list)
    nodes: dict[str, list[Node]] = field(default_factory=dict)
    misses: list[Miss] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    doubts: list[int] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class PlaneField:
    """One plane's answer; the record's PSF is that of the frame's centre. No interpolation where it was refused."""

    record: PlaneRecord
    interpolation: Interpolation | None = None
    maps: tuple[FieldMap, ...] = ()
    numbers: Mapping[str, Quantity] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FieldResult:
    """The whole answer; `reference` is the number of the plane that lateral colour and focus are told of."""

    measured: Measured
    planes: tuple[PlaneField, ...]
    colours: tuple[LateralColour, ...]
    reference: int
    focus: FocusSurface | None
    focus_refusal: str = ""


def measure(
    paths: Sequence[Path], names: Sequence[str] | None, chart: Chart, parameters: PatternParameters,
    told: Progress = silent, layout: DumpLayout | None = None,
) -> Measured:  # fmt: skip
    """The nodes of all photographs, several at a time; one that fails is named, and the rest goes on.

    Parameters
    ----------
    names : sequence of str or None
        The planes; None for all.
    layout : DumpLayout, optional
        How the samples lie in photographs without a header.
    """
    found = Measured()
    read = partial(read_frame, names=names, layout=layout)
    for path, answer in zip(paths, _side_by_side(paths, read, chart, parameters), strict=True):
        if isinstance(answer, ProcedureError):
            found.misses.append(Miss(path.name, answer.reason, answer.remedy))
            found.failed.append(path.name)
        else:
            _gather(found, *answer)
        told(path.name)
    return found


def measure_frames(frames: Iterable[RawFrame], chart: Chart, parameters: PatternParameters) -> Measured:
    """The nodes of photographs that are read one after the other; their charts are shared out among the cores."""
    found = Measured()
    with ThreadPoolExecutor(os.cpu_count() or 1) as charts:
        for frame in frames:
            try:
                nodes = measure_frame(frame, chart, parameters, charts.map)
            except Refused as refusal:
                found.misses.append(Miss(frame.path.name, refusal.reason, refusal.remedy))
                found.failed.append(frame.path.name)
            else:
                _gather(found, _without_samples(frame), nodes)
    return found


Answer = tuple[RawFrame, FrameNodes] | ProcedureError


def _side_by_side(
    paths: Sequence[Path], read: Callable[[Path], RawFrame], chart: Chart, parameters: PatternParameters
) -> Iterator[Answer]:
    """Answers in the order of the photographs. Threads: nearly all the time goes into code that lets others run.

    Where there are fewer photographs than cores, their charts are shared out instead.
    """
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(min(len(paths), cores)) as frames, ThreadPoolExecutor(cores) as charts:
        each: Each = charts.map if len(paths) < cores else map

        def one(path: Path) -> Answer:
            try:
                frame = read(path)
                return _without_samples(frame), measure_frame(frame, chart, parameters, each)
            except ProcedureError as error:
                return error

        try:
            yield from frames.map(one, paths)
        finally:
            frames.shutdown(cancel_futures=True)
            charts.shutdown(cancel_futures=True)


def _without_samples(frame: RawFrame) -> RawFrame:
    """What is kept of a photograph while others are measured."""
    nothing = np.zeros((0, 0), dtype=np.float32)
    return replace(frame, planes={name: replace(plane, samples=nothing) for name, plane in frame.planes.items()})


def _gather(found: Measured, frame: RawFrame, measured: FrameNodes) -> None:
    """Add one photograph; Miss where it is not of the size or planes of the first."""
    shapes = {name: plane.samples.shape for name, plane in found.planes.items()}
    if found.planes and measured.shapes != shapes:
        reason = f"{frame.path.name} has not the planes and sizes of {found.frames[0][0].name}"
        found.misses.append(Miss(frame.path.name, reason, "give photographs of one camera, in one format"))
        found.failed.append(frame.path.name)
        return
    if not found.planes:
        for name, plane in frame.planes.items():
            empty = np.broadcast_to(np.float32(0), measured.shapes[name])
            found.planes[name] = replace(plane, samples=empty)
    found.frames.append((frame.path, frame.sha256))
    found.exposures.append(frame)
    found.misses.extend(measured.misses)
    found.doubts.append(measured.doubts)
    for name, nodes in measured.nodes.items():
        found.nodes.setdefault(name, []).extend(nodes)
    if not any(measured.nodes.values()):
        found.failed.append(frame.path.name)


def conclude(
    measured: Measured, focus: Mapping[str, float] | None = None, limit: Limit = lambda plane: None,
    told: Progress = silent,
) -> FieldResult:  # fmt: skip
    """Field, maps and numbers of every plane, lateral colour between them, best focus where positions are known.

    Parameters
    ----------
    focus : mapping of photograph's name to focus position in mm, optional
        The field is then that of the sharpest position.

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
    planes = []
    for name, nodes in kept.items():
        planes.append(_plane_field(measured.planes[name], nodes, limit))
        told(f"field of {name}")
    surface, refusal = None, ""
    if focus:
        try:
            surface = focus_surface(brackets[reference], _shape(measured.planes[reference]))
        except Refused as error:
            refusal = f"{error.reason}; {error.remedy}"
    colours = _colours(measured, kept, reference)
    return FieldResult(measured, tuple(planes), colours, list(kept).index(reference), surface, refusal)


def _bracket(nodes: Sequence[Node], focus: Mapping[str, float]) -> dict[float, list[Node]]:
    """Nodes by focus position; all at 0 where none is known, those of photographs without one left out otherwise."""
    found: dict[float, list[Node]] = {}
    for node in nodes:
        if not focus or node.source in focus:
            found.setdefault(focus.get(node.source, 0.0), []).append(node)
    return found


def _colours(measured: Measured, kept: Mapping[str, Sequence[Node]], reference: str) -> tuple[LateralColour, ...]:
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


def _plane_field(plane: Plane, nodes: Sequence[Node], limit: Limit) -> PlaneField:
    shape = _shape(plane)
    try:
        found = interpolate(plane.name, shape, nodes)
    except Refused as refusal:
        return PlaneField(PlaneRecord(plane.name, Verdict.REFUSED, refusal.reason, refusal.remedy))
    maps = derive(found.field)
    centre = found.field.at((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    verdict, reason, remedy = verdict_of(_rules(found, maps))
    record = PlaneRecord(
        plane.name,
        verdict,
        reason,
        remedy,
        psf=centre,
        quality=assess(centre, n=len(nodes), diffraction=limit(plane)),
        numbers={"nodes": len(nodes), "components": len(found.field.components)},
    )
    return PlaneField(record, found, maps, _numbers(found, maps))


def _rules(found: Interpolation, maps: Sequence[FieldMap]) -> list[Rule]:
    """What makes a field doubtful."""
    by_name = {one.name: one for one in maps}
    error = float(np.nanmedian(by_name["error_interpolation"].value))
    enclosed = float(np.isfinite(by_name["error_noise"].value).mean())
    rows, columns = found.field.shape
    centred = bool(found.field.inside(np.array([[(columns - 1) / 2, (rows - 1) / 2]]))[0])
    return [
        Rule(
            Verdict.DOUBTFUL,
            not centred,
            "the frame's centre lies beyond the nodes: its PSF is that of the nearest place among them",
            "photograph the chart on all sides of the centre",
        ),
        Rule(
            Verdict.DOUBTFUL,
            error > LARGE_ERROR,
            f"between the nodes the PSF is told to {error:.0%} of its norm only",
            "photograph the chart at more places",
        ),
        Rule(
            Verdict.DOUBTFUL,
            enclosed < SMALL_SHARE,
            f"the nodes enclose {enclosed:.0%} of the frame",
            "photograph the chart nearer to the frame's corners too",
        ),
    ]


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
        if one.uncertainty is not None and np.isfinite(one.value).any():
            spread = float(np.nanmedian(one.uncertainty))
            numbers[f"{one.name}_median"] = Quantity(
                float(np.nanmedian(one.value)), one.unit, spread, "median over the field, and of the uncertainty", n
            )
    return numbers
