"""Checks of a trial photograph of the chart: light, distance, orientation, focus, and how to correct them. Pure.

Every check takes the frame and the facts so far, and returns an `Advice` with one action.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procedures.advice import changed_settings, exposure_advice, paper_level
from procedures.numbers import MTF50_RADIAL, MTF_NYQUIST, RADIAL, S_OVER_T
from procedures.numerics.warps import fit_homography
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.distance.consistency import cautious_mm, probe_mm, seed_contradiction, size_contradiction
from procedures.pattern_psf.distance.ranging import LASER_REACH_MM, look_now, range_facts, range_readings
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import MONOCHROME, MOSAIC, RATIO, RATIO_HIGH, RATIO_LOW, PatternFacts, RangeLook
from procedures.pattern_psf.outline import SHEET, frontal_outline, present_outline
from procedures.pattern_psf.pose import ChartPose, ImagingGeometry, chart_pose
from procedures.pattern_psf.radiometry import measure_light
from procedures.pattern_psf.registration import Registration, block_size_px, refine_corners, register_marks
from procedures.plan import Advice, Facts, Outline, Points, Reading, facts_as
from procedures.raw import Plane, RawFrame

PREFERRED_PLANES = ("G1", "Y")  # planes used for geometry, in order of preference
FLAT = 0.8  # least level of the darkest white block over the brightest
CENTRED = 0.12  # greatest distance of the chart's centre from the frame's, as a fraction of the frame's width
SQUARE_DEG, ROLL_DEG = 1.5, 5.0
"""Tolerance of yaw and pitch, and of roll, which only rotates the PSF's axes on the chart."""


def shown(frame: RawFrame) -> Plane:
    """Plane used for geometry."""
    return next(
        (frame.planes[name] for name in PREFERRED_PLANES if name in frame.planes), next(iter(frame.planes.values()))
    )


def seen_chart(plane: Plane, known: PatternFacts) -> ChartSighting | Advice:
    """The one chart in the frame, or advice on how to get one."""
    sightings = find_charts(plane.samples)
    if not sightings:
        say = "No chart is found: aim at it so that all of it is in the frame, and focus on it."
        return Advice(False, say, by_hand={"aim": 1.0})
    if len(sightings) > 1:
        return Advice(False, f"{len(sightings)} charts are found: cover all but one.")
    sighting = sightings[0]
    if sighting.negative:
        return Advice(False, "The photograph is a negative: the chart's white is dark. Use a linear picture.")
    if sighting.mirrored:
        return Advice(False, "The chart is mirrored: photograph it directly, not in a mirror or from its back.")
    cut = sighting.cut_marks(plane.samples.shape)
    if cut:
        # advice where the frame cuts the chart: the shift of the camera, once the lens is known
        say = f"The frame cuts the chart: {cut} of its 12 marks are outside. Aim at its middle."
        moves: dict[str, float] = {}
        if known.lens_known:
            pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, known.optics(plane.pitch))
            moves = {"x_mm": pose.centre_mm[0], "y_mm": -pose.centre_mm[1]}
        return Advice(False, say, moves=moves, by_hand={"aim": 1.0}, marks=marks_of(sighting))
    return sighting


def marks_of(sighting: ChartSighting) -> Points:
    """Visible marks, for the preview."""
    return tuple((float(x), float(y)) for x, y in sighting.corners[sighting.visible])


def registered(plane: Plane, sighting: ChartSighting) -> Registration:
    """Registration by the marks alone."""
    block = block_size_px(register_marks(sighting.corners))
    return register_marks(refine_corners(plane.samples, sighting.corners, block))


def check_light(frame: RawFrame, facts: Facts) -> Advice:
    """Check exposure (white at 80 % in the brightest plane), evenness, clipping, and a visible chart; records the
    sensor's kind too."""
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
        # advice on the direction in which the illumination falls off
        _, x, y = brightest.white[:3]
        across = abs(x) > abs(y)
        dark = ("left" if x > 0 else "right") if across else ("upper" if y > 0 else "lower")
        share = 100 * brightest.flatness
        say = f"The chart's {dark} side has {share:.0f} % of the brightest level: add light on that side."
        advice = Advice(False, say, by_hand={"even_light": 1.0})
    readings = (*advice.readings, flatness)
    advice = replace(advice, facts={**advice.facts, "white_percent": 100 * float(brightest.white[0])})
    advice = replace(advice, readings=readings, marks=marks_of(sighting), moves={})
    return with_cell_check(advice, plane, sighting, known) if advice.good else advice


