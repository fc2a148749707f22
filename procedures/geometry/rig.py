"""How two cameras on one rig stand to each other, from charts that both photographed at the same time.

Each camera is calibrated by itself and knows the pose of every chart, T_a and T_b, with one covariance over all, in
which its intrinsics and the chart's shape are allowed for. Every chart gives the relative pose T_b T_a^-1; that of
the rig is the one nearest to all, by generalised least squares in the changes (w, d): X -> exp(w) X + d. A change
(w, d) of T_a is one of the relative pose (R, t) by

    -(R w, R d + t x R w).

What both cameras' views have in common, errors of the print that neither tells, is counted twice and not as common: it
cancels in part, and the uncertainty is then too large rather than too small. The print's scale does not cancel, neither
what is not known of a cell nor what the nodes' own errors make of the whole.
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

FEWEST = 3
"""Charts: fewer do not tell whether the rig is rigid."""
ROUNDS = 4
UNLIKELY = 0.001
"""Chance of differences as large among the charts, below which the rig is doubted."""


@dataclass(frozen=True, eq=False)
class PosedCharts:
    """The charts that one camera saw.

    Attributes
    ----------
    sources : tuple of str
        What the photographs are called.
    poses : tuple of Pose
    covariance : (6 n, 6 n) float64
        Of the poses' changes in the camera's frame, one after the other.
    scale_uncertainty : float
        Standard uncertainty of the print's scale, over it.
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
    """The second camera on the first one's rig: X_second = R X_first + t.

    Attributes
    ----------
    pose : Pose
    covariance : (6, 6) float64
        Of its change in the second camera's frame: rotation in radians, translation in mm; the print's scale is in it.
    charts : tuple of str
        The first camera's photographs that it is made of.
    misfit : float
        Root of chi^2 over the degrees of freedom among the charts; where above 1 the covariance is widened by it.
    chance : float
        Of a chi^2 as large.
    """

    pose: Pose
    covariance: Array
    charts: tuple[str, ...]
    misfit: float
    chance: float

    def numbers(self) -> dict[str, Quantity]:
        """Baseline and the angle between the axes, with their uncertainties."""
        t, turn = self.pose.t, Rotation.from_matrix(self.pose.R)
        length, angle = float(np.linalg.norm(t)), float(turn.magnitude())
        along = t / length if length else np.zeros(3)
        # a turn of the camera carries t with it and leaves its length
        spread = float(np.sqrt(along @ self.covariance[3:, 3:] @ along))
        axis = turn.as_rotvec() / angle if angle else np.array([0.0, 0.0, 1.0])
        of_angle = float(np.degrees(np.sqrt(axis @ self.covariance[:3, :3] @ axis)))
        method, n = f"relative poses of {len(self.charts)} charts", len(self.charts)
        return {
            BASELINE: Quantity(length, "mm", spread, f"{method}; the print's scale is in the uncertainty", n),
            TURN: Quantity(float(np.degrees(angle)), "degree", of_angle, method, n),
        }


def posed_charts(found: Geometry) -> PosedCharts:
    """The charts of a calibrated camera."""
    first = len(found.camera.params) + len(found.adjustment.state.terms_mm)
    covariance = found.adjustment.covariance[first:, first:] * found.residual_scale**2
    return PosedCharts(
        tuple(one.view.source for one in found.views), tuple(one.pose for one in found.views), covariance,
        found.shape.scale_uncertainty,
    )  # fmt: skip


def matched(first: PosedCharts, second: PosedCharts) -> tuple[PosedCharts, PosedCharts]:
    """The charts that both saw: photographs of one name; where none has, and there are as many, in their order.

    Raises
    ------
    Refused
        If it cannot be told which belong together, or they are too few.
    """
    common = [name for name in first.sources if name in second.sources]
    if common:
        pairs = [(first.sources.index(name), second.sources.index(name)) for name in common]
    elif len(first.sources) == len(second.sources):
        pairs = [(i, i) for i in range(len(first.sources))]
    else:
        raise Refused(
            f"photographs that were taken together have one name, or both cameras have as many; "
            f"they have {len(first.sources)} and {len(second.sources)}, none of one name",
            "name those that were taken together alike",
        )
    if len(pairs) < FEWEST:
        raise Refused(
            f"a rig needs {FEWEST} charts that both cameras saw at a time; there are {len(pairs)}",
            "photograph the chart with both cameras at once, in more poses",
        )
    left, right = zip(*pairs, strict=True)
    return first.chosen(left), second.chosen(right)


def estimate_rig(first: PosedCharts, second: PosedCharts) -> Outcome[RigPose]:
    """How the second camera stands to the first, or the reason why they do not tell it.

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
    carried = np.zeros((POSE * count, POSE * count))
    for i, one in enumerate(relative):
        carried[POSE * i : POSE * (i + 1), POSE * i : POSE * (i + 1)] = _carrying(one)
    covariance = b.covariance + carried @ a.covariance @ carried.T
    precision, every = np.linalg.inv(covariance), np.tile(np.eye(POSE), (count, 1))
    known: Array = np.asarray(np.linalg.inv(every.T @ precision @ every), dtype=np.float64)
    for _ in range(ROUNDS):
        away = np.concatenate([_change(pose, one) for one in relative])
        pose = moved_pose(pose, known @ (every.T @ (precision @ away)))
    left = np.concatenate([_change(pose, one) for one in relative])
    chi_square, freedom = float(left @ precision @ left), POSE * (count - 1)
    misfit = float(np.sqrt(chi_square / freedom))
    known = known * max(misfit, 1.0) ** 2
    share = max(a.scale_uncertainty, b.scale_uncertainty)  # of one print: both saw the same error
    known[3:, 3:] += share**2 * np.outer(pose.t, pose.t)
    found = RigPose(pose, known, a.sources, misfit, float(stats.chi2.sf(chi_square, freedom)))
    return verdict_of([_rigid(found)], found)


def _rigid(found: RigPose) -> Check:
    return Check(
        "rigidity",
        -stats.norm.ppf(found.chance),
        -stats.norm.ppf(UNLIKELY),
        Verdict.DOUBTFUL,
        f"the charts give relative poses that differ by {found.misfit:.1f} times their uncertainties",
        "see that the photographs were taken at one time, that they are named alike, and that the rig does not give",
    )


def _relative(first: Pose, second: Pose) -> Pose:
    """T_second T_first^-1."""
    R = second.R @ first.R.T
    return Pose(np.asarray(R), np.asarray(second.t - R @ first.t))


def _carrying(pose: Pose) -> Array:
    """What makes the relative pose's change of the first camera's, (6, 6)."""
    R, t = pose.R, pose.t
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return -np.block([[R, np.zeros((3, 3))], [cross @ R, R]])


def _change(start: Pose, end: Pose) -> Array:
    """The change (6,) that makes one pose of another."""
    turn = end.R @ start.R.T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), end.t - turn @ start.t])
