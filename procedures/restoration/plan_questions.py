"""Questions of the plan of a restoration, each with the condition under which it is asked."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from procedures.facts import facts_as
from procedures.outcome import BadParameter
from procedures.plan import HAS_IMU, HAS_SHAKER, Ask, Fact, Facts, SetLight
from procedures.restoration.facts import APERTURES, BOTH, COLOUR, MOTIONS, NO, PLANE, SEARCH, YES, RestorationFacts
from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
from procedures.restoration.known_blur import ReadShape, shape_names
from procedures.restoration.masks.blur_models import named


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
