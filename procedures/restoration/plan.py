"""The plan of a restoration: one scene photographed twice or three times, by apertures or during motions of the rig."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from procedures.drawings import steps as drawings
from procedures.outcome import BadInput, BadParameter, Outcome, Refused, Verdict, mark_doubtful
from procedures.plan import (
    HAS_IMU,
    HAS_SHAKER,
    Advice,
    Ask,
    Decide,
    Estimate,
    Fact,
    Facts,
    Known,
    Look,
    Outcomes,
    Plan,
    SetLight,
    Shake,
    Shoot,
    Step,
    facts_as,
)
from procedures.raw import Plane, RawFrame
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.facts import (
    APERTURES,
    BOTH,
    COLOUR,
    MOTIONS,
    NO,
    ORDER,
    PLANE,
    SEARCH,
    TRUTH,
    YES,
    RestorationFacts,
)
from procedures.restoration.ground_truth import compare_to_ground_truth
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
from procedures.restoration.joint.result import Restoration
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.known_blur import (
    ReadShape,
    blur_spec,
    named_shape,
    planes_of,
    restored_plane,
    shape_names,
    split_ground_truth,
    stacked,
)
from procedures.restoration.masks.blur_models import named
from procedures.restoration.photograph_blur import blur_of
from procedures.restoration.plan_checks import Check, checks
from procedures.restoration.progress import progress
from procedures.restoration.unknown_motion.blind import SearchRound

PICTURE = "picture"
"""Name of the outcome."""
OMITTED = "not taken"
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
                drawings.FIRST, "mean {first_level:.0%}",
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


def light_summary(which: str, facts: Facts) -> str:
    """Brightness of a later photograph relative to the first, if there is such a photograph."""
    if (which == "third" and not with_third(facts)) or (which == TRUTH and not with_truth(facts)):
        return OMITTED
    levels = facts_as(RestorationFacts, facts).levels
    first, level = levels["first"], levels[which]
    return "" if first is None or level is None else f"light {100 * (level / first - 1):+z.0f} %"


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

    def check(results: Sequence[Outcomes], facts: Facts) -> Advice:
        known = facts_as(RestorationFacts, facts)
        taken = known.photographs if which == TRUTH else ORDER.index(which)
        goal = progress(taken + bool(results), known, lambda one: path(one, facts) if shaken(facts) else None)
        return Advice(bool(results), f"The {which} photograph is taken.", goal=goal)

    return check


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
    pictures = [stacked(plane) for plane in planes]
    if not is_mosaic(planes[0]):
        pictures = [picture * (pictures[0].mean() / picture.mean()) for picture in pictures]
    try:
        parameters = parameters_of(answers)
        report, rounds = getattr(frames, "progress", lambda done, total: None), parameters.scheme.rounds + 1
        spec = blur_spec(blurred, answers, read)
        blur = blur_of(spec, pictures, lambda one: isinstance(one, SearchRound) and report(one.n, one.most))
        outcome = blur.restored(pictures, parameters, lambda done: report(min(done.n, rounds), rounds))
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
        return outcome if outcome.value is None else mark_doubtful(outcome, error.reason, error.remedy)


# --- questions of the plan of a restoration, each with the condition under which it is asked ---


def shaken(facts: Facts) -> bool:
    """Whether a shaker blurs the photographs: the bench has one, and apertures were not chosen."""
    return bool(facts.get(HAS_SHAKER)) and facts.get("blur_by", MOTIONS) != APERTURES


def done_by_shaker(facts: Facts) -> Fact | None:
    """Manual actions that a shaker replaces."""
    return True if shaken(facts) else None


def where(condition: Callable[[RestorationFacts], bool]) -> Callable[[Facts], bool]:
    """A condition on the plan's facts."""
    return lambda facts: condition(facts_as(RestorationFacts, facts))


