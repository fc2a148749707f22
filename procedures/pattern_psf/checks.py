"""What a trial photograph of the chart tells about the rig: light, distance, turn, focus, and what to change. Pure.

Every check takes the frame and what is known so far, and gives an `Advice`: one thing to do at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.advice import changed_settings, exposure_advice, paper_level
from procedures.facts import facts_as
from procedures.numbers import MTF50_RADIAL, MTF_NYQUIST, RADIAL, S_OVER_T
from procedures.numerics.warps import fit_homography
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.distance.consistency import cautious_mm, probe_mm, seed_contradiction, size_contradiction
from procedures.pattern_psf.distance.ranging import look_now, range_facts, range_readings, without_offset
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import MONOCHROME, MOSAIC, RATIO, RATIO_HIGH, RATIO_LOW, PatternFacts, RangeLook
from procedures.pattern_psf.pose import ChartPose, Optics, chart_pose
from procedures.pattern_psf.radiometry import Light, measure_light
from procedures.pattern_psf.registration import Registration, block_size_px, refine_corners, register_marks
from procedures.plan import Advice, Facts, Reading
from procedures.raw import Plane, RawFrame

Array = npt.NDArray[np.float64]
Marks = tuple[tuple[float, float], ...]

SHOWN = ("G1", "Y")
"""The plane that geometry is told from."""
FLAT = 0.8
"""Least share of the brightest white block's light that the darkest must have."""
CENTRED = 0.12
"""How far the chart's centre may lie from the frame's, in parts of the frame's width."""
SQUARE_DEG, ROLL_DEG = 1.5, 5.0
"""Tolerance of yaw and pitch, and of roll, which changes nothing but the PSF's axes on the chart."""


def shown(frame: RawFrame) -> Plane:
    """The plane that geometry is told from."""
    return next((frame.planes[name] for name in SHOWN if name in frame.planes), next(iter(frame.planes.values())))


# --- is there a chart --------------------------------------------------------------------------------------------


def seen_chart(plane: Plane, known: PatternFacts) -> ChartSighting | Advice:
    """The one chart in the frame, or what to do so that there is one."""
    found = find_charts(plane.samples)
    if not found:
        say = "No chart is seen: aim at it so that all of it is in the frame, and focus on it."
        return Advice(False, say, by_hand={"aim": 1.0})
    if len(found) > 1:
        return Advice(False, f"{len(found)} charts are seen: cover all but one.")
    sighting = found[0]
    if sighting.negative:
        return Advice(False, "The photograph is a negative: it shows the chart's white as black. Use a linear picture.")
    if sighting.mirrored:
        return Advice(False, "The chart is mirrored: photograph it directly, not in a mirror or through its back.")
    cut = sighting.cut_marks(plane.samples.shape)
    if cut:
        return cut_off(cut, sighting, plane, known)
    return sighting


def cut_off(cut: int, sighting: ChartSighting, plane: Plane, known: PatternFacts) -> Advice:
    """What to do where the frame cuts the chart; how far to shift the camera, once the lens is known."""
    say = f"The frame cuts the chart: {cut} of its 12 marks are outside. Aim at its middle."
    moves: dict[str, float] = {}
    if known.lens_known:
        pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, known.optics(plane.pitch))
        moves = {"x_mm": pose.centre_mm[0], "y_mm": -pose.centre_mm[1]}
    return Advice(False, say, moves=moves, by_hand={"aim": 1.0}, marks=marks_of(sighting))


def marks_of(sighting: ChartSighting) -> Marks:
    """The marks in sight, for the preview."""
    return tuple((float(x), float(y)) for x, y in sighting.corners[sighting.visible])


def registered(plane: Plane, sighting: ChartSighting) -> Registration:
    """The map by the marks alone."""
    block = block_size_px(register_marks(sighting.corners))
    return register_marks(refine_corners(plane.samples, sighting.corners, block))


# --- light -------------------------------------------------------------------------------------------------------


