"""Plan of the two-photograph PSF: wall, two distances, focus at either, equal light."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from procedures.advice import changed_settings, exposure_advice
from procedures.clipping import NOMINAL
from procedures.drawings import steps as drawings
from procedures.numerics.arrays import Array32
from procedures.outcome import BadInput, Outcome, Refused, Verdict
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Diagram,
    Estimate,
    Fact,
    Facts,
    Go,
    Goal,
    Home,
    Known,
    Look,
    Outcomes,
    Outline,
    Plan,
    Reading,
    Scan,
    SetLight,
    Shoot,
    Show,
    Step,
    Tour,
    TourStop,
    facts_as,
    required,
    ring_places,
    say_ring,
)
from procedures.raw import Plane, RawFrame
from procedures.two_photo.distances import (
    beyond_rail,
    check_ratio,
    check_reach,
    most_ratio,
    near_by_laser,
    near_by_photographs,
    proposed_ratio,
    reached_ratio,
    times_as_far,
    way_by_laser,
    way_mm,
)
from procedures.two_photo.estimate import TwoPhotoParameters
from procedures.two_photo.facts import LEAST_RATIO, MOST_RATIO, RATIO, TwoPhotoFacts
from procedures.two_photo.near_noise import noise_at_most
from procedures.two_photo.prediction import DISTANCES, noise_of_two, predicted_uncertainty, together
from procedures.two_photo.several import estimate_psf_of_wall
from procedures.two_photo.sharpness import fineness
from procedures.two_photo.trust import check_settings

TEXTURE = 5.0  # minimum contrast of the wall's detail, relative to the noise
DETAIL_PX = 8.0  # slower variation than this is light, not detail
SAME_LIGHT = 0.25  # accepted relative change of the wall's level between the distances
FRAMES = 2  # photographs at either distance, which are averaged


def plan() -> Plan:
    """The guided calibration with a textured wall."""
    return Plan(
        "two-photo",
        "PSF from two photographs of a wall",
        (
            Step(
                "wall", "Wall", "Find a flat wall with detail of all sizes, and plan two distances.", WALL,
                drawings.WALL, wall_summary,
            ),
            Step(
                "near", "Near", "Photograph the wall from nearby.", (*focus("near"), shoot("near")), drawings.NEAR,
                "mean {near_level:.0%}",
            ),
            Step(
                "far", "Far", "Move back, focus again, change nothing else.",
                (Go(to_ratio, say_far), *focus("far"), shoot("far")), drawings.FAR, "light {far_light_percent:+z.0f} %",
            ),
            Step(
                "farther", "Farther", "Lower the uncertainty by photographs from further distances, if needed.",
                (Show(predicted), FARTHER, Tour(farther_stops)), drawings.FAR, "{farther:.0f} further",
            ),
            Step("estimate", "Estimate", "Estimate every plane's PSF from all photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the photographs again.", (Decide("near"),)),
        ),
        subject="wall",
        facts=TwoPhotoFacts,
    )  # fmt: skip


def wall_summary(facts: Facts) -> str:
    """The two distances."""
    known = facts_as(TwoPhotoFacts, facts)
    return "" if known.near_mm is None else f"{known.near_mm / 1000:.2f} m x {known.ratio:g}"


# --- wall and distances ---


def on_rail(facts: Facts) -> bool:
    """Whether a rail carries the camera."""
    return "z_mm" in facts_as(TwoPhotoFacts, facts).where()


def to_near(facts: Facts) -> dict[str, float]:
    """Near end of the rail, with the head along the rail."""
    axes = facts_as(TwoPhotoFacts, facts).axes
    straight = {name: 0.0 for name in ("pan_deg", "tilt_deg") if name in axes and axes[name].at is not None}
    low = axes["z_mm"].low if "z_mm" in axes else None
    return straight if low is None else {"z_mm": low, **straight}


def to_ratio(facts: Facts) -> dict[str, float]:
    """Position along the rail at `ratio` times the near distance, counted from the near place."""
    known = facts_as(TwoPhotoFacts, facts)
    near_mm = known.where().get("z_mm") if known.near_z_mm is None else known.near_z_mm
    return {} if near_mm is None else {"z_mm": near_mm + (known.ratio - 1) * wall_mm(known)}


def wall_mm(known: TwoPhotoFacts) -> float:
    """Near distance of the wall. Raises BadParameter."""
    return required(known.near_mm, "how far the wall is", "answer the step `wall`")


def say_far(facts: Facts) -> str:
    """Instruction to go to the far place."""
    known = facts_as(TwoPhotoFacts, facts)
    far_m = known.ratio * wall_mm(known) / 1000
    return f"Move the camera straight back, to {far_m:.2f} m from the wall. Leave zoom, aperture and exposure alone."


def reach_of_rail(facts: Facts) -> Diagram | None:
    """Distances of the far photographs that the rail allows; None without a rail."""
    known = facts_as(TwoPhotoFacts, facts)
    most = reached_ratio(known)
    possible = [ratio for ratio in DISTANCES if ratio <= most]
    if known.near_mm is None or not np.isfinite(most) or not possible:
        return None
    metres = tuple(ratio * known.near_mm / 1000 for ratio in possible)
    say = f"The rail reaches {most:g} times the near distance, {most * known.near_mm / 1000:.2f} m from the wall."
    rows = (
        ("times as far", "metres"),
        *((f"{ratio:g}", f"{m:.2f}") for ratio, m in zip(possible, metres, strict=True)),
    )
    return Diagram("distance of a far photograph in metres over its ratio", tuple(possible), metres, say, rows)


WALL = (
    Home(),
    Go(to_near, lambda facts: "going to the near end of the rail" if to_near(facts) else ""),
    SetLight(lambda facts: 1.0),
    Ask("wall", "Choose a flat wall with fine and coarse detail: rough plaster, concrete, brick. No glass, no relief."),
    Ask("square", "Set the camera square to the wall, the stabiliser off, in steady light.", when=on_rail),
    Ask(
        "tripod",
        "Put the camera on a tripod, square to the wall, the stabiliser off, in steady light.",
        when=lambda facts: not on_rail(facts),
    ),
    Ask("camera_set", "Set the camera: RAW, manual exposure, ISO 100, the aperture that is to be calibrated."),
    Ask("near_mm", "How far is the wall from the lens?", "number", "mm", low=50.0, high=1e5, check=check_reach),
    Show(reach_of_rail),
    Ask(
        "ratio", "How many times as far shall the second photograph be?", "number", "", RATIO, low=LEAST_RATIO,
        high=MOST_RATIO, proposed=proposed_ratio, check=check_ratio,
    ),
)  # fmt: skip

# --- checks ---


def clipped_fraction(frame: RawFrame) -> float:
    """Largest share of clipped samples in a plane."""
    return max(float(np.mean(plane.samples >= NOMINAL)) for plane in frame.planes.values())


def middle(samples: Array32, part: float) -> Array32:
    """The middle `part` of a photograph, as a share of its sides."""
    rows, columns = (max(round(n * part), 1) for n in samples.shape)
    top, left = (samples.shape[0] - rows) // 2, (samples.shape[1] - columns) // 2
    return samples[top : top + rows, left : left + columns]


def texture(plane: Plane) -> float:
    """Contrast of detail of a few pixels, over the noise."""
    samples = plane.samples
    detail = samples - cv2.GaussianBlur(samples, (0, 0), DETAIL_PX)
    noise = max(noise_at_most(samples), plane.quantisation / np.sqrt(12))
    return float(detail.std() / noise)


def check_near(frame: RawFrame, facts: Facts) -> Advice:
    """Check exposure, and the contrast of the wall's detail over the noise."""
    known = facts_as(TwoPhotoFacts, facts)
    if (contradiction := near_by_laser(known) or beyond_rail(known)) is not None:
        return contradiction
    level = max(float(np.percentile(plane.samples, 99.5)) for plane in frame.planes.values())
    advice = exposure_advice(level, clipped_fraction(frame), frame.exposure, "The brightest")
    plane = frame.guide
    contrast = Reading("texture", texture(plane), "× noise", TEXTURE, None)
    readings = (*advice.readings, contrast)
    if not advice.good:
        return replace(advice, readings=readings)
    if not contrast.good:
        say = f"The wall's detail is only {contrast.value:.1f} times the noise: choose a rougher wall."
        return Advice(False, say, readings, by_hand={"rougher_wall": 1.0})
    new_facts: dict[str, Fact] = {**advice.facts, "near_level": float(np.mean(plane.samples))}
    if known.distance_mm is not None:
        new_facts["near_laser_mm"] = known.distance_mm
    if "z_mm" in known.where():
        new_facts["near_z_mm"] = known.where()["z_mm"]
    return replace(advice, readings=readings, facts=new_facts)


