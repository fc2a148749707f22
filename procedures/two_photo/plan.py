"""The plan of the two-photograph PSF: which wall, which two distances, focus at either, the same light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from procedures.advice import changed_settings, exposure_advice
from procedures.clipping import NOMINAL
from procedures.drawings import steps as drawings
from procedures.facts import facts_as, required
from procedures.outcome import BadInput, Outcome, Refused, Verdict
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Facts,
    Go,
    Home,
    Known,
    Look,
    Outcomes,
    Plan,
    Reading,
    Scan,
    SetLight,
    Shoot,
    Step,
)
from procedures.raw import Plane, RawFrame
from procedures.two_photo.distances import (
    beyond_rail,
    check_ratio,
    check_reach,
    near_by_laser,
    near_by_photographs,
    proposed_ratio,
    times_as_far,
    way_by_laser,
    way_mm,
)
from procedures.two_photo.estimate import TwoPhotoParameters, estimate_psf_of_pair
from procedures.two_photo.facts import LEAST_RATIO, MOST_RATIO, RATIO, TwoPhotoFacts
from procedures.two_photo.near_noise import noise_at_most
from procedures.two_photo.sharpness import fineness
from procedures.two_photo.trust import check_settings

SHOWN = ("G1", "Y")
"""The plane that texture and focus are told from."""
TEXTURE = 5.0
"""Contrast of the wall's detail over the noise, at least."""
DETAIL_PX = 8.0
"""What varies more slowly than this is light, not detail."""
SAME_LIGHT = 0.25
"""Change of the wall's level between the distances that is still the same light."""
FRAMES = 2
"""Photographs at either distance; their mean is used."""
RING = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Small turns of the focus ring, from where autofocus or the eye put it; positive towards infinity."""


def plan() -> Plan:
    """The guided calibration with a textured wall."""
    return Plan(
        "two-photo",
        "PSF from two photographs of a wall",
        (
            Step(
                "wall",
                "Wall",
                "Find a flat wall with detail of all sizes, and plan two distances.",
                WALL,
                drawings.WALL,
                gave_wall,
            ),
            Step(
                "near",
                "Near",
                "Photograph the wall from nearby.",
                (*focus("near"), *shoot("near")),
                drawings.NEAR,
                gave_near,
            ),
            Step(
                "far",
                "Far",
                "Move back, focus again, change nothing else.",
                (*FAR, *focus("far"), *shoot("far")),
                drawings.FAR,
                gave_far,
            ),
            Step("estimate", "Estimate", "Estimate every plane's PSF from both.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the photographs again.", (Decide("near"),)),
        ),
        subject="wall",
        facts=TwoPhotoFacts,
    )


def gave_wall(facts: Facts) -> str:
    """The two distances."""
    known = facts_as(TwoPhotoFacts, facts)
    return "" if known.near_mm is None else f"{known.near_mm / 1000:.2f} m x {known.ratio:g}"


def gave_near(facts: Facts) -> str:
    """How bright the wall is from nearby."""
    level = facts_as(TwoPhotoFacts, facts).near_level
    return "" if level is None else f"mean {100 * level:.0f} %"


def gave_far(facts: Facts) -> str:
    """How much brighter it is from afar."""
    change = facts_as(TwoPhotoFacts, facts).far_light_percent
    return "" if change is None else f"light {change:+.0f} %"


# --- wall and distances ------------------------------------------------------------------------------------------


def asked_for(facts: Facts) -> TwoPhotoParameters:
    """s and k as the photographs allow, or s as it is given."""
    return TwoPhotoParameters(s=facts_as(TwoPhotoFacts, facts).s)


def on_rail(facts: Facts) -> bool:
    """Whether a rail carries the camera."""
    return "z_mm" in facts_as(TwoPhotoFacts, facts).where()


def to_near(facts: Facts) -> dict[str, float]:
    """The rail's near end, with the head looking along the rail."""
    axes = facts_as(TwoPhotoFacts, facts).axes
    straight = {name: 0.0 for name in ("pan_deg", "tilt_deg") if name in axes and axes[name].at is not None}
    low = axes["z_mm"].low if "z_mm" in axes else None
    return straight if low is None else {"z_mm": low, **straight}


def to_far(facts: Facts) -> dict[str, float]:
    """As many times as far, along the rail."""
    known = facts_as(TwoPhotoFacts, facts)
    here = known.where().get("z_mm")
    return {} if here is None else {"z_mm": here + (known.ratio - 1) * wall_mm(known)}


def wall_mm(known: TwoPhotoFacts) -> float:
    """How far the wall is from nearby. Raises BadParameter."""
    return required(known.near_mm, "how far the wall is", "answer the step `wall`")


