"""Nodes of many photographs, measured in parallel; a photograph that fails does not stop the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from procedures.field.estimate import NO_SENSORS, FrameNodes, MapLike, MeasuredChart, Sensors, measure_frame
from procedures.outcome import Miss, ProcedureError, Refused
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.psf_field import Node
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.sensor_dump import DumpLayout

Answer = tuple[RawFrame, FrameNodes] | ProcedureError


@dataclass(frozen=True, eq=False)
class MeasuredFrames:
    """Nodes of all photographs, by plane.

    frames : path and SHA-256 of the photographs that gave nodes
    planes : of the first photograph: pitch, origin and shape, without samples
    exposures : metadata of the photographs, without samples
    misses : photographs and charts without a result
    failed : names of the photographs without any result
    """

    frames: list[tuple[Path, str]] = field(default_factory=list)
    planes: dict[str, Plane] = field(default_factory=dict)
    exposures: list[RawFrame] = field(default_factory=list)
    nodes: dict[str, list[Node]] = field(default_factory=dict)
    misses: list[Miss] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    charts: dict[str, list[MeasuredChart]] = field(default_factory=dict)

    def add(self, name: str, answer: Answer) -> None:
        """Add the result of one photograph; a Miss where it failed, or its size or planes differ from the first."""
        if isinstance(answer, ProcedureError):
            self._fail(Miss(name, answer.reason, answer.remedy))
            return
        frame, measured = answer
        if self.planes and measured.shapes != {n: plane.samples.shape for n, plane in self.planes.items()}:
            reason = f"{name} has not the planes and sizes of {self.frames[0][0].name}"
            self._fail(Miss(name, reason, "give photographs of one camera, in one format"))
            return
        if not self.planes:
            for plane in frame.planes.values():
                empty = np.broadcast_to(np.float32(0), measured.shapes[plane.name])
                self.planes[plane.name] = replace(plane, samples=empty)
        self.frames.append((frame.path, frame.sha256))
        self.exposures.append(frame)
        self.misses.extend(measured.misses)
        for plane_name, nodes in measured.nodes.items():
            self.nodes.setdefault(plane_name, []).extend(nodes)
        for plane_name, charts in measured.charts.items():
            self.charts.setdefault(plane_name, []).extend(charts)
        if not any(measured.nodes.values()):
            self.failed.append(name)

    def _fail(self, miss: Miss) -> None:
        self.misses.append(miss)
        self.failed.append(miss.source)


def measure(
    paths: Sequence[Path], names: Sequence[str] | None, chart: Chart, parameters: PatternParameters,
    progress: Callable[[str], object] | None = None, layout: DumpLayout | None = None,
    content: Callable[[Path], bytes] | None = None, sensors: Sensors = NO_SENSORS,
) -> MeasuredFrames:  # fmt: skip
    """The nodes of all photographs, several at a time.

    names : the planes; None for all
    progress : called with the name of every finished photograph
    layout : layout of photographs without a header
    content : reads the files. An exception other than a ProcedureError ends the measurement.
    sensors : models of the planes' sensor from its calibration
    """
    measured = MeasuredFrames()

    def read(path: Path) -> RawFrame:
        return read_frame(path, names, layout, data=None if content is None else content(path))

    for path, answer in zip(paths, _in_parallel(paths, read, chart, parameters, sensors), strict=True):
        measured.add(path.name, answer)
        if progress is not None:
            progress(path.name)
    return measured


def measure_frames(
    frames: Iterable[RawFrame], chart: Chart, parameters: PatternParameters, sensors: Sensors = NO_SENSORS
) -> MeasuredFrames:
    """The nodes of photographs that are read one after the other; their charts are measured in parallel."""
    measured = MeasuredFrames()
    with ThreadPoolExecutor(os.cpu_count() or 1) as charts:
        for frame in frames:
            try:
                answer: Answer = _without_samples(frame), measure_frame(frame, chart, parameters, charts.map, sensors)
            except Refused as refusal:
                answer = refusal
            measured.add(frame.path.name, answer)
    return measured


def _in_parallel(
    paths: Sequence[Path], read: Callable[[Path], RawFrame], chart: Chart, parameters: PatternParameters,
    sensors: Sensors,
) -> Iterator[Answer]:  # fmt: skip
    """Results in the order of the photographs. Threads suffice: most of the time is spent without the interpreter's
    lock.

    Where there are fewer photographs than cores, their charts are distributed instead.
    """
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(min(len(paths), cores)) as frames, ThreadPoolExecutor(cores) as charts:
        each: MapLike = charts.map if len(paths) < cores else map

        def answer(path: Path) -> Answer:
            try:
                frame = read(path)
                return _without_samples(frame), measure_frame(frame, chart, parameters, each, sensors)
            except ProcedureError as error:
                return error

        try:
            yield from frames.map(answer, paths)
        finally:
            frames.shutdown(cancel_futures=True)
            charts.shutdown(cancel_futures=True)


def _without_samples(frame: RawFrame) -> RawFrame:
    nothing = np.zeros((0, 0), dtype=np.float32)
    return replace(frame, planes={name: replace(plane, samples=nothing) for name, plane in frame.planes.items()})
