"""Relative poses of the cameras on a rig, from charts that they photographed at the same time.

One adjustment estimates all cameras, the shape of the chart, which they share, and the pose of the chart in every
photograph, with a joint covariance that includes the camera model discrepancy. The poses are then reduced to those
of a rigid rig by generalised least squares, which is the adjustment of a rigid rig to first order: at one time the
chart has the pose P in the first camera's frame and C_c P in that of camera c. With changes (w, d): X -> exp(w) X + d,
a change of C_c changes the pose by the same, and a change of P by

    (R w, R d + t x R w),    C_c = (R, t).

Errors of the print's scale are common to all cameras and added afterwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, ndtri

from procedures.geometry.adjustment import POSE, Adjustment, AdjustmentProblem, adjust, by_pose, moved_pose
from procedures.geometry.cameras import CameraModel, CameraSet
from procedures.geometry.estimate import Geometry, concluded
from procedures.geometry.next_view import (
    DISTANCE_RATIOS,
    PLACES,
    TILTS_DEG,
    NextView,
    thinned,
    typical_noise,
    view_derivatives,
    visible_chart,
)
from procedures.geometry.shape import scale_spread, shape_model
from procedures.geometry.views import ChartView, Pose
from procedures.numbers import BASELINE, TURN
from procedures.numerics.arrays import Array, Indices
from procedures.outcome import Check, Outcome, Quantity, Refused, Verdict, verdict_of, with_refusal

FEWEST_CHARTS = 3  # fewer charts do not show whether the rig is rigid
ITERATIONS = 4
UNLIKELY = 0.001  # probability of such differences among the charts, below which the rig is doubtful
CONVENTION = (
    "X_camera = R X_first + t; the errors of every further camera are a rotation vector w in radians and a shift d in "
    "mm, in that camera's frame: X_camera -> exp([w]x) X_camera + d"
)
"""Meaning of the poses and of the rows and columns of their covariance."""


@dataclass(frozen=True, eq=False)
class RigCamera:
    """A calibrated camera with its views of the chart.

    poses : tuple of Pose, of the chart in every view
    nodes : (N, 3) float64, the plan of the chart, in mm
    cell_uncertainty : float, relative standard uncertainty of the plan's scale
    """

    camera: CameraModel
    views: tuple[ChartView, ...]
    poses: tuple[Pose, ...]
    nodes: Array
    cell_uncertainty: float = 0.0

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the photographs."""
        return tuple(view.source for view in self.views)


@dataclass(frozen=True, eq=False)
class RigPoses:
    """Poses of the further cameras relative to the first.

    covariance : (6 (n - 1), 6 (n - 1)) float64, see CONVENTION; includes the print's scale
    charts : tuple of str, the photographs, by the first camera that saw each chart, from which they are estimated
    misfit : float
        Root of chi^2 over the degrees of freedom of the charts; if above 1 the covariance is scaled by its square.
    chance : float, probability of a larger chi^2
    next_view : NextView or None, pose of the chart in the first camera that reduces the uncertainty of a depth most
    scale : float, relative standard uncertainty of the print's scale
    """

    poses: tuple[Pose, ...]
    covariance: Array
    charts: tuple[str, ...]
    misfit: float
    chance: float
    next_view: NextView | None = None
    scale: float = 0.0

    def numbers(self) -> dict[str, Quantity]:
        """Baseline and angle of the second camera."""
        return self.numbers_of(0)

    def numbers_of(self, i: int) -> dict[str, Quantity]:
        """Baseline and angle between the axes of the first camera and a further one."""
        covariance = self.covariance[POSE * i : POSE * (i + 1), POSE * i : POSE * (i + 1)]
        t, turn = self.poses[i].t, Rotation.from_matrix(self.poses[i].R)
        length, angle = float(np.linalg.norm(t)), float(turn.magnitude())
        along = t / length if length else np.zeros(3)
        # a rotation of the camera turns t and preserves its length
        spread = float(np.sqrt(along @ covariance[3:, 3:] @ along))
        axis = turn.as_rotvec() / angle if angle else np.array([0.0, 0.0, 1.0])
        of_angle = float(np.degrees(np.sqrt(axis @ covariance[:3, :3] @ axis)))
        method, n = f"one adjustment of the cameras and {len(self.charts)} charts", len(self.charts)
        return {
            BASELINE: Quantity(length, "mm", spread, f"{method}; the print's scale is in the uncertainty", n),
            TURN: Quantity(float(np.degrees(angle)), "degree", of_angle, method, n),
        }


