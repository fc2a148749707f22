"""The distances of the wall as they were given, held against the laser and against what both photographs show."""

from __future__ import annotations

import math

import numpy as np

from procedures.facts import facts_as
from procedures.numerics.warps import homography_jacobian
from procedures.outcome import BadParameter, Refused
from procedures.plan import Advice, Fact, Facts, Reading
from procedures.raw import Plane
from procedures.two_photo.facts import RATIO, SHARP_RATIO, TwoPhotoFacts
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


def room_mm(known: TwoPhotoFacts) -> float | None:
    """How far back the rail goes from here; None where there is no rail, or its end is not known."""
    rail = known.axes.get("z_mm")
    return None if rail is None or rail.at is None or rail.high is None else rail.high - rail.at


def check_reach(near_mm: Fact, facts: Facts) -> None:
    """Raises BadParameter where the rail does not reach a far place that determines a sharp lens's PSF."""
    room = room_mm(facts_as(TwoPhotoFacts, facts))
    if room is None or room >= (SHARP_RATIO - 1) * float(near_mm):
        return
    raise BadParameter(
        f"the far photograph must be taken from at least {SHARP_RATIO:g} times the near distance; from "
        f"{float(near_mm) / 1000:.2f} m the rail reaches {1 + room / float(near_mm):.1f} times",
        f"bring wall and rail together, so that the wall is at most {room / (SHARP_RATIO - 1) / 1000:.2f} m from the "
        "lens, or correct the distance",
    )


def check_ratio(ratio: Fact, facts: Facts) -> None:
    """Raises BadParameter where the far place lies beyond the rail's end."""
    known = facts_as(TwoPhotoFacts, {**facts, "ratio": ratio})
    beyond = beyond_rail(known)
    if beyond is not None:
        raise BadParameter(beyond.say.removesuffix("."), f"give a ratio of at most {reached_ratio(known):g}")


def proposed_ratio(facts: Facts) -> float:
    """The usual ratio, or the largest that the rail reaches."""
    return min(RATIO, reached_ratio(facts_as(TwoPhotoFacts, facts)))


def reached_ratio(known: TwoPhotoFacts) -> float:
    """The largest ratio that the rail reaches from here, to one decimal; infinite where there is none."""
    room = room_mm(known)
    return math.inf if room is None or known.near_mm is None else int(10 * (1 + room / known.near_mm)) / 10


def beyond_rail(known: TwoPhotoFacts) -> Advice | None:
    """That the rail does not reach the far place, from the near one; None where it does, or where there is none."""
    room, near_mm = room_mm(known), known.near_mm
    if room is None or near_mm is None or known.insisted.issuperset(("near_mm", "ratio")):
        return None
    told_mm = (known.ratio - 1) * near_mm
    if told_mm <= room:
        return None
    say = (
        f"{known.ratio:g} times as far as {near_mm / 1000:.2f} m is {told_mm / 1000:.2f} m farther back, and the rail "
        f"goes {room / 1000:.2f} m: a smaller ratio will do, or the near distance is wrong."
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
