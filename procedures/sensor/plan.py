"""Plan of a sensor's calibration: a dark stack, a ladder of pairs from the dark to beyond saturation, a flat stack.

The levels of the ladder are set by a light panel at one exposure time, or by the exposure time where the station
controls no panel.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from procedures.advice import change_exposure, changed_settings, nominal_times_s, time_words
from procedures.drawings import steps as drawings
from procedures.outcome import Outcome
from procedures.plan import (
    Advice,
    Ask,
    CameraFacts,
    Decide,
    Estimate,
    Facts,
    Goal,
    Known,
    Look,
    Outcomes,
    Outline,
    Plan,
    Reading,
    Request,
    SetLight,
    Shoot,
    Step,
    facts_as,
    gathered_numbers,
    required,
)
from procedures.raw import RawFrame
from procedures.sensor.photon_transfer import REGRESSION

Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
LEVELS, PICTURES = 24, 16  # levels of the ladder; pictures in each stack
PAIR = 2
TRIAL = 0.25
"""Share of the panel's light at which the exposure is set: the full light then saturates every plane of a mosaic."""
AT_TRIAL = (0.42, 0.6)
"""Level of the brightest plane in that light: four times as much saturates it, and planes with half of its light."""
DARK = 0.02  # maximum of a dark picture on the scale
FILLED, VISIBLE, SMALL_PX = 0.05, 0.1, 64
"""Largest share of the frame that a panel may leave free; its least level, and the width, to be found."""
SPREAD = 0.2  # largest less smallest light over the mean, of a picture's ninths: as refused by `checks`
SAME = 0.01  # accepted relative error of a level's light or time
STEPS_OF_PANEL = 255  # steps of a DMX channel: levels are integers, and so exact
TRIAL_LEVEL = round(TRIAL * STEPS_OF_PANEL) / STEPS_OF_PANEL


def plan(estimate: Estimator, levels: int = LEVELS, pictures: int = PICTURES) -> Plan:
    """The guided calibration of a sensor. levels, pictures : levels of the ladder, pictures in each stack."""
    whole = 2 * pictures + PAIR * levels
    return Plan(
        "sensor",
        "Gain, noise and non-uniformity of a sensor (EMVA 1288)",
        (
            Step(
                "panel", "Panel", "Let the sensor see even light, without a lens where that can be.", PANEL,
                drawings.PANEL, time_summary,
            ),
            Step(
                "dark", "Dark", "Pictures without any light.",
                (SetLight(lambda facts: 0.0), COVER, shoot("dark", 0.0, pictures, whole), UNCOVER),
                drawings.DARK, lambda facts: picture_count(facts, 0.0),
            ),
            Step(
                "ladder", "Ladder", "Two pictures at each level of light, from little to beyond saturation.",
                tuple(request for one in ladder(levels) for request in level(one, whole)), drawings.PANEL,
            ),
            Step(
                "flat", "Flat", "Many pictures at half of saturation.",
                (SetLight(lambda facts: TRIAL_LEVEL), shoot("flat", TRIAL_LEVEL, pictures, whole)), drawings.PANEL,
            ),
            Step("estimate", "Estimate", "Compute all numbers from the pictures.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the ladder again.", (Decide("ladder"),)),
        ),
        subject="panel",
        facts=SensorFacts,
    )  # fmt: skip


def ladder(levels: int) -> tuple[float, ...]:
    """Relative light of the levels, equally spaced, so that every plane has enough of them below its saturation."""
    steps = np.unique(np.round(np.linspace(1 / levels, 1, levels) * STEPS_OF_PANEL))
    return tuple(float(step) / STEPS_OF_PANEL for step in steps)


def time_summary(facts: Facts) -> str:
    """The exposure time."""
    ladder_s = facts_as(SensorFacts, facts).ladder_s
    return "" if ladder_s is None else time_words(ladder_s)


def picture_count(facts: Facts, light: float) -> str:
    """Number of pictures with that light."""
    count = sum(one == light for one in facts_as(SensorFacts, facts).lit.values())
    return f"{count} pictures" if count else ""


def without_panel(facts: Facts) -> bool:
    """Whether the station does not control the light."""
    return facts_as(SensorFacts, facts).light_level is None


COVER = Ask("covered", "Cover lens or sensor: no light at all.", when=without_panel)
UNCOVER = Ask("uncovered", "Take the cover off again.", when=without_panel)

