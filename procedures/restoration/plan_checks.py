"""Checks of each photograph in the plan of a restoration: light, detail, and the given apertures."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from procedures.advice import exposure_advice
from procedures.clipping import NOMINAL
from procedures.outcome import ProcedureError
from procedures.plan import Advice, Fact, Facts, Reading, facts_as
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import disagreements
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.facts import APERTURES, BOTH, COLOUR, MOTIONS, ORDER, SEARCH, TRUTH, RestorationFacts
from procedures.restoration.flat_part import DETAIL_PX
from procedures.restoration.known_blur import ReadShape, lens, named_shape, shapes_over
from procedures.restoration.progress import moved, view_of

LEAST_RATIO = 1.15
"""Smallest ratio of two f-numbers: closer ones blur too similarly."""
SAME_LIGHT = 0.1
OTHER_LIGHT = 1.12
"""Discrepancy between two estimates of the f-numbers' ratio above which one is wrong: rings and shutters make 6 %."""
MOVED = 0.03
"""Accepted shift of the view since the first photograph, over the frame's diagonal, beyond that by the blur."""
TEXTURE = 5.0
"""Smallest contrast of the scene's detail over the noise."""


def check_first(frame: RawFrame, facts: Facts, read: ReadShape = named_shape) -> Advice:
    """Require a good exposure, and enough detail to estimate blur."""
    plane, known = frame.guide, facts_as(RestorationFacts, facts)
    wrong = no_colour(frame, known) or shape_unknown(frame, known, read) or contradicts_camera("first", frame, known)
    wrong = wrong or lens_unknown(frame, known)
    if wrong is not None:
        return wrong
    level, clipped = float(np.percentile(plane.samples, 99.5)), float(np.mean(plane.samples >= NOMINAL))
    advice = exposure_advice(level, clipped, frame.exposure, "The brightest")
    contrast = Reading("detail", detail(plane), "× noise", TEXTURE, None)
    readings = (*advice.readings, contrast)
    if advice.good and not contrast.good:
        say = f"The scene's detail is only {contrast.value:.1f} times the noise: add texture, or more light."
        return Advice(False, say, readings, by_hand={"texture": 1.0})
    view: dict[str, Fact] = {"first_noise": noise_of(plane), "first_contrast": float(plane.samples.std())}
    view["first_view"] = view_of(plane)
    return replace(advice, readings=readings, facts={**advice.facts, **noted("first", frame), **view})


def check_later(which: str, frame: RawFrame, facts: Facts) -> Advice:
    """Require the brightness of the first, and another aperture than those before, where apertures blur."""
    wrong = contradicts_camera(which, frame, facts_as(RestorationFacts, facts))
    if wrong is not None:
        return wrong
    known = facts_as(RestorationFacts, {**facts, **noted(which, frame)})
    wrong = apertures_by_light(which, known)
    if wrong is not None:
        return wrong
    ratio = aperture_ratio(known, which) if known.blur_by == APERTURES else 0.0
    say = f"The apertures differ by a factor of {ratio:.2f}: make it {LEAST_RATIO:g} or more."
    return compared_to_first(frame, known, Reading("apertures", ratio, "", LEAST_RATIO, None), say, noted(which, frame))


def check_truth(frame: RawFrame, facts: Facts) -> Advice:
    """Require the brightness of the first, and the smallest aperture of all, where apertures blur."""
    noticed = {**noted(TRUTH, frame), "truth_sha256": frame.sha256}
    # a known f-number is that of an earlier ground truth
    others = {key: fact for key, fact in facts.items() if key != "truth_f_number"}
    known = facts_as(RestorationFacts, {**others, **noticed})
    f_number = f_number_of_truth(known)
    f_numbers = [N for which in known.blurred if (N := known.f_numbers[which]) is not None]
    largest = max(f_numbers, default=0.0)
    ratio = f_number / largest if f_number and largest and known.blur_by != MOTIONS else 0.0
    say = (
        f"The ground truth is taken at about f/{f_number:.3g}, the others at f/{largest:g} and wider: stop down as far "
        "as the lens goes, and expose as much longer."
    )
    return compared_to_first(frame, known, Reading("aperture", ratio, "", LEAST_RATIO, None), say, noticed)


