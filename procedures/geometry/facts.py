"""What a guided geometry knows beside the tour's start: how many views are wanted, and the poses in those taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from procedures.facts import gathered, number
from procedures.field.facts import FieldFacts
from procedures.geometry.views import Pose
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.pose import ChartPose
from procedures.plan import Fact, Facts

VIEW = "view_"
PARTS = ("x_mm", "y_mm", "z_mm", "yaw_deg", "pitch_deg", "roll_deg")


@dataclass(frozen=True)
class ViewPose:
    """The chart's pose in a view that counts, by the view's number in the tour."""

    number: int
    pose: ChartPose


def poses_of(facts: Facts) -> tuple[ViewPose, ...]:
    """Of the views that count, in their order; one that was left out is missing. Raises BadParameter."""
    first = f"_{PARTS[0]}"
    told = sorted(
        int(name[len(VIEW) : -len(first)]) for name in facts if name.startswith(VIEW) and name.endswith(first)
    )
    rows = {i: [number(facts, f"{VIEW}{i}_{part}") for part in PARTS] for i in told}
    return tuple(ViewPose(i, ChartPose((row[0], row[1], row[2]), *row[3:])) for i, row in rows.items())


def pose_facts(one: ViewPose) -> dict[str, Fact]:
    """The facts of a view."""
    pose = one.pose
    values = (*pose.centre_mm, pose.yaw_deg, pose.pitch_deg, pose.roll_deg)
    return {f"{VIEW}{one.number}_{part}": value for part, value in zip(PARTS, values, strict=True)}


def as_pose(seen: ChartPose) -> Pose:
    """The pose as the geometry counts."""
    turn = Rotation.from_euler("ZYX", [seen.roll_deg, seen.yaw_deg, seen.pitch_deg], degrees=True)
    return Pose(np.asarray(turn.as_matrix()), np.array(seen.centre_mm))


@dataclass(frozen=True)
class GeometryFacts(FieldFacts):
    """The facts of the plan: those of a field, how many `views` are wanted, and the poses in those that count."""

    views: float | None = None
    poses: tuple[ViewPose, ...] = gathered(poses_of, *SIZES, prefix=VIEW)

    def before(self, number: int) -> tuple[ChartPose, ...]:
        """The poses of the views before one."""
        return tuple(one.pose for one in self.poses if one.number < number)