# --- exposure ---


def check_panel(frame: RawFrame, facts: Facts) -> Advice:
    """Check that the light is even and its quarter near the middle of the scale; record the exposure time."""
    known = facts_as(SensorFacts, facts)
    share = TRIAL_LEVEL if known.light_level is not None else 1.0
    low, high = (one * share / TRIAL_LEVEL for one in AT_TRIAL) if share != 1.0 else AT_TRIAL
    brightest = max(frame.planes.values(), key=lambda plane: float(np.median(plane.samples)))
    light, spread = float(np.median(brightest.samples)), uneven(brightest.samples)
    readings = (
        Reading("light", 100 * light, "%", 100 * low, 100 * high),
        Reading("unevenness", 100 * spread, "%", None, 100 * SPREAD),
    )
    seconds = frame.exposure.exposure_s
    outline = panel_outline(brightest.samples)
    visible = float(np.percentile(brightest.samples, 95)) > VISIBLE
    if visible and outline.off_px > FILLED * max(brightest.samples.shape):
        say = "The panel does not fill the frame: bring it nearer, its middle in front of the camera."
        return Advice(False, say, readings, by_hand={"even_light": 1.0}, outline=outline)
    if not readings[0].good:
        stops = -1.0 if light >= high else math.log2((low + high) / 2 / max(light, 1e-3))
        return change_exposure(stops, f"The light is at {100 * light:.0f} % of the scale", seconds, readings, math.inf)
    if not readings[1].good:
        say = f"The light differs by {100 * spread:.0f} % over the sensor: move the panel nearer, or add a diffuser."
        return Advice(False, say, readings, by_hand={"even_light": 1.0}, outline=outline)
    settings = {name: value for name in ("camera", "lens", "exposure_s", "iso", "f_number")
             if (value := getattr(frame.exposure, name)) is not None}  # fmt: skip
    ladder_s = seconds if seconds is None or known.light_level is not None else seconds / TRIAL_LEVEL
    levels = {"brightest": light / share, "samples": float(brightest.samples.size)}
    new_facts = {**settings, **levels, **({} if ladder_s is None else {"ladder_s": ladder_s})}
    say = f"The light is good, at {100 * light:.0f} % of the scale."
    return Advice(True, say, readings, facts=new_facts, outline=outline)


def panel_outline(samples: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> Outline:
    """The panel, whatever is brighter than half of the brightest part, and the frame that it must fill."""
    rows, columns = samples.shape
    frame = ((0.0, 0.0), (columns - 1.0, 0.0), (columns - 1.0, rows - 1.0), (0.0, rows - 1.0))
    small = cv2.resize(samples, None, fx=SMALL_PX / columns, fy=SMALL_PX / columns, interpolation=cv2.INTER_AREA)
    _, _, boxes, _ = cv2.connectedComponentsWithStats((small > small.max() / 2).astype(np.uint8))
    x, y, width, height = max(boxes[1:, :4].tolist(), key=lambda box: box[2] * box[3], default=[0, 0, 0, 0])
    low, high = ((x, y), (x + width, y + height))
    scale = columns / SMALL_PX
    (x0, y0), (x1, y1) = ((min(x * scale, columns - 1.0), min(y * scale, rows - 1.0)) for x, y in (low, high))
    return Outline(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), frame)


