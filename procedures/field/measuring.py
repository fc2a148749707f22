"""The nodes of many photographs: measured one by one, side by side, none of them stopping the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from procedures.field.estimate import NO_SENSORS, FrameNodes, MapLike, Sensors, measure_frame
from procedures.field.seen_charts import SeenChart
from procedures.outcome import Miss, ProcedureError, Refused
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.psf_field import Node
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.sensor_dump import DumpLayout

Told = Callable[[str], object]
"""Hears of every photograph and plane that is done."""


def silent(done: str) -> None:
    """Nobody listens."""


@dataclass(frozen=True, eq=False)
class MeasuredFrames:
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
    charts : mapping of plane to what each node's chart tells beside it
    """

    frames: list[tuple[Path, str]] = field(default_factory=list)
    planes: dict[str, Plane] = field(default_factory=dict)
    exposures: list[RawFrame] = field(default_factory=list)
    nodes: dict[str, list[Node]] = field(default_factory=dict)
    misses: list[Miss] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    charts: dict[str, list[SeenChart]] = field(default_factory=dict)


def measure(
    paths: Sequence[Path], names: Sequence[str] | None, chart: Chart, parameters: PatternParameters,
    told: Told = silent, layout: DumpLayout | None = None, content: Callable[[Path], bytes] | None = None,
    sensors: Sensors = NO_SENSORS,
) -> MeasuredFrames:  # fmt: skip
    """The nodes of all photographs, several at a time; one that fails is named, and the rest goes on.

    Parameters
    ----------
    names : sequence of str or None
        The planes; None for all.
    layout : DumpLayout, optional
        How the samples lie in photographs without a header.
    content : callable, optional
        Reads the files, where they are not just read. What it raises that is no ProcedureError ends the measurement.
    sensors : Sensors
        What is known of the planes' sensor from its own calibration.
    """
    found = MeasuredFrames()

    def read(path: Path) -> RawFrame:
        if content is None:
            return read_frame(path, names, layout)
        return read_frame(path, names, layout, data=content(path))

    for path, answer in zip(paths, _side_by_side(paths, read, chart, parameters, sensors), strict=True):
        if isinstance(answer, ProcedureError):
            found.misses.append(Miss(path.name, answer.reason, answer.remedy))
            found.failed.append(path.name)
        else:
            _gather(found, *answer)
        told(path.name)
    return found


def measure_frames(
    frames: Iterable[RawFrame], chart: Chart, parameters: PatternParameters, sensors: Sensors = NO_SENSORS
) -> MeasuredFrames:
    """The nodes of photographs that are read one after the other; their charts are shared out among the cores."""
    found = MeasuredFrames()
    with ThreadPoolExecutor(os.cpu_count() or 1) as charts:
        for frame in frames:
            try:
                nodes = measure_frame(frame, chart, parameters, charts.map, sensors)
            except Refused as refusal:
                found.misses.append(Miss(frame.path.name, refusal.reason, refusal.remedy))
                found.failed.append(frame.path.name)
            else:
                _gather(found, _without_samples(frame), nodes)
    return found


Answer = tuple[RawFrame, FrameNodes] | ProcedureError


def _side_by_side(
    paths: Sequence[Path],
    read: Callable[[Path], RawFrame],
    chart: Chart,
    parameters: PatternParameters,
    sensors: Sensors,
) -> Iterator[Answer]:
    """Answers in the order of the photographs. Threads: nearly all the time goes into code that lets others run.

    Where there are fewer photographs than cores, their charts are shared out instead.
    """
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(min(len(paths), cores)) as frames, ThreadPoolExecutor(cores) as charts:
        each: MapLike = charts.map if len(paths) < cores else map

        def one(path: Path) -> Answer:
            try:
                frame = read(path)
                return _without_samples(frame), measure_frame(frame, chart, parameters, each, sensors)
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


def _gather(found: MeasuredFrames, frame: RawFrame, measured: FrameNodes) -> None:
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
    for name, nodes in measured.nodes.items():
        found.nodes.setdefault(name, []).extend(nodes)
    for name, charts in measured.charts.items():
        found.charts.setdefault(name, []).extend(charts)
    if not any(measured.nodes.values()):
        found.failed.append(frame.path.name)
