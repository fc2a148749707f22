"""The plan of a restoration: one scene photographed twice, by two apertures or during two motions of the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from procedures.advice import exposure_advice
from procedures.clipping import NOMINAL
from procedures.drawings import steps as drawings
from procedures.facts import facts_as
from procedures.outcome import BadInput, BadParameter, Outcome, Refused, Verdict
from procedures.plan import (
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
    Reading,
    SetLight,
    Shake,
    Shoot,
    Step,
)
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import disagreements
from procedures.restoration.facts import APERTURES, MOTIONS, RestorationFacts
from procedures.restoration.flat_part import DETAIL_PX
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.kernel_sizes import DEFAULT_MAX_W
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.photograph_blur import blur_of
from procedures.restoration.two_photographs import aperture, blur_spec, shown

Array = npt.NDArray[np.float64]

PICTURE = "picture"
"""The one outcome's name."""
LEAST_RATIO = 1.15
"""Of the two f-numbers: nearer ones blur too much alike."""
SAME_LIGHT = 0.1
OTHER_LIGHT = 1.12
"""Factor between two ways to tell the f-numbers' ratio, from which one is wrong: rings and shutters make 6 %."""
LEAST_ROUND_S = 0.05
"""A shaker goes around once in an exposure, but not faster than this: voice coils follow 20 Hz."""
POINTS = 48
"""Of a path: a millisecond apart in its fastest round, under a second in an exposure of 48 s."""
SHARE = 0.95
"""Of its stroke that a shaker goes."""
TEXTURE = 5.0
"""Contrast of the scene's detail over the noise, at least."""


def plan() -> Plan:
    """The guided restoration of picture and depth."""
    return Plan(
        "restoration",
        "Sharp picture and depth from two photographs",
        (
            Step("scene", "Scene", "Set up the scene, the rig and the light.", SCENE, drawings.SCENE, gave_blur),
            Step("first", "First", "Take the first photograph.", shots("first", FIRST), drawings.FIRST, gave_first),
            Step(
                "second", "Second", "Take the second: another aperture or motion.", shots("second", SECOND),
                drawings.SECOND, gave_second,
            ),
            Step("estimate", "Restore", "Restore picture and depth from both.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take both again.", (Decide("first"),)),
        ),
        subject="depth",
        facts=RestorationFacts,
    )  # fmt: skip


def shaken(facts: Facts) -> bool:
    """Whether a shaker blurs the photographs: the bench has one, and nobody said that it is to be the apertures."""
    return bool(facts.get(HAS_SHAKER)) and facts.get("blur_by", MOTIONS) == MOTIONS


def done_by_shaker(facts: Facts) -> Fact | None:
    """What is asked of hands is done where there is a shaker."""
    return True if shaken(facts) else None


def by_apertures(facts: Facts) -> bool:
    """Whether two apertures blur the photographs."""
    return facts_as(RestorationFacts, facts).blur_by == APERTURES


def by_motions(facts: Facts) -> bool:
    """Whether two motions of the rig do."""
    return not by_apertures(facts)


def gave_blur(facts: Facts) -> str:
    """What blurs."""
    return facts_as(RestorationFacts, facts).blur_by


def gave_first(facts: Facts) -> str:
    """How bright the first photograph is."""
    level = facts_as(RestorationFacts, facts).first_level
    return "" if level is None else f"mean {100 * level:.0f} %"


def gave_second(facts: Facts) -> str:
    """How much brighter the second is."""
    known = facts_as(RestorationFacts, facts)
    if known.first_level is None or known.second_level is None:
        return ""
    return f"light {100 * (known.second_level / known.first_level - 1):+.0f} %"