def say_far(facts: Facts) -> str:
    """Where to go, in metres."""
    known = facts_as(TwoPhotoFacts, facts)
    far_m = known.ratio * wall_mm(known) / 1000
    return f"Move the camera straight back, to {far_m:.2f} m from the wall. Leave zoom, aperture and exposure alone."


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
    Ask(
        "ratio",
        "How many times as far shall the second photograph be?",
        "number",
        "",
        RATIO,
        low=LEAST_RATIO,
        high=MOST_RATIO,
        proposed=proposed_ratio,
        check=check_ratio,
    ),
)

FAR = (Go(to_far, say_far),)

# --- checks ------------------------------------------------------------------------------------------------------


def shown(frame: RawFrame) -> Plane:
    """The plane that texture and focus are told from."""
    return next((frame.planes[name] for name in SHOWN if name in frame.planes), next(iter(frame.planes.values())))


def middle(samples: np.ndarray[Any, np.dtype[np.float32]], part: float) -> np.ndarray[Any, np.dtype[np.float32]]:
    """The middle of a photograph, `part` of its sides."""
    rows, columns = (max(round(n * part), 1) for n in samples.shape)
    top, left = (samples.shape[0] - rows) // 2, (samples.shape[1] - columns) // 2
    return samples[top : top + rows, left : left + columns]


def texture(plane: Plane) -> float:
    """Contrast of what varies within a few pixels, over the noise."""
    samples = plane.samples
    detail = samples - cv2.GaussianBlur(samples, (0, 0), DETAIL_PX)
    noise = max(noise_at_most(samples), plane.quantisation / np.sqrt(12))
    return float(detail.std() / noise)


def check_near(frame: RawFrame, facts: Facts) -> Advice:
    """The wall well exposed, with detail that stands clear of the noise."""
    known = facts_as(TwoPhotoFacts, facts)
    if (wrong := near_by_laser(known) or beyond_rail(known)) is not None:
        return wrong
    levels = {name: float(np.percentile(one.samples, 99.5)) for name, one in frame.planes.items()}
    clipped = max(float(np.mean(one.samples >= NOMINAL)) for one in frame.planes.values())
    advice = exposure_advice(max(levels.values()), clipped, frame.exposure, "The brightest")
    plane = shown(frame)
    told = Reading("texture", texture(plane), "× noise", TEXTURE, None)
    readings = (*advice.readings, told)
    if not advice.good:
        return replace(advice, readings=readings)
    if not told.good:
        say = f"The wall's detail is only {told.value:.1f} times the noise: choose a rougher wall."
        return Advice(False, say, readings, by_hand={"rougher_wall": 1.0})
    learned = {**advice.facts, "near_level": float(np.mean(plane.samples))}
    if known.distance_mm is not None:
        learned["near_laser_mm"] = known.distance_mm
    if "z_mm" in known.where():
        learned["near_z_mm"] = known.where()["z_mm"]
    return replace(advice, readings=readings, facts=learned)


def check_far(frame: RawFrame, facts: Facts) -> Advice:
    """The same wall in the same light, with the same settings."""
    known = facts_as(TwoPhotoFacts, facts)
    changed = changed_settings(frame.exposure, known)
    if changed:
        return Advice(False, f"Set the camera back: {changed}.", by_hand={"settings": 1.0})
    if (off := way_by_laser(known)) is not None:
        return off
    clipped = max(float(np.mean(one.samples >= NOMINAL)) for one in frame.planes.values())
    near = np.nan if known.near_level is None else known.near_level
    # what the near photograph showed is the middle of this one
    change = float(np.mean(middle(shown(frame).samples, 1 / known.ratio))) / near - 1
    readings = (
        Reading("light", 100 * change, "%", -100 * SAME_LIGHT, 100 * SAME_LIGHT),
        Reading("clipped", 100 * clipped, "%", None, 1.0),
    )
    if not readings[0].good:
        more = "brighter" if change > 0 else "darker"
        say = (
            f"The wall is {abs(change):.0%} {more} than from nearby: bring back the light, and keep your shadow off it."
        )
        return Advice(False, say, readings, by_hand={"light": -change})
    if not readings[1].good:
        return Advice(False, f"{clipped:.1%} is clipped: keep bright things out of the frame.", readings)
    gone_mm = way_mm(known)
    learned = {"far_light_percent": 100 * change, **({} if gone_mm is None else {"far_way_mm": gone_mm})}
    return Advice(True, "The light is the same.", readings, facts=learned)


