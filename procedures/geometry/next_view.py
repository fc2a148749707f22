"""Selection of the next view: the pose of the chart that reduces a chosen uncertainty most.

For each candidate pose a view with the noise of the existing ones is predicted. Its information on camera and chart,
with its own pose eliminated, is added to the present information. The sum gives the projection uncertainty at infinity
over the whole frame or at one pixel, up to the best rotation, since a rotated camera is the same camera; or the
uncertainty of a depth by the cameras of a rig, which all see the chart.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import POSE, Adjustment, by_pose
from procedures.geometry.cameras import CameraModel
from procedures.geometry.shape import ShapeModel, rigid_shape
from procedures.geometry.views import Pose
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import hull_area

PLACES = (0.2, 0.5, 0.8)  # positions of the chart's centre, in fractions of the frame, along both sides
TILTS_DEG = ((0.0, 0.0), (30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0))
"""Yaw (positive: the right edge is nearer) and pitch (positive: the lower edge is farther)."""
STEEPEST_DEG = 40.0
"""Angle between a chart's normal and the line of sight, above which it is not detected in a photograph."""
DISTANCE_RATIOS = (0.7, 1.0, 1.4)  # distances relative to the median of the views
VISIBLE_SHARE = 0.8  # part of the chart that must lie in the frame
FRAME = (13, 9)
ENOUGH_NODES = 120  # nodes of a chart from which the information of a view is computed
COVER = 0.65  # share of the frame that planned views cover before other criteria apply: a result needs 0.6
LEAST_GAIN, NEARLY_BEST = 0.01, 0.9
"""Least share of the frame that a view must add to the coverage; share of the largest gain that is as good."""
PRIOR: Mapping[str, Callable[[CameraModel], float]] = {
    "pixel": lambda camera: 0.03 * camera.columns,
    "1": lambda camera: 0.1,
}
"""Prior standard deviations of camera parameters without photographs, by unit."""


@dataclass(frozen=True)
class NextView:
    """A pose to photograph.

    at : (x, y) position of the chart's centre, in fractions of the frame from the top left
    yaw_deg, pitch_deg : float, positive where the right edge is nearer, and where the lower edge is farther
    before, after : float, the uncertainty without this view and with it
    of : str, which uncertainty, with its unit
    """

    at: tuple[float, float]
    yaw_deg: float
    pitch_deg: float
    distance_mm: float
    before: float
    after: float
    of: str = "projection at infinity over the frame, pixel rms"


def next_views(fit: Adjustment, pixel: tuple[float, float] | None = None) -> list[NextView]:
    """The feasible poses, the most informative first, about the direction of a pixel or the whole frame."""
    camera, problem = fit.state.camera, fit.problem
    covariance = fit.covariance[: fit.shared, : fit.shared] * fit.scale**2  # noise alone: more views reduce it
    information: Array = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    usual = float(np.median([np.linalg.norm(pose.t) for pose in fit.state.poses]))
    sigma = typical_noise(fit)
    distances = tuple(ratio * usual for ratio in DISTANCE_RATIOS)
    nodes = problem.nodes + fit.state.deviations_mm(problem.shape)
    views = _ranked(camera, information, nodes, problem.shape, sigma, distances, pixel=pixel)
    of = "" if pixel is None else f"direction of pixel {pixel[0]:g}, {pixel[1]:g}, pixel rms"
    return [replace(view, of=of) for view in views] if of else views


def typical_noise(fit: Adjustment) -> float:
    """Standard deviation of a point in the existing views."""
    variances = np.concatenate([np.einsum("naa->na", view.covariance) for view in fit.problem.views])
    return float(np.sqrt(np.median(variances))) * fit.scale


