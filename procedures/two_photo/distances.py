"""Comparison of the given distances of the wall with the laser and with the photographs."""

import math

import numpy as np

from procedures.numerics.warps import homography_jacobian
from procedures.outcome import BadParameter, Refused
from procedures.plan import Advice, Fact, Facts, Reading, facts_as
from procedures.raw import Plane
from procedures.two_photo.facts import RATIO, SHARP_RATIO, TwoPhotoFacts
from procedures.two_photo.registration import register

LASER_REACH_MM, NEAR_SHARE, WAY_SHARE = 300.0, 0.3, 0.15
"""Largest distance of the rangefinder from the lens along the rail, in mm and relative to its reading; accepted
relative deviation of the way by its two readings."""
PUPIL_MM, TAPE_SHARE = 60.0, 0.1
"""Largest distance of the entrance pupil behind the lens's front, from which distances are measured; and the accepted
relative error of such a distance."""


def near_by_laser(known: TwoPhotoFacts) -> Advice | None:
    """Contradiction of the entered near distance by the laser; None where both are possible, or one is missing."""
    laser_mm, near_mm = known.distance_mm, known.near_mm
    if laser_mm is None or near_mm is None or "near_mm" in known.insisted:
        return None
    if abs(laser_mm - near_mm) <= min(LASER_REACH_MM, NEAR_SHARE * laser_mm):
        return None
    say = f"The laser reads {laser_mm / 1000:.2f} m, and the wall was given as {near_mm / 1000:.2f} m away."
    return Advice(False, say, contradictory=("near_mm",))


def way_by_laser(known: TwoPhotoFacts) -> Advice | None:
    """Contradiction of the way to the far place by the laser; None where they agree, or a reading is missing."""
    far_mm, near_laser_mm, near_mm = known.distance_mm, known.near_laser_mm, known.near_mm
    if far_mm is None or near_laser_mm is None or near_mm is None or known.insisted.issuperset(("near_mm", "ratio")):
        return None
    gone_mm, wanted_mm = far_mm - near_laser_mm, (known.ratio - 1) * near_mm
    if abs(gone_mm - wanted_mm) <= WAY_SHARE * wanted_mm:
        return None
    say = (
        f"By the laser the camera went back by {gone_mm / 1000:.2f} m, and {wanted_mm / 1000:.2f} m were wanted: "
        "go there, or correct the near distance or the ratio."
    )
    way = Reading("way", gone_mm / 1000, "m", (1 - WAY_SHARE) * wanted_mm / 1000, (1 + WAY_SHARE) * wanted_mm / 1000)
    return Advice(False, say, (way,), moves={"z_mm": wanted_mm - gone_mm}, by_hand={"distance": wanted_mm - gone_mm})


def room_mm(known: TwoPhotoFacts) -> float | None:
    """Travel of the rail backwards from here; None where there is no rail, or its end is not known."""
    rail = known.axes.get("z_mm")
    return None if rail is None or rail.at is None or rail.high is None else rail.high - rail.at


def check_reach(near_mm: Fact, facts: Facts) -> None:
    """Raise BadParameter where the rail does not reach a far place that determines a sharp lens's PSF."""
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
    """Raise BadParameter where the far place lies beyond the rail's end."""
    known = facts_as(TwoPhotoFacts, {**facts, "ratio": ratio})
    beyond = beyond_rail(known)
    if beyond is not None:
        raise BadParameter(beyond.say.removesuffix("."), f"give a ratio of at most {reached_ratio(known):g}")


def proposed_ratio(facts: Facts) -> float:
    """The usual ratio, or the largest one within the rail's travel."""
    return min(RATIO, reached_ratio(facts_as(TwoPhotoFacts, facts)))


def reached_ratio(known: TwoPhotoFacts) -> float:
    """The largest ratio within the rail's travel from here, to one decimal; infinite without a rail."""
    room = room_mm(known)
    return math.inf if room is None or known.near_mm is None else int(10 * (1 + room / known.near_mm)) / 10


