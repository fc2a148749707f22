"""Where the chart should stand next: the pose that lowers the uncertainty of the projection most.

Every pose of a list is thought to be photographed, its points as noisy as those of the views there are. What it tells
of camera and chart, its own pose eliminated, is added to what is known, and the projection's uncertainty drawn from the
sum: at infinity, over the whole frame, the best turn between before and after allowed for, as a turned camera is the
same camera.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import POSE, Adjustment, by_pose
from procedures.geometry.cameras import Camera
from procedures.geometry.shape import ShapeModel, rigid_shape
from procedures.geometry.views import ChartView, Pose
from procedures.numerics.scattered import hull_area

Array = npt.NDArray[np.float64]

PLACES = (0.2, 0.5, 0.8)
"""Of the chart's centre, in fractions of the frame, along both sides."""
TILTS_DEG = ((0.0, 0.0), (30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0))
"""Yaw (positive: the right edge is nearer) and pitch (positive: the lower edge is farther)."""
STEEPEST_DEG = 40.0
"""Between a chart's normal and the line of sight to it: charts seen more obliquely are not found in a photograph."""
SHARES = (0.7, 1.0, 1.4)
"""Distances over the views' median."""
WITHIN = 0.8
"""Of the chart that must be in the frame."""
FRAME = (13, 9)
COVER = 0.65
"""Share of the frame that planned views enclose first, however much others would tell: a result needs 0.6."""
WIDENS, ALIKE = 0.01, 0.9
"""Least share of the frame that a view must add to widen what is covered; places that add so much of the most count.
"""
LOOSE: Mapping[str, Callable[[Camera], float]] = {
    "pixel": lambda camera: 0.03 * camera.columns,
    "1": lambda camera: 0.1,
}
"""Standard deviations of a camera's parameters before anything was photographed, by their units."""


@dataclass(frozen=True)
class NextView:
    """A pose to photograph.

    Attributes
    ----------
    at : (x, y)
        Of the chart's centre, in fractions of the frame from the top left.
    yaw_deg, pitch_deg : float
        Positive where the right edge is the nearer one, where the lower edge is the farther one.
    distance_mm : float
    before_px, after_px : float
        Root mean square error of the projection over the whole frame, without this view and with it.
    """

    at: tuple[float, float]
    yaw_deg: float
    pitch_deg: float
    distance_mm: float
    before_px: float
    after_px: float


def next_views(found: Adjustment, nodes: Array, views: tuple[ChartView, ...], shape: ShapeModel) -> list[NextView]:
    """The poses that can be photographed, the one that helps most first.

    Parameters
    ----------
    found : Adjustment
    nodes : (N, 3) float64
        The chart's plan.
    views : tuple of ChartView
        That the adjustment was made of.
    shape : ShapeModel
    """
    camera, known = found.state.camera, len(found.state.camera.params) + len(found.state.terms_mm)
    information: Array = np.asarray(np.linalg.inv(_scaled(found)[:known, :known]), dtype=np.float64)
    usual = float(np.median([np.linalg.norm(pose.t) for pose in found.state.poses]))
    variances = np.concatenate([np.einsum("naa->na", one.covariance) for one in views])
    sigma = float(np.sqrt(np.median(variances))) * found.scale
    distances = tuple(share * usual for share in SHARES)
    return _ranked(camera, information, nodes + found.state.deviations_mm(shape), shape, sigma, distances)


def planned_view(
    camera: Camera, poses: Sequence[Pose], nodes: Array, distance_mm: float, sigma_px: float, rim: tuple[float, float]
) -> NextView | None:
    """The pose to photograph next where nothing was adjusted yet: by a camera as its data sheet has it.

    Parameters
    ----------
    camera : Camera
        Without distortion; its parameters are taken to be known as little as `LOOSE` says.
    poses : sequence of Pose
        Of the views there are.
    nodes : (N, 3) float64
    distance_mm : float
        At which the chart stays, as the focus does.
    sigma_px : float
        Of a node's place in a photograph.
    rim : (x, y)
        How near to the frame's sides the chart's centre may come, in fractions of the frame.

    Returns
    -------
    NextView or None
        None where no pose fits into the frame.
    """
    shape = rigid_shape(nodes)
    information = np.diag([LOOSE[unit](camera) ** -2 for unit in camera.units])
    for pose in poses:
        gain = _information(camera, pose, nodes, shape, sigma_px)
        information = information if gain is None else information + gain
    places = list(product((rim[0], 0.5, 1 - rim[0]), (rim[1], 0.5, 1 - rim[1])))
    seen = [camera.project(pose.apply(nodes)) for pose in poses]
    if poses:  # hands turn the chart where it is seen next: it comes there as it was turned before
        places = [at for at in places if _obliquity_deg(camera, at, poses[-1].R) <= STEEPEST_DEG] or places
    wider = _widening(camera, seen, nodes, distance_mm, places)
    return next(iter(_ranked(camera, information, nodes, shape, sigma_px, (distance_mm,), wider)), None)


def corner_share(camera: Camera, nodes: Array, distance_mm: float, rim: tuple[float, float]) -> float:
    """Share of the frame that square charts in its four corners enclose, their centres `rim` from its sides."""
    corners = product((rim[0], 1 - rim[0]), (rim[1], 1 - rim[1]))
    points = [camera.project(chart_at(camera, at, 0.0, 0.0, distance_mm).apply(nodes)) for at in corners]
    return _covered(camera, points)


