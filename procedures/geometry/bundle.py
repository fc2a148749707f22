"""Bundle adjustment with a flat chart of known dimensions: the initial estimate.

Lenses up to some 100 degrees start as pinholes with radial distortion, adjusted by pycolmap; wider ones start as
equidistant or stereographic ones, adjusted by this package.

Source: Schönberger, Frahm, Structure-from-Motion Revisited, CVPR 2016; the solver is Ceres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from procedures.geometry import stereographic
from procedures.geometry.adjustment import AdjustmentProblem, adjust
from procedures.geometry.cameras import STEREOGRAPHIC, CameraModel, simple_camera
from procedures.geometry.colmap import pycolmap
from procedures.geometry.shape import rigid_shape
from procedures.geometry.views import ChartView, Pose
from procedures.numerics.arrays import Array
from procedures.outcome import Refused

FOCAL_RATIOS = (0.5, 1.0, 2.0, 4.0, 8.0)  # initial focal lengths, relative to the longer side of the frame
WIDE_RATIOS = (0.3, 0.45, 0.7)  # initial focal lengths of wide lenses, relative to the longer side of the frame
WIDE_PX = 2.0  # residual of a pinhole with radial distortion above which the lens may be wide
FIRST_NODES, FEWEST_NODES = 60, 4
"""Nodes of the initial estimate, chosen at random so that they are not collinear; nodes of a view at least."""
MAX_ITERATIONS, TOLERANCE = 200, 1e-7
"""Limits of Ceres' iteration; the tolerance applies to the relative change of the sum of squares."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """A camera and the poses of its views; `cost_px` is the root mean square distance of the points."""

    camera: CameraModel
    poses: tuple[Pose, ...]
    cost_px: float


def first_bundle(nodes: Array, views: Sequence[ChartView], size: tuple[int, int]) -> Bundle:
    """Initial camera and poses: the best of several focal lengths, each adjusted with radial distortion.

    Raises Refused if none of the focal lengths gives a solution.

    nodes : (N, 3) float64, the flat chart, in mm
    size : (columns, rows) of the frame
    """
    chosen = np.random.default_rng(0).permutation(len(nodes))[:FIRST_NODES]
    few = [view.part(np.isin(view.index, chosen)) for view in views]
    centre = (size[0] - 1) / 2, (size[1] - 1) / 2
    bundles = []
    for focal in (ratio * max(size) for ratio in FOCAL_RATIOS):
        camera = simple_camera("SIMPLE_RADIAL", (focal, focal), centre, size)
        try:
            bundle = adjust_flat(camera, [_first_pose(camera, nodes, view) for view in few], nodes, few)
        except Refused:
            continue
        if np.isfinite(bundle.cost_px) and all(pose.t[2] > 0 for pose in bundle.poses):
            bundles.append(bundle)
    if min((one.cost_px for one in bundles), default=np.inf) > WIDE_PX:
        bundles += _wide_bundles(nodes, few, size)
    if not bundles:
        raise Refused(
            "no focal length puts the charts where the photographs show them",
            "give photographs of one camera at one focus, the chart flat and tilted differently in each",
        )
    best = min(bundles, key=lambda one: one.cost_px)
    return best if best.camera.model == STEREOGRAPHIC else _resolve_tilts(best, nodes, few)


def _wide_bundles(nodes: Array, views: Sequence[ChartView], size: tuple[int, int]) -> list[Bundle]:
    """Stereographic cameras, from equidistant and stereographic ones of several focal lengths."""
    problem, bundles = AdjustmentProblem(nodes, views, rigid_shape(nodes)), []
    for ratio, series in product(WIDE_RATIOS, (stereographic.EQUIDISTANT, (0.0,) * 4)):
        focal, centre = (ratio * max(size),) * 2, ((size[0] - 1) / 2, (size[1] - 1) / 2)
        camera = CameraModel(STEREOGRAPHIC, np.array([*focal, *centre, *series, *(0.0,) * 8]), *size)
        try:
            poses = tuple(_first_pose(camera, nodes, view) for view in views)
            state = adjust(problem.flat_state(camera, poses), problem).state
        except (Refused, cv2.error):
            continue
        bundles.append(_scored(state.camera, state.poses, nodes, views))
    return bundles


def _resolve_tilts(bundle: Bundle, nodes: Array, views: Sequence[ChartView]) -> Bundle:
    """Replace poses by those of the opposite tilt where these fit better, and adjust again while the cost decreases.

    Through a long lens two opposite small tilts are nearly indistinguishable. The adjustment does not cross from one to
    the other: camera and other poses adapt to the wrong one.
    """
    for _ in views:
        poses = [_better(bundle.camera, pose, nodes, view) for pose, view in zip(bundle.poses, views, strict=True)]
        if all(new is old for new, old in zip(poses, bundle.poses, strict=True)):
            break
        again = adjust_flat(bundle.camera, poses, nodes, views)
        if not again.cost_px < bundle.cost_px:
            break
        bundle = again
    return bundle


