"""The plan of a sensor's calibration: a dark stack, a ladder of pairs from the dark to beyond saturation, a flat stack.

A light panel that the station sets makes the ladder at one exposure time. Where there is none, the panel stays as it is
and the exposure time makes it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.advice import changed_settings, nominal_times_s, time_words
from procedures.drawings import steps as drawings
from procedures.facts import facts_as, required
from procedures.outcome import Outcome
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Facts,
    Known,
    Look,
    Outcomes,
    Plan,
    Reading,
    Request,
    SetLight,
    Shoot,
    Step,
)
from procedures.raw import RawFrame
from procedures.sensor.facts import LIT, SensorFacts, mark_of

Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
LEVELS, PICTURES = 24, 16
"""Of the ladder; in each stack."""
PAIR = 2
TRIAL = 0.25
"""Of the panel's light, at which the exposure is set: the whole of it then saturates every plane of a mosaic."""
AT_TRIAL = (0.42, 0.6)
"""Of the sensor's scale, where the brightest plane lies in that light: of four times as much it is beyond its end, and
so are planes that get half as much."""
DARK = 0.02
"""Of the scale: what is brighter is not dark."""
SPREAD = 0.2
"""Largest less smallest light over the mean, of a picture's ninths: what `checks` refuses."""
SAME = 0.01
"""A level's light or time may be off by that share."""
STEPS_OF_PANEL = 255
"""A DMX channel has so many: levels are whole ones, and so exact."""


def plan(estimate: Estimator, levels: int = LEVELS, pictures: int = PICTURES) -> Plan:
    """The guided calibration of a sensor.

    Parameters
    ----------
    levels, pictures : int
        Of the ladder, and in each stack.
    """
    return Plan(
        "sensor",
        "Gain, noise and non-uniformity of a sensor (EMVA 1288)",
        (
            Step(
                "panel", "Panel", "Let the sensor see even light, without a lens where that can be.", PANEL,
                drawings.PANEL, gave_time,
            ),
            Step(
                "dark", "Dark", "Pictures without any light.",
                (SetLight(lambda facts: 0.0), COVER, *shoot("dark", 0.0, pictures), UNCOVER),
                drawings.DARK, lambda facts: gave(facts, 0.0),
            ),
            Step(
                "ladder", "Ladder", "Two pictures at each level of light, from little to beyond saturation.",
                tuple(request for one in ladder(levels) for request in level(one)), drawings.PANEL,
            ),
            Step(
                "flat", "Flat", "Many pictures at half of saturation.",
                (SetLight(lambda facts: trial_level()), *shoot("flat", trial_level(), pictures)), drawings.PANEL,
            ),
            Step("estimate", "Estimate", "Draw every number from all pictures.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the ladder again.", (Decide("ladder"),)),
        ),
        subject="panel",
        facts=SensorFacts,
    )  # fmt: skip


def trial_level() -> float:
    """The trial's light, as the panel can be set."""
    return round(TRIAL * STEPS_OF_PANEL) / STEPS_OF_PANEL


def ladder(levels: int) -> tuple[float, ...]:
    """Light over the whole, rising: evenly, so that every plane has levels enough below its own saturation."""
    steps = np.unique(np.round(np.linspace(1 / levels, 1, levels) * STEPS_OF_PANEL))
    return tuple(float(step) / STEPS_OF_PANEL for step in steps)


def gave_time(facts: Facts) -> str:
    """The exposure time."""
    ladder_s = facts_as(SensorFacts, facts).ladder_s
    return "" if ladder_s is None else time_words(ladder_s)


def gave(facts: Facts, light: float) -> str:
    """How many pictures had that light."""
    count = sum(one == light for one in facts_as(SensorFacts, facts).lit.values())
    return f"{count} pictures" if count else ""


def without_panel(facts: Facts) -> bool:
    """Whether no light is set by the station."""
    return facts_as(SensorFacts, facts).light_level is None


COVER = Ask("covered", "Cover lens or sensor: no light at all.", when=without_panel)
UNCOVER = Ask("uncovered", "Take the cover off again.", when=without_panel)

# --- exposure ----------------------------------------------------------------------------------------------------


