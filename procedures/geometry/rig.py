"""Relative pose of two cameras on a rig, from charts that both photographed at the same time.

Each camera is calibrated separately, which gives the poses T_a and T_b of every chart with a joint covariance that
includes the intrinsics and the shape of the chart. Each chart gives a relative pose T_b T_a^-1; that of the rig is the
generalised least-squares mean in the changes (w, d): X -> exp(w) X + d. A change (w, d) of T_a changes the relative
pose (R, t) by

    -(R w, R d + t x R w).

Errors of the print that affect both cameras partly cancel but are treated as independent, so that the uncertainty is
overestimated rather than underestimated. Errors of the print's scale do not cancel, whether of cell or of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.spatial.transform import Rotation

from procedures.geometry.adjustment import POSE, moved_pose
from procedures.geometry.estimate import Geometry
from procedures.geometry.views import Pose
from procedures.numbers import BASELINE, TURN
from procedures.outcome import Check, Outcome, Quantity, Refused, Verdict, verdict_of

Array = npt.NDArray[np.float64]

FEWEST_CHARTS = 3
"""Fewer charts do not show whether the rig is rigid."""
ITERATIONS = 4
UNLIKELY = 0.001
"""Probability of such differences among the charts, below which the rig is doubtful."""


@dataclass(frozen=True, eq=False)
class PosedCharts:
    """The charts photographed by one camera.

    Attributes
    ----------
    sources : tuple of str
        Names of the photographs.
    poses : tuple of Pose
    covariance : (6 n, 6 n) float64
        Of the changes of the poses in the camera's frame, in order.
    scale_uncertainty : float
        Relative standard uncertainty of the print's scale.
    """

    sources: tuple[str, ...]
    poses: tuple[Pose, ...]
    covariance: Array
    scale_uncertainty: float = 0.0

    def chosen(self, places: Sequence[int]) -> PosedCharts:
        """Some of the charts, in this order."""
        rows = np.concatenate([np.arange(POSE * i, POSE * (i + 1)) for i in places])
        return PosedCharts(
            tuple(self.sources[i] for i in places), tuple(self.poses[i] for i in places),
            self.covariance[np.ix_(rows, rows)], self.scale_uncertainty,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RigPose:
    """Pose of the second camera relative to the first: X_second = R X_first + t.

    Attributes
    ----------
    pose : Pose
    covariance : (6, 6) float64
        Of its change in the second camera's frame: rotation in radians, translation in mm; includes the print's scale.
    charts : tuple of str
        The first camera's photographs from which it is estimated.
    misfit : float
        Root of chi^2 over the degrees of freedom of the charts; if above 1 the covariance is scaled by its square.
    chance : float
        Probability of a larger chi^2.
    """

    pose: Pose
    covariance: Array
    charts: tuple[str, ...]
    misfit: float
    chance: float

    def numbers(self) -> dict[str, Quantity]:
        """Baseline and angle between the axes."""
        t, turn = self.pose.t, Rotation.from_matrix(self.pose.R)
        length, angle = float(np.linalg.norm(t)), float(turn.magnitude())
        along = t / length if length else np.zeros(3)
        # a rotation of the camera turns t and preserves its length
        spread = float(np.sqrt(along @ self.covariance[3:, 3:] @ along))
        axis = turn.as_rotvec() / angle if angle else np.array([0.0, 0.0, 1.0])
        of_angle = float(np.degrees(np.sqrt(axis @ self.covariance[:3, :3] @ axis)))
        method, n = f"relative poses of {len(self.charts)} charts", len(self.charts)
        return {
            BASELINE: Quantity(length, "mm", spread, f"{method}; the print's scale is in the uncertainty", n),
            TURN: Quantity(float(np.degrees(angle)), "degree", of_angle, method, n),
        }


def posed_charts(geometry: Geometry) -> PosedCharts:
    """The charts of a calibrated camera."""
    first = geometry.adjustment.shared
    covariance = geometry.adjustment.full_covariance[first:, first:]
    return PosedCharts(
        tuple(one.view.source for one in geometry.views), tuple(one.pose for one in geometry.views), covariance,
        geometry.shape.scale_uncertainty,
    )  # fmt: skip


def matched(first: PosedCharts, second: PosedCharts) -> tuple[PosedCharts, PosedCharts]:
    """The charts in common: photographs with the same name; without any, equally many ones in their order.

    Raises
    ------
    Refused
        If the correspondence is ambiguous, or there are too few.
    """
    common = [name for name in first.sources if name in second.sources]
    if common:
        pairs = [(first.sources.index(name), second.sources.index(name)) for name in common]
    elif len(first.sources) == len(second.sources):
        pairs = [(i, i) for i in range(len(first.sources))]
    else:
        raise Refused(
            f"simultaneous photographs must have the same name, or both cameras equally many; got "
            f"{len(first.sources)} and {len(second.sources)}, and no name in common",
            "give the same name to photographs that were taken together",
        )
    if len(pairs) < FEWEST_CHARTS:
        raise Refused(
            f"a rig needs {FEWEST_CHARTS} charts photographed by both cameras at the same time; there are {len(pairs)}",
            "photograph the chart with both cameras at once, in more poses",
        )
    left, right = zip(*pairs, strict=True)
    return first.chosen(left), second.chosen(right)


def estimate_rig(first: PosedCharts, second: PosedCharts) -> Outcome[RigPose]:
    """The pose of the second camera relative to the first, or the reason why the charts do not determine it.

    Parameters
    ----------
    first, second : PosedCharts
        Of one chart, in photographs taken at the same times.
    """
    try:
        a, b = matched(first, second)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    relative = [_relative(one, other) for one, other in zip(a.poses, b.poses, strict=True)]
    pose, count = relative[0], len(relative)
    transport = np.zeros((POSE * count, POSE * count))
    for i, one in enumerate(relative):
        transport[POSE * i : POSE * (i + 1), POSE * i : POSE * (i + 1)] = _transport(one)
    covariance = b.covariance + transport @ a.covariance @ transport.T
    precision, every = np.linalg.inv(covariance), np.tile(np.eye(POSE), (count, 1))
    known: Array = np.asarray(np.linalg.inv(every.T @ precision @ every), dtype=np.float64)
    for _ in range(ITERATIONS):
        residual = np.concatenate([_change(pose, one) for one in relative])
        pose = moved_pose(pose, known @ (every.T @ (precision @ residual)))
    residual = np.concatenate([_change(pose, one) for one in relative])
    chi_square, freedom = float(residual @ precision @ residual), POSE * (count - 1)
    misfit = float(np.sqrt(chi_square / freedom))
    known = known * max(misfit, 1.0) ** 2
    share = max(a.scale_uncertainty, b.scale_uncertainty)  # the same print: a common error
    known[3:, 3:] += share**2 * np.outer(pose.t, pose.t)
    rig = RigPose(pose, known, a.sources, misfit, float(stats.chi2.sf(chi_square, freedom)))
    return verdict_of([_rigid(rig)], rig)


def _rigid(rig: RigPose) -> Check:
    return Check(
        "rigidity",
        -stats.norm.ppf(rig.chance),
        -stats.norm.ppf(UNLIKELY),
        Verdict.DOUBTFUL,
        f"the charts give relative poses that differ by {rig.misfit:.1f} times their uncertainties",
        "check that the photographs were taken at one time and have the same names, and that the rig is rigid",
    )


def _relative(first: Pose, second: Pose) -> Pose:
    """T_second T_first^-1."""
    R = second.R @ first.R.T
    return Pose(np.asarray(R), np.asarray(second.t - R @ first.t))


def _transport(pose: Pose) -> Array:
    """Derivative (6, 6) of the relative pose by a change of the first camera's pose."""
    R, t = pose.R, pose.t
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return -np.block([[R, np.zeros((3, 3))], [cross @ R, R]])


def _change(start: Pose, end: Pose) -> Array:
    """The change (6,) from one pose to another."""
    turn = end.R @ start.R.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), end.t - turn @ start.t])