def with_cell_check(advice: Advice, plane: Plane, sighting: ChartSighting, known: PatternFacts) -> Advice:
    """The advice, unless the chart shows other cells than its number's; confirmed cells are not checked again."""
    if known.seed_agreement is not None:
        return advice
    agreement = seed_contradiction(plane, sighting, known)
    if isinstance(agreement, Advice):
        return replace(agreement, readings=advice.readings, facts=advice.facts, marks=advice.marks)
    return advice if agreement is None else replace(advice, facts={**advice.facts, "seed_agreement": agreement})


def check_distance(frame: RawFrame, facts: Facts) -> Advice:
    """Check s/t, the chart's centring, and that sizes and distances agree with lens, sensor and print."""
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, outline=in_the_middle(plane, known))
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
    if wrong is not None:  # before any move, which would be computed from wrong numbers
        return replace(wrong, readings=readings, marks=marks_of(sighting))
    new_facts = range_facts(look, optics, known)
    new_facts[S_OVER_T] = ratio
    draft = Advice(True, "", (*readings, *range_readings(new_facts)), facts=new_facts, marks=marks_of(sighting))
    wanted = in_the_middle(plane, known).wanted
    return replace(distance_advice(draft, look, pose, known), outline=to_match(sighting, wanted))


def in_the_middle(plane: Plane, known: PatternFacts) -> Outline:
    """Where a chart that is not found is wanted."""
    return Outline((), frontal_outline(plane.samples.shape, known.wanted_px_per_cell))


def to_match(sighting: ChartSighting, wanted: Points) -> Outline:
    """The chart's sheet as it is, and as it is wanted."""
    return Outline(present_outline(sighting.H_sensor_pattern), wanted)


def distance_advice(draft: Advice, look: RangeLook, pose: ChartPose, known: PatternFacts) -> Advice:
    """Next action on the distance: correct s/t, centre the chart, or move to verify the lens's data."""
    z, ratio = pose.centre_mm[2], draft.readings[0].value
    # the focus stays unchanged, so the image size is proportional to 1 / z
    change = cautious_mm(z * (ratio / RATIO - 1), look, z, known)
    if not draft.readings[0].good:
        say = f"Move the camera {_direction(change)}: s/t is {ratio:.2f} and should be {RATIO:g}."
        return replace(draft, good=False, say=say, moves={"z_mm": change})
    if not all(reading.good for reading in draft.readings[:4]):
        return aim(pose, draft.readings, draft.facts, draft.marks)
    if not all(reading.good for reading in draft.readings[4:]):
        say = (
            f"The laser reads as if it were {draft.readings[4].value:.0f} mm behind the lens; at most "
            f"{LASER_REACH_MM:.0f} mm is plausible. Aim it at the chart's wall."
        )
        plausible = {name: value for name, value in draft.facts.items() if name != "laser_offset_mm"}
        return replace(draft, good=False, say=say, facts=plausible, by_hand={"aim_laser": 1.0})
    probe = probe_mm(look, z, ratio < RATIO, known)
    if probe:
        say = f"Move the camera {_direction(probe)}: a second distance verifies the data of lens, sensor and print."
        return replace(draft, good=False, say=say, moves={"z_mm": probe})
    return replace(draft, say=f"The distance is good: {z / 1000:.2f} m, s/t {ratio:.2f}.")


def _direction(change_mm: float) -> str:
    return f"{'back' if change_mm > 0 else 'closer'} by {abs(change_mm) / 1000:.2f} m"


def centre_readings(pose: ChartPose, plane: Plane, optics: ImagingGeometry) -> tuple[Reading, Reading]:
    """Offset of the chart's centre from the frame's, in per cent of the frame's width."""
    x, y, z = pose.centre_mm
    scale = 100 * optics.principal_px(z) / z / plane.samples.shape[1]
    limit = 100 * CENTRED
    return Reading("right of centre", scale * x, "%", -limit, limit), Reading(
        "below centre", scale * y, "%", -limit, limit
    )


def aim(pose: ChartPose, readings: tuple[Reading, ...], facts: Facts, marks: Points) -> Advice:
    """Advice to centre the chart by shifting the camera parallel to it."""
    x, y, _ = pose.centre_mm
    across = f"{abs(x):.0f} mm to the {'right' if x > 0 else 'left'}"
    down = f"{abs(y):.0f} mm {'down' if y > 0 else 'up'}"
    say = f"Shift the camera {across} and {down}: the chart is off centre."
    return Advice(False, say, readings, moves={"x_mm": x, "y_mm": -y}, facts=facts, marks=marks)