def most_ratio(known: TwoPhotoFacts) -> float:
    """The largest ratio between the near place and the rail's end; infinite without a rail."""
    rail = known.axes.get("z_mm")
    if rail is None or rail.high is None or known.near_z_mm is None or known.near_mm is None:
        return math.inf
    return 1 + (rail.high - known.near_z_mm) / known.near_mm


def beyond_rail(known: TwoPhotoFacts) -> Advice | None:
    """Advice where the rail does not reach the far place; None where it does, or without a rail."""
    room, near_mm = room_mm(known), known.near_mm
    if room is None or near_mm is None or known.insisted.issuperset(("near_mm", "ratio")):
        return None
    wanted_mm = (known.ratio - 1) * near_mm
    if wanted_mm <= room:
        return None
    say = (
        f"{known.ratio:g} times as far as {near_mm / 1000:.2f} m is {wanted_mm / 1000:.2f} m farther back, and the "
        f"rail goes {room / 1000:.2f} m: a smaller ratio will do, or the near distance is wrong."
    )
    return Advice(False, say, contradictory=("near_mm", "ratio"))


def way_mm(known: TwoPhotoFacts) -> float | None:
    """Way of the camera from the near place, by the rail, otherwise by the laser; None where neither is known."""
    here_mm = known.where().get("z_mm")
    if here_mm is not None and known.near_z_mm is not None:
        return here_mm - known.near_z_mm
    if known.distance_mm is not None and known.near_laser_mm is not None:
        return known.distance_mm - known.near_laser_mm
    return None


def times_as_far(near: Plane, far: Plane) -> float | None:
    """Ratio of the distances by the photographs; None where they do not show one wall.

    It is the number of near pixels per far pixel, in the middle of the far photograph.
    """
    try:
        sighting = register(near.samples, far.samples)
    except Refused:
        return None
    rows, columns = (near if sighting.swapped else far).samples.shape
    J = homography_jacobian(sighting.H_near_far, np.array([(columns - 1) / 2, (rows - 1) / 2]))
    zoom = float(np.sqrt(abs(np.linalg.det(J))))
    return 1 / zoom if sighting.swapped else zoom


def near_by_photographs(times: float | None, known: TwoPhotoFacts) -> Advice | None:
    """Contradiction of the entered near distance by the photographs; None where both are possible, or one is missing.

    With a known way w to the far place, the near distance is w / (times - 1); otherwise the required ratio is compared
    with `times`. In both cases the entrance pupil may lie up to `PUPIL_MM` behind the lens's front.
    """
    near_mm, gone_mm = known.near_mm, known.far_way_mm
    keys = ("near_mm",) if gone_mm is not None else ("near_mm", "ratio")
    if times is None or times <= 1 or near_mm is None or known.insisted.issuperset(keys):
        return None
    shown = f"By the photographs the second place is {times:.2f} times as far as the first"
    if gone_mm is not None:
        derived_mm = gone_mm / (times - 1)
        if (1 - TAPE_SHARE) * near_mm <= derived_mm <= (1 + TAPE_SHARE) * near_mm + PUPIL_MM:
            return None
        say = (
            f"{shown}, and {gone_mm / 1000:.2f} m behind it: that is {derived_mm / 1000:.2f} m from the wall, which "
            f"was given as {near_mm / 1000:.2f} m away."
        )
        return Advice(False, say, contradictory=keys)
    least = (known.ratio * near_mm + PUPIL_MM) / (near_mm + PUPIL_MM)
    if (1 - TAPE_SHARE) * least <= times <= (1 + TAPE_SHARE) * known.ratio:
        return None
    return Advice(
        False,
        f"{shown}; {known.ratio:g} times as far was wanted: correct the distance or the ratio.",
        contradictory=keys,
    )