by_apertures = where(lambda known: known.blur_by == APERTURES)
by_motions = where(lambda known: known.blur_by != APERTURES)
by_motions_alone = where(lambda known: known.blur_by == MOTIONS)
by_both = where(lambda known: known.blur_by == BOTH)
motions_measured = where(lambda known: known.blur_by == MOTIONS and known.motion_shape != SEARCH)
with_third = where(lambda known: known.photographs > 2)
third_by_apertures = where(lambda known: known.photographs > 2 and known.blur_by == APERTURES)
third_by_motions = where(lambda known: known.photographs > 2 and known.blur_by != APERTURES)
with_truth = where(lambda known: known.ground_truth == YES)
truth_by_apertures = where(lambda known: known.ground_truth == YES and known.blur_by == APERTURES)
truth_at_rest = where(lambda known: known.ground_truth == YES and known.blur_by == MOTIONS)
truth_of_both = where(lambda known: known.ground_truth == YES and known.blur_by == BOTH)


def only_flat(facts: Facts) -> bool:
    """Whether the scene must be flat: a flat part does not determine three motions that nothing records."""
    recorded = motions_measured(facts) or shaken(facts) or facts.get(HAS_IMU)
    return third_by_motions(facts) and by_motions_alone(facts) and not recorded


def check_photographs(answer: Fact, facts: Facts) -> None:
    """Refuse other numbers than 2 and 3. Raises BadParameter."""
    if answer not in (2, 3):
        raise BadParameter(f"two or three photographs are restored together; got {answer}", "answer 2 or 3")


def names_file(part: str) -> bool:
    """Whether a part of a checked answer is the name of a file."""
    return part != SEARCH and named(part) is None


def check_shape(read: ReadShape, answer: Fact, facts: Facts) -> None:
    """Refuse unreadable shapes, and numbers of shapes other than one or one for each photograph."""
    names = shape_names(str(answer))
    each = int(facts_as(RestorationFacts, facts).photographs)
    if len(names) not in (1, each):
        raise BadParameter(f"one shape, or one for each of {each} photographs; got {len(names)}", "separate them by ;")
    for name in names:
        if named(name) is None:
            read(name, None, None)


def check_motion(read: ReadShape, answer: Fact, facts: Facts) -> None:
    """Refuse unreadable shapes, shapes of apertures, and numbers of shapes other than one for each photograph."""
    names = shape_names(str(answer))
    if names == (SEARCH,):
        return
    each = int(facts_as(RestorationFacts, facts).photographs)
    if len(names) != each:
        raise BadParameter(f"{each} motions need {each} kernels; got {len(names)}", "separate the files by ;")
    for name in names:
        if named(name) is not None:
            raise BadParameter(f"{name} is the shape of an aperture", f"name files of kernels, or {SEARCH}")
        read(name, None, None)