def uneven(samples: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> float:
    """Largest less smallest mean of a picture's ninths, relative to the mean."""
    rows, columns = (size // 3 for size in samples.shape)
    ninths = samples[: 3 * rows, : 3 * columns].reshape(3, rows, 3, columns).mean(axis=(1, 3), dtype=np.float64)
    return float(np.ptp(ninths) / max(ninths.mean(), 1e-6))


PANEL = (
    SetLight(lambda facts: TRIAL_LEVEL),
    Ask("panel", "Put the light panel close to the camera, so that it fills the frame; take the lens off if you can."),
    Ask("camera_set", "Set the camera: RAW, manual exposure, ISO as it is to be calibrated, no noise reduction."),
    Look("panel", check_panel, tries=10),
)

# --- pictures ---


def level(light: float, whole: int) -> tuple[Request, ...]:
    """One level of the ladder."""
    return (SetLight(lambda facts: light), shoot(f"level {light:.3f}", light, PAIR, whole))


def shoot(purpose: str, light: float, count: int, whole: int) -> Shoot:
    """Pictures of one light, out of the `whole` number."""
    return Shoot(purpose, partial(check_picture, light), estimate_none, partial(enough, count, whole), 4 * count)


def check_picture(light: float, frame: RawFrame, facts: Facts) -> Advice:
    """Check light, exposure time and sensitivity of a picture."""
    known = facts_as(SensorFacts, facts)
    by_panel, lit = known.light_level is not None, {LIT + mark_of(frame.sha256): light}
    if by_panel and abs(known.light_level - light) > SAME * light:  # type: ignore[operator]
        say = f"The panel is at {known.light_level:.3f} in place of {light:.3f}: let the station set it."
        return Advice(False, say)
    settings = replace(known, exposure_s=None) if not by_panel and light else known
    if changed := changed_settings(frame.exposure, settings):
        return Advice(False, f"This picture does not count: {changed}. Set it back.")
    if light == 0:
        brightest = max(float(np.median(plane.samples)) for plane in frame.planes.values())
        reading = (Reading("light", 100 * brightest, "%", None, 100 * DARK),)
        if not reading[0].good:
            return Advice(False, "There is light in a dark picture: cover the camera, and darken the room.", reading)
        return Advice(True, "This picture counts.", reading, facts=lit)
    if not by_panel:
        wanted = light * required(known.ladder_s, "the ladder's exposure time", "take the step `panel` again")
        seconds = required(frame.exposure.exposure_s, "the exposure time", "use a camera that records it")
        stops = math.log2(min(nominal_times_s(), key=lambda t: abs(math.log2(t / wanted))) / seconds)
        if abs(stops) > 1 / 6:
            return change_exposure(stops, "Next level", seconds, (), math.inf)
        lit = {LIT + mark_of(frame.sha256): seconds}
    return Advice(True, "This picture counts.", facts=lit)


def estimate_none(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """Nothing is estimated from one picture."""
    return {name: Outcome(None) for name in frame.planes}


def enough(count: int, whole: int, results: Sequence[Outcomes], facts: Facts) -> Advice:
    """Whether the number of pictures is reached."""
    return Advice(len(results) >= count, f"Pictures: {len(results)} of {count}.", goal=gain_goal(facts, whole))


def gain_goal(facts: Facts, whole: int) -> Goal:
    """Progress of the gain, to 70 % of the scale of the brightest plane."""
    known = facts_as(SensorFacts, facts)
    full = 1.0 if known.light_level is not None else required(known.ladder_s, "the ladder's exposure time", "")
    lights = [light / full for light in known.lit.values() if light / full * (known.brightest or 0.0) < REGRESSION]
    last = lights[-1:] if lights and lights.count(lights[-1]) % PAIR else []
    now, after = (100 * gain_uncertainty(one, known.samples or 1.0) for one in (lights, lights + last))
    return Goal(max(whole - len(known.lit), 0), "Gain", "%", now, after)


def gain_uncertainty(lights: Sequence[float], samples: float) -> float:
    """Relative uncertainty of the slope of the variance, a line through 0: n pictures of shot noise with N samples give
    a variance with the relative uncertainty sqrt(2 / (N (n - 1))); infinite without two pictures of one light."""
    levels = [(light, n) for light, n in Counter(lights).items() if light and n > 1]
    if not levels:
        return math.inf
    spread = sum(light**4 / (n - 1) for light, n in levels)
    return math.sqrt(2 / samples * spread) / sum(light**2 for light, _ in levels)


# --- Facts of a guided sensor measurement: the exposure, and the light of every picture ---

LIT = "lit_"  # prefix of a picture's mark (`mark_of`): the fact of its light, relative to the maximum
MARK = 16  # characters of a file's hash that identify it


def mark_of(sha256: str) -> str:
    """Name of a picture in the facts."""
    return sha256[:MARK]


@dataclass(frozen=True)
class SensorFacts(CameraFacts):
    """Facts of the plan.

    light_level : setting of the panel; None without one, where exposure times make the ladder
    brightest, samples : level of the brightest plane in full light, and number of its samples
    ladder_s : exposure time of the whole ladder, or of its brightest level
    lit : light of every accepted picture, by its mark; 0 in the dark
    """

    light_level: float | None = None
    brightest: float | None = None
    samples: float | None = None
    ladder_s: float | None = None
    lit: Mapping[str, float] = gathered_numbers(LIT)
