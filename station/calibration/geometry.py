"""The geometry of a camera from photographs of the chart: views of each photograph, then the camera of each plane."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from procedures.geometry.chart_bins.photographs import views_of
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.views import ChartView
from procedures.outcome import BadInput, Miss, Outcome, ProcedureError, Verdict
from procedures.pattern import Chart
from procedures.raw import RawFrame, default_plane, read_frame
from procedures.reading.exposure import Exposure
from procedures.reading.sensor_dump import DumpLayout
from station.common.progress import Progress, silent, threads


@dataclass(frozen=True)
class ViewRecord:
    """The view of one photograph.

    path, sha256 : of the file, the hash "" where it could not be read
    verdict, reason, remedy : of the chart in it
    exposure : from the metadata
    """

    path: Path
    sha256: str
    view: ChartView | None
    verdict: Verdict
    reason: str = ""
    remedy: str = ""
    exposure: Exposure = field(default_factory=Exposure)


@dataclass(frozen=True, eq=False)
class GeometryPhotographs:
    """The views of all photographs in one plane.

    plane : name of the plane
    size : (columns, rows) of the sensor, (0, 0) where no photograph could be read
    records : one for each photograph, in order
    """

    plane: str
    size: tuple[int, int]
    records: tuple[ViewRecord, ...]

    @property
    def views(self) -> list[ChartView]:
        """The views of the photographs that have one."""
        return [record.view for record in self.records if record.view is not None]

    @property
    def missed(self) -> list[Miss]:
        """The photographs without a view."""
        return [Miss(record.path.name, record.reason, record.remedy) for record in self.records if record.view is None]

    @property
    def exposure(self) -> Exposure:
        """Exposure of the first readable photograph."""
        return next((record.exposure for record in self.records if record.sha256), Exposure())


@dataclass(frozen=True)
class PlaneGeometry:
    """A plane's photographs, and its camera."""

    shoot: GeometryPhotographs
    outcome: Outcome[Geometry]


@dataclass(frozen=True)
class _Measured:
    """The views of a photograph in every plane; `unread` is the reason why it could not be read."""

    records: Mapping[str, ViewRecord]
    size: tuple[int, int] = (0, 0)
    unread: ViewRecord | None = None


def measure_views(
    paths: Sequence[Path],
    plane: str | None,
    chart: Chart,
    layout: DumpLayout | None = None,
    progress: Progress = silent,
) -> list[GeometryPhotographs]:
    """Views of all photographs in each plane, or one (None: green of RAW files), several at a time; failures are
    recorded. Raises BadInput for different sizes or planes."""
    one = partial(_measure, plane=plane, chart=chart, layout=layout)
    measured: list[_Measured] = []
    with ThreadPoolExecutor(min(len(paths), threads())) as workers:
        try:
            for path, answer in zip(paths, workers.map(one, paths), strict=True):
                measured.append(answer)
                progress(f"read {path.name}")
        finally:
            workers.shutdown(cancel_futures=True)
    return _by_plane(measured)


def _measure(path: Path, *, plane: str | None, chart: Chart, layout: DumpLayout | None) -> _Measured:
    try:
        names = None if plane == "all" else [plane or default_plane(path, layout)]
        frame = read_frame(path, names, layout)
    except ProcedureError as error:
        return _Measured({}, unread=ViewRecord(path, "", None, Verdict.REFUSED, error.reason, error.remedy))
    views = views_of(frame.planes, chart, frame.path.name)
    records = {
        name: ViewRecord(frame.path, frame.sha256, view.value, view.verdict, view.reason, view.remedy, frame.exposure)
        for name, view in views.items()
    }
    return _Measured(records, _size(frame))


def _size(frame: RawFrame) -> tuple[int, int]:
    plane = next(iter(frame.planes.values()))
    rows, columns = plane.samples.shape
    return columns * plane.pitch, rows * plane.pitch


def _by_plane(measured: Sequence[_Measured]) -> list[GeometryPhotographs]:
    read = [(one, record) for one in measured for record in list(one.records.values())[:1]]
    if not read:
        first = next(one.unread for one in measured if one.unread)
        raise BadInput(f"none of {len(measured)} photographs can be read; {first.path}: {first.reason}", first.remedy)
    kinds = {(one.size, ", ".join(one.records)): record.path for one, record in read}
    if len(kinds) > 1:
        differing = ", ".join(f"{path.name} {size[0]} x {size[1]} {planes}" for (size, planes), path in kinds.items())
        raise BadInput(
            f"photographs of one camera must have one size and one plane; got {differing}",
            "give the photographs of one camera and one lens, all as RAW or all as grey images",
        )
    one, _ = read[0]
    planes = {name: [each.records.get(name, each.unread) for each in measured] for name in one.records}
    return [GeometryPhotographs(name, one.size, tuple(filter(None, records))) for name, records in planes.items()]


def conclude(
    shoots: Sequence[GeometryPhotographs], parameters: GeometryParameters, frame_rate_hz: float | None = None
) -> list[PlaneGeometry]:
    """The camera of every plane, or the reason why it has none; a refusal mentions a photograph without a view. With a
    frame rate the photographs are all frames of a video, in their order."""
    if frame_rate_hz is not None:
        parameters = replace(parameters, is_video=True)
        shoots = [
            replace(shoot, records=tuple(
                record if record.view is None else replace(record, view=replace(record.view, time_s=i / frame_rate_hz))
                for i, record in enumerate(shoot.records)
            ))
            for shoot in shoots
        ]  # fmt: skip
    return [
        PlaneGeometry(one, _with_missed(calibrate_geometry(one.views, one.size, parameters), one)) for one in shoots
    ]


def _with_missed(outcome: Outcome[Geometry], shoot: GeometryPhotographs) -> Outcome[Geometry]:
    missed = shoot.missed
    if outcome.value is not None or not missed:
        return outcome
    first = missed[0]
    share = f"{len(missed)} of {len(shoot.records)} photographs gave none"
    reason = f"{outcome.reason}; {share}, {first.source}: {first.reason}"
    return replace(outcome, reason=reason, remedy=first.remedy or outcome.remedy)
