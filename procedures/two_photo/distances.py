"""The distances of the wall as they were given, held against the laser and against what both photographs show."""

from __future__ import annotations

import numpy as np

from procedures.numerics.warps import homography_jacobian
from procedures.outcome import Refused
from procedures.plan import Advice, Reading
from procedures.raw import Plane
from procedures.two_photo.facts import TwoPhotoFacts
from procedures.two_photo.registration import register

LASER_REACH_MM, NEAR_SHARE, WAY_SHARE = 300.0, 0.3, 0.15
"""How far before or behind the lens a rangefinder on its carriage is, and no more than this share of its reading; the
share of the way by which its two readings may differ from it."""
PUPIL_MM, TAPE_SHARE = 60.0, 0.1
"""How far behind the lens's front, from where a wall's distance is taken, its perspective may begin; and the share by
which that distance may be off."""


def near_by_laser(known: TwoPhotoFacts) -> Advice | None:
    """The near distance as it was typed against the laser's reading; None where both can be true, or one is missing."""
    laser_mm, near_mm = known.distance_mm, known.near_mm
    if laser_mm is None or near_mm is None or "near_mm" in known.insisted:
        return None
    if abs(laser_mm - near_mm) <= min(LASER_REACH_MM, NEAR_SHARE * laser_mm):
        return None
    say = f"The laser reads {laser_mm / 1000:.2f} m, and the wall was given as {near_mm / 1000:.2f} m away."
    return Advice(False, say, doubted=("near_mm",))


def way_by_laser(known: TwoPhotoFacts) -> Advice | None:
    """The way to the far place against the laser's two readings; None where they agree, or one is missing."""
    far_mm, near_laser_mm, near_mm = known.distance_mm, known.near_laser_mm, known.near_mm
    if far_mm is None or near_laser_mm is None or near_mm is None or known.insisted.issuperset(("near_mm", "ratio")):
        return None
    gone_mm, told_mm = far_mm - near_laser_mm, (known.ratio - 1) * near_mm
    if abs(gone_mm - told_mm) <= WAY_SHARE * told_mm:
        return None
    say = (
        f"By the laser the camera went back by {gone_mm / 1000:.2f} m, and {told_mm / 1000:.2f} m were wanted: "
        "go there, or correct the near distance or the ratio."
    )
    way = Reading("way", gone_mm / 1000, "m", (1 - WAY_SHARE) * told_mm / 1000, (1 + WAY_SHARE) * told_mm / 1000)
    return Advice(False, say, (way,), moves={"z_mm": told_mm - gone_mm}, by_hand={"distance": told_mm - gone_mm})


def beyond_rail(known: TwoPhotoFacts) -> Advice | None:
    """That the rail does not reach the far place, from the near one; None where it does, or where there is none."""
    rail, near_mm = known.axes.get("z_mm"), known.near_mm
    if rail is None or rail.at is None or near_mm is None or known.insisted.issuperset(("near_mm", "ratio")):
        return None
    told_mm = (known.ratio - 1) * near_mm
    if rail.high is None or rail.at + told_mm <= rail.high:
        return None
    say = (
        f"{known.ratio:g} times as far as {near_mm / 1000:.2f} m is {told_mm / 1000:.2f} m farther back, and the rail "
        f"goes {(rail.high - rail.at) / 1000:.2f} m: a smaller ratio will do, or the near distance is wrong."
    )
    return Advice(False, say, doubted=("near_mm", "ratio"))


def way_mm(known: TwoPhotoFacts) -> float | None:
    """How far the camera went back from the near place, by the rail, else by the laser; None where neither tells."""
    here_mm = known.where().get("z_mm")
    if here_mm is not None and known.near_z_mm is not None:
        return here_mm - known.near_z_mm
    if known.distance_mm is not None and known.near_laser_mm is not None:
        return known.distance_mm - known.near_laser_mm
    return None


def times_as_far(near: Plane, far: Plane) -> float | None:
    """Distance of the far place over that of the near one, as the photographs show; None where they show no one wall.

    It is the number of near pixels per far pixel, in the middle of the far photograph.
    """
    try:
        found = register(near.samples, far.samples)
    except Refused:
        return None
    rows, columns = (near if found.swapped else far).samples.shape
    J = homography_jacobian(found.H_near_far, np.array([(columns - 1) / 2, (rows - 1) / 2]))
    zoom = float(np.sqrt(abs(np.linalg.det(J))))
    return 1 / zoom if found.swapped else zoom


def near_by_photographs(times: float | None, known: TwoPhotoFacts) -> Advice | None:
    """The near distance as it was typed against the photographs; None where both can be true, or one is missing.

    With the way w to the far place known, the near one is w / (times - 1) away; else the ratio that was wanted is held
    against `times`. Either way the lens's perspective may begin up to `PUPIL_MM` behind its front.
    """
    near_mm, gone_mm = known.near_mm, known.far_way_mm
    doubted = ("near_mm",) if gone_mm is not None else ("near_mm", "ratio")
    if times is None or times <= 1 or near_mm is None or known.insisted.issuperset(doubted):
        return None
    shown = f"By the photographs the second place is {times:.2f} times as far as the first"
    if gone_mm is not None:
        found_mm = gone_mm / (times - 1)
        if (1 - TAPE_SHARE) * near_mm <= found_mm <= (1 + TAPE_SHARE) * near_mm + PUPIL_MM:
            return None
        say = (
            f"{shown}, and {gone_mm / 1000:.2f} m behind it: that is {found_mm / 1000:.2f} m from the wall, which was "
            f"given as {near_mm / 1000:.2f} m away."
        )
        return Advice(False, say, doubted=doubted)
    least = (known.ratio * near_mm + PUPIL_MM) / (near_mm + PUPIL_MM)
    if (1 - TAPE_SHARE) * least <= times <= (1 + TAPE_SHARE) * known.ratio:
        return None
    return Advice(False, f"{shown}; {known.ratio:g} times as far was wanted: give both as they are.", doubted=doubted)
