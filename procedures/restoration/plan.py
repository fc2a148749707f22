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
from procedures.restoration.ground_truth import compare_to_ground_truth
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.result import Restoration
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.known_blur import (
    ReadShape,
    blur_spec,
    named_shape,
    planes_of,
    restored_plane,
    split_ground_truth,
    stacked,
)
from procedures.restoration.photograph_blur import blur_of
from procedures.restoration.plan_checks import Check, checks
from procedures.restoration.plan_questions import (
    FIRST,
    GROUND_TRUTH,
    MOVES,
    SECOND,
    THIRD,
    scene,
    with_third,
    with_truth,
)

PICTURE = "picture"
"""Name of the outcome."""
OMITTED = "left out"
"""Status of a photograph that was not requested."""
LEAST_ROUND_S = 0.05
"""Shortest round of a shaker, which otherwise takes one exposure: voice coils follow 20 Hz."""
POINTS = 48
"""Points of a path: a millisecond apart in its fastest round, under a second in an exposure of 48 s."""
SHARE = 0.95
"""Fraction of a shaker's stroke that is used."""


def plan(read_shape: ReadShape = named_shape) -> Plan:
    """The guided restoration of picture and depth; `read_shape` reads measured shapes."""
    check, restore = checks(read_shape), Estimate(partial(estimate, read=read_shape))
    return Plan(
        "restoration",
        "Sharp picture and depth from blurred photographs",
        (
            Step(
                "scene", "Scene", "Set up the scene, the rig and the light.", scene(read_shape),
                drawings.SCENE, lambda facts: facts_as(RestorationFacts, facts).blur_by,
            ),
            Step(
                "first", "First", "Take the first photograph.", shots("first", FIRST, check),
                drawings.FIRST, first_summary,
            ),
            Step(
                "second", "Second", "Take the second: another aperture or motion.", shots("second", SECOND, check),
                drawings.SECOND, partial(light_summary, "second"),
            ),
            Step(
                "third", "Third", "Take the third: yet another aperture or motion.", shots("third", THIRD, check),
                drawings.THIRD, partial(light_summary, "third"), with_third,
            ),
            Step(
                TRUTH, "Truth", "Take the ground truth: a sharp photograph.", shots(TRUTH, GROUND_TRUTH, check),
                drawings.TRUTH, partial(light_summary, TRUTH), with_truth,
            ),
            Step("estimate", "Restore", "Restore picture and depth from all.", (restore,)),
            Step("verdict", "Verdict", "Accept the result, or take all again.", (Decide("first"),)),
        ),
        subject="depth",
        facts=RestorationFacts,
    )  # fmt: skip


def first_summary(facts: Facts) -> str:
    """Brightness of the first photograph."""
    level = facts_as(RestorationFacts, facts).first_level
    return "" if level is None else f"mean {100 * level:.0f} %"


def light_summary(which: str, facts: Facts) -> str:
    """Brightness of a later photograph relative to the first, if there is such a photograph."""
    if (which == "third" and not with_third(facts)) or (which == TRUTH and not with_truth(facts)):
        return OMITTED
    levels = facts_as(RestorationFacts, facts).levels
    first, level = levels["first"], levels[which]
    return "" if first is None or level is None else f"light {100 * (level / first - 1):+.0f} %"


def shots(which: str, questions: tuple[Ask, ...], check: Mapping[str, Check]) -> tuple[Any, ...]:
    """One photograph for the estimate, with a record of the IMU unless the rig rests."""
    # the light is checked while the rig rests
    look = (Look("light", check[which]), MOVES) if which == "first" else ()
    shoot = Shoot(
        which, check[which], level_of, enough(which), most=8, record_motion=which != TRUTH,
        shake=lambda facts: path(which, facts),
    )  # fmt: skip
    return (*questions, *look, shoot)


def level_of(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """Result of a single photograph: its mean."""
    return {PICTURE: Outcome(float(np.mean(restored_plane(frame).samples)))}


def enough(which: str) -> Any:
    """One photograph is enough."""
    return lambda results, facts: Advice(bool(results), f"The {which} photograph is taken.")


def path(which: str, facts: Facts) -> Shake | None:
    """Path of the shaker: loops along x, along y, and diagonal, so that each retains what another suppresses."""
    known = facts_as(RestorationFacts, facts)
    if known.blur_by == APERTURES or which == TRUTH:
        return None
    turn = 2 * np.pi * np.arange(POINTS) / POINTS
    if which == "third":
        # forth and back along a parabola: of such loops the one with the smallest noise gain
        along, across = np.cos(turn), np.cos(2 * turn) / 2
        x, y = SHARE * (along + across) / 1.5, SHARE * (along - across) / 1.5
    else:
        lag = 0.6 if which == "first" else 1.1
        loop = SHARE * np.cos(turn), SHARE / 2 * np.cos(2 * turn + lag)
        x, y = loop if which == "first" else loop[::-1]
    round_s = max(known.first_exposure_s or 0.0, LEAST_ROUND_S)
    return Shake(round_s, {"x_mm": tuple(x.tolist()), "y_mm": tuple(y.tolist())})


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known, read: ReadShape = named_shape) -> Outcomes:
    """The sharp picture and w of every pixel, from all photographs used."""
    answers = facts_as(RestorationFacts, facts)
    blurred, truth = split_ground_truth(frames, answers)
    if len(blurred) != answers.photographs:
        raise BadInput(
            f"restoration needs {answers.photographs} photographs; {len(blurred)} are available",
            "take all of them again",
        )
    planes = [planes_of(frame, answers) for frame in blurred]
    pictures = [stacked(one) for one in planes]
    if not is_mosaic(planes[0]):
        pictures = [one * (pictures[0].mean() / one.mean()) for one in pictures]
    try:
        parameters = parameters_of(answers)
        blur = blur_of(blur_spec(blurred, answers, read), pictures)
        outcome = blur.restored(pictures, parameters)
        if is_mosaic(planes[0]):
            outcome = blur.coloured(outcome, planes)
        return {PICTURE: outcome if truth is None else compared_to_truth(outcome, planes, planes_of(truth, answers))}
    except (Refused, BadInput, BadParameter) as error:
        return {PICTURE: Outcome(None, Verdict.REFUSED, error.reason, error.remedy)}


def parameters_of(known: RestorationFacts) -> RestorationParameters:
    """Parameters: defaults but for the scheme, and the initial depth of uniform motion. Raises BadParameter."""
    parameters = RestorationParameters(scheme=Scheme() if known.scheme is None else Scheme.parse(known.scheme))
    if known.steady == NO:
        return parameters
    return replace(parameters, depth_start="symmetric", symmetric_axis=known.steady)


def compared_to_truth(
    outcome: Outcome[Restoration], photographs: Sequence[Mapping[str, Plane]], truth: Mapping[str, Plane]
) -> Outcome[Restoration]:
    """Compare with the ground truth; an invalid one makes the restoration doubtful."""
    try:
        return compare_to_ground_truth(outcome, photographs, truth)
    except BadInput as error:
        return outcome if outcome.value is None else with_doubt(outcome, error.reason, error.remedy)
