"""The geometry of a camera from photographs of the chart: each measured by itself, all of a plane put together."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from procedures.geometry.chart_bins.photographs import views_of
from procedures.geometry.estimate import Geometry, GeometryParameters
from procedures.geometry.planes import calibrate_planes
from procedures.geometry.views import ChartView
from procedures.outcome import BadInput, Outcome, ProcedureError, Verdict
from procedures.pattern import Chart
from procedures.raw import RawFrame, default_plane, read_frame
from procedures.reading.sensor_dump import DumpLayout
from station.common.progress import Progress, silent


@dataclass(frozen=True)
class ViewRecord:
    """What a photograph gave.

    Attributes
    ----------
    path, sha256 : of the file, the hash "" where it could not be read
    view : ChartView or None
    verdict, reason, remedy : of the chart in it
    """

    path: Path
    sha256: str
    view: ChartView | None
    verdict: Verdict
    reason: str = ""
    remedy: str = ""


@dataclass(frozen=True, eq=False)
class GeometryPhotographs:
    """All photographs, measured in one plane.

    Attributes
    ----------
    plane : name of the plane that they were measured in
    size : (columns, rows) of the sensor, (0, 0) where no photograph could be read
    records : one for each photograph, in their order
    """

    plane: str
    size: tuple[int, int]
    records: tuple[ViewRecord, ...]

    @property
    def views(self) -> list[ChartView]:
        """Of the photographs that show the chart well."""
        return [record.view for record in self.records if record.view is not None]

    @property
    def missed(self) -> list[ViewRecord]:
        """The photographs that gave none."""
        return [record for record in self.records if record.view is None]


@dataclass(frozen=True)
class PlaneGeometry:
    """A plane's photographs, and the camera that they tell."""

    shoot: GeometryPhotographs
    outcome: Outcome[Geometry]


@dataclass(frozen=True)
class _Measured:
    """What a photograph gave in every plane; `unread` why it could not be read."""

    records: Mapping[str, ViewRecord]
    size: tuple[int, int] = (0, 0)
    unread: ViewRecord | None = None


def measure_views(
    paths: Sequence[Path], plane: str | None, chart: Chart, layout: DumpLayout | None = None, told: Progress = silent
) -> list[GeometryPhotographs]:
    """The charts of all photographs in each plane, several photographs at a time; one that fails is named, no more.

    Parameters
    ----------
    plane : str or None
        The colour plane, or "all"; None for green of RAW files, the only one of grey images.

    Raises
    ------
    BadInput
        If photographs are of different sizes or planes: they are not of one camera.
    """
    one = partial(_measure, plane=plane, chart=chart, layout=layout)
    found: list[_Measured] = []
    with ThreadPoolExecutor(min(len(paths), os.cpu_count() or 1)) as workers:
        try:
            for path, answer in zip(paths, workers.map(one, paths), strict=True):
                found.append(answer)
                told(path.name)
        finally:
            workers.shutdown(cancel_futures=True)
    return _together(found)


def _measure(path: Path, *, plane: str | None, chart: Chart, layout: DumpLayout | None) -> _Measured:
    try:
        names = None if plane == "all" else [plane or default_plane(path, layout)]
        frame = read_frame(path, names, layout)
    except ProcedureError as error:
        return _Measured({}, unread=ViewRecord(path, "", None, Verdict.REFUSED, error.reason, error.remedy))
    seen = views_of(frame.planes, chart, frame.path.name)
    return _Measured({name: _record(frame, one) for name, one in seen.items()}, _size(frame))


def _record(frame: RawFrame, seen: Outcome[ChartView]) -> ViewRecord:
    return ViewRecord(frame.path, frame.sha256, seen.value, seen.verdict, seen.reason, seen.remedy)


def _size(frame: RawFrame) -> tuple[int, int]:
    """Columns and rows of the sensor."""
    plane = next(iter(frame.planes.values()))
    rows, columns = plane.samples.shape
    return columns * plane.pitch, rows * plane.pitch


def _together(found: Sequence[_Measured]) -> list[GeometryPhotographs]:
    read = [(one, record) for one in found for record in list(one.records.values())[:1]]
    if not read:
        first = next(one.unread for one in found if one.unread)
        raise BadInput(f"none of {len(found)} photographs can be read; {first.path}: {first.reason}", first.remedy)
    kinds = {(one.size, ", ".join(one.records)): record.path for one, record in read}
    if len(kinds) > 1:
        differing = ", ".join(f"{path.name} {size[0]} x {size[1]} {planes}" for (size, planes), path in kinds.items())
        raise BadInput(
            f"photographs of one camera have one size and one plane; got {differing}",
            "give the photographs of one camera and one lens, all as RAW or all as grey images",
        )
    one, _ = read[0]
    return [GeometryPhotographs(name, one.size, tuple(_of_plane(name, found))) for name in one.records]


def _of_plane(name: str, found: Sequence[_Measured]) -> Iterator[ViewRecord]:
    """What every photograph gave in a plane."""
    for one in found:
        record = one.records.get(name, one.unread)
        if record is not None:
            yield record


def conclude(shoots: Sequence[GeometryPhotographs], parameters: GeometryParameters) -> list[PlaneGeometry]:
    """The camera of every plane of a shoot, or why it has none; where photographs gave none, a refusal names one."""
    found = calibrate_planes({one.plane: one.views for one in shoots}, shoots[0].size, parameters)
    return [PlaneGeometry(one, _with_missed(found[one.plane], one)) for one in shoots]


def _with_missed(found: Outcome[Geometry], shoot: GeometryPhotographs) -> Outcome[Geometry]:
    """The same; a refusal tells a photograph that was left out, too."""
    missed = shoot.missed
    if found.value is not None or not missed:
        return found
    first = missed[0]
    share = f"{len(missed)} of {len(shoot.records)} photographs gave none"
    reason = f"{found.reason}; {share}, {first.path.name}: {first.reason}"
    return replace(found, reason=reason, remedy=first.remedy or found.remedy)