def planned_view(
    camera: CameraModel,
    poses: Sequence[Pose],
    nodes: Array,
    distance_mm: float,
    sigma_px: float,
    rim: tuple[float, float],
    pixel: tuple[float, float] | None = None,
) -> NextView | None:
    """The pose to photograph next before any adjustment, for a nominal camera.

    camera : Camera, without distortion; `PRIOR` holds the uncertainties of its parameters
    poses : sequence of Pose, of the existing views
    nodes : (N, 3) float64
    distance_mm : float, distance of the chart, constant as the focus is
    sigma_px : float, standard deviation of a node's position in a photograph
    rim : (x, y) least distance of the chart's centre from the sides, in fractions of the frame
    pixel : (x, y) whose direction matters; None: the whole frame

    Returns
    -------
    NextView or None
        None where no pose fits into the frame.
    """
    shape = rigid_shape(nodes)
    information = np.diag([PRIOR[unit](camera) ** -2 for unit in camera.units])
    for pose in poses:
        gain = _information(camera, pose, nodes, shape, sigma_px)
        information = information if gain is None else information + gain
    places = list(product((rim[0], 0.5, 1 - rim[0]), (rim[1], 0.5, 1 - rim[1])))
    projected = [camera.project(pose.apply(nodes)) for pose in poses]
    if poses:  # the chart is turned by hand after it has moved: it arrives with its previous tilt
        places = [at for at in places if _obliquity_deg(camera, at, poses[-1].R) <= STEEPEST_DEG] or places
    wider = _widening(camera, projected, nodes, distance_mm, places)
    return next(iter(_ranked(camera, information, nodes, shape, sigma_px, (distance_mm,), wider, pixel)), None)


def corner_share(camera: CameraModel, nodes: Array, distance_mm: float, rim: tuple[float, float]) -> float:
    """Share of the frame covered by frontal charts in its four corners, with their centres `rim` from its sides."""
    corners = product((rim[0], 1 - rim[0]), (rim[1], 1 - rim[1]))
    points = [camera.project(chart_at(camera, at, 0.0, 0.0, distance_mm).apply(nodes)) for at in corners]
    return _covered(camera, points)


def _widening(
    camera: CameraModel,
    projected: Sequence[Array],
    nodes: Array,
    distance_mm: float,
    places: Sequence[tuple[float, float]],
) -> Sequence[tuple[float, float]]:
    """The places that increase the coverage of the frame most, while it is small; else all of them."""
    before = _covered(camera, projected) if projected else 0.0
    if before >= COVER:
        return places
    there = [camera.project(chart_at(camera, at, 0.0, 0.0, distance_mm).apply(nodes)) for at in places]
    gains = np.array([_covered(camera, [*projected, one]) for one in there]) - before
    most = float(gains.max())
    return (
        [at for at, gain in zip(places, gains, strict=True) if gain >= NEARLY_BEST * most]
        if most > LEAST_GAIN
        else places
    )


def _covered(camera: CameraModel, projected: Sequence[Array]) -> float:
    """Share of the frame enclosed by the points of the views, each (n, 2)."""
    inside = np.clip(np.concatenate(projected), 0, np.array([camera.columns, camera.rows]) - 1)
    return hull_area(inside) / (camera.columns * camera.rows)


def _ranked(
    camera: CameraModel, information: Array, nodes: Array, shape: ShapeModel, sigma_px: float,
    distances_mm: Sequence[float], places: Sequence[tuple[float, float]] = tuple(product(PLACES, PLACES)),
    pixel: tuple[float, float] | None = None,
) -> list[NextView]:  # fmt: skip
    """The feasible poses, ordered by the projection uncertainty after their photograph."""
    rays = camera.rays(camera.frame_grid(*FRAME))
    rays = rays[np.isfinite(rays).all(axis=1)]
    J = camera.by_params(rays).reshape(2 * len(rays), -1)
    turns = by_pose(camera.by_points(rays), rays)[..., :3].reshape(-1, 3)
    rotation = np.linalg.lstsq(turns, J, rcond=None)[0]
    if pixel is not None:
        ray = camera.rays(np.array([pixel]))
        J, turns = camera.by_params(ray)[0], by_pose(camera.by_points(ray), ray)[0, :, :3]
    A = np.asarray(J - turns @ rotation)
    before = _rms(A, np.asarray(np.linalg.inv(information), dtype=np.float64))
    nodes, shape, sigma_px = thinned(nodes, shape, sigma_px)
    answers = []
    for at, (yaw, pitch), distance in product(places, TILTS_DEG, distances_mm):
        pose = visible_chart(camera, at, yaw, pitch, distance)
        gain = None if pose is None else _information(camera, pose, nodes, shape, sigma_px)
        if gain is not None:
            after = _rms(A, np.asarray(np.linalg.inv(information + gain), dtype=np.float64))
            answers.append(NextView(at, yaw, pitch, distance, before, after))
    return sorted(answers, key=lambda one: one.after)