def check_panel(frame: RawFrame, facts: Facts) -> Advice:
    """Even light, of which a quarter lies about the middle of the scale; the exposure time becomes known."""
    known = facts_as(SensorFacts, facts)
    share = trial_level() if known.light_level is not None else 1.0
    low, high = (one * share / trial_level() for one in AT_TRIAL) if share != 1.0 else AT_TRIAL
    brightest = max(frame.planes.values(), key=lambda plane: float(np.median(plane.samples)))
    light, spread = float(np.median(brightest.samples)), uneven(brightest.samples)
    readings = (
        Reading("light", 100 * light, "%", 100 * low, 100 * high),
        Reading("unevenness", 100 * spread, "%", None, 100 * SPREAD),
    )
    seconds = frame.exposure.exposure_s
    if not readings[0].good:
        stops = -1.0 if light >= high else math.log2((low + high) / 2 / max(light, 1e-3))
        return exposure_by(stops, seconds, f"The light is at {100 * light:.0f} % of the scale", readings)
    if not readings[1].good:
        say = (
            f"The light differs by {100 * spread:.0f} % over the sensor: put the panel nearer, or a diffuser before it."
        )
        return Advice(False, say, readings, by_hand={"even_light": 1.0})
    noted = {name: value for name in ("camera", "lens", "exposure_s", "iso", "f_number")
             if (value := getattr(frame.exposure, name)) is not None}  # fmt: skip
    ladder_s = seconds if seconds is None or known.light_level is not None else seconds / trial_level()
    told = noted if ladder_s is None else {**noted, "ladder_s": ladder_s}
    return Advice(True, f"The light is good, at {100 * light:.0f} % of the scale.", readings, facts=told)


def uneven(samples: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> float:
    """Largest less smallest mean of a picture's ninths, over the mean."""
    rows, columns = (size // 3 for size in samples.shape)
    ninths = samples[: 3 * rows, : 3 * columns].reshape(3, rows, 3, columns).mean(axis=(1, 3), dtype=np.float64)
    return float(np.ptp(ninths) / max(ninths.mean(), 1e-6))


def exposure_by(stops: float, seconds: float | None, why: str, readings: tuple[Reading, ...]) -> Advice:
    """Advice to expose by so many stops more, in times that cameras have."""
    if seconds is None:
        return Advice(False, f"{why}: expose by {stops:+.1f} stops.", readings, by_hand={"exposure_ev": stops})
    proposed = min(nominal_times_s(), key=lambda t: abs(math.log2(t / seconds) - stops))
    say = f"{why}: set the exposure time from {time_words(seconds)} to {time_words(proposed)}."
    return Advice(False, say, readings, by_hand={"exposure_ev": math.log2(proposed / seconds)})


PANEL = (
    SetLight(lambda facts: trial_level()),
    Ask(
        "panel",
        "Put the light panel close before the camera, so that it fills the frame; take the lens off if you can.",
    ),
    Ask("camera_set", "Set the camera: RAW, manual exposure, ISO as it is to be calibrated, no noise reduction."),
    Look("panel", check_panel, tries=10),
)

# --- pictures ----------------------------------------------------------------------------------------------------


def level(light: float) -> tuple[Request, ...]:
    """One level of the ladder."""
    return (SetLight(lambda facts: light), *shoot(f"level {light:.3f}", light, PAIR))


def shoot(purpose: str, light: float, count: int) -> tuple[Request, ...]:
    """So many pictures of one light."""
    return (Shoot(purpose, partial(check_picture, light), estimate_none, partial(enough, count), 4 * count),)


def check_picture(light: float, frame: RawFrame, facts: Facts) -> Advice:
    """A picture that counts has the light, the exposure time and the sensitivity that it should have."""
    known = facts_as(SensorFacts, facts)
    by_panel, told = known.light_level is not None, {LIT + mark_of(frame.sha256): light}
    if by_panel and abs(known.light_level - light) > SAME * light:  # type: ignore[operator]
        return Advice(
            False, f"The panel is at {known.light_level:.3f} in place of {light:.3f}: let the station set it."
        )
    settings = replace(known, exposure_s=None) if not by_panel and light else known
    changed = changed_settings(frame.exposure, settings)
    if changed:
        return Advice(False, f"This picture does not count: {changed}. Set it back.")
    if light == 0:
        brightest = max(float(np.median(plane.samples)) for plane in frame.planes.values())
        reading = (Reading("light", 100 * brightest, "%", None, 100 * DARK),)
        if not reading[0].good:
            return Advice(False, "There is light in a dark picture: cover the camera, and darken the room.", reading)
        return Advice(True, "This picture counts.", reading, facts=told)
    if not by_panel:
        wanted = light * required(known.ladder_s, "the ladder's exposure time", "take the step `panel` again")
        seconds = required(frame.exposure.exposure_s, "the exposure time", "use a camera that notes it")
        stops = math.log2(min(nominal_times_s(), key=lambda t: abs(math.log2(t / wanted))) / seconds)
        if abs(stops) > 1 / 6:
            return exposure_by(stops, seconds, "Next level", ())
        told = {LIT + mark_of(frame.sha256): seconds}
    return Advice(True, "This picture counts.", facts=told)


def estimate_none(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """One picture alone tells nothing that could be refused."""
    return {name: Outcome(None) for name in frame.planes}


def enough(count: int, results: Sequence[Outcomes], facts: Facts) -> Advice:
    """When there are so many."""
    return Advice(len(results) >= count, f"Pictures: {len(results)} of {count}.")
