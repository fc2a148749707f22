"""What the plan of a restoration asks, each question only where it fits what blurs and what is known."""

from __future__ import annotations

from functools import partial

from procedures.facts import facts_as
from procedures.outcome import BadParameter
from procedures.plan import HAS_IMU, HAS_SHAKER, Ask, Fact, Facts, SetLight
from procedures.restoration.facts import APERTURES, BOTH, COLOUR, MOTIONS, NO, PLANE, SEARCH, YES, RestorationFacts
from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
from procedures.restoration.known_blur import ReadShape, names_in
from procedures.restoration.masks.blur_models import named


def shaken(facts: Facts) -> bool:
    """Whether a shaker blurs the photographs: the bench has one, and nobody said that it is to be the apertures."""
    return bool(facts.get(HAS_SHAKER)) and facts.get("blur_by", MOTIONS) != APERTURES


def done_by_shaker(facts: Facts) -> Fact | None:
    """What is asked of hands is done where there is a shaker."""
    return True if shaken(facts) else None


def by_apertures(facts: Facts) -> bool:
    """Whether apertures blur the photographs."""
    return facts_as(RestorationFacts, facts).blur_by == APERTURES


def by_motions(facts: Facts) -> bool:
    """Whether motions of the rig do, alone or beside the lens."""
    return not by_apertures(facts)


def by_both(facts: Facts) -> bool:
    """Whether the lens blurs beside motions that are recorded."""
    return facts_as(RestorationFacts, facts).blur_by == BOTH


def by_motions_alone(facts: Facts) -> bool:
    """Whether nothing but motions does."""
    return facts_as(RestorationFacts, facts).blur_by == MOTIONS


def with_third(facts: Facts) -> bool:
    """Whether there is to be a third photograph."""
    return facts_as(RestorationFacts, facts).photographs > 2


def motions_unrecorded(facts: Facts) -> bool:
    """Whether nothing tells the motions but the photographs themselves: no kernels, no shaker, no IMU."""
    return by_motions_alone(facts) and not (told_motions(facts) or shaken(facts) or facts.get(HAS_IMU))


def only_flat(facts: Facts) -> bool:
    """Whether the scene has to be of one distance: of three photographs no flat part tells the motions."""
    return with_third(facts) and motions_unrecorded(facts)


def third_by_apertures(facts: Facts) -> bool:
    """Whether a third aperture blurs."""
    return with_third(facts) and by_apertures(facts)


def third_by_motions(facts: Facts) -> bool:
    """Whether a third motion does."""
    return with_third(facts) and by_motions(facts)


def with_truth(facts: Facts) -> bool:
    """Whether there is to be a ground truth."""
    return facts_as(RestorationFacts, facts).ground_truth == YES


def truth_by_apertures(facts: Facts) -> bool:
    """Whether it is stopped down for one."""
    return with_truth(facts) and by_apertures(facts)


def truth_at_rest(facts: Facts) -> bool:
    """Whether the rig rests for one."""
    return with_truth(facts) and by_motions_alone(facts)


def truth_of_both(facts: Facts) -> bool:
    """Whether the rig rests and the lens is stopped down for one."""
    return with_truth(facts) and by_both(facts)


def check_photographs(answer: Fact, facts: Facts) -> None:
    """Refuse parts of a photograph. Raises BadParameter."""
    if answer not in (2, 3):
        raise BadParameter(f"two or three photographs are restored together; got {answer}", "answer 2 or 3")


def told_motions(facts: Facts) -> bool:
    """Whether measured kernels tell the motions."""
    return by_motions_alone(facts) and facts_as(RestorationFacts, facts).motion_shape != SEARCH


def names_file(part: str) -> bool:
    """Whether a part of an answer that was checked is the name of a file."""
    return part != SEARCH and named(part) is None


def check_shape(read: ReadShape, answer: Fact, facts: Facts) -> None:
    """Refuse what cannot be read, and shapes that are not one for all photographs or one for each."""
    names = names_in(str(answer))
    each = int(facts_as(RestorationFacts, facts).photographs)
    if len(names) not in (1, each):
        raise BadParameter(f"one shape, or one for each of {each} photographs; got {len(names)}", "put ; between them")
    for name in names:
        if named(name) is None:
            read(name, None, None)


def check_motion(read: ReadShape, answer: Fact, facts: Facts) -> None:
    """Refuse what cannot be read, shapes of apertures, and shapes that are not one for each photograph."""
    names = names_in(str(answer))
    if names == (SEARCH,):
        return
    each = int(facts_as(RestorationFacts, facts).photographs)
    if len(names) != each:
        raise BadParameter(f"{each} motions need {each} kernels; got {len(names)}", "put ; between the files")
    for name in names:
        if named(name) is not None:
            raise BadParameter(f"{name} is the shape of an aperture", f"name files of kernels, or {SEARCH}")
        read(name, None, None)


