"""Bundle adjustment by pycolmap, with the chart as it is known: brings a first guess near the answer.

References
----------
Schönberger, Frahm, Structure-from-Motion Revisited, CVPR 2016; the solver is Ceres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import pycolmap

from procedures.geometry.cameras import Camera, simple_camera
from procedures.geometry.views import ChartView, Pose
from procedures.outcome import Refused

Array = npt.NDArray[np.float64]

COVERS = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Focal lengths that are tried as a first guess, over the frame's longer side."""
FEW = 60
"""Nodes that a first guess makes do with, drawn at random: they lie on no line."""
ITERATIONS, ENOUGH = 200, 1e-7
"""Steps at most; relative change of the sum of squares at which they end: the last ones are not pycolmap's."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """A camera and its views' poses; `cost_px` is the root mean square distance of points from where they are put."""

    camera: Camera
    poses: tuple[Pose, ...]
    cost_px: float


def first_bundle(nodes: Array, views: Sequence[ChartView], size: tuple[int, int]) -> Bundle:
    """Camera and poses from nothing: the best of several focal lengths, each adjusted with radial distortion.

    Parameters
    ----------
    nodes : (N, 3) float64
        Of the flat chart, in mm.
    size : (columns, rows) of the frame

    Raises
    ------
    Refused
        If none of them leads anywhere.
    """
    drawn = np.random.default_rng(0).permutation(len(nodes))[:FEW]
    few = [_some(view, np.isin(view.index, drawn)) for view in views]
    centre = (size[0] - 1) / 2, (size[1] - 1) / 2
    found = []
    for focal in (cover * max(size) for cover in COVERS):
        camera = simple_camera("SIMPLE_RADIAL", (focal, focal), centre, size)
        try:
            bundle = adjust_flat(camera, [first_pose(camera, nodes, view) for view in few], nodes, few)
        except Refused:
            continue
        if np.isfinite(bundle.cost_px) and all(pose.t[2] > 0 for pose in bundle.poses):
            found.append(bundle)
    if not found:
        raise Refused(
            "no focal length puts the charts where the photographs show them",
            "give photographs of one camera at one focus, the chart flat and tilted differently in each",
        )
    return _turned_over(min(found, key=lambda one: one.cost_px), nodes, few)


def _turned_over(bundle: Bundle, nodes: Array, views: Sequence[ChartView]) -> Bundle:
    """The bundle with those charts turned over that fit better so, adjusted again as long as that helps.

    Through a long lens a chart that is tilted a little looks the same tilted the other way. One that began the wrong
    way does not turn by itself: camera and the other poses give way to it.
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


def _better(camera: Camera, pose: Pose, nodes: Array, view: ChartView) -> Pose:
    """A pose, or the chart's other tilt where that puts the nodes nearer to where they are seen."""
    poses = _flat_poses(camera, nodes, view)
    other = max(poses, key=lambda one: float(np.linalg.norm(one.R - pose.R)), default=pose)
    return other if _misses(camera, other, nodes, view) < _misses(camera, pose, nodes, view) else pose


def _misses(camera: Camera, pose: Pose, nodes: Array, view: ChartView) -> float:
    """Sum of the squared distances of nodes from where they are seen."""
    return float(np.sum((camera.project(pose.apply(nodes[view.index])) - view.points) ** 2))


def _flat_poses(camera: Camera, nodes: Array, view: ChartView) -> list[Pose]:
    """The two poses in which a flat chart looks alike to first order: Collins, Bartoli, IJCV 2014."""
    flat = camera.rays(view.points)[:, :2]
    known = np.isfinite(flat).all(axis=1)
    board, seen = nodes[view.index[known]], flat[known][:, None]
    _, turns, places, _ = cv2.solvePnPGeneric(board, seen, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    poses = [
        Pose(np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), np.asarray(t, dtype=np.float64).ravel())
        for turn, t in zip(turns, places, strict=True)
    ]
    return [one for one in poses if np.isfinite(one.R).all() and np.isfinite(one.t).all()]


def _some(view: ChartView, chosen: npt.NDArray[np.bool_]) -> ChartView:
    """A view with some of its nodes."""
    return ChartView(view.source, view.index[chosen], view.points[chosen], view.covariance[chosen])