def check_light(frame: RawFrame, facts: Facts) -> Advice:
    """White at 80 % of the scale in the brightest plane, evenly lit, nothing clipped, the chart in sight.

    The first photograph is looked at for this: it tells what kind of sensor took it, too.
    """
    advice = _light(frame, facts)
    kind = MONOCHROME if shown(frame).pitch == 1 else MOSAIC
    return replace(advice, facts={**advice.facts, "sensor_kind": kind})


def _light(frame: RawFrame, facts: Facts) -> Advice:
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        levels = {name: paper_level(one) for name, one in frame.planes.items()}
        advice = exposure_advice(*max(levels.values()), frame.exposure)
        return advice if not advice.good else sighting
    registration = registered(plane, sighting)
    lights = {name: measure_light(one.samples, registration, one.quantisation) for name, one in frame.planes.items()}
    brightest = max(lights.values(), key=lambda light: float(light.white[0]))
    clipped = max(light.saturated for light in lights.values())
    advice = exposure_advice(float(brightest.white[0]), clipped, frame.exposure)
    flatness = Reading("evenness", 100 * brightest.flatness, "%", 100 * FLAT, None)
    if advice.good and not flatness.good:
        advice = uneven(brightest)
    readings = (*advice.readings, flatness)
    advice = replace(advice, facts={**advice.facts, "white_percent": 100 * float(brightest.white[0])})
    advice = replace(advice, readings=readings, marks=marks_of(sighting), moves={})
    return held_by_cells(advice, plane, sighting, known) if advice.good else advice


def held_by_cells(advice: Advice, plane: Plane, sighting: ChartSighting, known: PatternFacts) -> Advice:
    """The advice, if the chart shows its number's cells; once they were found to be these, they are not looked for."""
    if known.seed_agreement is not None:
        return advice
    told = seed_contradiction(plane, sighting, known)
    if isinstance(told, Advice):
        return replace(told, readings=advice.readings, facts=advice.facts, marks=advice.marks)
    return advice if told is None else replace(advice, facts={**advice.facts, "seed_agreement": told})


def uneven(light: Light) -> Advice:
    """Which way the light falls off, and where to move the lamp."""
    _, x, y = light.white[:3]
    across = abs(x) > abs(y)
    dark = ("left" if x > 0 else "right") if across else ("upper" if y > 0 else "lower")
    say = f"The chart's {dark} side is darker, at {100 * light.flatness:.0f} % of the brightest: light that side more."
    return Advice(False, say, by_hand={"even_light": 1.0})


# --- distance ----------------------------------------------------------------------------------------------------


def check_distance(frame: RawFrame, facts: Facts) -> Advice:
    """s/t near its best, the chart in the middle of the frame, and nothing that contradicts lens, sensor and print."""
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    optics = known.optics(plane.pitch)
    pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, optics)
    look = look_now(float(sighting.widths().max()) / CELLS, known)
    ratio = known.s_or_start * look.px_per_cell
    readings = (
        Reading("s/t", ratio, "", RATIO_LOW, RATIO_HIGH),
        Reading("distance", pose.centre_mm[2] / 1000, "m"),
        *centre_readings(pose, plane, optics),
    )
    wrong = size_contradiction(look, optics, known, frame.exposure)
    if wrong is not None:  # before any move: it would be reckoned from what cannot be
        return replace(wrong, readings=readings, marks=marks_of(sighting))
    learned = range_facts(look, optics, known)
    told = {**learned, S_OVER_T: ratio}
    seen = Advice(True, "", (*readings, *range_readings(learned)), facts=told, marks=marks_of(sighting))
    return distance_advice(seen, look, pose, known)