def rig_camera(geometry: Geometry, cell_uncertainty: float = 0.0) -> RigCamera:
    """A calibrated camera for `estimate_rig`."""
    views, poses = (tuple(getattr(view, name) for view in geometry.views) for name in ("view", "pose"))
    return RigCamera(geometry.camera, views, poses, geometry.adjustment.problem.nodes, cell_uncertainty)


@with_refusal
def estimate_rig(cameras: Sequence[RigCamera], depth_mm: float | None = None) -> Outcome[RigPoses]:
    """The poses of all cameras relative to the first, or the reason why the charts do not determine them.

    cameras : sequence of RigCamera, two or more, of one chart, in photographs taken at the same times
    depth_mm : float, depth on the first camera's axis whose uncertainty the proposed next view shall reduce
    """
    times = _times(cameras)
    # all cameras, poses, and the one chart
    nodes = cameras[0].nodes
    views = [replace(view, camera=c) for c, camera in enumerate(cameras) for view in camera.views]
    problem = AdjustmentProblem(nodes, views, shape_model(nodes))
    poses = tuple(pose for camera in cameras for pose in camera.poses)
    adjusted = adjust(problem.flat_state(CameraSet.of([camera.camera for camera in cameras]), poses), problem)
    placed, fit = _placed(cameras, times), concluded(adjusted)
    rig = _rigid(fit, times, placed, max(camera.cell_uncertainty for camera in cameras), depth_mm)
    rigidity = Check(
        "rigidity",
        -ndtri(rig.chance),
        -ndtri(UNLIKELY),
        Verdict.DOUBTFUL,
        f"the charts give relative poses that differ by {rig.misfit:.1f} times their uncertainties",
        "check that the photographs were taken at one time and have the same names, and that the rig is rigid",
    )
    return verdict_of([(rigidity)], rig)


def _times(cameras: Sequence[RigCamera]) -> list[list[int]]:
    """The time of every view of every camera: photographs of one name, or else in their order.

    Raises Refused if the correspondence is ambiguous, or the cameras' charts differ.
    """
    if any(
        one.nodes.shape != cameras[0].nodes.shape or not np.allclose(one.nodes, cameras[0].nodes) for one in cameras
    ):
        raise Refused(
            "the cameras of a rig must photograph one chart; the widths of their charts differ",
            "calibrate the cameras with photographs of one chart, and give its width to all",
        )
    names = [name for camera in cameras for name in camera.sources]
    if len(set(names)) < len(names):
        places = {name: i for i, name in enumerate(dict.fromkeys(names))}
        return [[places[name] for name in camera.sources] for camera in cameras]
    if len({len(camera.views) for camera in cameras}) == 1:
        return [list(range(len(camera.views))) for camera in cameras]
    raise Refused(
        f"simultaneous photographs must have the same name, or all cameras equally many; got "
        f"{' and '.join(str(len(camera.views)) for camera in cameras)}, and no name in common",
        "give the same name to photographs that were taken together",
    )


def _placed(cameras: Sequence[RigCamera], times: Sequence[Sequence[int]]) -> list[Pose]:
    """Initial pose of every camera relative to the first, through cameras that saw the same charts.

    Raises Refused if a camera has too few charts in common with the others.
    """
    poses: list[Pose | None] = [Pose(np.eye(3), np.zeros(3)), *(None for _ in cameras[1:])]
    for _ in cameras:
        for c, pose in enumerate(poses):
            for other, known in enumerate(poses):
                common = sorted(set(times[c]) & set(times[other]))
                if pose is None and known is not None and len(common) >= FEWEST_CHARTS:
                    a, b = (cameras[i].poses[times[i].index(common[0])] for i in (other, c))
                    poses[c] = _compose(_compose(b, _inverse(a)), known)
    if any(pose is None for pose in poses):
        most = max(len(set(time) & set(other)) for i, time in enumerate(times) for other in times[:i])
        raise Refused(
            f"a rig needs {FEWEST_CHARTS} charts photographed by two cameras at the same time, and every camera "
            f"connected to the first in this way; two cameras have at most {most} in common",
            "photograph the chart with the cameras at once, in more poses",
        )
    return [pose for pose in poses if pose is not None]