def first_pose(camera: Camera, nodes: Array, view: ChartView) -> Pose:
    """A pose from the homography between the flat chart and the pinhole's picture."""
    flat = camera.rays(view.points)[:, :2]
    known = np.isfinite(flat).all(axis=1)
    board, seen = nodes[view.index[known]], flat[known][:, None]
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE):  # the first has no answer for some frontal charts
        _, turn, t = cv2.solvePnP(board, seen, np.eye(3), np.zeros(4), flags=method)
        if turn is not None and np.isfinite(turn).all() and np.isfinite(t).all():
            break
    return Pose(np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), np.asarray(t, dtype=np.float64).ravel())


def adjust_flat(camera: Camera, poses: Sequence[Pose], nodes: Array, views: Sequence[ChartView]) -> Bundle:
    """The camera and poses that put the nodes nearest to where they are seen, all points weighing the same."""
    views = _seen_twice(views, len(nodes))
    scene = _reconstruction(camera, poses, nodes, views)
    config, options = _problem(scene)
    pycolmap.create_default_ceres_bundle_adjuster(options, config, scene).solve()
    return _bundle(scene, nodes, views)


def _seen_twice(views: Sequence[ChartView], count: int) -> list[ChartView]:
    """The views without nodes that only one of them shows: pycolmap takes no such points."""
    times = np.bincount(np.concatenate([view.index for view in views]), minlength=count)
    return [_some(view, times[view.index] > 1) for view in views]


def flat_covariance(bundle: Bundle, nodes: Array, views: Sequence[ChartView]) -> Array:
    """Covariance (p, p) of the parameters for unit noise of every coordinate, poses allowed for, by pycolmap."""
    scene = _reconstruction(bundle.camera, bundle.poses, nodes, _seen_twice(views, len(nodes)))
    config, options = _problem(scene)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, scene)
    adjuster.solve()
    choice = pycolmap.BACovarianceOptions()
    choice.params = pycolmap.BACovarianceOptionsParams.ALL
    covariance = pycolmap.estimate_ba_covariance(choice, scene, adjuster)
    if covariance is None:
        raise Refused("these views do not determine the camera", "add views, tilted and over the whole frame")
    return np.asarray(covariance.get_other_params_cov(scene.cameras[1].params), dtype=np.float64)


def _reconstruction(
    camera: Camera, poses: Sequence[Pose], nodes: Array, views: Sequence[ChartView]
) -> pycolmap.Reconstruction:
    """pycolmap's scene: one camera, the nodes as points, a photograph for every view.

    Numbers that are none are refused here: Ceres ends the whole program over them.
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
    # only those that are seen: Ceres ends the whole program over a constant point without any observation
    seen = np.unique(np.concatenate([view.index for view in views]))
    points = {node: scene.add_point3D(nodes[node], pycolmap.Track(), np.zeros(3, np.uint8)) for node in seen}
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
    """All of the camera and the poses free, the chart as it is given."""
    config = pycolmap.BundleAdjustmentConfig()
    for image in scene.images:
        config.add_image(image)
    for point in scene.points3D:
        config.add_constant_point(point)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.solver_options.max_num_iterations = ITERATIONS
    options.ceres.solver_options.function_tolerance = ENOUGH
    options.ceres.solver_options.num_threads = 1  # the same answer on every machine
    return config, options


def _bundle(scene: pycolmap.Reconstruction, nodes: Array, views: Sequence[ChartView]) -> Bundle:
    """What pycolmap's scene has come to."""
    camera = Camera.from_colmap(scene.cameras[1])
    poses = []
    squares, count = 0.0, 0
    for number, view in enumerate(views, 1):
        rigid = scene.images[number].cam_from_world()
        pose = Pose(np.asarray(rigid.rotation.matrix()), np.asarray(rigid.translation, dtype=np.float64))
        error = camera.project(pose.apply(nodes[view.index])) - view.points
        squares, count = squares + float(np.sum(error**2)), count + len(view)
        poses.append(pose)
    return Bundle(camera, tuple(poses), float(np.sqrt(squares / max(count, 1))))