def check_far(frame: RawFrame, facts: Facts) -> Advice:
    """Check that settings and light are unchanged."""
    known = facts_as(TwoPhotoFacts, facts)
    if changed := changed_settings(frame.exposure, known):
        return Advice(False, f"Set the camera back: {changed}.", by_hand={"settings": 1.0})
    # the part of a far photograph that must show the wall of the near one
    rows, columns = frame.guide.samples.shape
    x, y, half = (columns - 1) / 2, (rows - 1) / 2, 0.5 / known.ratio
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    wanted = Outline((), tuple((x + i * half * columns, y + j * half * rows) for i, j in signs))
    if (off := way_by_laser(known)) is not None:
        return replace(off, outline=wanted)
    clipped = clipped_fraction(frame)
    near = np.nan if known.near_level is None else known.near_level
    # the near photograph corresponds to the middle of this one
    change = float(np.mean(middle(frame.guide.samples, 1 / known.ratio))) / near - 1
    readings = (
        Reading("light", 100 * change, "%", -100 * SAME_LIGHT, 100 * SAME_LIGHT),
        Reading("clipped", 100 * clipped, "%", None, 1.0),
    )
    if not readings[0].good:
        more = "brighter" if change > 0 else "darker"
        say = (
            f"The wall is {abs(change):.0%} {more} than from nearby: bring back the light, and keep your shadow off it."
        )
        return Advice(False, say, readings, by_hand={"light": -change}, outline=wanted)
    if not readings[1].good:
        return Advice(False, f"{clipped:.1%} is clipped: keep bright things out of the frame.", readings)
    gone_mm = way_mm(known)
    new_facts: dict[str, Fact] = {"far_light_percent": 100 * change}
    if gone_mm is not None:
        new_facts["far_way_mm"] = gone_mm
    return Advice(True, "The light is the same.", readings, facts=new_facts, outline=wanted)