def _rigid(
    fit: Adjustment, times: Sequence[Sequence[int]], placed: list[Pose], cell_uncertainty: float, depth_mm: float | None
) -> RigPoses:
    """The rig from the poses of the chart in every view."""
    all_times = [time for one in times for time in one]
    used = [i for i, time in enumerate(all_times) if all_times.count(time) > 1]
    charts = list(dict.fromkeys(all_times[i] for i in used))
    rows = np.concatenate([np.arange(POSE * i, POSE * (i + 1)) for i in used]) + fit.shared
    precision = np.linalg.inv(fit.full_covariance[np.ix_(rows, rows)])
    of = [fit.problem.views[i].camera for i in used]
    estimated = [fit.state.poses[i] for i in used]
    where = [charts.index(all_times[i]) for i in used]
    first = [where.index(board) for board in range(len(charts))]  # the first view of each chart
    boards = [_board(placed[of[i]], estimated[i]) for i in first]
    further = POSE * (len(placed) - 1)
    for _ in range(ITERATIONS):
        residual, A = np.zeros(len(rows)), np.zeros((len(rows), further + POSE * len(charts)))
        for row, (c, pose, board) in enumerate(zip(of, estimated, where, strict=True)):
            place = slice(POSE * row, POSE * (row + 1))
            residual[place] = _change(_compose(placed[c], boards[board]), pose)
            if c:
                A[place, POSE * (c - 1) : POSE * c] = np.eye(POSE)
            A[place, further + POSE * board : further + POSE * (board + 1)] = _transport(placed[c])
        known = np.linalg.inv(A.T @ precision @ A)
        step = (known @ (A.T @ (precision @ residual))).reshape(-1, POSE)
        placed = [placed[0], *(moved_pose(*one) for one in zip(placed[1:], step, strict=False))]
        boards = [moved_pose(*one) for one in zip(boards, step[len(placed) - 1 :], strict=True)]
    chi_square, freedom = float(residual @ precision @ residual), len(rows) - A.shape[1]
    misfit = float(np.sqrt(chi_square / freedom))
    covariance = known[:further, :further] * max(misfit, 1.0) ** 2
    share = float(np.hypot(cell_uncertainty, scale_spread(fit.problem.nodes, fit.problem.shape.node_mm)))
    shifts = np.concatenate([[0.0, 0.0, 0.0, *pose.t] for pose in placed[1:]])
    covariance = covariance + share**2 * np.outer(shifts, shifts)
    names = [fit.problem.views[used[where.index(i)]].source for i in range(len(charts))]
    view = None if depth_mm is None else _next_view(fit, rows, A, placed, depth_mm, share)
    chance = float(chdtrc(freedom, chi_square))
    return RigPoses(tuple(placed[1:]), covariance, tuple(names), misfit, chance, view, share)


