"""The plan of a camera's geometry: the chart in a dozen poses, each the one that the projection gains most by.

Which pose that is follows from those taken already, the lens as its data sheet has it, and the chart (`next_view`). The
head brings the chart to its place in the frame, hands turn it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.facts import facts_as
from procedures.field import plan as field_plan
from procedures.field.facts import TourStart
from procedures.field.locations import Location
from procedures.field.plan import MOST_CLIPPED, correction, light_readings, off_place, to_place
from procedures.geometry.cameras import Camera, simple_camera
from procedures.geometry.chart_bins.photographs import view_of
from procedures.geometry.estimate import GeometryParameters, calibrate_geometry
from procedures.geometry.facts import GeometryFacts, ViewPose, as_pose, pose_facts
from procedures.geometry.next_view import COVER, NextView, corner_share, next_view_words, planned_view
from procedures.geometry.views import ChartView, chart_nodes
from procedures.outcome import Outcome, Refused, Verdict
from procedures.pattern_psf.checks import check_light, marks_of, seen_chart, shown
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.pattern_psf.pose import ChartPose, chart_pose
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Facts,
    Go,
    Known,
    Look,
    Outcomes,
    Plan,
    Reading,
    Step,
    Tour,
    TourStop,
)
from procedures.raw import Plane, RawFrame

BEFORE = ("print", "mount", "distance", "focus")
"""Steps that are the pattern PSF's."""
USUAL, FEWEST, MOST = 12, 6, 60
"""Views: fewer than six cannot be held against each other."""
NEAR = 0.05
"""How far from its place the chart may appear, in parts of the frame's width: any place near it tells as much."""
TURN_DEG = 7.0
"""How far its turn may be from the one wanted."""
SURE_DEG, STEP_DEG = 20.0, 25.0
"""A turn below the first is told by perspective alone, which distortion looks like: from there the chart is turned by
the second at most before it is looked at again, so that it is not turned out of sight."""
LEAST_WHITE = 0.15
"""Of the scale: a chart that is turned away is darker."""
SCATTER_PX = 0.02
"""Of a point in a photograph, in sensor pixels: what next views are weighed by, not what they will be known to."""


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
                drawings.TOUR, gave_wanted,
            ),
            Step(
                "views", "Views", "One photograph of the chart in each pose.", (Tour(stops),),
                drawings.VIEWS, gave_views,
            ),
            Step("estimate", "Estimate", "Put the camera together from all views.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the views again.", (Decide("views"),)),
        ),
        subject="frame",
        facts=GeometryFacts,
    )  # fmt: skip


def gave_wanted(facts: Facts) -> str:
    """How many views were chosen."""
    views = facts_as(GeometryFacts, facts).views
    return "" if views is None else f"{views:.0f} views"


def gave_views(facts: Facts) -> str:
    """How many were taken."""
    poses = facts_as(GeometryFacts, facts).poses
    return f"{len(poses)} views" if poses else ""


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """As the field's, and charts in the frame's corners must cover as much of it as the result needs."""
    advice = field_plan.check_start(frame, facts)
    if not advice.good:
        return advice
    known = facts_as(GeometryFacts, {**facts, **advice.facts})
    start = known.begun()
    camera = camera_as_told(start.shape, start.principal_px)
    share = corner_share(camera, chart_nodes(known.cell_mm), start.distance_mm, rim_of(start))
    covered = Reading("covered by the corner views", 100 * share, "% of the frame", 100 * COVER)
    advice = replace(advice, readings=(*advice.readings, covered))
    return advice if covered.good else field_plan.small_frame(advice)


START = (
    Ask("views", "How many views?", "number", "", USUAL, low=FEWEST, high=MOST),
    Look("light", check_light),
    Look("start", check_start, tries=10, rests_on=SIZES),
)

# --- which view is next ------------------------------------------------------------------------------------------


def pose_wanted(number: int, known: GeometryFacts) -> NextView:
    """The pose that the projection gains most by, after the views before. Raises Refused where none fits."""
    start = known.begun()
    before, rim = known.before(number), rim_of(start)
    found = _planned(before, start.shape, start.principal_px, start.distance_mm, known.cell_mm, rim)
    if found is None:
        raise Refused("the chart fits into the frame in no pose", "go farther away, or print a smaller chart")
    return found


def rim_of(start: TourStart) -> tuple[float, float]:
    """How near to the frame's sides the chart's centre may come, in parts of the frame."""
    return start.half[0] + NEAR, start.half[1] + NEAR


