"""What a trial photograph of the chart tells about the rig: light, distance, turn, focus, and what to change. Pure.

Every check takes the frame and what is known so far, and gives an `Advice`: one thing to do at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.advice import changed_settings, exposure_advice, paper_level
from procedures.choice import START_K, START_S
from procedures.numerics.warps import fit_homography
from procedures.pattern import AIM_S_OVER_T, BEST_S_OVER_T, CELLS, DEFAULT_SEED, Chart
from procedures.pattern_print.rulers import LENGTH_MM
from procedures.pattern_print.sheet import Size
from procedures.pattern_psf.chart_finding.detection import Sighting, find_charts
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from procedures.pattern_psf.pose import ChartPose, Optics, chart_pose
from procedures.pattern_psf.radiometry import Light, measure_light
from procedures.pattern_psf.registration import Registration, block_size_px, refine_corners, register_marks
from procedures.plan import Advice, Fact, Facts, Reading
from procedures.raw import Plane, RawFrame

Array = npt.NDArray[np.float64]
Marks = tuple[tuple[float, float], ...]

SHOWN = ("G1", "Y")
"""The plane that geometry is told from."""
FLAT = 0.8
"""Least share of the brightest white block's light that the darkest must have."""
CENTRED = 0.12
"""How far the chart's centre may lie from the frame's, in parts of the frame's width."""
RATIO, (RATIO_LOW, RATIO_HIGH) = AIM_S_OVER_T, BEST_S_OVER_T
"""Aim and tolerance of s/t. At 1 the chart is as fine as the PSF's samples; with a camera that is sharper than its
pixels, the same number of shots has half the error at 1.3 (simulated: 24 mm at f/5.6 on pixels of 11.9 um)."""
SQUARE_DEG, ROLL_DEG = 1.5, 5.0
"""Tolerance of yaw and pitch, and of roll, which changes nothing but the PSF's axes on the chart."""


@lru_cache(maxsize=4)
def chart_of(seed: int) -> Chart:
    """The chart of a seed."""
    return Chart.from_seed(seed)


def known_chart(facts: Facts) -> Chart:
    """The chart that was printed."""
    return chart_of(chart_seed(facts))


def chart_seed(facts: Facts) -> int:
    """The seed of its cells."""
    return int(facts.get("chart_seed", DEFAULT_SEED))


def parameters_of(facts: Facts) -> PatternParameters:
    """How the PSF is to be sampled: as the facts say, else as the photograph lets the program choose."""
    if "s" not in facts or "k" not in facts:
        return PatternParameters()
    return PatternParameters(int(facts["s"]), int(facts["k"]), chosen=True)


def quick_parameters(facts: Facts) -> PatternParameters:
    """How a PSF is sampled whose sharpness alone is asked, many times over."""
    asked = parameters_of(facts)
    return asked if asked.s is not None else PatternParameters(START_S, START_K, chosen=True)


def number(facts: Facts, name: str, otherwise: float) -> float:
    """A fact as a number."""
    return float(facts.get(name, otherwise))


def cell_mm(facts: Facts) -> float:
    """Side of a printed cell: as ordered, corrected by what the printed ruler measured."""
    return Size(number(facts, "chart_width_mm", 300.0)).cell_mm * number(facts, "ruler_mm", LENGTH_MM) / LENGTH_MM


def optics_of(plane: Plane, facts: Facts) -> Optics:
    """What tells distances from sizes. Raises KeyError where the lens is not known."""
    pitch_um = float(facts["pixel_pitch_um"]) * plane.pitch
    return Optics(float(facts["focal_length_mm"]), pitch_um, cell_mm(facts))


def shown(frame: RawFrame) -> Plane:
    """The plane that geometry is told from."""
    return next((frame.planes[name] for name in SHOWN if name in frame.planes), next(iter(frame.planes.values())))


# --- is there a chart --------------------------------------------------------------------------------------------