SCENE = (
    Ask(
        "blur_by", "What will blur the two photographs?", "choice", default=APERTURES, choices=(APERTURES, MOTIONS),
        given=lambda facts: MOTIONS if shaken(facts) else None,
    ),
    Ask("scene", "Set up a scene that stands still, detailed everywhere. Fix the camera to its rig, the IMU y up.",
        when=by_motions),
    Ask("scene", "Set up a scene that stands still, detailed everywhere, and fix the camera.", when=by_apertures),
    SetLight(lambda facts: 1.0),
    Ask("focused", "Focus nearer than anything in the scene, then switch autofocus off."),
    Ask("max_w", "How far does the widest blur reach?", "number", "pixels", DEFAULT_MAX_W, low=1.0, high=40.0),
    Ask("first_f_number", "Which f-number has the first photograph?", "number", "", 8.0, low=0.5, high=64.0,
        when=by_apertures),
    Ask("second_f_number", "And the second one?", "number", "", 4.0, low=0.5, high=64.0, when=by_apertures),
    Ask("shape", "Which shape has the aperture? pillbox, gaussian, polygon:BLADES", "text", default="pillbox",
        when=by_apertures),
    Ask("pixel_pitch_um", "How far apart are the pixels? 0: the rig does not turn.", "number", "µm", 0.0, low=0.0,
        when=by_motions),
    Ask("pixel_pitch_um", "How far apart are the pixels? 0: not known.", "number", "µm",
        0.0, low=0.0, when=by_apertures),
    Ask("region", "Where is a flat part of one distance? x,y,width,height, auto or whole.", "text", default="auto",
        when=lambda facts: by_motions(facts) and not shaken(facts)),
)  # fmt: skip
FIRST = (
    Ask("first", "Set the first aperture.", when=by_apertures),
    Ask("first", "Let the rig stand still: the light is looked at first.", when=by_motions, given=done_by_shaker),
)
MOVES = Ask("first_moves", "Set the rig in its first motion.", when=by_motions, given=done_by_shaker)
SECOND = (
    Ask("second", "Set the second aperture, and as much more or less time; touch nothing else.", when=by_apertures),
    Ask("second", "Set the rig in its second motion.", when=by_motions, given=done_by_shaker),
)

# --- checks ------------------------------------------------------------------------------------------------------


def check_first(frame: RawFrame, facts: Facts) -> Advice:
    """Well exposed, with detail that blur can be told from."""
    plane, known = shown(frame), facts_as(RestorationFacts, facts)
    wrong = shape_unknown(known) or typed_otherwise("first", frame, known)
    if wrong is not None:
        return wrong
    level, clipped = float(np.percentile(plane.samples, 99.5)), float(np.mean(plane.samples >= NOMINAL))
    advice = exposure_advice(level, clipped, frame.exposure, "The brightest")
    told = Reading("detail", detail(plane), "× noise", TEXTURE, None)
    readings = (*advice.readings, told)
    if advice.good and not told.good:
        say = f"The scene's detail is only {told.value:.1f} times the noise: add things with texture, or more light."
        return Advice(False, say, readings, by_hand={"texture": 1.0})
    return replace(advice, readings=readings, facts={**advice.facts, **noted("first", frame)})


def check_second(frame: RawFrame, facts: Facts) -> Advice:
    """As bright as the first; another aperture, where that is what blurs."""
    level = float(np.mean(shown(frame).samples))
    wrong = typed_otherwise("second", frame, facts_as(RestorationFacts, facts))
    if wrong is not None:
        return wrong
    known = facts_as(RestorationFacts, {**facts, **noted("second", frame)})
    wrong = apertures_by_light(known)
    if wrong is not None:
        return wrong
    change = 0.0 if known.first_level is None else level / known.first_level - 1
    light = Reading("light", 100 * change, "%", -100 * SAME_LIGHT, 100 * SAME_LIGHT)
    ratio = aperture_ratio(known)
    readings = (light, *((Reading("apertures", ratio, "", LEAST_RATIO, None),) if ratio else ()))
    if known.blur_by == APERTURES and ratio and ratio < LEAST_RATIO:
        say = f"The apertures differ by a factor of {ratio:.2f}: make it {LEAST_RATIO:g} or more."
        return Advice(False, say, readings, by_hand={"aperture": LEAST_RATIO / ratio})
    if not light.good:
        word = "brighter" if change > 0 else "darker"
        say = f"It is {abs(change):.0%} {word} than the first: correct the exposure time by as much."
        return Advice(False, say, readings, by_hand={"exposure_ev": -float(np.log2(1 + change))})
    return Advice(True, "It is as bright as the first.", readings, facts=noted("second", frame))


def shape_unknown(known: RestorationFacts) -> Advice | None:
    """That no aperture has the shape that was typed; None where one has."""
    try:
        aperture(known.shape)
    except BadParameter as error:
        return Advice(False, f"{error.reason}: {error.remedy}.", doubted=("shape",))
    return None


def typed_otherwise(which: str, frame: RawFrame, known: RestorationFacts) -> Advice | None:
    """What was typed of this photograph against what the camera noted; None where nothing contradicts."""
    f_number = known.first_f_number if which == "first" else known.second_f_number
    typed = {"f_number": f_number if known.blur_by == APERTURES else None, "pixel_pitch_um": known.pixel_pitch_um}
    asked = {"f_number": f"{which}_f_number"}
    for name, value in typed.items():
        key = asked.get(name, name)
        told = disagreements(frame.exposure, {name: value}) if key not in known.insisted else []
        if told:
            return Advice(False, f"Of the {which} photograph {told[0]}.", doubted=(key,))
    return None