CHECKS = {"near": check_near, "far": check_far}

# --- focus and shots ---


def sharpness(frame: RawFrame, facts: Facts) -> float:
    """Fine over coarse contrast of the frame's middle, for comparison of focus positions at one wall."""
    plane = frame.guide
    return fineness(middle(plane.samples, 0.5), noise_at_most(plane.samples))


def choose_focus(places: Sequence[float], scores: Sequence[float]) -> Advice:
    """The sharpest of the bracket."""
    known = np.asarray(scores, dtype=np.float64)
    if not np.isfinite(known).any():
        say = "The bracket has no sharpest place: focus by eye."
        return Advice(False, say, moves={"focus_steps": -places[-1]})
    best = float(places[int(np.nanargmax(known))])
    return Advice(True, f"Sharpest at {best:+g} steps.", moves={"focus_steps": best - places[-1]})


def focus(place: str) -> tuple[Any, ...]:
    """Requests that focus at one of the distances."""
    return (
        Ask(f"focused_{place}", "Focus on the wall, then switch autofocus off."),
        Look("light", CHECKS[place], rests_on=("near_mm", "ratio") if place == "far" else ()),
        Ask("focus_by", "How will you search the focus?", "choice", default="ring", choices=("ring", "skip")),
        Scan("focus", "focus_steps", ring_places, sharpness, choose_focus, say_ring),
    )