CHECKS = {"near": check_near, "far": check_far}

# --- focus and shots ---------------------------------------------------------------------------------------------


def sharpness(frame: RawFrame, facts: Facts) -> float:
    """Fine over coarse contrast of the frame's middle: a wall's own cancels, as all places see the same wall."""
    plane = shown(frame)
    return fineness(middle(plane.samples, 0.5), noise_at_most(plane.samples))


def ring_places(facts: Facts) -> Sequence[float]:
    """Turns of the focus ring, if the operator brackets the focus."""
    return RING if facts_as(TwoPhotoFacts, facts).focus_by == "ring" else ()


def say_ring(change: float) -> str:
    """What to do with the focus ring."""
    steps = "one small step" if abs(change) == 1 else f"{abs(change):g} small steps"
    return f"Turn the focus ring {steps} towards {'infinity' if change > 0 else 'near'}."


def choose_focus(places: Sequence[float], scores: Sequence[float]) -> Advice:
    """The sharpest of the bracket."""
    known = np.asarray(scores, dtype=np.float64)
    if not np.isfinite(known).any():
        return Advice(
            False,
            "The bracket has no sharpest place: focus by eye.",
            moves={"focus_steps": -places[-1]},
        )
    best = float(places[int(np.nanargmax(known))])
    return Advice(True, f"Sharpest at {best:+g} steps.", moves={"focus_steps": best - places[-1]})


def focus(place: str) -> tuple[Any, ...]:
    """Focus at one of the distances."""
    return (
        Ask(f"focused_{place}", "Focus on the wall, then switch autofocus off."),
        Look("light", CHECKS[place], rests_on=("near_mm", "ratio") if place == "far" else ()),
        Ask("focus_by", "How will you search the focus?", "choice", default="ring", choices=("ring", "skip")),
        Scan("focus", "focus_steps", ring_places, sharpness, choose_focus, say_ring),
    )


NEAR_PLANE = "near plane"
"""Under this name the far photographs find a near one of the same run."""


def shoot(place: str) -> tuple[Any, ...]:
    """The photographs that count, at one of the distances."""
    estimate_one = estimate_near if place == "near" else estimate_far
    return (Shoot(place, CHECKS[place], estimate_one, partial(enough, place), most=8),)


def estimate_near(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """How bright each plane is; one is kept, for the far photographs to be held against."""
    known[NEAR_PLANE] = Outcome(shown(frame))
    return {name: Outcome(float(np.mean(one.samples))) for name, one in frame.planes.items()}


def estimate_far(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """How many times as far the first of them shows the wall; None where the near ones were taken in an earlier run."""
    if results:
        return results[0]
    near = known[NEAR_PLANE].value if NEAR_PLANE in known else None
    return dict.fromkeys(frame.planes, Outcome(None if near is None else times_as_far(near, shown(frame))))


def enough(place: str, results: Sequence[Outcomes], facts: Facts) -> Advice:
    """So many from either distance; from afar, where these contradict no distance that was given."""
    if place == "far":
        times = next(iter(results[0].values())).value
        wrong = near_by_photographs(times, facts_as(TwoPhotoFacts, facts))
        if wrong is not None:
            return wrong
    say = f"Photographs from {'nearby' if place == 'near' else 'afar'}: {len(results)} of {FRAMES}."
    return Advice(len(results) >= FRAMES, say, facts={f"{place}_frames": float(len(results))})


# --- estimate ----------------------------------------------------------------------------------------------------


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """Every plane's PSF from the mean of the near and the mean of the far photographs."""
    count = facts_as(TwoPhotoFacts, facts).near_frames
    count = FRAMES if count is None else count
    near, far = frames[:count], frames[count:]
    if not near or not far:
        raise BadInput("photographs from both distances are needed", "take them again, from the near ones on")
    parameters = asked_for(facts)
    return {name: _of_plane(name, near, far, parameters) for name in near[0].planes}


def _of_plane(
    name: str, near: Sequence[RawFrame], far: Sequence[RawFrame], parameters: TwoPhotoParameters
) -> Outcome[Any]:
    try:
        check_settings(near[0].exposure, far[0].exposure)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return estimate_psf_of_pair(mean_plane(name, near), mean_plane(name, far), parameters)


def mean_plane(name: str, frames: Sequence[RawFrame]) -> Plane:
    """The mean of one plane over photographs of one scene by a camera that stood still."""
    planes = [frame.planes[name] for frame in frames]
    mean = np.mean([plane.samples for plane in planes], axis=0, dtype=np.float64)
    return replace(planes[0], samples=np.asarray(mean, dtype=np.float32))