def apertures_by_light(known: RestorationFacts) -> Advice | None:
    """The f-numbers' ratio against what the light says of it; None where they agree, or times are not known.

    The level goes with t / N^2, at one ISO: N1 / N2 = sqrt(t1 L2 / (t2 L1)).
    """
    apertures, keys = (known.first_f_number, known.second_f_number), ("first_f_number", "second_f_number")
    times, levels = (known.first_exposure_s, known.second_exposure_s), (known.first_level, known.second_level)
    if known.blur_by != APERTURES or None in (*apertures, *times, *levels) or known.insisted.issuperset(keys):
        return None
    (N1, N2), (t1, t2), (L1, L2) = ([float(one or 0.0) for one in pair] for pair in (apertures, times, levels))
    by_light = float(np.sqrt(t1 * L2 / (t2 * L1)))
    if 1 / OTHER_LIGHT < by_light / (N1 / N2) < OTHER_LIGHT:
        return None
    say = (
        f"By exposure times and light the first f-number is {by_light:.2f} times the second, by what was given "
        f"{N1 / N2:.2f} times: one of them is wrong, or the light has changed."
    )
    return Advice(False, say, doubted=keys)


CHECKS = {"first": check_first, "second": check_second}


def detail(plane: Plane) -> float:
    """Contrast of what varies within a few pixels, over the noise of neighbouring pixels."""
    samples = plane.samples
    rough = samples[:, 2:] - 2 * samples[:, 1:-1] + samples[:, :-2]
    noise = max(1.4826 * float(np.median(np.abs(rough))) / 6**0.5, plane.quantisation / 12**0.5)
    return float((samples - cv2.GaussianBlur(samples, (0, 0), DETAIL_PX)).std()) / noise


def noted(which: str, frame: RawFrame) -> dict[str, float]:
    """Level, exposure time and aperture of a photograph, as facts."""
    facts = {f"{which}_level": float(np.mean(shown(frame).samples))}
    if frame.exposure.exposure_s:
        facts[f"{which}_exposure_s"] = float(frame.exposure.exposure_s)
    if frame.exposure.f_number:
        facts[f"{which}_f_number"] = float(frame.exposure.f_number)
    return facts


def aperture_ratio(known: RestorationFacts) -> float:
    """The larger f-number over the smaller; 0 where one is not known."""
    if known.first_f_number is None or known.second_f_number is None:
        return 0.0
    ratio = known.first_f_number / known.second_f_number
    return max(ratio, 1 / ratio)


def shots(which: str, asks: tuple[Ask, ...]) -> tuple[Any, ...]:
    """One photograph that counts; the IMU is recorded meanwhile."""

    def estimate_one(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
        return {PICTURE: Outcome(float(np.mean(shown(frame).samples)))}

    def enough(results: Sequence[Outcomes], facts: Facts) -> Advice:
        return Advice(bool(results), f"The {which} photograph is taken.")

    # the light is judged while the rig is still
    look = (Look("light", check_first), MOVES) if which == "first" else ()
    shoot = Shoot(
        which, CHECKS[which], estimate_one, enough, most=8, record_motion=True, shake=lambda facts: path(which, facts)
    )
    return (*asks, *look, shoot)


def path(which: str, facts: Facts) -> Shake | None:
    """Around which a shaker carries the camera: two loops, the first mostly along x, the second along y.

    They cross as the kernels of a pair should: what one blurs away the other keeps.
    """
    known = facts_as(RestorationFacts, facts)
    if known.blur_by != MOTIONS:
        return None
    turn = 2 * np.pi * np.arange(POINTS) / POINTS
    lag = 0.6 if which == "first" else 1.1
    loop = SHARE * np.cos(turn), SHARE / 2 * np.cos(2 * turn + lag)
    x, y = loop if which == "first" else loop[::-1]
    round_s = max(known.first_exposure_s or 0.0, LEAST_ROUND_S)
    return Shake(round_s, {"x_mm": tuple(x.tolist()), "y_mm": tuple(y.tolist())})


# --- estimate ----------------------------------------------------------------------------------------------------


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The sharp picture and w of every pixel, from the first and the last photograph that count."""
    if len(frames) < 2:
        raise BadInput(f"restoration needs two photographs; {len(frames)} count", "take both again")
    first, last = frames[0], frames[len(frames) - 1]
    pictures = [shown(frame).samples.astype(np.float64)[None] for frame in (first, last)]
    pictures[1] *= pictures[0].mean() / pictures[1].mean()
    try:
        told = facts_as(RestorationFacts, facts)
        parameters = RestorationParameters(scheme=Scheme() if told.scheme is None else Scheme.parse(told.scheme))
        blur = blur_of(blur_spec(first, last, told), pictures)
        return {PICTURE: blur.restored(pictures, parameters)}
    except (Refused, BadInput, BadParameter) as error:
        return {PICTURE: Outcome(None, Verdict.REFUSED, error.reason, error.remedy)}
