"""Plan of the PSF over the frame: one photograph of the chart at each of many positions.

The chart stays in place; the camera turns on its head, or shifts along the chart. The caller passes the estimator that
combines the photographs to a field.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.field.conclusion import SMALL_SHARE
from procedures.field.measuring import Location, chosen_locations, direction, pan_tilt_deg, rail_mm, ray
from procedures.numerics.scattered import hull_area
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.checks import check_distance, check_light, marks_of, registered, seen_chart, shown
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import RATIO_HIGH, RATIO_LOW, SIZES, PatternFacts
from procedures.pattern_psf.outline import points_of, present_outline
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.pattern_psf.plan import uncertainty
from procedures.pattern_psf.pose import chart_pose
from procedures.pattern_psf.radiometry import measure_light
from procedures.plan import (
    Advice,
    Ask,
    AxisTravel,
    Decide,
    Estimate,
    Fact,
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
    gathered,
    number,
    required,
)
from procedures.raw import Plane, RawFrame

Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
BEFORE = ("print", "mount", "distance", "square", "focus")  # steps of the pattern PSF
USUAL, FEWEST, MOST = 9, 6, 400  # numbers of positions: fewer than six do not determine a field
ROOM = 0.4  # largest half size of the chart, in fractions of the frame, that leaves room to move it
NEAR = 0.03  # accepted distance of the chart from its position, in fractions of the frame's width
LEAST_WHITE = 0.2  # minimum of white on the scale: a lens is darker towards the corners, and noise grows
MOST_CLIPPED = 0.005
REMEDIES = {
    "s/t": "The chart appears too large or too small: bring the camera back to the distance of the start.",
    "clipped": "White is clipped here: keep glare off the chart.",
    "white": "The chart is too dark here: keep shadows off it.",
}


def plan(estimate: Estimator) -> Plan:
    """The guided calibration of a field."""
    begin = pattern_plan()
    places = (
        Ask("places", "At how many places?", "number", "", USUAL, low=FEWEST, high=MOST),
        Look("light", check_light),
        Look("start", check_places, tries=10, rests_on=SIZES),
    )
    return Plan(
        "field",
        "PSF over the frame, from the chart at many places",
        (
            *(begin.step(name) for name in BEFORE),
            Step(
                "places", "Places", "Choose how many places of the frame to measure.", places, drawings.TOUR,
                "{places:.0f} places",
            ),
            Step("tour", "Tour", "One photograph of the chart at each place.", (Tour(stops),), drawings.TOUR),
            Step("estimate", "Estimate", "Put the field together from all photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the tour again.", (Decide("tour"),)),
        ),
        subject="frame",
        facts=FieldFacts,
    )  # fmt: skip


# --- start of the tour ---


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """Check the chart in the middle, its size, and the room to move it; record the start of the tour as facts."""
    advice = check_distance(frame, facts)
    if not advice.good:
        return advice
    plane, known = shown(frame), facts_as(FieldFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    half_x, half_y = half_size(sighting, plane)
    if max(half_x, half_y) > ROOM:
        return small_frame(advice)
    optics, (rows, columns) = known.optics(plane.pitch), plane.samples.shape
    distance_mm = chart_pose(sighting.H_sensor_pattern, (rows, columns), optics).centre_mm[2]
    at = location_of(sighting, plane)
    start: dict[str, Fact] = {
        "tour_rows": float(rows),
        "tour_columns": float(columns),
        "tour_principal_px": optics.principal_px(distance_mm),
        "tour_distance_mm": distance_mm,
        "tour_x": at.x,
        "tour_y": at.y,
        "tour_half_x": half_x,
        "tour_half_y": half_y,
    }
    axes = {BASE + name: place for name, place in known.where().items()}
    return replace(advice, facts={**advice.facts, **start, **axes})


def check_places(frame: RawFrame, facts: Facts) -> Advice:
    """`check_start`, and positions that enclose a sufficient part of the frame."""
    advice = check_start(frame, facts)
    if not advice.good:
        return advice
    places = locations({**facts, **advice.facts})
    share = hull_area(np.array([(place.x, place.y) for place in places]))
    enclosed = Reading("enclosed by the places", 100 * share, "% of the frame", 100 * SMALL_SHARE)
    advice = replace(advice, readings=(*advice.readings, enclosed))
    if not enclosed.good:
        return small_frame(advice)
    known = facts_as(FieldFacts, facts)
    one = uncertainty(estimate_psf(shown(frame), known.chart, known.quick_parameters))
    return replace(advice, facts={**advice.facts, "chart_mtf50_uncertainty": one}) if one < np.inf else advice


def small_frame(advice: Advice) -> Advice:
    """Advice where the chart at its best size in pixels is too large for the frame."""
    say = (
        "The frame is too small for the chart, whose best size in pixels is the same at every distance: set the camera "
        "to its whole sensor, without binning or a region of interest."
    )
    return replace(advice, good=False, say=say)


def half_size(sighting: ChartSighting, plane: Plane) -> tuple[float, float]:
    """Half the width and height of the sheet, in fractions of the frame's."""
    reach = np.abs(np.array(present_outline(sighting.H_sensor_pattern)) - sighting.centre()).max(axis=0)
    rows, columns = plane.samples.shape
    return float(reach[0]) / columns, float(reach[1]) / rows