def camera_as_told(shape: tuple[int, int], principal_px: float) -> Camera:
    """The camera as its data sheet has it, in the plane's pixels."""
    rows, columns = shape
    centre = ((columns - 1) / 2, (rows - 1) / 2)
    return simple_camera("OPENCV", (principal_px, principal_px), centre, (columns, rows))


@lru_cache(maxsize=64)
def _planned(
    poses: tuple[ChartPose, ...], shape: tuple[int, int], principal_px: float, distance_mm: float, cell_mm: float,
    rim: tuple[float, float],
) -> NextView | None:  # fmt: skip
    camera = camera_as_told(shape, principal_px)
    return planned_view(camera, [as_pose(one) for one in poses], chart_nodes(cell_mm), distance_mm, SCATTER_PX, rim)


def stops(facts: Facts) -> list[TourStop]:
    """As many as are wanted; where each is, is told by the views before it."""
    wanted = facts_as(GeometryFacts, facts).views
    count = USUAL if wanted is None else int(wanted)
    return [TourStop(f"view {i} of {count}", way_to(i), partial(check_view, i)) for i in range(1, count + 1)]


def way_to(number: int) -> Go:
    """The way to a view."""
    return Go(partial(to_view, number), partial(say_view, number))


def to_view(number: int, facts: Facts) -> dict[str, float]:
    """Where the head goes so that the chart appears in the place wanted; nothing where there is none."""
    return to_place(Location(*pose_wanted(number, facts_as(GeometryFacts, facts)).at), facts)


def say_view(number: int, facts: Facts) -> str:
    """The pose for the operator."""
    words = next_view_words(pose_wanted(number, facts_as(GeometryFacts, facts)))
    if to_view(number, facts):
        return f"going where the chart appears in {words.partition(',')[0]}"
    return f"Turn the camera, and the chart, until it is seen in {words}."


# --- a photograph of a view --------------------------------------------------------------------------------------


def check_view(number: int, frame: RawFrame, facts: Facts) -> Advice:
    """The chart in the pose wanted, with the settings of the trial, neither clipped nor dark."""
    plane, known = shown(frame), facts_as(GeometryFacts, facts)
    changed = changed_settings(frame.exposure, known)
    if changed:
        return Advice(False, f"This view does not count: {changed}. Set it back.")
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, moves={})
    wanted = pose_wanted(number, known)
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
        say = f"The chart is off its place: it shall be seen in {next_view_words(wanted)}."
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
    """Both turns at once: by the rig, where the chart hangs on axes of these names, else by hand."""
    yaw, pitch = turn_by(pose.yaw_deg, wanted.yaw_deg), turn_by(pose.pitch_deg, wanted.pitch_deg)
    parts = []
    if not readings[1].good:
        parts.append(f"about its upright axis by {abs(yaw):.0f}°, its {'right' if yaw > 0 else 'left'} edge nearer")
    if not readings[2].good:
        parts.append(f"its {'upper' if pitch > 0 else 'lower'} edge nearer, by {abs(pitch):.0f}°")
    say = f"Turn the chart {' and '.join(parts)}."
    turns = {"chart_yaw_deg": yaw, "chart_pitch_deg": pitch}
    return Advice(False, say, readings, moves=turns, by_hand=turns, marks=marks)


def turn_by(seen_deg: float, wanted_deg: float) -> float:
    """By how much to turn the chart next."""
    turn = wanted_deg - seen_deg
    return turn if abs(seen_deg) >= SURE_DEG else min(max(turn, -STEP_DEG), STEP_DEG)


# --- estimate ----------------------------------------------------------------------------------------------------


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The camera from all views, by the plane that they were measured in."""
    told = facts_as(GeometryFacts, facts)
    name, size = _measured(shown(frames[0])) if frames else ("", (0, 0))
    views, reasons = seen_views(frames, told)
    found = calibrate_geometry(views, size, GeometryParameters(told.cell_mm))
    if found.value is None and reasons:
        return {name: replace(found, reason=f"{found.reason}; {reasons[0]}")}
    return {name: found}


def _measured(plane: Plane) -> tuple[str, tuple[int, int]]:
    """The plane's name, and columns and rows of the sensor."""
    rows, columns = plane.samples.shape
    return plane.name, (columns * plane.pitch, rows * plane.pitch)


def seen_views(frames: Sequence[RawFrame], told: GeometryFacts) -> tuple[list[ChartView], list[str]]:
    """The views of those photographs that tell one, and why the others tell none."""
    views: list[ChartView] = []
    reasons = []
    for frame in frames:
        try:
            seen = view_of(shown(frame), told.chart, frame.path.name)
        except Refused as refusal:
            seen = Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
        if seen.value is None:
            reasons.append(f"{frame.path.name}: {seen.reason}")
        else:
            views.append(seen.value)
    return views, reasons
