"""Facts of the guided calibration: those of a field, the number of views, and the chart's pose in each."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from procedures.field.plan import FieldFacts
from procedures.geometry.views import Pose
from procedures.outcome import BadParameter
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.pose import ChartPose
from procedures.plan import Fact, Facts, gathered, number

FRAME = "frame"
VIEW = "view_"
PARTS = ("x_mm", "y_mm", "z_mm", "yaw_deg", "pitch_deg", "roll_deg")


def place_of(aim: str) -> tuple[float, float] | None:
    """Fractions of the frame from a text x,y in per cent; None for the whole frame. Raises BadParameter."""
    if aim == FRAME:
        return None
    try:
        x, y = (float(one) / 100 for one in aim.split(","))
    except ValueError:
        x = y = -1.0
    if not (0 <= x <= 1 and 0 <= y <= 1):
        raise BadParameter(f"a place is {FRAME} or two shares in per cent; got {aim!r}", "answer 80,20, for example")
    return x, y


@dataclass(frozen=True)
class ViewPose:
    """The chart's pose in a view that counts, by the view's number in the tour."""

    number: int
    pose: ChartPose


def poses_of(facts: Facts) -> tuple[ViewPose, ...]:
    """Poses of the views that count, in their order; skipped views are missing. Raises BadParameter."""
    first = f"_{PARTS[0]}"
    numbers = sorted(
        int(name[len(VIEW) : -len(first)]) for name in facts if name.startswith(VIEW) and name.endswith(first)
    )
    rows = {i: [number(facts, f"{VIEW}{i}_{part}") for part in PARTS] for i in numbers}
    return tuple(ViewPose(i, ChartPose((row[0], row[1], row[2]), *row[3:])) for i, row in rows.items())


def pose_facts(view: ViewPose) -> dict[str, Fact]:
    """The facts of a view."""
    pose = view.pose
    values = (*pose.centre_mm, pose.yaw_deg, pose.pitch_deg, pose.roll_deg)
    return {f"{VIEW}{view.number}_{part}": value for part, value in zip(PARTS, values, strict=True)}


def as_pose(pose: ChartPose) -> Pose:
    """The pose in the convention of the geometry."""
    turn = Rotation.from_euler("ZYX", [pose.roll_deg, pose.yaw_deg, pose.pitch_deg], degrees=True)
    return Pose(np.asarray(turn.as_matrix()), np.array(pose.centre_mm))


@dataclass(frozen=True)
class GeometryFacts(FieldFacts):
    """The facts of the plan: those of a field, the number of `views`, the `aim`, and the poses in those that count."""

    views: float | None = None
    aim: str = FRAME
    poses: tuple[ViewPose, ...] = gathered(poses_of, *SIZES, prefix=VIEW)

    @property
    def aimed_at(self) -> tuple[float, float] | None:
        """The place whose direction matters most, as fractions of the frame; None: all of it."""
        return place_of(self.aim)

    def before(self, number: int) -> tuple[ChartPose, ...]:
        """The poses of the views before one."""
        return tuple(pose.pose for pose in self.poses if pose.number < number)
