"""The plan of the PSF over the frame: one photograph of the chart at each of many places of it.

The chart hangs where it is; the camera turns on its head, or shifts along the chart, so that it appears elsewhere. How
the field is put together of the photographs is told by whoever makes the plan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.facts import AxisTravel, facts_as
from procedures.field.conclusion import SMALL_SHARE
from procedures.field.facts import BASE, FieldFacts, TourStart
from procedures.field.locations import Location, chosen_locations, direction, pan_tilt_deg, rail_mm, ray
from procedures.numerics.scattered import hull_area
from procedures.numerics.warps import apply_homography
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.checks import check_distance, check_light, marks_of, registered, seen_chart, shown
from procedures.pattern_psf.facts import RATIO_HIGH, RATIO_LOW, SIZES
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.pattern_psf.pose import chart_pose
from procedures.pattern_psf.radiometry import measure_light
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Fact,
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

Array = npt.NDArray[np.float64]
Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
BEFORE = ("print", "mount", "distance", "square", "focus")
"""Steps that are the pattern PSF's."""
USUAL, FEWEST, MOST = 9, 6, 400
"""Places: fewer than six determine no field."""
SHEET = 1.3
"""Side of the chart with its marks and a white rim, over that of its noise region."""
ROOM = 0.4
"""The chart's half, in parts of the frame, from which on there is no room to move it."""
NEAR = 0.03
"""How far from its place the chart may appear, in parts of the frame's width."""
LEAST_WHITE = 0.2
"""Of the scale: towards the corners a lens is darker, and noise grows."""
MOST_CLIPPED = 0.005


def plan(estimate: Estimator) -> Plan:
    """The guided calibration of a field."""
    begin = pattern_plan()
    return Plan(
        "field",
        "PSF over the frame, from the chart at many places",
        (
            *(begin.step(name) for name in BEFORE),
            Step(
                "places",
                "Places",
                "Choose how many places of the frame to measure.",
                PLACES,
                drawings.TOUR,
                gave_places,
            ),
            Step("tour", "Tour", "One photograph of the chart at each place.", (Tour(stops),), drawings.TOUR),
            Step("estimate", "Estimate", "Put the field together from all photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the tour again.", (Decide("tour"),)),
        ),
        subject="frame",
        facts=FieldFacts,
    )


def gave_places(facts: Facts) -> str:
    """How many places were chosen."""
    places = facts_as(FieldFacts, facts).places
    return "" if places is None else f"{places:.0f} places"