def _widening(
    camera: Camera, seen: Sequence[Array], nodes: Array, distance_mm: float, places: Sequence[tuple[float, float]]
) -> Sequence[tuple[float, float]]:
    """The places at which a chart widens the covered part of the frame most, while that is small; else all of them."""
    before = _covered(camera, seen) if seen else 0.0
    if before >= COVER:
        return places
    there = [camera.project(chart_at(camera, at, 0.0, 0.0, distance_mm).apply(nodes)) for at in places]
    gains = np.array([_covered(camera, [*seen, one]) for one in there]) - before
    most = float(gains.max())
    return [at for at, gain in zip(places, gains, strict=True) if gain >= ALIKE * most] if most > WIDENS else places


def _covered(camera: Camera, seen: Sequence[Array]) -> float:
    """Share of the frame that the points of views, each (n, 2), enclose."""
    inside = np.clip(np.concatenate(seen), 0, np.array([camera.columns, camera.rows]) - 1)
    return hull_area(inside) / (camera.columns * camera.rows)


def _ranked(
    camera: Camera, information: Array, nodes: Array, shape: ShapeModel, sigma_px: float,
    distances_mm: Sequence[float], places: Sequence[tuple[float, float]] = tuple(product(PLACES, PLACES)),
) -> list[NextView]:  # fmt: skip
    """The poses that can be photographed by what camera and chart are known to afterwards."""
    A = _projection(camera)
    before = _rms(A, np.asarray(np.linalg.inv(information), dtype=np.float64))
    answers = []
    for at, (yaw, pitch), distance in product(places, TILTS_DEG, distances_mm):
        pose = chart_at(camera, at, yaw, pitch, distance)
        visible = _obliquity_deg(camera, at, pose.R) <= STEEPEST_DEG
        gain = _information(camera, pose, nodes, shape, sigma_px) if visible else None
        if gain is not None:
            after = _rms(A, np.asarray(np.linalg.inv(information + gain), dtype=np.float64))
            answers.append(NextView(at, yaw, pitch, distance, before, after))
    return sorted(answers, key=lambda one: one.after_px)


def _scaled(found: Adjustment) -> Array:
    return np.asarray(found.covariance * found.scale**2)


def chart_at(camera: Camera, at: tuple[float, float], yaw_deg: float, pitch_deg: float, distance_mm: float) -> Pose:
    """The pose of a chart whose centre is seen at a place, turned against the frame."""
    turn = Rotation.from_euler("YX", [yaw_deg, pitch_deg], degrees=True)
    return Pose(np.asarray(turn.as_matrix()), distance_mm * _sight(camera, at))


def _sight(camera: Camera, at: tuple[float, float]) -> Array:
    """The direction in which a place of the frame is seen, of length 1."""
    ray = camera.rays(np.array([[at[0] * (camera.columns - 1), at[1] * (camera.rows - 1)]]))[0]
    return np.asarray(ray / np.linalg.norm(ray))


def _obliquity_deg(camera: Camera, at: tuple[float, float], R: Array) -> float:
    """Angle between the normal of a chart so turned and the line of sight to it."""
    return float(np.degrees(np.arccos(np.clip(_sight(camera, at) @ R[:, 2], -1.0, 1.0))))


def _information(camera: Camera, pose: Pose, nodes: Array, shape: ShapeModel, sigma_px: float) -> Array | None:
    """What a view tells of camera and chart, (p + q, p + q); None where too little of it is in the frame."""
    points = pose.apply(nodes)
    seen = camera.project(points) if (points[:, 2] > 0).all() else np.full((len(points), 2), -1.0)
    with np.errstate(invalid="ignore"):
        inside = ((seen >= 0) & (seen <= np.array([camera.columns, camera.rows]) - 1)).all(axis=1)
    if inside.mean() < WITHIN:
        return None
    points = points[inside]
    by_points = camera.by_points(points)
    by_terms = by_points @ pose.R @ shape.terms[inside]
    G = np.concatenate([camera.by_params(points), by_terms], axis=-1).reshape(2 * len(points), -1) / sigma_px
    P = by_pose(by_points, points).reshape(-1, POSE) / sigma_px
    cross = P.T @ G
    return np.asarray(G.T @ G - cross.T @ np.linalg.solve(P.T @ P, cross))


def _projection(camera: Camera) -> Array:
    """How the frame moves with the camera's parameters, at infinity, the best turn taken away, (2 n, p)."""
    rays = camera.rays(camera.frame_grid(*FRAME))
    rays = rays[np.isfinite(rays).all(axis=1)]
    J = camera.by_params(rays).reshape(2 * len(rays), -1)
    turns = by_pose(camera.by_points(rays), rays)[..., :3].reshape(-1, 3)
    return np.asarray(J - turns @ np.linalg.lstsq(turns, J, rcond=None)[0])


def _rms(A: Array, covariance: Array) -> float:
    """Root mean square length of the frame's moves, in pixels."""
    p = A.shape[1]
    return float(np.sqrt(2 * np.einsum("ma,ab,mb->", A, covariance[:p, :p], A, optimize=True) / len(A)))


def next_view_words(one: NextView) -> str:
    """The pose for people."""
    return ", ".join(_words(one))


def _words(one: NextView) -> Iterator[str]:
    x, y = ("left", "middle", "right"), ("upper", "middle", "lower")
    row, column = (names[(share >= 0.5) + (share > 0.5)] for names, share in ((y, one.at[1]), (x, one.at[0])))
    yield "the middle of the frame" if (row, column) == ("middle", "middle") else f"the {row} {column} of the frame"
    yield f"{one.distance_mm:.0f} mm away"
    if one.yaw_deg:
        edge = "right" if one.yaw_deg > 0 else "left"
        yield f"its {edge} edge nearer by a turn of {abs(one.yaw_deg):.0f} degrees"
    if one.pitch_deg:
        edge = "upper" if one.pitch_deg > 0 else "lower"
        yield f"its {edge} edge nearer by a turn of {abs(one.pitch_deg):.0f} degrees"
    if not (one.yaw_deg or one.pitch_deg):
        yield "frontal"