# --- further distances ---

FARTHER = Ask(
    "farther", "From how many further distances will you photograph the wall?", "number", "", 0.0, low=0.0, high=3.0,
    when=lambda facts: bool(further(facts)),
)  # fmt: skip
MTF_NYQUIST_WORDS = "MTF at Nyquist by noise"
ALIKE = 0.1  # relative difference below which two distances are one


def further(facts: Facts) -> list[float]:
    """Ratios of further distances, the most informative one first: within the rail, and unlike the far place."""
    known = facts_as(TwoPhotoFacts, facts)
    most = most_ratio(known)
    possible = {one: u for one, u in known.predictions.items() if one <= most and abs(one / known.ratio - 1) > ALIKE}
    return sorted(possible, key=lambda ratio: possible[ratio])


def predicted(facts: Facts) -> Diagram | None:
    """Predicted uncertainty over the number of further distances; None without a prediction, or without room."""
    known, ratios = facts_as(TwoPhotoFacts, facts), further(facts)
    if not ratios:
        return None
    totals = uncertainties_up_to(known, ratios)
    say = (
        f"By the wall's texture and the noise, the far photographs determine the MTF at Nyquist to {totals[0]:.2g}; "
        f"one further distance, {ratios[0]:g} times the near one, lowers that to {totals[1]:.2g}."
    )
    names = ("none", *(f"{ratio:g} times" for ratio in ratios))
    rows = (("further distance", "uncertainty up to it"), *zip(names, (f"{u:.2g}" for u in totals), strict=True))
    counts = tuple(map(float, range(len(totals))))
    label = "uncertainty of the MTF at Nyquist over further distances"
    return Diagram(label, counts, tuple(totals), say, tuple(rows))


def uncertainties_up_to(known: TwoPhotoFacts, ratios: Sequence[float]) -> list[float]:
    """Predicted uncertainty by the far photographs, and after each further distance."""
    nearest = min(known.predictions, key=lambda one: abs(one - known.ratio))
    uncertainties = [known.predictions[one] for one in (nearest, *ratios)]
    return [together(uncertainties[: n + 1]) for n in range(len(uncertainties))]


def farther_stops(facts: Facts) -> list[TourStop]:
    """The most informative further distances, from near to far."""
    ratios = sorted(further(facts)[: int(facts_as(TwoPhotoFacts, facts).farther)])

    totals = uncertainties_up_to(facts_as(TwoPhotoFacts, facts), ratios) if ratios else []

    def stop(n: int, ratio: float) -> TourStop:
        def at(facts: Facts) -> Facts:
            return {**facts, "ratio": ratio}

        return TourStop(
            f"{ratio:g} times",
            Go(lambda facts: to_ratio(at(facts)), lambda facts: f"{say_far(at(facts))} Focus again."),
            lambda frame, facts: replace(check_far(frame, at(facts)), facts={}),
            lambda facts: Goal(len(ratios) - n, MTF_NYQUIST_WORDS, "", totals[n], totals[n + 1]),
        )

    return [stop(n, ratio) for n, ratio in enumerate(ratios)]


NEAR_PLANE = "near plane"  # key of a near photograph of the same run, for comparison with the far ones


def shoot(place: str) -> Shoot:
    """The photographs at one of the distances."""
    estimate_one = estimate_near if place == "near" else estimate_far
    return Shoot(place, CHECKS[place], estimate_one, partial(enough, place), most=8)