def seen_chart(plane: Plane, facts: Facts) -> Sighting | Advice:
    """The one chart in the frame, or what to do so that there is one."""
    found = find_charts(plane.samples)
    if not found:
        say = "No chart is seen: aim at it so that all of it is in the frame, and focus on it."
        return Advice(False, say, by_hand={"aim": 1.0})
    if len(found) > 1:
        return Advice(False, f"{len(found)} charts are seen: cover all but one.")
    sighting = found[0]
    if sighting.mirrored:
        return Advice(False, "The chart is mirrored: photograph it directly, not in a mirror or through its back.")
    cut = sighting.cut_marks(plane.samples.shape)
    if cut:
        return cut_off(cut, sighting, plane, facts)
    return sighting


def cut_off(cut: int, sighting: Sighting, plane: Plane, facts: Facts) -> Advice:
    """What to do where the frame cuts the chart; how far to shift the camera, once the lens is known."""
    say = f"The frame cuts the chart: {cut} of its 12 marks are outside. Aim at its middle."
    moves: dict[str, float] = {}
    if {"focal_length_mm", "pixel_pitch_um"} <= set(facts):
        pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, optics_of(plane, facts))
        moves = {"x_mm": pose.centre_mm[0], "y_mm": -pose.centre_mm[1]}
    return Advice(False, say, moves=moves, by_hand={"aim": 1.0}, marks=marks_of(sighting))


def marks_of(sighting: Sighting) -> Marks:
    """The marks in sight, for the preview."""
    return tuple((float(x), float(y)) for x, y in sighting.corners[sighting.visible])


def registered(plane: Plane, sighting: Sighting) -> Registration:
    """The map by the marks alone."""
    block = block_size_px(register_marks(sighting.corners))
    return register_marks(refine_corners(plane.samples, sighting.corners, block))


# --- light -------------------------------------------------------------------------------------------------------


def check_light(frame: RawFrame, facts: Facts) -> Advice:
    """White at 80 % of the scale in the brightest plane, evenly lit, nothing clipped, the chart in sight."""
    plane = shown(frame)
    sighting = seen_chart(plane, facts)
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
    return Advice(
        advice.good, advice.say, readings, by_hand=advice.by_hand, facts=advice.facts, marks=marks_of(sighting)
    )


def uneven(light: Light) -> Advice:
    """Which way the light falls off, and where to move the lamp."""
    _, x, y = light.white[:3]
    across = abs(x) > abs(y)
    dark = ("left" if x > 0 else "right") if across else ("upper" if y > 0 else "lower")
    say = f"The chart's {dark} side is darker, at {100 * light.flatness:.0f} % of the brightest: light that side more."
    return Advice(False, say, by_hand={"even_light": 1.0})


# --- distance ----------------------------------------------------------------------------------------------------


def wanted_px_per_cell(facts: Facts) -> float:
    """Pixels of the plane per cell at the s/t that is aimed at."""
    return RATIO / (parameters_of(facts).s or START_S)


def expected_optics(facts: Facts, pitch: int = 2) -> Optics:
    """Lens and print, for a mosaic's planes, before any photograph. Raises KeyError where the lens is not known."""
    return Optics(float(facts["focal_length_mm"]), float(facts["pixel_pitch_um"]) * pitch, cell_mm(facts))


def wanted_distance_mm(facts: Facts, pitch: int = 2) -> float:
    """From how far to photograph, by the lens and the print. Raises KeyError where the lens is not known."""
    return expected_optics(facts, pitch).distance_mm(wanted_px_per_cell(facts))


def check_distance(frame: RawFrame, facts: Facts) -> Advice:
    """s/t near its best, and the chart in the middle of the frame."""
    plane = shown(frame)
    sighting = seen_chart(plane, facts)
    if isinstance(sighting, Advice):
        return sighting
    optics = optics_of(plane, facts)
    pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, optics)
    z, px_per_cell = pose.centre_mm[2], float(sighting.widths().max()) / CELLS
    ratio = (parameters_of(facts).s or START_S) * px_per_cell
    change = z * (ratio / RATIO - 1)  # the focus is left alone meanwhile: the size goes with 1 / z
    learned = range_facts(px_per_cell, optics, facts)
    readings = (
        Reading("s/t", ratio, "", RATIO_LOW, RATIO_HIGH),
        Reading("distance", z / 1000, "m"),
        *centre_readings(pose, plane, optics),
        *range_readings(learned),
    )
    marks = marks_of(sighting)
    if not readings[0].good:
        way = "back" if change > 0 else "closer"
        say = f"Move the camera {way} by {abs(change) / 1000:.2f} m: s/t is {ratio:.2f} and should be {RATIO:g}."
        return Advice(False, say, readings, moves={"z_mm": change}, facts=learned, marks=marks)
    if not all(reading.good for reading in readings):
        return aim(pose, readings, learned, marks)
    return Advice(
        True, f"The distance is good: {z / 1000:.2f} m, s/t {ratio:.2f}.", readings, facts=learned, marks=marks
    )


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


