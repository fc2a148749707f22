"""The plan of a restoration: one scene photographed twice or three times, by apertures or during motions of the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from procedures.drawings import steps as drawings
from procedures.facts import facts_as
from procedures.outcome import BadInput, BadParameter, Outcome, Refused, Verdict, with_doubt
from procedures.plan import Advice, Ask, Decide, Estimate, Facts, Known, Look, Outcomes, Plan, Shake, Shoot, Step
from procedures.raw import Plane, RawFrame
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.facts import APERTURES, NO, TRUTH, RestorationFacts
from procedures.restoration.ground_truth import held_against
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.result import Restoration
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.known_blur import ReadShape, apart, blur_spec, by_name, planes_of, shown, stacked
from procedures.restoration.photograph_blur import blur_of
from procedures.restoration.plan_asks import FIRST, GROUND_TRUTH, MOVES, SECOND, THIRD, scene, with_third, with_truth
from procedures.restoration.plan_checks import Check, checks

PICTURE = "picture"
"""The one outcome's name."""
LEFT_OUT = "left out"
"""What the rail shows of a photograph that was not wanted."""
LEAST_ROUND_S = 0.05
"""A shaker goes around once in an exposure, but not faster than this: voice coils follow 20 Hz."""
POINTS = 48
"""Of a path: a millisecond apart in its fastest round, under a second in an exposure of 48 s."""
SHARE = 0.95
"""Of its stroke that a shaker goes."""


def plan(read_shape: ReadShape = by_name) -> Plan:
    """The guided restoration of picture and depth; `read_shape` reads shapes that were measured."""
    check, restore = checks(read_shape), Estimate(partial(estimate, read=read_shape))
    return Plan(
        "restoration",
        "Sharp picture and depth from blurred photographs",
        (
            Step(
                "scene", "Scene", "Set up the scene, the rig and the light.", scene(read_shape),
                drawings.SCENE, gave_blur,
            ),
            Step(
                "first", "First", "Take the first photograph.", shots("first", FIRST, check),
                drawings.FIRST, gave_first,
            ),
            Step(
                "second", "Second", "Take the second: another aperture or motion.", shots("second", SECOND, check),
                drawings.SECOND, gave_second,
            ),
            Step(
                "third", "Third", "Take the third: yet another aperture or motion.", shots("third", THIRD, check),
                drawings.THIRD, gave_third, with_third,
            ),
            Step(
                TRUTH, "Truth", "Take the ground truth: nothing blurs it.", shots(TRUTH, GROUND_TRUTH, check),
                drawings.TRUTH, gave_truth, with_truth,
            ),
            Step("estimate", "Restore", "Restore picture and depth from all.", (restore,)),
            Step("verdict", "Verdict", "Accept the result, or take all again.", (Decide("first"),)),
        ),
        subject="depth",
        facts=RestorationFacts,
    )  # fmt: skip


def gave_blur(facts: Facts) -> str:
    """What blurs."""
    return facts_as(RestorationFacts, facts).blur_by


def gave_first(facts: Facts) -> str:
    """How bright the first photograph is."""
    level = facts_as(RestorationFacts, facts).first_level
    return "" if level is None else f"mean {100 * level:.0f} %"


def gave_second(facts: Facts) -> str:
    """How much brighter the second is."""
    return _gave_light("second", facts)


def gave_third(facts: Facts) -> str:
    """How much brighter the third is, where there is one."""
    return _gave_light("third", facts) if with_third(facts) else LEFT_OUT


def gave_truth(facts: Facts) -> str:
    """How much brighter the ground truth is, where there is one."""
    return _gave_light(TRUTH, facts) if with_truth(facts) else LEFT_OUT


def _gave_light(which: str, facts: Facts) -> str:
    """How much brighter than the first."""
    levels = facts_as(RestorationFacts, facts).levels
    first, own = levels["first"], levels[which]
    return "" if first is None or own is None else f"light {100 * (own / first - 1):+.0f} %"


# --- photographs -------------------------------------------------------------------------------------------------