def scene(read: ReadShape) -> tuple[Ask | SetLight, ...]:
    """What is asked before the first photograph; `read` reads shapes."""
    return (
        Ask("blur_by", "What will blur the photographs?", "choice", default=APERTURES,
            choices=(APERTURES, MOTIONS, BOTH), when=lambda facts: not facts.get(HAS_SHAKER)),
        Ask("blur_by", "What will blur the photographs? The shaker makes the motions.", "choice", default=MOTIONS,
            choices=(MOTIONS, BOTH, APERTURES), when=lambda facts: bool(facts.get(HAS_SHAKER))),
        Ask("photographs", "How many photographs will be blurred? A third makes the picture better.", "number",
            default=2.0, low=2.0, high=3.0, check=check_photographs),
        Ask("colour", "What is restored: one plane, or the mosaic in colour, which takes longer?", "choice",
            default=PLANE, choices=(PLANE, COLOUR)),
        Ask("ground_truth", "Take a ground truth too, one more photograph that nothing blurs?", "choice", default=NO,
            choices=(NO, YES)),
        Ask("motion_shape", "What tells the motions? search: records or photographs; or FILE; FILE: a measured kernel "
            "of each.", "text", default=SEARCH, when=lambda facts: by_motions_alone(facts) and not shaken(facts),
            check=partial(check_motion, read), names_file=names_file),
        Ask("scene", "Set up a scene that stands still, detailed everywhere. Fix the camera to its rig, the IMU y up.",
            when=lambda facts: by_motions(facts) and not only_flat(facts)),
        Ask("scene", "Set up a flat scene, detailed everywhere, all of it at one distance: nothing else tells three "
            "motions by hand without an IMU. Fix the camera to its rig.", when=only_flat),
        Ask("scene", "Set up a scene that stands still, detailed everywhere, and fix the camera.", when=by_apertures),
        SetLight(lambda facts: 1.0),
        Ask("focused", "Focus nearer than anything in the scene, then switch autofocus off.",
            when=by_apertures),
        Ask("focused", "Focus on the scene's middle, then switch autofocus off.", when=by_motions),
        Ask("max_w", "How far does the widest blur reach?", "number", "pixels", DEFAULT_MAX_W, low=1.0, high=40.0),
        Ask("first_f_number", "Which f-number has the first photograph?", "number", "", 8.0, low=0.5, high=64.0,
            when=by_apertures),
        Ask("lens_f_number", "Which f-number has the lens in all of them?", "number", "", 8.0, low=0.5, high=64.0,
            when=by_both),
        Ask("focus_m", "How far from the lens is its plane of focus? 0: as the camera notes it.", "number", "m", 0.0,
            low=0.0, when=by_both),
        Ask("second_f_number", "And the second one?", "number", "", 4.0, low=0.5, high=64.0, when=by_apertures),
        Ask("third_f_number", "And the third one?", "number", "", 5.6, low=0.5, high=64.0, when=third_by_apertures),
        Ask("shape", "Which shape has the aperture? pillbox, gaussian, polygon:BLADES, or FILE, measured; or one for "
            "each photograph, with ; between.", "text", default="pillbox",
            when=lambda facts: by_apertures(facts) or by_both(facts),
            check=partial(check_shape, read), names_file=names_file),
        Ask("pixel_pitch_um", "How far apart are the pixels? 0: the rig does not turn.", "number", "µm", 0.0, low=0.0,
            when=by_motions_alone),
        Ask("pixel_pitch_um", "How far apart are the pixels?", "number", "µm", 4.0, low=0.1, when=by_both),
        Ask("pixel_pitch_um", "How far apart are the pixels? 0: not known.", "number", "µm",
            0.0, low=0.0, when=by_apertures),
        Ask("steady", "Does the rig go steadily along one axis of the frame in both photographs?", "choice", default=NO,
            choices=(NO, "x", "y"), when=lambda facts: by_motions_alone(facts) and not shaken(facts)),
        Ask("region", "Where is a flat part of one distance? x,y,width,height, auto or whole.", "text", default="auto",
            when=lambda facts: by_motions_alone(facts) and not (shaken(facts) or told_motions(facts)),
            given=lambda facts: "whole" if only_flat(facts) else None),
    )  # fmt: skip


FIRST = (
    Ask("first", "Set the first aperture.", when=by_apertures),
    Ask("first", "Let the rig stand still: the light is looked at first.", when=by_motions_alone, given=done_by_shaker),
    Ask("first", "Set the aperture, and let the rig stand still: the light is looked at first.", when=by_both),
)
MOVES = Ask("first_moves", "Set the rig in its first motion.", when=by_motions, given=done_by_shaker)
SECOND = (
    Ask("second", "Set the second aperture, and as much more or less time; touch nothing else.", when=by_apertures),
    Ask("second", "Set the rig in its second motion.", when=by_motions, given=done_by_shaker),
)
THIRD = (
    Ask("third", "Set the third aperture, and as much more or less time; touch nothing else.", when=third_by_apertures),
    Ask("third", "Set the rig in its third motion, across both others.", when=third_by_motions, given=done_by_shaker),
)
GROUND_TRUTH = (
    Ask("truth", "Set the smallest aperture, and as much more time; touch nothing else.", when=truth_by_apertures),
    Ask(
        "truth",
        "Let the rig stand still and the scene as it was; set the smallest aperture, and as much more time.",
        when=truth_of_both,
    ),
    Ask("truth", "Let the rig stand still, and the scene as it was.", when=truth_at_rest, given=done_by_shaker),
)