def location_of(sighting: ChartSighting, plane: Plane) -> Location:
    """Position of the chart's centre in the frame."""
    (x, y), (rows, columns) = sighting.centre(), plane.samples.shape
    return Location((float(x) + 0.5) / columns, (float(y) + 0.5) / rows)


# --- the positions ---


def locations(facts: Facts) -> list[Location]:
    """Positions of the chart's centre: as near to the frame's sides as the whole sheet allows."""
    known = facts_as(FieldFacts, facts)
    start = known.begun()
    rim_x, rim_y = (half + NEAR for half in start.half)
    rows, columns = start.shape
    chosen = chosen_locations(USUAL if known.places is None else int(known.places), columns / rows)
    return [Location(rim_x + (1 - 2 * rim_x) * place.x, rim_y + (1 - 2 * rim_y) * place.y) for place in chosen]


def stops(facts: Facts) -> list[TourStop]:
    """The stops of the tour, one per position."""
    places = locations(facts)
    return [
        TourStop(
            f"place {i} of {len(places)}",
            Go(partial(to_place, location), partial(say_place, location)),
            partial(check_place, location),
            partial(corner_goal, places, i),
        )
        for i, location in enumerate(places, 1)
    ]


def corner_goal(places: Sequence[Location], number: int, facts: Facts) -> Goal:
    """Progress of MTF50 in the frame's corners before the photograph at a place, by the noise of that at the start."""
    one = facts_as(FieldFacts, facts).chart_mtf50_uncertainty or float("nan")
    now, after = (one * corner_spread(places[:n]) for n in (number - 1, number))
    return Goal(len(places) - number + 1, "MTF50 in the corners by noise", "cycles/pixel", now, after)


def corner_spread(places: Sequence[Location], *, plane: bool = False) -> float:
    """Uncertainty in a corner of a quadratic through values at places, or of its plane alone over the centre, over that
    of one value; infinite where they do not determine it."""
    x, y = np.array([(2 * one.x - 1, 2 * one.y - 1) for one in (*places, Location(1.0, 1.0))]).T
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    known, corner = design[:-1], design[-1] * ([0, 1, 1, 0, 0, 0] if plane else 1)
    if np.linalg.matrix_rank(known) < len(corner):
        return float("inf")
    return float(np.sqrt(corner @ np.linalg.inv(known.T @ known) @ corner))


def say_place(location: Location, facts: Facts) -> str:
    """Required position of the chart, for the operator."""
    where = f"{100 * location.x:.0f} % from the left and {100 * location.y:.0f} % from the top of the frame"
    if to_place(location, facts):
        return f"going where the chart appears {where}"
    return f"Turn the camera, and leave the chart, until the chart's middle is {where}."


def to_place(location: Location, facts: Facts) -> dict[str, float]:
    """Positions of head or rail for a position of the chart; the rail keeps the distance along the optical axis, within
    its travel, so that focus and size are unchanged."""
    known = facts_as(FieldFacts, facts)
    start = known.start
    if start is None:
        return {}
    places = bring(start.chart_at, location, start.base, start)
    if "pan_deg" in places and "z_mm" in start.base:
        now, then = (float(ray(at, start.shape, start.principal_px)[2]) for at in (start.chart_at, location))
        z = start.base["z_mm"] + start.distance_mm * (now / then - 1)
        places["z_mm"] = known.axes.get("z_mm", AxisTravel()).nearest(z)
    return places


def bring(now: Location, wanted: Location, at: Mapping[str, float], start: "TourStart") -> dict[str, float]:
    """Positions of the axes, now `at`, that move the chart to another position; empty without head or rail."""
    shape, principal_px = start.shape, start.principal_px
    if {"pan_deg", "tilt_deg"} <= set(at):
        towards = direction(ray(now, shape, principal_px), at["pan_deg"], at["tilt_deg"])
        pan, tilt = pan_tilt_deg(wanted, shape, principal_px, towards)
        return {"pan_deg": pan, "tilt_deg": tilt}
    if {"x_mm", "y_mm"} <= set(at):
        before, then = (rail_mm(place, shape, principal_px, start.distance_mm) for place in (now, wanted))
        return {"x_mm": at["x_mm"] + then[0] - before[0], "y_mm": at["y_mm"] - (then[1] - before[1])}
    return {}


# --- a photograph at a position ---


def check_place(location: Location, frame: RawFrame, facts: Facts) -> Advice:
    """Check position and size of the chart, the camera settings of the trial, clipping and darkness."""
    plane, known = shown(frame), facts_as(FieldFacts, facts)
    if changed := changed_settings(frame.exposure, known):
        return Advice(False, f"This shot does not count: {changed}. Set it back.")
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        if not sighting.marks:
            return replace(sighting, by_hand={}, moves={})
        cut = find_charts(plane.samples)[0]
        moves, outline = correction(location, cut, plane, known), at_place(location, cut, plane)
        return replace(sighting, by_hand={}, moves=moves, outline=outline)
    ratio = Reading("s/t", known.s_or_start * float(sighting.widths().max()) / CELLS, "", RATIO_LOW, RATIO_HIGH)
    return place_advice(location, sighting, frame, known, NEAR, (ratio,), f" {say_place(location, {})}")


