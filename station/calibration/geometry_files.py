"""The measurement of a geometry: numbers, entries of the record, covariances and tables."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.geometry.cameras import distortion
from procedures.geometry.estimate import Geometry
from procedures.geometry.spline_camera import SplineCamera
from procedures.outcome import Outcome, Quantity
from procedures.raw import RawFrame
from procedures.whole_camera.camera_file import write_camera_numbers
from procedures.whole_camera.from_field import CameraPart, WholeCamera, join
from station.calibration.chart_scale import ChartScale
from station.calibration.geometry import GeometryPhotographs, PlaneGeometry, ViewRecord
from station.calibration.stored_results import table_prefix
from station.results.exports import csv_bytes, csv_columns, numbers_table
from station.results.measurement import NUMBERS, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import npy

SCHEMA = "station/geometry/1"
NODES, CHART, POINTS = "nodes.npy", "chart.npy", "points.npy"
"""Tables of the chart's plan and its deviations from it, and of the points of all views; after the plane's prefix."""


def geometry_measurement(
    planes: Sequence[PlaneGeometry], head: RecordHead, scale: ChartScale | None = None
) -> Measurement:
    """Every plane's camera with its tables, and the record of the chart's scale; `found` are the planes."""
    cameras = {plane.shoot.plane: plane.outcome.value for plane in planes if plane.outcome.value is not None}
    files: dict[str, bytes | Callable[[Path], None]] = {}
    for name, camera in cameras.items():
        prefix = table_prefix(name, len(planes))
        first = camera.maps[0]
        x, y = (one.ravel() for one in np.meshgrid(first.x, first.y))
        dx, dy = distortion(camera.camera, np.column_stack([x, y])).T
        maps = {f"uncertainty_px_at_{one.distance_mm:g}_mm": one.value.ravel() for one in camera.maps}
        files |= {
            f"{prefix}covariance.npy": npy(camera.covariance),
            f"{prefix}joint_covariance.npy": npy(camera.adjustment.full_covariance),
            f"{prefix}{CHART}": npy(camera.shape.deviations_mm),
            f"{prefix}{NODES}": npy(camera.adjustment.problem.nodes),
            f"{prefix}{POINTS}": npy(_points(camera)),
            f"{prefix}residuals.csv": csv_bytes(_residual_rows(camera)),
            f"{prefix}projection.csv": csv_columns({"x": x, "y": y, "distortion_x": dx, "distortion_y": dy, **maps}, 6),
        }
        file = "camera.h5" if len(planes) == 1 else f"camera_{name}.h5"
        files[file] = partial(_write_camera, camera, head, scale)
    if cameras:
        files[NUMBERS] = numbers_table(row for name, one in cameras.items() for row in _numbers(name, one))
    missed = dict.fromkeys(miss for plane in planes for miss in plane.shoot.missed)
    return Measurement(
        SCHEMA, head, tuple(_plane(plane, scale) for plane in planes), files=files, missed=tuple(missed),
        exposure=planes[0].shoot.exposure, result=planes,
    )  # fmt: skip


def session_plane(plane: PlaneResult, frames: Sequence[RawFrame]) -> PlaneGeometry:
    """The plane of a session with its photographs."""
    camera: Geometry | None = plane.estimate
    views = {} if camera is None else {view.view.source: view.view for view in camera.views}
    records = (
        ViewRecord(frame.path, frame.sha256, views.get(frame.path.name), plane.verdict, exposure=frame.exposure)
        for frame in frames
    )
    return PlaneGeometry(GeometryPhotographs(plane.name, (0, 0), tuple(records)), plane.outcome(camera))


def _plane(one: PlaneGeometry, scale: ChartScale | None) -> PlaneResult:
    camera = one.outcome.value
    recorded = {} if scale is None else {"chart_scale": scale.to_record()}
    left_out = [miss.to_record() for miss in one.shoot.missed]
    return PlaneResult.of_outcome(
        one.shoot.plane, one.outcome, numbers={} if camera is None else camera.numbers(), estimate=camera, pitch=0,
        details={**({} if camera is None else _entries(camera)), **recorded, "left_out": left_out},
    )  # fmt: skip


def _entries(geometry: Geometry) -> dict[str, Any]:
    camera = geometry.camera
    budgets, numbers = geometry.budgets(), geometry.numbers()
    return {
        **{name: asdict(numbers[name]) | {"budget": budgets[name]} for name in budgets},
        "camera": {
            "model": camera.model,
            "columns": camera.columns,
            "rows": camera.rows,
            "names": list(camera.names),
            "params": camera.params.tolist(),
            **({"roughness_px": camera.roughness_px} if isinstance(camera, SplineCamera) else {}),
            "pixel_centres": "at integers; COLMAP's own numbers have 0.5 more in cx and cy",
        },
        "smoothness": [asdict(trial) for trial in geometry.trials],
        "formulas": [
            {
                "model": formula.camera.model, "names": list(formula.camera.names),
                "params": formula.camera.params.tolist(), "covariance": formula.covariance.tolist(),
                **asdict(formula.difference), "share": formula.share,
            }
            for formula in geometry.formulas
        ],
        "misfit": {"probability": geometry.misfit.probability, "rms_px": geometry.misfit.rms_px},
        "residual_scale": geometry.residual_scale,
        "covered_share": geometry.covered,
        "region": geometry.region.tolist(),
        "views": [  # X_camera = R X_chart + t, in mm from the chart's centre
            {
                "source": view.view.source, "points": len(view.view),
                "distance": asdict(view.distance) | {"budget": geometry.distance_budget(i)},
                "tilt_deg": view.tilt_deg, "residual_rms_px": view.rms_px,
                "R": view.pose.R.tolist(), "t_mm": view.pose.t.tolist(),
            }
            for i, view in enumerate(geometry.views)
        ],
        "next_view": None if geometry.next_view is None else asdict(geometry.next_view),
        "chart": {
            **{name: asdict(number) for name, number in geometry.shape.terms.items()},
            "node_mm": list(geometry.shape.node_mm),
            "scale_uncertainty": geometry.shape.scale_uncertainty,
        },
    }  # fmt: skip


def _write_camera(geometry: Geometry, head: RecordHead, scale: ChartScale | None, path: Path) -> None:
    """camera.h5: the camera alone, with the budget of its numbers and the record of the chart's scale."""
    camera, outcome = geometry.camera, Outcome(geometry)
    part = CameraPart("geometry", camera.names, camera.units, camera.params, geometry.covariance, "the chart's views")
    provenance = {"input": json.dumps([asdict(one) for one in head.input]), "parameters": json.dumps(head.parameters)}
    provenance["chart_scale"] = json.dumps(None if scale is None else scale.to_record())
    write_camera_numbers(path, WholeCamera(join([part], {}), (), (), outcome), provenance)


