"""mrcal's .cameramodel, with `optimization_inputs`, from which its tools compute the uncertainty of projection.

mrcal adjusts one formula, the poses, and points of a flat regular board with independent errors. The calibration here
also adjusts the print and may include a model discrepancy. The file therefore holds what an exact board would have
shown: the projection by the written formula, and the residuals. mrcal takes the noise from their spread; they are
multiplied so that its uncertainty over the covered frame, in the mean of that at the charts and at infinity, is the
stated one.

Source: Kogan, mrcal documentation, "Camera model files" and "Projection uncertainty".
"""

from base64 import b85encode
from io import BytesIO
from math import isqrt

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from procedures.geometry.conversion import OpenCvCamera, covered_grid
from procedures.geometry.rig import RigCamera
from procedures.geometry.views import Pose
from procedures.numbers import projection_at
from procedures.numerics.arrays import Array
from station.calibration.geometry_files import CHART
from station.calibration.stored_cameras import StoredCamera, plane_table, read_rig_camera
from station.calibration.stored_results import plane_entry, stored_record, table_prefix

GRID = (15, 11)
HIDDEN = -1.0
METRE = 1000.0
POSE = 6
"""Columns of OpenCV's derivatives: rotation and shift, before the camera's parameters."""


def cameramodel(stored: StoredCamera, camera: OpenCvCamera) -> str:
    """The file's text, with `optimization_inputs` where the result has its tables beside it."""
    outline = [*stored.region.tolist(), stored.region[0].tolist()]
    inputs = _inputs(stored, camera)
    lines = [
        f"# {stored.source}",
        "{",
        f"    'lensmodel':  {_lensmodel(camera)!r},",
        f"    'intrinsics': {_intrinsics(camera).tolist()},",
        f"    'valid_intrinsics_region': {outline},",
        "    'extrinsics': [0, 0, 0, 0, 0, 0],",
        f"    'imagersize': [{stored.camera.columns}, {stored.camera.rows}],",
        *([] if inputs is None else ["    'icam_intrinsics': 0,", f"    'optimization_inputs': {_packed(inputs)!r},"]),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _lensmodel(camera: OpenCvCamera) -> str:
    return f"LENSMODEL_OPENCV{len(camera.distortion)}"


def _intrinsics(camera: OpenCvCamera) -> Array:
    return np.array([*camera.focal_px, *camera.centre, *camera.distortion], dtype=np.float64)


def _packed(inputs: dict[str, object]) -> bytes:
    """NumPy's compressed archive in ASCII; mrcal reads an empty text as nothing."""
    archive = BytesIO()
    np.savez_compressed(archive, **inputs)  # type: ignore[arg-type]
    return b85encode(archive.getvalue())


def _inputs(stored: StoredCamera, camera: OpenCvCamera) -> dict[str, object] | None:
    """Arguments of mrcal's optimisation; None without tables, or for charts behind a pinhole."""
    if stored.record is None:
        return None
    with stored_record(stored.record, "geometry", "calibrate the camera again") as record:
        name, entry = plane_entry(record.data["planes"], stored.plane, record.path)
        shape = table_prefix(name, len(record.data["planes"])) + CHART
        if not (record.path.parent / shape).is_file():
            return None
        taken = read_rig_camera(stored.record, name).camera
        nodes = taken.nodes + plane_table(record, shape, "shape of the chart", 3)
        usual = float(np.median([np.linalg.norm(pose.t) for pose in taken.poses]))
        stated = {distance: float(entry[projection_at(distance)]["value"]) for distance in (usual, np.inf)}
    if min((pose.apply(nodes)[:, 2].min() for pose in taken.poses), default=0.0) <= 0:
        return None
    side, corner = isqrt(len(nodes)), taken.nodes[:1]
    sigma = [np.sqrt(np.einsum("naa->n", view.covariance) / 2) for view in taken.views]
    unit_px = float(np.mean(np.concatenate(sigma) ** -2.0) ** -0.5)
    residuals = [
        view.points - taken.camera.project(pose.apply(nodes[view.index]))
        for view, pose in zip(taken.views, taken.poses, strict=True)
    ]
    now = np.concatenate([residual / one[:, None] for residual, one in zip(residuals, sigma, strict=True)])
    enlarged = _noise(stored, camera, taken, sigma, stated) / float(np.std(now))
    observed = np.full((len(sigma), side * side, 3), HIDDEN)
    for board, view, pose, residual, one in zip(observed, taken.views, taken.poses, residuals, sigma, strict=True):
        flat = _seen(camera, taken.nodes[view.index], pose)[0]
        board[view.index] = np.column_stack([flat + enlarged * residual, unit_px / one])
    return {
        "lensmodel": _lensmodel(camera),
        "intrinsics": _intrinsics(camera)[None],
        "imagersizes": np.array([[stored.camera.columns, stored.camera.rows]], dtype=np.int32),
        "extrinsics_rt_fromref": np.zeros((0, 6)),
        "frames_rt_toref": np.array([[*_turn(pose), *(pose.apply(corner)[0] / METRE)] for pose in taken.poses]),
        "observations_board": observed.reshape(-1, side, side, 3),
        "indices_frame_camintrinsics_camextrinsics": np.array([[i, 0, -1] for i in range(len(sigma))], dtype=np.int32),
        "calibration_object_spacing": float(taken.nodes[1, 0] - taken.nodes[0, 0]) / METRE,
        **dict.fromkeys(("points", "observations_point", "indices_point_camintrinsics_camextrinsics"), ""),
        "calobject_warp": "",
        **{f"do_optimize_{one}": True for one in ("intrinsics_core", "intrinsics_distortions", "extrinsics", "frames")},
        "do_optimize_calobject_warp": False,
        "do_apply_outlier_rejection": False,
        "do_apply_regularization": False,
        "verbose": False,
    }


def _turn(pose: Pose) -> Array:
    return np.asarray(Rotation.from_matrix(pose.R).as_rotvec())


def _seen(camera: OpenCvCamera, points: Array, pose: Pose) -> tuple[Array, Array]:
    """Pixels (n, 2) of points (n, 3) of a chart, and derivatives (n, 2, 6 + p) by pose and camera."""
    (fx, fy), (cx, cy) = camera.focal_px, camera.centre
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    given = np.ascontiguousarray(points)[:, None]
    pixels, derivatives = cv2.projectPoints(given, _turn(pose), pose.t, K, camera.distortion)
    return np.asarray(pixels[:, 0], dtype=np.float64), derivatives.reshape(len(points), 2, -1).astype(np.float64)


def _noise(
    stored: StoredCamera, camera: OpenCvCamera, taken: RigCamera, sigma: list[Array], stated: dict[float, float]
) -> float:
    """Noise, in standard deviations of the points, from which mrcal computes the stated {distance in mm: pixel rms}."""
    p, count = 4 + len(camera.distortion), len(taken.poses)
    N = np.zeros((p + POSE * count, p + POSE * count))
    for i, (view, pose) in enumerate(zip(taken.views, taken.poses, strict=True)):
        J = _seen(camera, taken.nodes[view.index], pose)[1] / sigma[i][:, None, None]
        columns = np.r_[p + POSE * i : p + POSE * (i + 1), :p]
        N[np.ix_(columns, columns)] += np.einsum("nai,naj->ij", J, J, optimize=True)
    scale = np.sqrt(np.diag(N))
    covariance = np.linalg.inv(N / np.outer(scale, scale)) / np.outer(scale, scale)
    _, rays = covered_grid(stored.camera, stored.region, GRID)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    ratios = []
    for distance, value in stated.items():
        D, far = np.zeros((len(rays), 2, len(N))), distance == np.inf
        points = rays * (1.0 if far else distance)
        for i, pose in enumerate(taken.poses):
            own = Pose(pose.R, np.zeros(3)) if far else pose
            J = _seen(camera, (points - own.t) @ own.R, own)[1]
            moved = J[..., :POSE] * np.repeat([1.0, 0.0 if far else 1.0], 3) / count
            D[..., p + POSE * i : p + POSE * (i + 1)] = moved
            D[..., :p] = J[..., POSE:]
        ratios.append(value / np.sqrt(np.mean(np.einsum("nai,ij,naj->n", D, covariance, D, optimize=True))))
    return float(np.sqrt(np.prod(ratios)))