def compared_to_first(
    frame: RawFrame, known: RestorationFacts, apertures: Reading, say: str, noticed: dict[str, Fact]
) -> Advice:
    """Require another aperture, `say` otherwise, where its ratio is not 0, then the first's brightness and place."""
    light = light_against_first(frame, known)
    readings = (light, apertures) if apertures.value else (light,)
    if apertures.value and not apertures.good:
        return Advice(False, say, readings, by_hand={"aperture": LEAST_RATIO / apertures.value})
    if not light.good:
        return unevenly_lit(light, readings)
    return moved_away(frame, known) or Advice(True, "It is as bright as the first.", readings, facts=noticed)


def moved_away(frame: RawFrame, known: RestorationFacts) -> Advice | None:
    """Advice where the camera stands elsewhere than for the first photograph; else None."""
    plane = frame.guide
    outline, size = moved(plane, known.first_view), math.hypot(*plane.samples.shape)
    if outline is None or outline.off_px < MOVED * size + 2 * (known.max_w or 0.0):
        return None
    say = f"The camera has moved by {outline.off_px / size:.0%} of the frame since the first photograph: move it back."
    return Advice(False, say, by_hand={"camera": outline.off_px}, outline=outline)


def f_number_of_truth(known: RestorationFacts) -> float:
    """Exposures recorded by the camera, else from time and light relative to the first; 0 where neither is known."""
    if known.truth_f_number:
        return known.truth_f_number
    N, t1, t2 = known.first_f_number, known.first_exposure_s, known.truth_exposure_s
    L1, L2 = known.first_level, known.truth_level
    return float(N * np.sqrt(t2 * L1 / (t1 * L2))) if N and t1 and t2 and L1 and L2 else 0.0


def light_against_first(frame: RawFrame, known: RestorationFacts) -> Reading:
    """Brightness of a photograph relative to the first, in per cent."""
    level = float(np.mean(frame.guide.samples))
    change = 0.0 if known.first_level is None else level / known.first_level - 1
    return Reading("light", 100 * change, "%", -100 * SAME_LIGHT, 100 * SAME_LIGHT)


def unevenly_lit(light: Reading, readings: tuple[Reading, ...]) -> Advice:
    """Advice on the exposure time."""
    change = light.value / 100
    word = "brighter" if change > 0 else "darker"
    say = f"It is {abs(change):.0%} {word} than the first: correct the exposure time accordingly."
    return Advice(False, say, readings, by_hand={"exposure_ev": -float(np.log2(1 + change))})


def no_colour(frame: RawFrame, known: RestorationFacts) -> Advice | None:
    """Advice where colour is requested without a mosaic; else None."""
    if known.colour != COLOUR or "colour" in known.insisted or is_mosaic(frame.planes):
        return None
    say = f"Colour needs a camera with a mosaic; this photograph has only {', '.join(frame.planes)}: restore one plane."
    return Advice(False, say, contradictory=("colour",))


def shape_unknown(frame: RawFrame, known: RestorationFacts, read: ReadShape) -> Advice | None:
    """Advice where the given shape does not fit this photograph; else None."""
    key, answer = ("motion_shape", known.motion_shape) if known.blur_by == MOTIONS else ("shape", known.shape)
    try:
        if answer != SEARCH:
            shapes_over(frame, answer, known, read)
    except ProcedureError as error:
        return Advice(False, f"{error.reason}: {error.remedy}.", contradictory=(key,))
    return None


def lens_unknown(frame: RawFrame, known: RestorationFacts) -> Advice | None:
    """Advice where the lens's blur is required in addition to motion and not known; else None."""
    if known.blur_by != BOTH or lens(frame, known.lens_f_number, known) is not None:
        return None
    say = (
        "The lens's blur depends on its focal length, which the camera must record, and on its f-number, its distance "
        "of focus beyond that and the pixel pitch."
    )
    return Advice(False, say, contradictory=("lens_f_number", "focus_m", "pixel_pitch_um"))