def distance_advice(seen: Advice, look: RangeLook, pose: ChartPose, known: PatternFacts) -> Advice:
    """What to do next about the distance: come to the right s/t, to the middle, or hold the lens against the rail."""
    z, ratio = pose.centre_mm[2], seen.readings[0].value
    # the focus is left alone meanwhile: the size goes with 1 / z
    change = cautious_mm(z * (ratio / RATIO - 1), look, z, known)
    if not seen.readings[0].good:
        say = f"Move the camera {_way(change)}: s/t is {ratio:.2f} and should be {RATIO:g}."
        return replace(seen, good=False, say=say, moves={"z_mm": change})
    if not all(reading.good for reading in seen.readings[:4]):
        return aim(pose, seen.readings, seen.facts, seen.marks)
    if not all(reading.good for reading in seen.readings[4:]):
        say = f"The laser cannot be {seen.readings[4].value:.0f} mm behind the lens: aim it at the chart's wall."
        return replace(seen, good=False, say=say, facts=without_offset(seen.facts), by_hand={"aim_laser": 1.0})
    probe = probe_mm(look, z, ratio < RATIO, known)
    if probe:
        say = f"Move the camera {_way(probe)}: two distances tell whether lens, sensor and print are as given."
        return replace(seen, good=False, say=say, moves={"z_mm": probe})
    return replace(seen, say=f"The distance is good: {z / 1000:.2f} m, s/t {ratio:.2f}.")


def _way(change_mm: float) -> str:
    return f"{'back' if change_mm > 0 else 'closer'} by {abs(change_mm) / 1000:.2f} m"


def centre_readings(pose: ChartPose, plane: Plane, optics: Optics) -> tuple[Reading, Reading]:
    """How far the chart's centre lies from the frame's, in per cent of the frame's width."""
    x, y, z = pose.centre_mm
    scale = 100 * optics.principal_px(z) / z / plane.samples.shape[1]
    limit = 100 * CENTRED
    return Reading("right of centre", scale * x, "%", -limit, limit), Reading(
        "below centre", scale * y, "%", -limit, limit
    )


def aim(
    pose: ChartPose,
    readings: tuple[Reading, ...],
    facts: Facts,
    marks: Marks,
) -> Advice:
    """Bring the chart to the middle: shift the camera along the chart."""
    x, y, _ = pose.centre_mm
    across = f"{abs(x):.0f} mm to the {'right' if x > 0 else 'left'}"
    down = f"{abs(y):.0f} mm {'down' if y > 0 else 'up'}"
    say = f"Shift the camera {across} and {down}: the chart is off the middle."
    return Advice(False, say, readings, moves={"x_mm": x, "y_mm": -y}, facts=facts, marks=marks)


# --- square ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Turned:
    """How the chart is turned, and whether the noise cells told it or only the marks."""

    pose: ChartPose
    fine: bool


def turned(plane: Plane, sighting: ChartSighting, known: PatternFacts) -> Turned:
    """The chart's pose; by the noise cells it is good to a tenth of a degree, by the marks alone to two degrees."""
    optics, shape = known.optics(plane.pitch), plane.samples.shape
    found = estimate_psf(plane, known.chart, known.quick_parameters).value
    if found is None:
        return Turned(chart_pose(sighting.H_sensor_pattern, shape, optics), False)
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, CELLS, 9)]), axis=-1).reshape(-1, 2)
    H = fit_homography(grid, found.registration.to_sensor(grid))
    return Turned(chart_pose(H, shape, optics), True)


def check_square(frame: RawFrame, facts: Facts) -> Advice:
    """The chart's plane across the optical axis, in the middle of the frame."""
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    found, optics = turned(plane, sighting, known), known.optics(plane.pitch)
    pose = found.pose
    limit = SQUARE_DEG if found.fine else 2 * SQUARE_DEG
    return square_advice(pose, centre_readings(pose, plane, optics), marks_of(sighting), limit)