def range_facts(px_per_cell: float, optics: Optics, facts: Facts) -> dict[str, Fact]:
    """The laser's offset from the lens, by this look and those before it, and what the next look needs for it.

    With the focus left alone the image lies F pixels behind the lens, whatever the distance z: px = F cell / z, and
    the laser reads z + offset. Looks from distances that differ by a twentieth give F cell and the offset as the
    line's slope and intercept; before that the lens's data do, as if it were focused here.
    """
    if "distance_mm" not in facts:
        return {}
    number_of_looks = int(number(facts, "range_looks", 0.0)) + 1
    new: dict[str, Fact] = {
        "range_looks": float(number_of_looks),
        f"range_{number_of_looks}_cell_px": px_per_cell,
        f"range_{number_of_looks}_laser_mm": float(facts["distance_mm"]),
    }
    known = {**facts, **new}
    looks = range(1, number_of_looks + 1)
    pairs = [(number(known, f"range_{i}_cell_px", 1.0), number(known, f"range_{i}_laser_mm", 0.0)) for i in looks]
    offset = fit_offset_mm(pairs)
    return new | {"laser_offset_mm": pairs[-1][1] - optics.distance_mm(px_per_cell) if offset is None else offset}


def fit_offset_mm(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Where laser readings (mm) over pixels per cell would lie for the lens itself; None from hardly one distance."""
    px, laser = np.array(pairs).T
    if np.ptp(px) < 0.05 * px.mean():
        return None
    _, offset = np.polyfit(1 / px, laser, 1)
    return float(offset)


def range_readings(learned: Facts) -> tuple[Reading, ...]:
    """The laser's offset, where there is a laser."""
    return (Reading("laser behind lens", float(learned["laser_offset_mm"]), "mm"),) if learned else ()


# --- square ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Turned:
    """How the chart is turned, and whether the noise cells told it or only the marks."""

    pose: ChartPose
    fine: bool


def turned(plane: Plane, sighting: Sighting, facts: Facts) -> Turned:
    """The chart's pose; by the noise cells it is good to a tenth of a degree, by the marks alone to two degrees."""
    optics, shape = optics_of(plane, facts), plane.samples.shape
    found = estimate_psf(plane, known_chart(facts), quick_parameters(facts)).value
    if found is None:
        return Turned(chart_pose(sighting.H_sensor_pattern, shape, optics), False)
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, CELLS, 9)]), axis=-1).reshape(-1, 2)
    H = fit_homography(grid, found.registration.to_sensor(grid))
    return Turned(chart_pose(H, shape, optics), True)


def check_square(frame: RawFrame, facts: Facts) -> Advice:
    """The chart's plane across the optical axis, in the middle of the frame."""
    plane = shown(frame)
    sighting = seen_chart(plane, facts)
    if isinstance(sighting, Advice):
        return sighting
    found, optics = turned(plane, sighting, facts), optics_of(plane, facts)
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
    return Advice(True, say, readings, marks=marks)


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
    found = estimate_psf(shown(frame), known_chart(facts), quick_parameters(facts)).value
    if found is None:
        return float("nan")
    numbers = found.quality.numbers
    told = numbers.get("mtf50_radial") or numbers.get("mtf_nyquist_radial")
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
    changed = changed_settings(frame.exposure, facts)
    if changed:
        return Advice(False, f"This shot does not count: {changed}. Set it back and take it again.")
    plane = shown(frame)
    sighting = seen_chart(plane, facts)
    if isinstance(sighting, Advice):
        return sighting
    advice = check_light(frame, facts)
    if not advice.good and "exposure_ev" in advice.by_hand:
        return advice
    return Advice(True, "This shot counts.", advice.readings, marks=advice.marks)