def _points(geometry: Geometry) -> npt.NDArray[np.float64]:
    """Every point: view, node, x, y, variance of x, covariance, variance of y."""
    views = [one.view for one in geometry.views]
    return np.concatenate([
        np.column_stack([np.full(len(view), i), view.index, view.points, view.covariance.reshape(-1, 4)[:, [0, 1, 3]]])
        for i, view in enumerate(views)
    ])  # fmt: skip


def _numbers(plane: str, geometry: Geometry) -> Iterator[tuple[str, str, Quantity]]:
    for name, number in geometry.numbers().items():
        yield plane, name, number
    for name, number in geometry.shape.terms.items():
        yield plane, f"chart_{name}", number
    for view in geometry.views:
        yield plane, f"distance {view.view.source}", view.distance


def _residual_rows(geometry: Geometry) -> Iterator[tuple[object, ...]]:
    yield "source", "node", "x", "y", "residual_x", "residual_y", "sigma_x", "sigma_y"
    for view in geometry.views:
        sigma = np.sqrt(np.einsum("naa->na", view.view.covariance))
        columns = np.hstack([view.view.points, view.residual_px, sigma])
        for node, row in zip(view.view.index, columns, strict=True):
            yield view.view.source, int(node), *(f"{value:.6g}" for value in row)