def square_advice(pose: ChartPose, centre: tuple[Reading, ...], marks: Marks, limit_deg: float) -> Advice:
    """One thing to do so that the chart is square: roll first, which only hands can mend."""
    readings = (
        Reading("yaw", pose.yaw_deg, "°", -limit_deg, limit_deg),
        Reading("pitch", pose.pitch_deg, "°", -limit_deg, limit_deg),
        Reading("roll", pose.roll_deg, "°", -ROLL_DEG, ROLL_DEG),
        *centre,
    )
    if not readings[2].good:
        way = "counter-clockwise" if pose.roll_deg > 0 else "clockwise"
        say = f"Turn the chart {way} by {abs(pose.roll_deg):.1f}°."
        return Advice(False, say, readings, by_hand={"chart_roll_deg": -pose.roll_deg}, marks=marks)
    if not (readings[0].good and readings[1].good):
        return square_up(pose, readings, marks)
    if not all(reading.good for reading in readings):
        return aim(pose, readings, {}, marks)
    say = f"The chart is square: yaw {pose.yaw_deg:+.1f}°, pitch {pose.pitch_deg:+.1f}°, roll {pose.roll_deg:+.1f}°."
    tilt_deg = max(abs(pose.yaw_deg), abs(pose.pitch_deg))
    return Advice(True, say, readings, facts={"tilt_deg": tilt_deg}, marks=marks)


def square_up(pose: ChartPose, readings: tuple[Reading, ...], marks: Marks) -> Advice:
    """Turn the chart, the worse angle first; or go around it: pan and tilt the head, and shift the camera back."""
    yaw, pitch = pose.yaw_deg, pose.pitch_deg
    if abs(yaw) >= abs(pitch):
        side = "right" if yaw > 0 else "left"
        say = f"Turn the chart by {abs(yaw):.1f}° about its upright axis: its {side} edge away from the camera."
        by_hand = {"chart_yaw_deg": -yaw}
    else:
        edge = "upper" if pitch > 0 else "lower"
        say = f"Tip the chart by {abs(pitch):.1f}°: its {edge} edge away from the camera."
        by_hand = {"chart_pitch_deg": -pitch}
    x, y, z = pose.centre_mm
    moves = {
        "pan_deg": yaw,
        "tilt_deg": pitch,
        "x_mm": x - z * float(np.tan(np.radians(yaw))),
        "y_mm": -y - z * float(np.tan(np.radians(pitch))),
    }
    return Advice(False, say, readings, moves=moves, by_hand=by_hand, marks=marks)


# --- focus -------------------------------------------------------------------------------------------------------


def sharpness(frame: RawFrame, facts: Facts) -> float:
    """MTF50 of the PSF in the shown plane, in cycles/pixel; NaN where there is none."""
    known = facts_as(PatternFacts, facts)
    found = estimate_psf(shown(frame), known.chart, known.quick_parameters).value
    if found is None:
        return float("nan")
    numbers = found.quality.numbers
    told = numbers.get(MTF50_RADIAL) or numbers.get(MTF_NYQUIST[RADIAL])
    return told.value if told else float("nan")


def best_place(places: Sequence[float], scores: Sequence[float]) -> float | None:
    """Where the score is highest: by a parabola through the best and its neighbours. None without any score."""
    x, y = np.asarray(places, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    if not np.isfinite(y).any():
        return None
    i = int(np.nanargmax(y))
    if i in (0, len(x) - 1) or not np.isfinite(y[i - 1 : i + 2]).all():
        return float(x[i])
    a, b, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    return float(x[i] - b / (2 * a)) if a < 0 else float(x[i])


def best_tried(places: Sequence[float], scores: Sequence[float]) -> float | None:
    """The place of the highest score itself, for what cannot be set between. None without any score."""
    y = np.asarray(scores, dtype=np.float64)
    return float(places[int(np.nanargmax(y))]) if np.isfinite(y).any() else None


# --- shots -------------------------------------------------------------------------------------------------------


def check_shot(frame: RawFrame, facts: Facts) -> Advice:
    """A shot that counts shows the whole chart, exposed as the trial was, and nothing clipped."""
    changed = changed_settings(frame.exposure, facts_as(PatternFacts, facts))
    if changed:
        return Advice(False, f"This shot does not count: {changed}. Set it back and take it again.")
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    advice = check_light(frame, facts)
    if not advice.good and "exposure_ev" in advice.by_hand:
        return advice
    return Advice(True, "This shot counts.", advice.readings, marks=advice.marks)
