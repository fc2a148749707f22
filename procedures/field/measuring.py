"""Nodes of many photographs, measured in parallel; a photograph that fails does not stop the others."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy.linalg

from procedures.field.estimate import NO_SENSORS, FrameNodes, MapLike, MeasuredChart, Sensors, measure_frame
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import monomials
from procedures.outcome import BadParameter, Miss, ProcedureError, Refused
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
        """Add the result of one photograph; a Miss where it failed, is a copy, or has other planes than the
        first."""
        if isinstance(answer, ProcedureError):
            self._fail(Miss(name, answer.reason, answer.remedy))
            return
        frame, measured = answer
        if self.planes and measured.shapes != {n: plane.samples.shape for n, plane in self.planes.items()}:
            reason = f"{name} has not the planes and sizes of {self.frames[0][0].name}"
            self._fail(Miss(name, reason, "give photographs of one camera, in one format"))
            return
        copied = [path.name for path, digest in self.frames if digest and digest == frame.sha256]
        if copied:
            self._fail(Miss(name, f"{name} has the content of {copied[0]}", "give it once"))
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
            progress(f"read {path.name}")
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
    """Results in the order of the photographs, by threads, as most work does without the interpreter's lock; for few
    photographs their charts are distributed."""
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


# --- Positions of the chart in the frame, their order, and the moves of a rig that bring the chart there ---

CANDIDATES = 25  # candidate positions along the longer side


@dataclass(frozen=True)
class Location:
    """Position of a chart's centre, in fractions of the frame's width and height from the top left."""

    x: float
    y: float

    def in_pixels(self, shape: tuple[int, int]) -> tuple[float, float]:
        """(x, y) in pixels of a plane with that many rows and columns."""
        return self.x * shape[1] - 0.5, self.y * shape[0] - 0.5


def chosen_locations(n: int, aspect: float = 1.5) -> list[Location]:
    """The n positions, up to the frame's sides, that determine a smooth surface best, in an order with short moves.

    They are the pivots of the QR decomposition of the monomials over a fine grid (approximate Fekete points), of the
    highest degree that n determine; further ones are placed in the largest gaps.

    aspect : width over height of the frame

    Source: Sommariva, Vianello, Computing approximate Fekete points by QR factorizations of Vandermonde matrices, 2009.
    """
    if n < 3:
        raise BadParameter(f"a surface needs three places or more; got {n}", "choose 6 or more")
    columns, rows = CANDIDATES, max(round(CANDIDATES / aspect), 3)
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    candidates = np.column_stack([x.ravel(), y.ravel()])
    degree = 0
    while (degree + 2) * (degree + 3) // 2 <= n:
        degree += 1
    V = monomials(candidates, degree)
    chosen: list[int] = scipy.linalg.qr(V.T, mode="r", pivoting=True)[1][: V.shape[1]].tolist()
    while len(chosen) < n:
        apart = (candidates[:, None] - candidates[chosen]) * [aspect, 1.0]
        chosen.append(int(np.argmax(np.hypot(*apart.T).min(axis=0))))
    return [Location(float(a), float(b)) for a, b in _boustrophedon(0.5 + candidates[chosen] / 2)]


def _boustrophedon(places: Array) -> Array:
    """The positions in bands from top to bottom, every other band from right to left."""
    bands = max(round(np.sqrt(len(places))), 1)
    order = np.array_split(np.argsort(places[:, 1], kind="stable"), bands)
    ways = [part[np.argsort(places[part, 0])][:: 1 if i % 2 == 0 else -1] for i, part in enumerate(order)]
    return np.asarray(places[np.concatenate(ways)])


def ray(location: Location, shape: tuple[int, int], principal_px: float) -> Array:
    """Unit vector (3,) from the camera to a position of its frame: x right, y down, z ahead; principal_px : focal
    length over pitch of the plane."""
    x, y = location.in_pixels(shape)
    towards = np.array([x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2, principal_px])
    return np.asarray(towards / np.linalg.norm(towards))


def direction(ray: Array, pan_deg: float, tilt_deg: float) -> Array:
    """A ray of the camera in the axes of the head, R_y(pan) R_x(tilt) ray: both right-handed, y down."""
    (cp, sp), (ct, st) = ((np.cos(a), np.sin(a)) for a in np.radians([pan_deg, tilt_deg]))
    R_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    R_x = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    return np.asarray(R_y @ R_x @ ray)


def pan_tilt_deg(
    location: Location, shape: tuple[int, int], principal_px: float, towards: Array
) -> tuple[float, float]:
    """Pan and tilt at which the chart appears at a position of the frame.

    A camera that is panned (about its vertical), then tilted (about its horizontal) sees the direction d as the ray
    t = R^-1 d. Rotated back by the tilt, t keeps its x; rotated by the pan, d keeps its y: R_x(tilt) t = R_y(pan)^-1 d
    is two equations, in x for the pan and in y for the tilt.

    shape, principal_px : as in `ray`; towards : (3,) direction of the chart's centre, in the axes of a head at rest.
    """
    t, d = ray(location, shape, principal_px), towards / np.linalg.norm(towards)
    pan = np.arctan2(d[0], d[2]) - np.arcsin(t[0] / np.hypot(d[0], d[2]))
    tilt = np.arctan2(t[1], t[2]) - np.arcsin(d[1] / np.hypot(t[1], t[2]))
    return float(np.degrees(pan)), float(np.degrees(tilt))


def rail_mm(location: Location, shape: tuple[int, int], principal_px: float, distance_mm: float) -> tuple[float, float]:
    """Moves of the camera to the right and down by which a chart on the axis appears at a position of the frame."""
    x, y = location.in_pixels(shape)
    scale = distance_mm / principal_px
    return -(x - (shape[1] - 1) / 2) * scale, -(y - (shape[0] - 1) / 2) * scale
