"""The files of a geometry: the record, covariances, tables, and the page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.geometry.cameras import distortion
from procedures.geometry.estimate import Geometry, PosedView
from procedures.outcome import Outcome, Quantity
from procedures.raw import RawFrame
from station.calibration.geometry import GeometryPhotographs, PlaneGeometry, ViewRecord
from station.common.versions import software
from station.results.exports import csv_bytes, numbers_table
from station.results.geometry_planes import table_prefix
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, files_read, verdict_entry
from station.results.result_files import ResultFolder, npy, write_record

Array = npt.NDArray[np.float64]

SCHEMA = "station/geometry/1"
PAGE = "report.html"


def write_geometry_result(
    folder: ResultFolder,
    planes: Sequence[PlaneGeometry],
    *,
    parameters: Mapping[str, Any],
    start: float,
    report: bool = False,
) -> str:
    """Write covariances, tables, the page where it is wanted, and the record; returns the record's text."""
    head = RecordHead("geometry", files_read(planes[0].shoot.records), parameters)
    _write_files(folder, planes, head, report=report)
    return _write_record(folder, planes, replace(head, duration_s=round(time.perf_counter() - start, 3)))


def write_plane(folder: ResultFolder, plane: PlaneResult, frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The same files of a guided session's one plane and its photographs; what was refused has its record alone."""
    found: Geometry | None = plane.found
    views = {} if found is None else {one.view.source: one.view for one in found.views}
    records, size = [], (0, 0)
    for frame in frames:
        view, of = views.get(frame.path.name), frame.planes.get(plane.name)
        records.append(ViewRecord(frame.path, frame.sha256, view, plane.verdict))
        if of is not None:
            size = (of.samples.shape[1] * of.pitch, of.samples.shape[0] * of.pitch)
    shoot = GeometryPhotographs(plane.name, size, tuple(records))
    planes = [PlaneGeometry(shoot, plane.outcome(found))]
    _write_files(folder, planes, head, report=True)
    return _write_record(folder, planes, head)


def _write_files(folder: ResultFolder, planes: Sequence[PlaneGeometry], head: RecordHead, *, report: bool) -> None:
    """Covariances, tables and the page where it is wanted, of planes that have a camera."""
    found = {one.shoot.plane: one.outcome.value for one in planes if one.outcome.value is not None}
    if not found:
        return
    for name, geometry in found.items():
        _write_tables(folder, table_prefix(name, len(planes)), geometry)
    folder.write("numbers.csv", numbers_table(row for name, one in found.items() for row in _numbers(name, one)))
    if report:
        from station.reports.geometry_page import geometry_page  # it draws: that import is slow

        folder.write(PAGE, geometry_page(planes, head).encode())


def _write_record(folder: ResultFolder, planes: Sequence[PlaneGeometry], head: RecordHead) -> str:
    entries = {one.shoot.plane: geometry_entry(one.shoot, one.outcome) for one in planes}
    return write_record(folder, {"schema": SCHEMA, **head.told(), "planes": entries, "software": software()})


def geometry_entry(shoot: GeometryPhotographs, outcome: Outcome[Geometry]) -> dict[str, Any]:
    """What the record says of the plane that was measured."""
    entry = verdict_entry(outcome)
    missed = [_missed_entry(one) for one in shoot.missed]
    found = outcome.value
    if found is None:
        return {**entry, "left_out": missed}
    camera = found.camera
    return {
        **entry,
        **{name: asdict(number) for name, number in found.numbers().items()},
        "camera": {
            "model": camera.model,
            "columns": camera.columns,
            "rows": camera.rows,
            "names": list(camera.names),
            "params": camera.params.tolist(),
            "pixel_centres": "at integers; COLMAP's own numbers have 0.5 more in cx and cy",
        },
        "models": [asdict(trial) for trial in found.trials],
        "misfit": {"probability": found.misfit.probability, "rms_px": found.misfit.rms_px},
        "residual_scale": found.residual_scale,
        "covered_share": found.covered,
        "region": found.region.tolist(),
        "views": [_view_entry(one) for one in found.views],
        "left_out": missed,
        "next_view": None if found.next_view is None else asdict(found.next_view),
        "chart": {
            **{name: asdict(number) for name, number in found.shape.terms.items()},
            "node_mm": list(found.shape.node_mm),
            "scale_uncertainty": found.shape.scale_uncertainty,
        },
    }


def _missed_entry(record: ViewRecord) -> dict[str, str]:
    return {"source": record.path.name, "reason": record.reason, "remedy": record.remedy}


def _view_entry(one: PosedView) -> dict[str, Any]:
    """Pose, distance and residual of a view: X_camera = R X_chart + t, in mm from the chart's centre."""
    return {
        "source": one.view.source,
        "points": len(one.view),
        "distance": asdict(one.distance),
        "tilt_deg": one.tilt_deg,
        "residual_rms_px": one.rms_px,
        "R": one.pose.R.tolist(),
        "t_mm": one.pose.t.tolist(),
    }


def _write_tables(folder: ResultFolder, prefix: str, found: Geometry) -> None:
    folder.write(f"{prefix}covariance.npy", npy(found.covariance))
    joint = found.adjustment.covariance * found.residual_scale**2
    folder.write(f"{prefix}joint_covariance.npy", npy(joint))
    folder.write(f"{prefix}chart.npy", npy(found.shape.deviations_mm))
    folder.write(f"{prefix}residuals.csv", csv_bytes(_residual_rows(found)))
    folder.write(f"{prefix}projection.csv", csv_bytes(_projection_rows(found)))


def _numbers(plane: str, found: Geometry) -> Iterator[tuple[str, str, Quantity]]:
    for name, number in found.numbers().items():
        yield plane, name, number
    for name, number in found.shape.terms.items():
        yield plane, f"chart_{name}", number
    for one in found.views:
        yield plane, f"distance {one.view.source}", one.distance


def _residual_rows(found: Geometry) -> Iterator[tuple[object, ...]]:
    """Every correspondence: where it is seen, what is left, how well it is known."""
    yield "source", "node", "x", "y", "residual_x", "residual_y", "sigma_x", "sigma_y"
    for one in found.views:
        sigma = np.sqrt(np.einsum("naa->na", one.view.covariance))
        columns = np.hstack([one.view.points, one.residual_px, sigma])
        for node, row in zip(one.view.index, columns, strict=True):
            yield one.view.source, int(node), *(f"{value:.6g}" for value in row)


def _projection_rows(found: Geometry) -> Iterator[tuple[object, ...]]:
    """The maps over the frame: uncertainty of the projection at each distance, and what distortion does there."""
    distances = [f"uncertainty_px_at_{one.distance_mm:g}_mm" for one in found.maps]
    yield "x", "y", "distortion_x", "distortion_y", *distances
    first = found.maps[0]
    x, y = (one.ravel() for one in np.meshgrid(first.x, first.y))
    moved = distortion(found.camera, np.column_stack([x, y]))
    columns = [x, y, *moved.T, *(one.value.ravel() for one in found.maps)]
    for row in zip(*columns, strict=True):
        yield tuple(f"{value:.6g}" for value in row)