def _next_view(
    fit: Adjustment, rows: Indices, A: Array, placed: list[Pose], depth_mm: float, share: float
) -> NextView | None:
    """The pose of a chart, seen by several cameras at once, that reduces the uncertainty of a depth most.

    The unknowns are the cameras, the chart's shape, and the further cameras' poses; `A` is the derivative of the poses
    of the views, `rows` of the covariance, by these and the poses of the charts.
    """
    cameras, further = [fit.state.camera.part(c) for c in range(len(placed))], POSE * (len(placed) - 1)
    used = np.concatenate([np.arange(fit.shared), rows])
    design = block_diag(np.eye(fit.shared), A)
    known = fit.shared + further
    information = _without_last(design.T @ np.linalg.solve(fit.full_covariance[np.ix_(used, used)], design), known)
    depth = _depth_derivative(cameras, placed, depth_mm, fit.shared, known)
    deviated = fit.problem.nodes + fit.state.deviations_mm(fit.problem.shape)
    nodes, shape, sigma = thinned(deviated, fit.problem.shape, typical_noise(fit))
    usual = float(np.median([np.linalg.norm(pose.t) for pose in fit.state.poses]))
    before, views = _depth_spread(information, depth, share * depth_mm), []
    for at, (yaw, pitch), ratio in product(product(PLACES, PLACES), TILTS_DEG, DISTANCE_RATIOS):
        pose = visible_chart(cameras[0][0], at, yaw, pitch, ratio * usual)
        if pose is None:
            continue
        gain, imaged = np.zeros((known + POSE, known + POSE)), 0
        for c, (camera, place) in enumerate(cameras):
            derivatives = view_derivatives(camera, _compose(placed[c], pose), nodes, shape, sigma)
            if derivatives is None:
                continue
            G, P = derivatives
            J, imaged, p = np.zeros((len(P), known + POSE)), imaged + 1, place.stop - place.start
            J[:, place], J[:, fit.shared - (G.shape[1] - p) : fit.shared] = G[:, :p], G[:, p:]
            if c:
                J[:, fit.shared + POSE * (c - 1) : fit.shared + POSE * c] = P
            J[:, known:] = P @ _transport(placed[c])
            gain += J.T @ J
        if imaged >= 2:
            after = _depth_spread(information + _without_last(gain, known), depth, share * depth_mm)
            of = f"depth at {depth_mm / 1000:g} m, mm"
            views.append(NextView(at, yaw, pitch, ratio * usual, before, after, of))
    return min(views, key=lambda one: one.after, default=None)


def _without_last(information: Array, known: int) -> Array:
    """Information on the first unknowns, with the others eliminated."""
    cross = information[known:, :known]
    return np.asarray(information[:known, :known] - cross.T @ np.linalg.solve(information[known:, known:], cross))


def _depth_spread(information: Array, depth: Array, scale_mm: float) -> float:
    """Standard uncertainty of a depth, with that of the print's scale."""
    return float(np.hypot(np.sqrt(depth @ np.linalg.solve(information, depth)), scale_mm))


def _depth_derivative(
    cameras: Sequence[tuple[CameraModel, slice]], placed: list[Pose], depth_mm: float, shared: int, known: int
) -> Array:
    """Derivative (known,) of the depth of a point on the first camera's axis, triangulated by all that see it."""
    by_place, by_unknowns = [], []
    for c, ((camera, place), pose) in enumerate(zip(cameras, placed, strict=True)):
        point = pose.apply(np.array([[0.0, 0.0, depth_mm]]))
        by_points = camera.by_points(point)
        if not np.isfinite(by_points).all():
            continue
        row = np.zeros((2, known))
        row[:, place] = camera.by_params(point)[0]
        if c:
            row[:, shared + POSE * (c - 1) : shared + POSE * c] = by_pose(by_points, point)[0]
        by_place.append(by_points[0] @ pose.R)
        by_unknowns.append(row)
    return np.asarray(-(np.linalg.pinv(np.concatenate(by_place)) @ np.concatenate(by_unknowns))[2])


def _board(camera: Pose, pose: Pose) -> Pose:
    """Pose of a chart in the first camera's frame, from that in another camera's."""
    return _compose(_inverse(camera), pose)


def _compose(second: Pose, first: Pose) -> Pose:
    """The first motion, then the second."""
    return Pose(np.asarray(second.R @ first.R), np.asarray(second.R @ first.t + second.t))


def _inverse(pose: Pose) -> Pose:
    return Pose(pose.R.T, np.asarray(-pose.R.T @ pose.t))


def _transport(camera: Pose) -> Array:
    """Derivative (6, 6) of a chart's pose in a camera by a change of its pose in the first camera."""
    R, t = camera.R, camera.t
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return np.block([[R, np.zeros((3, 3))], [cross @ R, R]])


def _change(start: Pose, end: Pose) -> Array:
    """The change (6,) from one pose to another."""
    turn = end.R @ start.R.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), end.t - turn @ start.t])