def scene(read: ReadShape) -> tuple[Ask | SetLight, ...]:
    """Questions before the first photograph; `read` reads shapes."""
    return (
        Ask("blur_by", "What will blur the photographs?", "choice", default=APERTURES,
            choices=(APERTURES, MOTIONS, BOTH), when=lambda facts: not facts.get(HAS_SHAKER)),
        Ask("blur_by", "What will blur the photographs? The shaker makes the motions.", "choice", default=MOTIONS,
            choices=(MOTIONS, BOTH, APERTURES), when=lambda facts: bool(facts.get(HAS_SHAKER))),
        Ask("photographs", "How many photographs will be blurred? A third makes the picture better.", "number",
            default=2.0, low=2.0, high=3.0, check=check_photographs),
        Ask("colour", "What is restored: one plane, or the mosaic in colour, which takes longer?", "choice",
            default=PLANE, choices=(PLANE, COLOUR)),
        Ask("ground_truth", "Take a ground truth too, one more photograph without blur?", "choice", default=NO,
            choices=(NO, YES)),
        Ask("motion_shape", "Where do the motions come from? search: records or photographs; or FILE; FILE: a measured "
            "kernel of each.", "text", default=SEARCH, when=lambda facts: by_motions_alone(facts) and not shaken(facts),
            check=partial(check_motion, read), names_file=names_file),
        Ask("scene", "Set up a static scene, detailed everywhere. Fix the camera to its rig, the IMU y up.",
            when=lambda facts: by_motions(facts) and not only_flat(facts)),
        Ask("scene", "Set up a flat scene, detailed everywhere, at one distance: three motions by hand without an IMU "
            "cannot be estimated otherwise. Fix the camera to its rig.", when=only_flat),
        Ask("scene", "Set up a static scene, detailed everywhere, and fix the camera.", when=by_apertures),
        SetLight(lambda facts: 1.0),
        Ask("focused", "Focus nearer than anything in the scene, then switch autofocus off.",
            when=by_apertures),
        Ask("focused", "Focus on the scene's middle, then switch autofocus off.", when=by_motions),
        Ask("max_w", "How far does the widest blur reach?", "number", "pixels", DEFAULT_MAX_W, low=1.0, high=40.0),
        Ask("first_f_number", "What is the f-number of the first photograph?", "number", "", 8.0, low=0.5, high=64.0,
            when=by_apertures),
        Ask("lens_f_number", "What is the f-number of all of them?", "number", "", 8.0, low=0.5, high=64.0,
            when=by_both),
        Ask("focus_m", "How far from the lens is its plane of focus? 0: as the camera records it.", "number", "m", 0.0,
            low=0.0, when=by_both),
        Ask("second_f_number", "And the second one?", "number", "", 4.0, low=0.5, high=64.0, when=by_apertures),
        Ask("third_f_number", "And the third one?", "number", "", 5.6, low=0.5, high=64.0, when=third_by_apertures),
        Ask("shape", "What is the shape of the aperture? pillbox, gaussian, polygon:BLADES, or FILE, measured; or one "
            "for each photograph, separated by ;.", "text", default="pillbox",
            when=lambda facts: by_apertures(facts) or by_both(facts),
            check=partial(check_shape, read), names_file=names_file),
        Ask("pixel_pitch_um", "What is the pixel pitch? 0: the rig does not rotate.", "number", "µm", 0.0, low=0.0,
            when=by_motions_alone),
        Ask("pixel_pitch_um", "What is the pixel pitch?", "number", "µm", 4.0, low=0.1, when=by_both),
        Ask("pixel_pitch_um", "What is the pixel pitch? 0: not known.", "number", "µm",
            0.0, low=0.0, when=by_apertures),
        Ask("steady", "Is the motion uniform along one axis of the frame in both photographs?", "choice", default=NO,
            choices=(NO, "x", "y"), when=lambda facts: by_motions_alone(facts) and not shaken(facts)),
        Ask("region", "Where is a flat part at one distance? x,y,width,height, auto or whole.", "text", default="auto",
            when=lambda facts: by_motions_alone(facts) and not (shaken(facts) or motions_measured(facts)),
            given=lambda facts: "whole" if only_flat(facts) else None),
    )  # fmt: skip


FIRST = (
    Ask("first", "Set the first aperture.", when=by_apertures),
    Ask("first", "Let the rig rest: the light is checked first.", when=by_motions_alone, given=done_by_shaker),
    Ask("first", "Set the aperture, and let the rig rest: the light is checked first.", when=by_both),
)
MOVES = Ask("first_moves", "Set the rig in its first motion.", when=by_motions, given=done_by_shaker)
SECOND = (
    Ask("second", "Set the second aperture, and adapt the exposure time; touch nothing else.", when=by_apertures),
    Ask("second", "Set the rig in its second motion.", when=by_motions, given=done_by_shaker),
)
THIRD = (
    Ask("third", "Set the third aperture, and adapt the exposure time; touch nothing else.", when=third_by_apertures),
    Ask("third", "Set the rig in its third motion, across the other two.", when=third_by_motions, given=done_by_shaker),
)
GROUND_TRUTH = (
    Ask(
        "truth", "Set the smallest aperture, and extend the exposure time; touch nothing else.", when=truth_by_apertures
    ),
    Ask(
        "truth",
        "Let the rig rest, leave the scene unchanged; set the smallest aperture, and extend the exposure time.",
        when=truth_of_both,
    ),
    Ask("truth", "Let the rig rest, and leave the scene unchanged.", when=truth_at_rest, given=done_by_shaker),
)