def check_square(frame: RawFrame, facts: Facts) -> Advice:
    """Check that the chart is perpendicular to the optical axis and centred."""
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, outline=in_the_middle(plane, known))
    optics, H, limit = known.optics(plane.pitch), sighting.H_sensor_pattern, 2 * SQUARE_DEG
    estimate = estimate_psf(plane, known.chart, known.quick_parameters).value
    if estimate is not None:  # the noise cells determine the angles to 0.1°, the marks alone to 2°
        grid = np.stack(np.meshgrid(*2 * [np.linspace(0, CELLS, 9)]), axis=-1).reshape(-1, 2)
        H, limit = fit_homography(grid, estimate.registration.to_sensor(grid)), SQUARE_DEG
    pose = chart_pose(H, plane.samples.shape, optics)
    half_mm = SHEET * CELLS / 2 * optics.cell_mm
    advice = square_advice(pose, centre_readings(pose, plane, optics), marks_of(sighting), limit, half_mm)
    wanted = frontal_outline(plane.samples.shape, float(sighting.widths().mean()) / CELLS)
    return replace(advice, outline=Outline(present_outline(H), wanted))


def square_advice(
    pose: ChartPose, centre: tuple[Reading, ...], marks: Points, limit_deg: float, half_mm: float
) -> Advice:
    """Advice with one correction that squares the chart, a sheet of half-width `half_mm`; roll first, which only the
    operator can correct."""
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
        return square_up(pose, readings, marks, half_mm)
    if not all(reading.good for reading in readings):
        return aim(pose, readings, {}, marks)
    say = f"The chart is square: yaw {pose.yaw_deg:+.1f}°, pitch {pose.pitch_deg:+.1f}°, roll {pose.roll_deg:+.1f}°."
    tilt_deg = max(abs(pose.yaw_deg), abs(pose.pitch_deg))
    return Advice(True, say, readings, facts={"tilt_deg": tilt_deg}, marks=marks)


def square_up(pose: ChartPose, readings: tuple[Reading, ...], marks: Points, half_mm: float) -> Advice:
    """Advice to turn the chart, larger angle first; or to pan and tilt the head and shift the camera."""
    yaw, pitch = pose.yaw_deg, pose.pitch_deg
    if abs(yaw) >= abs(pitch):
        edge, by_hand = "right" if yaw > 0 else "left", {"chart_yaw_deg": -yaw}
    else:
        edge, by_hand = "upper" if pitch > 0 else "lower", {"chart_pitch_deg": -pitch}
    ((name, angle),) = by_hand.items()
    verb = "Turn" if name == "chart_yaw_deg" else "Tip"
    by = f"{half_mm * float(np.sin(np.radians(abs(angle)))):.0f} mm ({abs(angle):.1f}°)"
    say = f"{verb} the chart about its middle: its {edge} edge away from the camera by {by}."
    x, y, z = pose.centre_mm
    moves = {
        "pan_deg": yaw,
        "tilt_deg": pitch,
        "x_mm": x - z * float(np.tan(np.radians(yaw))),
        "y_mm": -y - z * float(np.tan(np.radians(pitch))),
    }
    return Advice(False, say, readings, moves=moves, by_hand=by_hand, marks=marks)


def sharpness(frame: RawFrame, facts: Facts) -> float:
    """MTF50 of the PSF in the plane used for geometry, in cycles/pixel; NaN where there is no PSF."""
    known = facts_as(PatternFacts, facts)
    estimate = estimate_psf(shown(frame), known.chart, known.quick_parameters).value
    if estimate is None:
        return float("nan")
    numbers = estimate.quality.numbers
    mtf = numbers.get(MTF50_RADIAL) or numbers.get(MTF_NYQUIST[RADIAL])
    return mtf.value if mtf else float("nan")


def best_place(places: Sequence[float], scores: Sequence[float]) -> float | None:
    """Position of the highest score, by a parabola through the best and its neighbours; None without any score."""
    x, y = np.asarray(places, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    if not np.isfinite(y).any():
        return None
    i = int(np.nanargmax(y))
    if i in (0, len(x) - 1) or not np.isfinite(y[i - 1 : i + 2]).all():
        return float(x[i])
    a, b, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    return float(x[i] - b / (2 * a)) if a < 0 else float(x[i])


def best_tried(places: Sequence[float], scores: Sequence[float]) -> float | None:
    """Tried position of the highest score, for settings without intermediate values; None without any score."""
    y = np.asarray(scores, dtype=np.float64)
    return float(places[int(np.nanargmax(y))]) if np.isfinite(y).any() else None


def check_shot(frame: RawFrame, facts: Facts) -> Advice:
    """Check that a shot shows the whole chart, unclipped, exposed as the trial was."""
    if changed := changed_settings(frame.exposure, facts_as(PatternFacts, facts)):
        return Advice(False, f"This shot is rejected: {changed}. Restore the setting and take it again.")
    plane, known = shown(frame), facts_as(PatternFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, outline=in_the_middle(plane, known))
    advice = check_light(frame, facts)
    if not advice.good and "exposure_ev" in advice.by_hand:
        return advice
    return Advice(True, "This shot is accepted.", advice.readings, marks=advice.marks)
