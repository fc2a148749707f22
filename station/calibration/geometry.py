"""The geometry of a camera from photographs of the chart: each measured by itself, all put together."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from procedures.geometry.chart_bins.photographs import view_of
from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.views import ChartView
from procedures.outcome import BadInput, Outcome, ProcedureError, Refused, Verdict
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
    """All photographs, measured.

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
class _Measured:
    record: ViewRecord
    plane: str = ""
    size: tuple[int, int] = (0, 0)


def measure_views(
    paths: Sequence[Path], plane: str | None, chart: Chart, layout: DumpLayout | None = None, told: Progress = silent
) -> GeometryPhotographs:
    """The charts of all photographs, several at a time; one that fails is named, and the rest goes on.

    Parameters
    ----------
    plane : str or None
        The colour plane; None for green of RAW files, the only one of grey images.

    Raises
    ------
    BadInput
        If photographs are of different sizes: they are not of one camera.
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
        name = plane or default_plane(path, layout)
        frame = read_frame(path, [name], layout)
    except ProcedureError as error:
        return _Measured(ViewRecord(path, "", None, Verdict.REFUSED, error.reason, error.remedy))
    return _Measured(_record(frame, name, chart), name, _size(frame, name))


def _record(frame: RawFrame, name: str, chart: Chart) -> ViewRecord:
    try:
        seen = view_of(frame.planes[name], chart, frame.path.name)
    except Refused as refusal:
        return ViewRecord(frame.path, frame.sha256, None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return ViewRecord(frame.path, frame.sha256, seen.value, seen.verdict, seen.reason, seen.remedy)


def _size(frame: RawFrame, name: str) -> tuple[int, int]:
    """Columns and rows of the sensor."""
    plane = frame.planes[name]
    rows, columns = plane.samples.shape
    return columns * plane.pitch, rows * plane.pitch


def _together(found: Sequence[_Measured]) -> GeometryPhotographs:
    read = [one for one in found if one.plane]
    if not read:
        first = found[0].record
        raise BadInput(f"none of {len(found)} photographs can be read; {first.path}: {first.reason}", first.remedy)
    kinds = {(one.size, one.plane): one.record.path for one in read}
    if len(kinds) > 1:
        differing = ", ".join(f"{path.name} {size[0]} x {size[1]} {plane}" for (size, plane), path in kinds.items())
        raise BadInput(
            f"photographs of one camera have one size and one plane; got {differing}",
            "give the photographs of one camera and one lens, all as RAW or all as grey images",
        )
    return GeometryPhotographs(read[0].plane, read[0].size, tuple(one.record for one in found))


def conclude(shoot: GeometryPhotographs, parameters: GeometryParameters) -> Outcome[Geometry]:
    """The camera of a shoot, or why it has none; photographs that were left out are told in a doubt or refusal."""
    found = calibrate_geometry(shoot.views, shoot.size, parameters)
    missed = shoot.missed
    if found.value is not None or not missed:
        return found
    first = missed[0]
    share = f"{len(missed)} of {len(shoot.records)} photographs gave none"
    reason = f"{found.reason}; {share}, {first.path.name}: {first.reason}"
    return Outcome(None, found.verdict, reason, first.remedy or found.remedy)
