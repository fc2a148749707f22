"""The measurement of a geometry: numbers, entries of the record, covariances and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from procedures.geometry.cameras import distortion
from procedures.geometry.estimate import Geometry, PosedView
from procedures.outcome import Quantity
from procedures.raw import RawFrame
from station.calibration.geometry import GeometryPhotographs, PlaneGeometry, ViewRecord
from station.results.exports import csv_bytes, numbers_table
from station.results.geometry_planes import table_prefix
from station.results.measurement import NUMBERS, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import npy

SCHEMA = "station/geometry/1"


def geometry_measurement(planes: Sequence[PlaneGeometry], head: RecordHead) -> Measurement:
    """Each plane's camera with its tables; `found` are the planes themselves."""
    cameras = {one.shoot.plane: one.outcome.value for one in planes if one.outcome.value is not None}
    files: dict[str, bytes | Callable[[Path], None]] = {}
    for name, camera in cameras.items():
        files |= _tables(table_prefix(name, len(planes)), camera)
    if cameras:
        files[NUMBERS] = numbers_table(row for name, one in cameras.items() for row in _numbers(name, one))
    missed = dict.fromkeys(miss for one in planes for miss in one.shoot.missed)
    return Measurement(
        SCHEMA, head, tuple(map(_plane, planes)), files=files, missed=tuple(missed),
        exposure=planes[0].shoot.exposure, found=planes,
    )  # fmt: skip


def session_plane(plane: PlaneResult, frames: Sequence[RawFrame]) -> PlaneGeometry:
    """A session's one plane with the photographs that it was found in."""
    found: Geometry | None = plane.found
    views = {} if found is None else {one.view.source: one.view for one in found.views}
    records = (
        ViewRecord(frame.path, frame.sha256, views.get(frame.path.name), plane.verdict, exposure=frame.exposure)
        for frame in frames
    )
    return PlaneGeometry(GeometryPhotographs(plane.name, (0, 0), tuple(records)), plane.outcome(found))


def _plane(one: PlaneGeometry) -> PlaneResult:
    found = one.outcome.value
    left_out = [miss.told() for miss in one.shoot.missed]
    return PlaneResult.of_outcome(
        one.shoot.plane, one.outcome, numbers={} if found is None else found.numbers(), found=found, pitch=0,
        details={**({} if found is None else _entries(found)), "left_out": left_out},
    )  # fmt: skip


def _entries(found: Geometry) -> dict[str, Any]:
    """What the record says of a camera beside its numbers."""
    camera = found.camera
    return {
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
        "next_view": None if found.next_view is None else asdict(found.next_view),
        "chart": {
            **{name: asdict(number) for name, number in found.shape.terms.items()},
            "node_mm": list(found.shape.node_mm),
            "scale_uncertainty": found.shape.scale_uncertainty,
        },
    }


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


def _tables(prefix: str, found: Geometry) -> dict[str, bytes]:
    return {
        f"{prefix}covariance.npy": npy(found.covariance),
        f"{prefix}joint_covariance.npy": npy(found.adjustment.covariance * found.residual_scale**2),
        f"{prefix}chart.npy": npy(found.shape.deviations_mm),
        f"{prefix}residuals.csv": csv_bytes(_residual_rows(found)),
        f"{prefix}projection.csv": csv_bytes(_projection_rows(found)),
    }


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
