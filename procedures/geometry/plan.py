"""The guided calibration of a camera's geometry: the chart in a dozen poses, each the most informative one.

The pose follows from those already taken, the nominal lens and the chart (`next_view`). The head moves the chart to its
place in the frame; the operator turns it.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.field import plan as field_plan
from procedures.field.measuring import Location
from procedures.field.plan import MOST_CLIPPED, TourStart, correction, light_readings, off_place, to_place
from procedures.geometry.cameras import CameraModel, simple_camera
from procedures.geometry.chart_bins.photographs import view_of
from procedures.geometry.estimate import GeometryParameters, calibrate_geometry
from procedures.geometry.facts import FRAME, GeometryFacts, ViewPose, as_pose, place_of, pose_facts
from procedures.geometry.next_view import COVER, NextView, chart_at, corner_share, next_view_words, planned_view
from procedures.geometry.views import ChartView, chart_nodes
from procedures.outcome import Refused
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting
from procedures.pattern_psf.checks import check_light, marks_of, seen_chart, shown, to_match
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.outline import CORNERS, points_of
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.pattern_psf.pose import ChartPose, chart_pose
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Facts,
    Go,
    Goal,
    Known,
    Look,
    Outcomes,
    Outline,
    Plan,
    Reading,
    Step,
    Tour,
    TourStop,
    facts_as,
)
from procedures.raw import RawFrame

BEFORE = ("print", "mount", "distance", "focus")  # steps shared with the pattern PSF
USUAL, FEWEST, MOST = 12, 6, 60  # numbers of views: fewer than six do not allow cross-validation
NEAR = 0.05
"""Tolerance of the chart's position, as a fraction of the frame's width: nearby positions are as informative."""
TURN_DEG = 7.0  # tolerance of its yaw and pitch
SURE_DEG, STEP_DEG = 20.0, 25.0
"""A tilt below the first shows in perspective alone, which resembles distortion: from there the chart is turned by at
most the second before the next photograph, lest it be turned out of sight."""
LEAST_WHITE = 0.15  # least white of a usable photograph, in fractions of full scale: a tilted chart is darker
SCATTER_PX = 0.02  # standard deviation of a point, in sensor pixels, assumed for the choice of views


def plan() -> Plan:
    """The guided calibration of a camera's geometry."""
    begin = pattern_plan()
    return Plan(
        "geometry",
        "Intrinsics and distortion, from the chart in many poses",
        (
            *(begin.step(name) for name in BEFORE),
            Step(
                "start", "Start", "Choose how many views to take, the chart in the middle.", START,
                drawings.TOUR, "{views:.0f} views",
            ),
            Step(
                "views", "Views", "One photograph of the chart in each pose.", (Tour(stops),),
                drawings.VIEWS, views_taken,
            ),
            Step("estimate", "Estimate", "Put the camera together from all views.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the views again.", (Decide("views"),)),
        ),
        subject="frame",
        facts=GeometryFacts,
    )  # fmt: skip


def views_taken(facts: Facts) -> str:
    """Number of views taken."""
    poses = facts_as(GeometryFacts, facts).poses
    return f"{len(poses)} views" if poses else ""


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """The check of a field; in addition, charts in the corners must cover enough of the frame."""
    advice = field_plan.check_start(frame, facts)
    if not advice.good:
        return advice
    known = facts_as(GeometryFacts, {**facts, **advice.facts})
    start = known.begun()
    camera = nominal_camera(start.shape, start.principal_px)
    share = corner_share(camera, chart_nodes(known.cell_mm), start.distance_mm, rim_of(start))
    covered = Reading("covered by the corner views", 100 * share, "% of the frame", 100 * COVER)
    advice = replace(advice, readings=(*advice.readings, covered))
    return advice if covered.good else field_plan.small_frame(advice)


START = (
    Ask("views", "How many views?", "number", "", USUAL, low=FEWEST, high=MOST),
    Ask("aim", "Which place matters most? Per cent of the frame's width and height as 80,20, or frame for all of it.",
        "text", default=FRAME, check=lambda answer, facts: place_of(str(answer))),
    Look("light", check_light),
    Look("start", check_start, tries=10, rests_on=SIZES),
)  # fmt: skip

# --- the next view ---