def _better(camera: CameraModel, pose: Pose, nodes: Array, view: ChartView) -> Pose:
    """A pose, or that of the opposite tilt where its residual is smaller."""
    # the two poses of a flat chart with the same image to first order: Collins, Bartoli, IJCV 2014
    board, points, turn = _normalised(camera, nodes, view)
    _, turns, shifts, _ = cv2.solvePnPGeneric(board, points, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    poses = [_pose(one, t, turn) for one, t in zip(turns, shifts, strict=True)]
    flat_poses = [pose for pose in poses if np.isfinite(pose.R).all() and np.isfinite(pose.t).all()]
    other = max(flat_poses, key=lambda one: float(np.linalg.norm(one.R - pose.R)), default=pose)
    return min(pose, other, key=lambda one: float(np.sum(_distances(camera, one, nodes, view) ** 2)))


def _distances(camera: CameraModel, pose: Pose, nodes: Array, view: ChartView) -> Array:
    return np.asarray(camera.project(pose.apply(nodes[view.index])) - view.points)


def _first_pose(camera: CameraModel, nodes: Array, view: ChartView) -> Pose:
    """Pose from the homography between the flat chart and the image of a pinhole turned towards it."""
    board, points, turn = _normalised(camera, nodes, view)
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE):  # the first fails for some frontal charts
        _, rotation, t = cv2.solvePnP(board, points, np.eye(3), np.zeros(4), flags=method)
        if rotation is not None and np.isfinite(rotation).all() and np.isfinite(t).all():
            break
    return _pose(rotation, t, turn)


def _normalised(camera: CameraModel, nodes: Array, view: ChartView) -> tuple[Array, Array, Array]:
    """The nodes of a view, their undistorted points at focal length 1 in a camera turned towards them, and the turn."""
    rays = camera.rays(view.points)
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    sight = np.nanmean(unit, axis=0)
    turn = np.asarray(Rotation.align_vectors([[0.0, 0.0, 1.0]], [sight])[0].as_matrix())
    turned = unit @ turn.T
    known = turned[:, 2] > 0
    if known.sum() < FEWEST_NODES:
        raise Refused(
            f"a view must show {FEWEST_NODES} of the {FIRST_NODES} nodes of the first estimate; {view.source} shows "
            f"{int(known.sum())}",
            "remove that photograph, or show the whole chart in it",
        )
    return nodes[view.index[known]], (turned[known, :2] / turned[known, 2:])[:, None], turn


def _pose(rotation: npt.ArrayLike, t: npt.ArrayLike, turn: Array) -> Pose:
    """The pose in the camera's frame of one in the frame of the turned camera."""
    R = np.asarray(cv2.Rodrigues(np.asarray(rotation))[0], dtype=np.float64)
    return Pose(turn.T @ R, turn.T @ np.asarray(t, dtype=np.float64).ravel())


def adjust_flat(camera: CameraModel, poses: Sequence[Pose], nodes: Array, views: Sequence[ChartView]) -> Bundle:
    """Camera and poses that minimise the distances of the nodes from their points, all weighted equally."""
    # without nodes that only one view shows: pycolmap rejects such points
    times = np.bincount(np.concatenate([view.index for view in views]), minlength=len(nodes))
    views = [view.part(times[view.index] > 1) for view in views]
    scene = _reconstruction(camera, poses, nodes, views)
    config, options = _problem(scene)
    pycolmap.create_default_ceres_bundle_adjuster(options, config, scene).solve()
    camera = CameraModel.from_colmap(scene.cameras[1])
    rigid = [scene.images[number].cam_from_world() for number in range(1, len(views) + 1)]
    poses = [Pose(np.asarray(one.rotation.matrix()), np.asarray(one.translation, dtype=np.float64)) for one in rigid]
    return _scored(camera, poses, nodes, views)


def _reconstruction(
    camera: CameraModel, poses: Sequence[Pose], nodes: Array, views: Sequence[ChartView]
) -> pycolmap.Reconstruction:
    """pycolmap's scene: one camera, the nodes as points, an image per view.

    Non-finite numbers are refused here: Ceres aborts the process on them.
    """
    numbers = [
        camera.params,
        nodes,
        *(view.points for view in views),
        *(part for one in poses for part in (one.R, one.t)),
    ]
    if not all(np.isfinite(one).all() for one in numbers):
        raise Refused("these views lead to no camera", "tilt the chart by 20 degrees and more, and fill the frame")
    scene = pycolmap.Reconstruction()
    theirs = camera.colmap()
    theirs.camera_id = 1
    scene.add_camera_with_trivial_rig(theirs)
    # visible nodes only: Ceres aborts the process on a constant point without observations
    visible = np.unique(np.concatenate([view.index for view in views]))
    points = {node: scene.add_point3D(nodes[node], pycolmap.Track(), np.zeros(3, np.uint8)) for node in visible}
    for number, (pose, view) in enumerate(zip(poses, views, strict=True), 1):
        image = pycolmap.Image(name=str(number), keypoints=view.points + 0.5, camera_id=1, image_id=number)
        rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(pose.R), pose.t)
        scene.add_image_with_trivial_frame(image, rigid)
        for k, node in enumerate(view.index):
            scene.add_observation(points[node], pycolmap.TrackElement(number, k))
    return scene


def _problem(
    scene: pycolmap.Reconstruction,
) -> tuple[pycolmap.BundleAdjustmentConfig, pycolmap.BundleAdjustmentOptions]:
    """Camera and poses free, the chart constant."""
    config = pycolmap.BundleAdjustmentConfig()
    for image in scene.images:
        config.add_image(image)
    for point in scene.points3D:
        config.add_constant_point(point)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.solver_options.max_num_iterations = MAX_ITERATIONS
    options.ceres.solver_options.function_tolerance = TOLERANCE
    options.ceres.solver_options.num_threads = 1  # the same result on every machine
    return config, options


def _scored(camera: CameraModel, poses: Sequence[Pose], nodes: Array, views: Sequence[ChartView]) -> Bundle:
    pairs = zip(poses, views, strict=True)
    squares = sum(float(np.sum(_distances(camera, pose, nodes, view) ** 2)) for pose, view in pairs)
    return Bundle(camera, tuple(poses), float(np.sqrt(squares / max(sum(map(len, views)), 1))))