# --- where the tour begins ---------------------------------------------------------------------------------------


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """The chart in the middle, as large as wanted, with room to move; where everything then is becomes known."""
    advice = check_distance(frame, facts)
    if not advice.good:
        return advice
    plane, known = shown(frame), facts_as(FieldFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    half = half_size(sighting, plane)
    if max(half) > ROOM:
        return small_frame(advice)
    start = start_facts(sighting, plane, known)
    return replace(advice, facts={**advice.facts, **start, "tour_half_x": half[0], "tour_half_y": half[1]})


def check_places(frame: RawFrame, facts: Facts) -> Advice:
    """The same, and places that enclose as much of the frame as the result needs."""
    advice = check_start(frame, facts)
    if not advice.good:
        return advice
    places = locations({**facts, **advice.facts})
    share = hull_area(np.array([(one.x, one.y) for one in places]))
    enclosed = Reading("enclosed by the places", 100 * share, "% of the frame", 100 * SMALL_SHARE)
    advice = replace(advice, readings=(*advice.readings, enclosed))
    return advice if enclosed.good else small_frame(advice)


def small_frame(advice: Advice) -> Advice:
    """The advice where the chart, which has its best size in pixels at any distance, is too large for the frame."""
    say = (
        "The frame is too small for the chart, whose best size in pixels is the same at every distance: set the camera "
    )
    return replace(advice, good=False, say=f"{say}to its whole sensor, without binning or a region of interest.")


def half_size(sighting: ChartSighting, plane: Plane) -> tuple[float, float]:
    """Half the width and height that the sheet takes of the frame, in parts of the frame's."""
    side = SHEET * CELLS / 2
    corners = CELLS / 2 + side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    reach = np.abs(apply_homography(sighting.H_sensor_pattern, corners) - sighting.centre()).max(axis=0)
    rows, columns = plane.samples.shape
    return float(reach[0]) / columns, float(reach[1]) / rows


def start_facts(sighting: ChartSighting, plane: Plane, known: FieldFacts) -> dict[str, Fact]:
    """What the moves of the tour follow from: lens, distance, where the chart is in the frame, where the axes are."""
    optics, shape = known.optics(plane.pitch), plane.samples.shape
    distance_mm = chart_pose(sighting.H_sensor_pattern, shape, optics).centre_mm[2]
    at = seen_at(sighting, plane)
    told: dict[str, Fact] = {
        "tour_rows": float(shape[0]),
        "tour_columns": float(shape[1]),
        "tour_principal_px": optics.principal_px(distance_mm),
        "tour_distance_mm": distance_mm,
        "tour_x": at.x,
        "tour_y": at.y,
    }
    return told | {BASE + name: place for name, place in known.where().items()}


def seen_at(sighting: ChartSighting, plane: Plane) -> Location:
    """Where the chart's centre appears."""
    (x, y), (rows, columns) = sighting.centre(), plane.samples.shape
    return Location((float(x) + 0.5) / columns, (float(y) + 0.5) / rows)


PLACES = (
    Ask("places", "At how many places?", "number", "", USUAL, low=FEWEST, high=MOST),
    Look("light", check_light),
    Look("start", check_places, tries=10, rests_on=SIZES),
)

# --- the places --------------------------------------------------------------------------------------------------


def locations(facts: Facts) -> list[Location]:
    """Where the chart's centre shall be: as near to the frame's sides as the whole sheet allows."""
    known = facts_as(FieldFacts, facts)
    start = known.begun()
    rim_x, rim_y = (half + NEAR for half in start.half)
    rows, columns = start.shape
    found = chosen_locations(USUAL if known.places is None else int(known.places), columns / rows, margin=0.0)
    return [Location(rim_x + (1 - 2 * rim_x) * one.x, rim_y + (1 - 2 * rim_y) * one.y) for one in found]


def stops(facts: Facts) -> list[TourStop]:
    """The tour: a place of the frame each."""
    found = locations(facts)
    names = [f"place {i} of {len(found)}" for i in range(1, len(found) + 1)]
    return [stop(name, location) for name, location in zip(names, found, strict=True)]


def stop(name: str, location: Location) -> TourStop:
    """One place."""
    return TourStop(name, Go(partial(to_place, location), partial(say_place, location)), partial(check_place, location))


def say_place(location: Location, facts: Facts) -> str:
    """Where the chart shall appear, for the operator."""
    where = f"{100 * location.x:.0f} % from the left and {100 * location.y:.0f} % from the top of the frame"
    if to_place(location, facts):
        return f"going where the chart appears {where}"
    return f"Turn the camera, and leave the chart, until the chart's middle is {where}."


def to_place(location: Location, facts: Facts) -> dict[str, float]:
    """Where head or rail go from where the tour began; nothing where there is neither.

    A camera that turns sees the chart the nearer, along its axis, the farther off it is: the rail makes up for that,
    as far as it goes, and focus and size stay as they were.
    """
    known = facts_as(FieldFacts, facts)
    start = known.start
    if start is None:
        return {}
    places = bring(start.seen_at, location, start.base, start)
    if "pan_deg" in places and "z_mm" in start.base:
        ahead, there = (float(ray(one, start.shape, start.principal_px)[2]) for one in (start.seen_at, location))
        z = start.base["z_mm"] + start.distance_mm * (ahead / there - 1)
        places["z_mm"] = known.axes.get("z_mm", AxisTravel()).nearest(z)
    return places


def bring(now: Location, wanted: Location, at: Mapping[str, float], start: TourStart) -> dict[str, float]:
    """Where the axes, now `at`, must go so that the chart is seen at another place; nothing without head or rail."""
    shape, principal_px = start.shape, start.principal_px
    if {"pan_deg", "tilt_deg"} <= set(at):
        towards = direction(ray(now, shape, principal_px), at["pan_deg"], at["tilt_deg"])
        pan, tilt = pan_tilt_deg(wanted, shape, principal_px, towards)
        return {"pan_deg": pan, "tilt_deg": tilt}
    if {"x_mm", "y_mm"} <= set(at):
        before, then = (rail_mm(one, shape, principal_px, start.distance_mm) for one in (now, wanted))
        return {"x_mm": at["x_mm"] + then[0] - before[0], "y_mm": at["y_mm"] - (then[1] - before[1])}
    return {}


# --- a photograph at a place -------------------------------------------------------------------------------------


def check_place(location: Location, frame: RawFrame, facts: Facts) -> Advice:
    """The chart where it is wanted, as large as wanted, with the settings of the trial, neither clipped nor dark."""
    plane, known = shown(frame), facts_as(FieldFacts, facts)
    changed = changed_settings(frame.exposure, known)
    if changed:
        return Advice(False, f"This shot does not count: {changed}. Set it back.")
    found = seen_chart(plane, known)
    if isinstance(found, Advice):
        cut = find_charts(plane.samples)[0] if found.marks else None
        return replace(found, by_hand={}, moves=correction(location, cut, plane, known) if cut else {})
    marks = marks_of(found)
    off, ratio = (
        off_place(location, found, plane),
        known.s_or_start * float(found.widths().max()) / CELLS,
    )
    readings = (
        Reading("off its place", 100 * off, "% of the width", None, 100 * NEAR),
        Reading("s/t", ratio, "", RATIO_LOW, RATIO_HIGH),
        *light_readings(frame, found),
    )
    if not readings[0].good:
        say = f"The chart is {100 * off:.0f} % of the frame's width off its place. {say_place(location, {})}"
        return Advice(False, say, readings, moves=correction(location, found, plane, known), marks=marks)
    bad = next((reading for reading in readings if not reading.good), None)
    if bad is not None:
        return Advice(False, f"{REMEDIES[bad.name]} ({bad.name} {bad.value:.3g} {bad.unit})", readings, marks=marks)
    return Advice(True, "The chart is in its place.", readings, marks=marks)


REMEDIES = {
    "s/t": "The chart appears too large or too small: bring the camera back to the distance of the start.",
    "clipped": "White is clipped here: keep glare off the chart.",
    "white": "The chart is too dark here: keep shadows off it.",
}


def light_readings(frame: RawFrame, sighting: ChartSighting) -> tuple[Reading, Reading]:
    """White of the brightest plane, and what is clipped of it, where the chart is now."""
    registration = registered(shown(frame), sighting)
    lights = [measure_light(one.samples, registration, one.quantisation) for one in frame.planes.values()]
    white, clipped = max(float(one.white[0]) for one in lights), max(one.saturated for one in lights)
    return (
        Reading("white", 100 * white, "%", 100 * LEAST_WHITE, None),
        Reading("clipped", 100 * clipped, "%", None, 100 * MOST_CLIPPED),
    )


def off_place(location: Location, sighting: ChartSighting, plane: Plane) -> float:
    """How far the chart's centre is from where it shall be, in parts of the frame's width."""
    shape = plane.samples.shape
    x, y = sighting.centre() - np.array(location.in_pixels((shape[0], shape[1])))
    return float(np.hypot(x, y)) / float(shape[1])


def correction(location: Location, sighting: ChartSighting, plane: Plane, known: FieldFacts) -> dict[str, float]:
    """How far the axes must move from where they are."""
    at = known.where()
    there = bring(seen_at(sighting, plane), location, at, known.begun())
    return {name: place - at[name] for name, place in there.items()}