def wanted_pose(number: int, known: GeometryFacts) -> NextView:
    """The most informative pose after the previous views. Raises Refused where none fits."""
    start = known.begun()
    before, rim = known.before(number), rim_of(start)
    view = _planned(before, start.shape, start.principal_px, start.distance_mm, known.cell_mm, rim, known.aimed_at)
    if view is None:
        raise Refused("the chart fits into the frame in no pose", "go farther away, or print a smaller chart")
    return view


def rim_of(start: TourStart) -> tuple[float, float]:
    """Least distance of the chart's centre from the sides, as fractions of the frame."""
    return start.half[0] + NEAR, start.half[1] + NEAR


def nominal_camera(shape: tuple[int, int], principal_px: float) -> CameraModel:
    """The camera according to its data sheet, in pixels of the plane."""
    rows, columns = shape
    centre = ((columns - 1) / 2, (rows - 1) / 2)
    return simple_camera("OPENCV", (principal_px, principal_px), centre, (columns, rows))


@lru_cache(maxsize=64)
def _planned(
    poses: tuple[ChartPose, ...], shape: tuple[int, int], principal_px: float, distance_mm: float, cell_mm: float,
    rim: tuple[float, float], aim: tuple[float, float] | None = None,
) -> NextView | None:  # fmt: skip
    camera, pixel = nominal_camera(shape, principal_px), None if aim is None else in_pixels(aim, shape[::-1])
    before = [as_pose(pose) for pose in poses]
    return planned_view(camera, before, chart_nodes(cell_mm), distance_mm, SCATTER_PX, rim, pixel)


def in_pixels(place: tuple[float, float], size: tuple[int, int]) -> tuple[float, float]:
    """The pixel at fractions of a frame of a size (columns, rows)."""
    return place[0] * (size[0] - 1), place[1] * (size[1] - 1)


def stops(facts: Facts) -> list[TourStop]:
    """The requested number of views; the pose of each follows from the previous ones."""
    wanted = facts_as(GeometryFacts, facts).views
    count = USUAL if wanted is None else int(wanted)
    return [
        TourStop(f"view {i} of {count}", way_to(i), partial(check_view, i), partial(view_goal, i))
        for i in range(1, count + 1)
    ]


def way_to(number: int) -> Go:
    """The move to a view."""
    return Go(partial(to_view, number), partial(say_view, number))


def to_view(number: int, facts: Facts) -> dict[str, float]:
    """Position of the head at which the chart appears in the wanted place; empty without a head."""
    return to_place(Location(*wanted_pose(number, facts_as(GeometryFacts, facts)).at), facts)


def say_view(number: int, facts: Facts) -> str:
    """Description of the move for the operator."""
    words = next_view_words(wanted_pose(number, facts_as(GeometryFacts, facts)))
    if to_view(number, facts):
        return f"moving until the chart appears in {words.partition(',')[0]}"
    return f"Turn the camera, and the chart, until it appears in {words}."


# --- a photograph of a view ---


def check_view(number: int, frame: RawFrame, facts: Facts) -> Advice:
    """The chart in the wanted pose, with the settings of the trial, neither clipped nor dark."""
    plane, known = shown(frame), facts_as(GeometryFacts, facts)
    if changed := changed_settings(frame.exposure, known):
        return Advice(False, f"This view does not count: {changed}. Set it back.")
    wanted = wanted_pose(number, known)
    # the chart's sheet in the wanted pose, by the nominal lens
    start = known.begun()
    camera = nominal_camera(start.shape, start.principal_px)
    corners = np.column_stack([(CORNERS - CELLS / 2) * known.cell_mm, np.zeros(len(CORNERS))])
    pose = chart_at(camera, wanted.at, wanted.yaw_deg, wanted.pitch_deg, wanted.distance_mm)
    outline = points_of(camera.project(pose.apply(corners)))
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, moves={}, outline=Outline((), outline))
    advice = pose_advice(number, wanted, sighting, frame, known)
    return replace(advice, outline=to_match(sighting, outline))


def view_goal(number: int, facts: Facts) -> Goal:
    """Predicted error of the projection, over the frame or at the wanted place, before this view and with it."""
    known = facts_as(GeometryFacts, facts)
    wanted = wanted_pose(number, known)
    left = int(USUAL if known.views is None else known.views) - number + 1
    return Goal(left, "Projection", "px of the plane", wanted.before, wanted.after)