def estimate_near(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """Predicted uncertainties by far photographs, from the second one on; one plane is kept for comparison."""
    before, plane = known.get(NEAR_PLANE), frame.guide
    known[NEAR_PLANE] = Outcome(plane)
    if before is None or before.value is None or before.value.samples.shape != plane.samples.shape:
        return dict.fromkeys(frame.planes, Outcome(""))
    noise = max(noise_of_two(before.value.samples, plane.samples), plane.quantisation / np.sqrt(12)) / np.sqrt(FRAMES)
    each = ((ratio, predicted_uncertainty(plane.samples, ratio, noise)) for ratio in DISTANCES)
    return dict.fromkeys(frame.planes, Outcome(", ".join(f"{ratio:g} {u:.3g}" for ratio, u in each)))


def estimate_far(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """Ratio of the distances by the first far photograph; None where the near ones were taken in an earlier run."""
    if results:
        return results[0]
    near = known[NEAR_PLANE].value if NEAR_PLANE in known else None
    return dict.fromkeys(frame.planes, Outcome(None if near is None else times_as_far(near, frame.guide)))


def enough(place: str, results: Sequence[Outcomes], facts: Facts) -> Advice:
    """Check the number of photographs, and that the far ones contradict no given distance."""
    if place == "far":
        times = next(iter(results[0].values())).value
        if (contradiction := near_by_photographs(times, facts_as(TwoPhotoFacts, facts))) is not None:
            return contradiction
    say = f"Photographs from {'nearby' if place == 'near' else 'afar'}: {len(results)} of {FRAMES}."
    new_facts: dict[str, Fact] = {f"{place}_frames": float(len(results))}
    if place == "near" and (prediction := next(iter(results[-1].values())).value):
        new_facts["predicted"] = prediction
    goal = first_goal(place, len(results), facts_as(TwoPhotoFacts, {**facts, **new_facts}))
    return Advice(len(results) >= FRAMES, say, facts=new_facts, goal=goal)


def first_goal(place: str, count: int, known: TwoPhotoFacts) -> Goal:
    """Progress of the near and the first far photographs, whose mean has the noise over the root of their number."""
    far = 0 if place == "near" else count
    whole = uncertainties_up_to(known, [])[0] if known.predictions else np.inf
    now, after = (
        whole * float(np.sqrt(FRAMES / n)) if n else np.inf for n in (far, far + (place == "far" or count >= FRAMES))
    )
    return Goal(FRAMES - count + FRAMES * (place == "near"), MTF_NYQUIST_WORDS, "", now, after)


# --- estimate ---


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """Every plane's PSF from the means of the near and of the far photographs, and from those of further distances."""
    known_facts = facts_as(TwoPhotoFacts, facts)
    count = FRAMES if known_facts.near_frames is None else known_facts.near_frames
    near, rest = frames[:count], frames[count:]
    far_count = len(rest) - int(known_facts.farther) if known_facts.far_frames is None else known_facts.far_frames
    far, farther = rest[:far_count], rest[far_count:]
    if not near or not far:
        raise BadInput("photographs from both distances are needed", "take them again, from the near ones on")
    names, parameters = near[0].planes, TwoPhotoParameters(s=known_facts.s)
    try:
        for one in rest:
            check_settings(near[0].exposure, one.exposure)
    except Refused as refusal:
        return dict.fromkeys(names, Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy))
    return {
        name: estimate_psf_of_wall(
            [mean_plane(name, near), mean_plane(name, far), *(one.planes[name] for one in farther)], parameters
        )
        for name in names
    }


def mean_plane(name: str, frames: Sequence[RawFrame]) -> Plane:
    """Mean of one plane over photographs of one scene by a camera at rest."""
    planes = [frame.planes[name] for frame in frames]
    mean = np.mean([plane.samples for plane in planes], axis=0, dtype=np.float64)
    return replace(planes[0], samples=np.asarray(mean, dtype=np.float32))