def contradicts_camera(which: str, frame: RawFrame, known: RestorationFacts) -> Advice | None:
    """Advice where typed values contradict the camera's record of this photograph; else None."""
    f_numbers = {APERTURES: known.f_numbers[which], BOTH: known.lens_f_number}
    typed = {"f_number": f_numbers.get(known.blur_by), "pixel_pitch_um": known.pixel_pitch_um}
    keys = {"f_number": "lens_f_number" if known.blur_by == BOTH else f"{which}_f_number"}
    for name, value in typed.items():
        key = keys.get(name, name)
        contradictions = disagreements(frame.exposure, {name: value}) if key not in known.insisted else []
        if contradictions:
            return Advice(False, f"In the {which} photograph {contradictions[0]}.", contradictory=(key,))
    return None


def apertures_by_light(which: str, known: RestorationFacts) -> Advice | None:
    """Advice where the f-numbers' ratio contradicts the light; None where they agree, or times are not known.

    The level is proportional to t / N^2 at one ISO: N1 / N2 = sqrt(t1 L2 / (t2 L1)).
    """
    pair, keys = ("first", which), ("first_f_number", f"{which}_f_number")
    each = [[values[name] for name in pair] for values in (known.f_numbers, known.exposures_s, known.levels)]
    if known.blur_by != APERTURES or any(None in values for values in each) or known.insisted.issuperset(keys):
        return None
    (N1, N2), (t1, t2), (L1, L2) = ([float(one or 0.0) for one in pair] for pair in each)
    by_light = float(np.sqrt(t1 * L2 / (t2 * L1)))
    if 1 / OTHER_LIGHT < by_light / (N1 / N2) < OTHER_LIGHT:
        return None
    say = (
        f"By exposure times and light the first f-number is {by_light:.2f} times the {which}, by the given values "
        f"{N1 / N2:.2f} times: one of them is wrong, or the light has changed."
    )
    return Advice(False, say, contradictory=keys)


def detail(plane: Plane) -> float:
    """Contrast of variations within a few pixels, over the noise of neighbouring pixels."""
    return float((plane.samples - cv2.GaussianBlur(plane.samples, (0, 0), DETAIL_PX)).std()) / noise_of(plane)


def noise_of(plane: Plane) -> float:
    """Standard deviation of the noise, by second differences of neighbours."""
    samples = plane.samples
    rough = samples[:, 2:] - 2 * samples[:, 1:-1] + samples[:, :-2]
    return max(1.4826 * float(np.median(np.abs(rough))) / 6**0.5, plane.quantisation / 12**0.5)


def noted(which: str, frame: RawFrame) -> dict[str, Fact]:
    """Level, exposure time and aperture of a photograph, as facts."""
    facts: dict[str, Fact] = {f"{which}_level": float(np.mean(frame.guide.samples))}
    if frame.exposure.exposure_s:
        facts[f"{which}_exposure_s"] = float(frame.exposure.exposure_s)
    if frame.exposure.f_number:
        facts[f"{which}_f_number"] = float(frame.exposure.f_number)
    return facts


def aperture_ratio(known: RestorationFacts, which: str = "second") -> float:
    """The larger f-number over the smaller, of a photograph and the closest before it; 0 where one is not known."""
    N, before = known.f_numbers[which], [known.f_numbers[name] for name in ORDER[: ORDER.index(which)]]
    others = [other for other in before if other is not None]
    if N is None or len(others) < len(before):
        return 0.0
    return min(max(other / N, N / other) for other in others)


Check = Callable[[RawFrame, Facts], Advice]


def checks(read: ReadShape = named_shape) -> dict[str, Check]:
    """The checks of each photograph, by its purpose."""
    later = {which: partial(check_later, which) for which in ORDER[1:]}
    return {ORDER[0]: partial(check_first, read=read), **later, TRUTH: check_truth}