def pose_advice(
    number: int, wanted: NextView, sighting: ChartSighting, frame: RawFrame, known: GeometryFacts
) -> Advice:
    """Advice on a chart in the frame: its turn, then its place, then its light."""
    plane = shown(frame)
    pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, known.optics(plane.pitch))
    location = Location(*wanted.at)
    white, clipped = light_readings(frame, sighting)
    readings = (
        Reading("off its place", 100 * off_place(location, sighting, plane), "% of the width", None, 100 * NEAR),
        Reading("yaw off", pose.yaw_deg - wanted.yaw_deg, "°", -TURN_DEG, TURN_DEG),
        Reading("pitch off", pose.pitch_deg - wanted.pitch_deg, "°", -TURN_DEG, TURN_DEG),
        replace(white, low=100 * LEAST_WHITE),
        replace(clipped, high=100 * MOST_CLIPPED),
    )
    marks = marks_of(sighting)
    if not (readings[1].good and readings[2].good):
        return turn_chart(pose, wanted, readings, marks)
    if not readings[0].good:
        say = f"The chart is off its place: it must appear in {next_view_words(wanted)}."
        return Advice(False, say, readings, moves=correction(location, sighting, plane, known), marks=marks)
    bad = next((reading for reading in readings if not reading.good), None)
    if bad is not None:
        return Advice(False, f"{REMEDIES[bad.name]} ({bad.name} {bad.value:.3g} {bad.unit})", readings, marks=marks)
    return Advice(True, f"View {number} counts.", readings, facts=pose_facts(ViewPose(number, pose)), marks=marks)


REMEDIES = {
    "white": "The chart is too dark in this pose: light it from the side that it faces.",
    "clipped": "White is clipped in this pose: keep glare off the chart.",
}


def turn_chart(
    pose: ChartPose, wanted: NextView, readings: tuple[Reading, ...], marks: tuple[tuple[float, float], ...]
) -> Advice:
    """Advice on both turns: by the rig where it has axes of these names, else by hand."""
    yaw, pitch = turn_by(pose.yaw_deg, wanted.yaw_deg), turn_by(pose.pitch_deg, wanted.pitch_deg)
    parts = []
    if not readings[1].good:
        parts.append(f"about its upright axis by {abs(yaw):.0f}°, its {'right' if yaw > 0 else 'left'} edge nearer")
    if not readings[2].good:
        parts.append(f"about its level axis by {abs(pitch):.0f}°, its {'upper' if pitch > 0 else 'lower'} edge nearer")
    say = f"Turn the chart {'; then '.join(parts)}."
    turns = {"chart_yaw_deg": yaw, "chart_pitch_deg": pitch}
    return Advice(False, say, readings, moves=turns, by_hand=turns, marks=marks)


def turn_by(present_deg: float, wanted_deg: float) -> float:
    """Next turn of the chart."""
    turn = wanted_deg - present_deg
    return turn if abs(present_deg) >= SURE_DEG else min(max(turn, -STEP_DEG), STEP_DEG)


# --- estimate ---


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The camera from all views, by the name of their plane."""
    known_facts = facts_as(GeometryFacts, facts)
    name, size = "", (0, 0)
    if frames:
        plane = shown(frames[0])
        name, size = plane.name, (plane.samples.shape[1] * plane.pitch, plane.samples.shape[0] * plane.pitch)
    views, reasons = chart_views(frames, known_facts)
    aim = known_facts.aimed_at
    advise_px = None if aim is None else in_pixels(aim, size)
    outcome = calibrate_geometry(views, size, GeometryParameters(known_facts.cell_mm, advise_px=advise_px))
    if outcome.value is None and reasons:
        return {name: replace(outcome, reason=f"{outcome.reason}; {reasons[0]}")}
    return {name: outcome}


def chart_views(frames: Sequence[RawFrame], facts: GeometryFacts) -> tuple[list[ChartView], list[str]]:
    """The views of the photographs, and the reasons why some give none."""
    views: list[ChartView] = []
    reasons = []
    for frame in frames:
        view = view_of(shown(frame), facts.chart, frame.path.name)
        if view.value is None:
            reasons.append(f"{frame.path.name}: {view.reason}")
        else:
            views.append(view.value)
    return views, reasons