def thinned(nodes: Array, shape: ShapeModel, sigma_px: float) -> tuple[Array, ShapeModel, float]:
    """Some of the nodes, with a noise at which they carry the information of all."""
    every = max(len(nodes) // ENOUGH_NODES, 1)
    return nodes[::every], replace(shape, terms=shape.terms[::every]), sigma_px / every**0.5


def visible_chart(
    camera: CameraModel, at: tuple[float, float], yaw_deg: float, pitch_deg: float, distance_mm: float
) -> Pose | None:
    """The pose of `chart_at`; None where the chart is seen too obliquely."""
    pose = chart_at(camera, at, yaw_deg, pitch_deg, distance_mm)
    return pose if _obliquity_deg(camera, at, pose.R) <= STEEPEST_DEG else None


def chart_at(
    camera: CameraModel, at: tuple[float, float], yaw_deg: float, pitch_deg: float, distance_mm: float
) -> Pose:
    """The pose of a chart with its centre at a place of the frame, rotated relative to the frame."""
    turn = Rotation.from_euler("YX", [yaw_deg, pitch_deg], degrees=True)
    return Pose(np.asarray(turn.as_matrix()), distance_mm * _sight(camera, at))


def _sight(camera: CameraModel, at: tuple[float, float]) -> Array:
    ray = camera.rays(np.array([[at[0] * (camera.columns - 1), at[1] * (camera.rows - 1)]]))[0]
    return np.asarray(ray / np.linalg.norm(ray))


def _obliquity_deg(camera: CameraModel, at: tuple[float, float], R: Array) -> float:
    """Angle between the normal of a chart with this rotation and the line of sight to it."""
    return float(np.degrees(np.arccos(np.clip(_sight(camera, at) @ R[:, 2], -1.0, 1.0))))


def _information(camera: CameraModel, pose: Pose, nodes: Array, shape: ShapeModel, sigma_px: float) -> Array | None:
    """Information (p + q, p + q) of a view on camera and chart; None where too little of it is in the frame."""
    derivatives = view_derivatives(camera, pose, nodes, shape, sigma_px)
    if derivatives is None:
        return None
    G, P = derivatives
    cross = P.T @ G
    return np.asarray(G.T @ G - cross.T @ np.linalg.solve(P.T @ P, cross))


def view_derivatives(
    camera: CameraModel, pose: Pose, nodes: Array, shape: ShapeModel, sigma_px: float
) -> tuple[Array, Array] | None:
    """Derivatives of a view's points, in units of their noise: (2 n, p + q) by camera and chart, (2 n, 6) by its pose.

    None where too little of the chart is in the frame.
    """
    points = pose.apply(nodes)
    projected = camera.project(points) if (points[:, 2] > 0).all() else np.full((len(points), 2), -1.0)
    with np.errstate(invalid="ignore"):
        inside = ((projected >= 0) & (projected <= np.array([camera.columns, camera.rows]) - 1)).all(axis=1)
    if inside.mean() < VISIBLE_SHARE:
        return None
    points = points[inside]
    by_points = camera.by_points(points)
    by_terms = by_points @ pose.R @ shape.terms[inside]
    G = np.concatenate([camera.by_params(points), by_terms], axis=-1).reshape(2 * len(points), -1) / sigma_px
    return G, by_pose(by_points, points).reshape(-1, POSE) / sigma_px


def _rms(A: Array, covariance: Array) -> float:
    """Root mean square length of the projection error, in pixels."""
    p = A.shape[1]
    return float(np.sqrt(2 * np.einsum("ma,ab,mb->", A, covariance[:p, :p], A, optimize=True) / len(A)))


def advice(view: NextView) -> str:
    """The pose with its effect."""
    return f"next, the chart in {next_view_words(view)}; {view.of}: {view.before:.4g} now, {view.after:.4g} with it"


def next_view_words(view: NextView) -> str:
    """Description of the pose."""
    return ", ".join(_words(view))


def _words(view: NextView) -> Iterator[str]:
    x, y = ("left", "middle", "right"), ("upper", "middle", "lower")
    row, column = (names[(share >= 0.5) + (share > 0.5)] for names, share in ((y, view.at[1]), (x, view.at[0])))
    yield "the middle of the frame" if (row, column) == ("middle", "middle") else f"the {row} {column} of the frame"
    yield f"{view.distance_mm:.0f} mm away"
    if view.yaw_deg:
        edge = "right" if view.yaw_deg > 0 else "left"
        yield f"its {edge} edge nearer by a turn of {abs(view.yaw_deg):.0f} degrees"
    if view.pitch_deg:
        edge = "upper" if view.pitch_deg > 0 else "lower"
        yield f"its {edge} edge nearer by a turn of {abs(view.pitch_deg):.0f} degrees"
    if not (view.yaw_deg or view.pitch_deg):
        yield "frontal"