def place_advice(
    location: Location, sighting: ChartSighting, frame: RawFrame, known: "FieldFacts", near: float,
    more: tuple[Reading, ...] = (), hint: str = "",
) -> Advice:  # fmt: skip
    """Advice on light and position of a chart, `near` its location in fractions of the frame's width, and on `more`
    readings; `hint` is the move."""
    plane, marks = shown(frame), marks_of(sighting)
    off = off_place(location, sighting, plane)
    readings = (
        Reading("off its place", 100 * off, "% of the width", None, 100 * near),
        *more,
        *light_readings(frame, sighting),
    )
    outline = at_place(location, sighting, plane)
    bad = next((reading for reading in readings if not reading.good), None)
    if bad is None:
        return Advice(True, "The chart is in its place.", readings, marks=marks, outline=outline)
    if bad is readings[0]:
        say = f"The chart is {100 * off:.0f} % of the frame's width off its place.{hint}"
        moves = correction(location, sighting, plane, known)
        return Advice(False, say, readings, moves=moves, marks=marks, outline=outline)
    say = f"{REMEDIES[bad.name]} ({bad.name} {bad.value:.3g} {bad.unit})"
    return Advice(False, say, readings, marks=marks, outline=outline)


def light_readings(frame: RawFrame, sighting: ChartSighting) -> tuple[Reading, Reading]:
    """White level and clipped fraction at the chart, of the brightest plane."""
    registration = registered(shown(frame), sighting)
    lights = [measure_light(plane.samples, registration, plane.quantisation) for plane in frame.planes.values()]
    white, clipped = max(float(light.white[0]) for light in lights), max(light.saturated for light in lights)
    return (
        Reading("white", 100 * white, "%", 100 * LEAST_WHITE, None),
        Reading("clipped", 100 * clipped, "%", None, 100 * MOST_CLIPPED),
    )


def at_place(location: Location, sighting: ChartSighting, plane: Plane) -> Outline:
    """The sheet as it is, and shifted to its required position."""
    present = np.array(present_outline(sighting.H_sensor_pattern))
    wanted = present + np.array(location.in_pixels(plane.samples.shape)) - sighting.centre()
    return Outline(points_of(present), points_of(wanted))


def off_place(location: Location, sighting: ChartSighting, plane: Plane) -> float:
    """Distance of the chart's centre from its required position, in fractions of the frame's width."""
    rows, columns = plane.samples.shape
    x, y = sighting.centre() - np.array(location.in_pixels((rows, columns)))
    return float(np.hypot(x, y)) / float(columns)


def correction(location: Location, sighting: ChartSighting, plane: Plane, known: "FieldFacts") -> dict[str, float]:
    """Relative moves of the axes to the required position."""
    at = known.where()
    targets = bring(location_of(sighting, plane), location, at, known.begun())
    return {name: place - at[name] for name, place in targets.items()}


# --- Facts of a tour over the frame, in addition to those of the chart: number of positions, and where it began ---

TOUR = "tour_"
BASE = f"{TOUR}from_"  # prefix of an axis' name: the fact of its position when the chart was in the middle


@dataclass(frozen=True)
class TourStart:
    """The start of a tour, from which its moves are computed.

    shape : rows and columns of the plane
    principal_px : distance of the image from the lens, in pixels of the plane
    distance_mm : distance of the chart along the optical axis
    chart_at : position of the chart in the frame
    half : half the width and height of the sheet, in fractions of the frame's
    base : positions of the axes by name
    """

    shape: tuple[int, int]
    principal_px: float
    distance_mm: float
    chart_at: Location
    half: tuple[float, float]
    base: Mapping[str, float]


def start_of(facts: Facts) -> TourStart | None:
    """Start of the tour; None before it. Raises BadParameter."""
    if f"{TOUR}rows" not in facts:
        return None
    rows, columns, principal_px, distance_mm, x, y, half_x, half_y = (
        number(facts, TOUR + name)
        for name in ("rows", "columns", "principal_px", "distance_mm", "x", "y", "half_x", "half_y")
    )
    base = {name.removeprefix(BASE): number(facts, name) for name in facts if name.startswith(BASE)}
    return TourStart((int(rows), int(columns)), principal_px, distance_mm, Location(x, y), (half_x, half_y), base)


@dataclass(frozen=True)
class FieldFacts(PatternFacts):
    """Facts of the plan of a field: those of the chart, the number of `places`, the start of the tour, and the standard
    uncertainty of MTF50 by its noise there."""

    places: float | None = None
    chart_mtf50_uncertainty: float | None = None
    start: TourStart | None = gathered(start_of, *SIZES, prefix=TOUR)

    def begun(self) -> TourStart:
        """Start of the tour. Raises BadParameter before it."""
        return required(self.start, "where the tour begins", "take the step `places` again")