def shots(which: str, asks: tuple[Ask, ...], check: Mapping[str, Check]) -> tuple[Any, ...]:
    """One photograph that counts; the IMU is recorded meanwhile, unless the rig rests."""
    # the light is judged while the rig is still
    look = (Look("light", check[which]), MOVES) if which == "first" else ()
    shoot = Shoot(
        which, check[which], level_of, enough(which), most=8, record_motion=which != TRUTH,
        shake=lambda facts: path(which, facts),
    )  # fmt: skip
    return (*asks, *look, shoot)


def level_of(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """What a photograph alone gives: its mean."""
    return {PICTURE: Outcome(float(np.mean(shown(frame).samples)))}


def enough(which: str) -> Any:
    """One is enough."""
    return lambda results, facts: Advice(bool(results), f"The {which} photograph is taken.")


def path(which: str, facts: Facts) -> Shake | None:
    """Around which a shaker carries the camera: loops, mostly along x, along y, and across both.

    They cross as kernels should: what one blurs away the others keep.
    """
    known = facts_as(RestorationFacts, facts)
    if known.blur_by == APERTURES or which == TRUTH:
        return None
    turn = 2 * np.pi * np.arange(POINTS) / POINTS
    if which == "third":
        # there and back along a parabola: of such loops the one with which noise is amplified least
        along, across = np.cos(turn), np.cos(2 * turn) / 2
        x, y = SHARE * (along + across) / 1.5, SHARE * (along - across) / 1.5
    else:
        lag = 0.6 if which == "first" else 1.1
        loop = SHARE * np.cos(turn), SHARE / 2 * np.cos(2 * turn + lag)
        x, y = loop if which == "first" else loop[::-1]
    round_s = max(known.first_exposure_s or 0.0, LEAST_ROUND_S)
    return Shake(round_s, {"x_mm": tuple(x.tolist()), "y_mm": tuple(y.tolist())})


# --- estimate ----------------------------------------------------------------------------------------------------


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known, read: ReadShape = by_name) -> Outcomes:
    """The sharp picture and w of every pixel, from all photographs that count."""
    told = facts_as(RestorationFacts, facts)
    blurred, truth = apart(frames, told)
    if len(blurred) != told.photographs:
        raise BadInput(
            f"restoration needs {told.photographs} photographs; {len(blurred)} count",
            "take all of them again",
        )
    planes = [planes_of(frame, told) for frame in blurred]
    pictures = [stacked(one) for one in planes]
    if not is_mosaic(planes[0]):
        pictures = [one * (pictures[0].mean() / one.mean()) for one in pictures]
    try:
        parameters = parameters_of(told)
        blur = blur_of(blur_spec(blurred, told, read), pictures)
        outcome = blur.restored(pictures, parameters)
        if is_mosaic(planes[0]):
            outcome = blur.coloured(outcome, planes)
        return {PICTURE: outcome if truth is None else witnessed(outcome, planes, planes_of(truth, told))}
    except (Refused, BadInput, BadParameter) as error:
        return {PICTURE: Outcome(None, Verdict.REFUSED, error.reason, error.remedy)}


def parameters_of(known: RestorationFacts) -> RestorationParameters:
    """How to restore: as usual but for the scheme, and where depth begins of a steady motion. Raises BadParameter."""
    parameters = RestorationParameters(scheme=Scheme() if known.scheme is None else Scheme.parse(known.scheme))
    if known.steady == NO:
        return parameters
    return replace(parameters, depth_start="symmetric", symmetric_axis=known.steady)


def witnessed(
    outcome: Outcome[Restoration], photographs: Sequence[Mapping[str, Plane]], truth: Mapping[str, Plane]
) -> Outcome[Restoration]:
    """The same held against the ground truth; what was restored stands, and is doubted, where that cannot be one."""
    try:
        return held_against(outcome, photographs, truth)
    except BadInput as error:
        return outcome if outcome.value is None else with_doubt(outcome, error.reason, error.remedy)
