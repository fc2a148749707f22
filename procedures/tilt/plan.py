"""Plan of a sensor's tilt: a focus bracket at places of the frame, turns of the screws, and verification.

The rail makes the bracket: the focus ring is unchanged, and the chart's image moves through the sensor. The chart's
distance along the optical axis follows from rail and head, not from its size, which distortion changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.facts import AxisTravel, facts_as
from procedures.field import plan as field_plan
from procedures.field.facts import TourStart
from procedures.field.locations import AHEAD, Location, direction, pan_tilt_deg, ray
from procedures.field.plan import BEFORE
from procedures.numbers import HELPS, TILT_CORNER
from procedures.numerics.arrays import Array
from procedures.pattern_psf.checks import check_light, seen_chart, shown
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.plan import LENS
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Fact,
    Facts,
    Go,
    Home,
    Known,
    Look,
    Measure,
    Outcomes,
    Plan,
    Request,
    Step,
    Tour,
    TourStop,
)
from procedures.raw import RawFrame
from procedures.tilt.estimate import Tilt
from procedures.tilt.facts import DEPTH, TURN, TiltFacts
from procedures.tilt.reach import bracket_mm, check_width, f_number_of, off_reach_mm, width_within_reach, without_laser
from procedures.tilt.screws import SURE

Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
USUAL, FEWEST, MOST = 9, 7, 25  # numbers of places: fewer than seven do not separate a tilt from field curvature
NEAR = 0.05  # accepted distance of the chart from its place, in fractions of the frame's width
ITERATIONS = 6  # alternating moves of head and rail, each of which reduces the error about tenfold
MARK = 16  # characters of a file's hash that identify it


def plan(estimate: Estimator) -> Plan:
    """The guided squaring of a sensor to its lens."""
    begin = pattern_plan()
    return Plan(
        "tilt",
        "The sensor's tilt, and the screws that correct it",
        (
            Step(
                "rail", "Rail and lens", "Enter the lens, and home the rail: its travel limits the chart's size.", RAIL,
                drawings.DISTANCE,
            ),
            *(replace(step, requests=after_rail(step)) for step in map(begin.step, BEFORE)),
            Step(
                "screws", "Screws", "Enter the screws of the sensor, with the chart in the middle.", SCREWS,
                drawings.TOUR,
            ),
            Step("turn", "Turn", "Turn the screws by the measured amounts.", (TURN_THEM,)),
            Step(
                "bracket", "Bracket", "The chart at places of the frame, at each of them through the focus.",
                (Tour(stops),), drawings.TOUR,
            ),
            Step(
                "estimate", "Estimate", "Compute the sensor's plane, and the turns.",
                (Estimate(estimate, result_facts),),
            ),
            Step(
                "verdict", "Verdict", "Accept it, or turn the screws and measure again.",
                (Decide("turn", worth_turning),),
            ),
        ),
        subject="tilt",
        facts=TiltFacts,
    )  # fmt: skip


# --- rail and lens: the chart's width ----------------------------------------------------------------------------

RAIL: tuple[Request, ...] = (
    *LENS,
    Ask("typed_f_number", "Which f-number do you set?", "number", "", low=0.5, high=64.0),
    Home(),
    Measure(),
)


def after_rail(step: Step) -> tuple[Request, ...]:
    """A step's requests without those of the step `rail`; the chart's width is proposed from its facts."""
    known = [one.key for one in RAIL if isinstance(one, Ask)]
    requests = (one for one in step.requests if not isinstance(one, Home) and getattr(one, "key", "") not in known)
    return tuple(
        replace(one, proposed=width_within_reach, check=check_width)
        if isinstance(one, Ask) and one.key == "chart_width_mm"
        else one
        for one in requests
    )


# --- screws ------------------------------------------------------------------------------------------------------


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """`check_start` of the field, and check that the rail reaches all positions of the bracket."""
    advice = field_plan.check_start(frame, facts)
    if not advice.good:
        return advice
    known = facts_as(TiltFacts, {**facts, **advice.facts})
    optics, f_number = known.optics(shown(frame).pitch), f_number_of(known)
    distance_mm, aimed_mm = known.begun().distance_mm, optics.distance_mm(known.wanted_px_per_cell)
    if not off_reach_mm(known, bracket_mm(optics, f_number, distance_mm)):
        return advice
    if not off_reach_mm(known, bracket_mm(optics, f_number, aimed_mm)):
        say = f"Move the camera to {aimed_mm / 1000:.2f} m from the chart: there the rail reaches the bracket."
        return replace(advice, good=False, say=say, moves={"z_mm": aimed_mm - distance_mm})
    depths = bracket_mm(optics, f_number, aimed_mm)
    nearer = off_reach_mm(known, depths)
    way = "nearer to" if nearer > 0 else "farther from"
    say = f"hang the chart {abs(nearer):.0f} mm {way} the rail."
    if abs(nearer) == math.inf:
        say = f"begin again with a chart at most {width_within_reach(without_laser(facts)):.0f} mm wide."
    needed = f"The bracket goes from {depths[0]:.0f} to {depths[-1]:.0f} mm before the chart"
    return replace(advice, good=False, say=f"{needed}, where the rail does not reach: {say}")


SCREWS = (
    Ask("places", "At how many places?", "number", "", USUAL, low=FEWEST, high=MOST),
    Ask("screw_count", "How many screws hold the sensor?", "number", "", 3, low=3, high=12),
    Ask("screw_radius_mm", "How far are they from the frame's centre?", "number", "mm", low=1.0, high=500.0),
    Ask("screw_pitch_mm", "By how much does a turn move the sensor?", "number", "mm", low=0.01, high=5.0),
    Ask(
        "first_screw_deg", "Where is the first, clockwise from the top, seen from behind the camera?", "number", "°",
        0.0, low=-360.0, high=360.0,
    ),
    Look("light", check_light),
    Look("start", check_start, tries=10, rests_on=SIZES),
)  # fmt: skip


def worth_turning(facts: Facts) -> bool:
    """Whether the probability of improvement is high enough to advise the turns."""
    helps = facts_as(TiltFacts, facts).helps
    return helps is not None and helps >= SURE


def result_facts(results: Mapping[str, Any]) -> Facts:
    """The turns and their probability of improvement, for the measured plane."""
    tilts: list[Tilt] = [one for one in results.values() if one is not None]
    if not tilts:
        return {HELPS: 0.0}
    (tilt,) = tilts
    turns: dict[str, Fact] = {f"{TURN}{i}": one.value for i, one in enumerate(tilt.turns.turns, 1)}
    return {**turns, HELPS: tilt.turns.helps, "corner_um": tilt.numbers()[TILT_CORNER].value}


def say_turns(facts: Facts) -> str:
    """Instruction to turn the screws; empty before the measurement, or where it would not help."""
    if not worth_turning(facts):
        return ""
    known = facts_as(TiltFacts, facts)
    screws = zip(known.screws.angles_deg, known.turns, strict=False)
    words = [
        f"screw {i} at {angle:.0f}° by {abs(turn):.3f} of a turn, {'away from' if turn > 0 else 'towards'} the lens"
        for i, (angle, turn) in enumerate(screws, 1)
    ]
    return f"Turn {'; '.join(words)}. That helps with a probability of {known.helps:.2f}."


def turns_by_hand(facts: Facts) -> dict[str, float]:
    """The turns in numbers."""
    return {f"screw_{i}_turns": turn for i, turn in enumerate(facts_as(TiltFacts, facts).turns, 1)}


TURN_THEM = Go(lambda facts: {}, say_turns, turns_by_hand)

# --- bracket -----------------------------------------------------------------------------------------------------


def stops(facts: Facts) -> list[TourStop]:
    """All places at all distances of the bracket."""
    known = facts_as(TiltFacts, facts)
    start = known.begun()
    pitch = round(known.optics(1).principal_px(start.distance_mm) / start.principal_px)
    depths = bracket_mm(known.optics(pitch), f_number_of(known), start.distance_mm)
    nearer = start.distance_mm / depths[0]
    as_nearest = {name: half * nearer for name, half in zip(("tour_half_x", "tour_half_y"), start.half, strict=True)}
    locations = field_plan.locations({**facts, **as_nearest})  # the chart is not cut where it is largest
    return [
        TourStop(
            f"place {i} of {len(locations)}, {depth:.0f} mm",
            Go(partial(to_depth, location, depth), partial(say_depth, location, depth)),
            partial(check_bracket, location),
        )
        for i, location in enumerate(locations, 1)
        for depth in (depths if i % 2 else depths[::-1])
    ]


def chart_mm(start: TourStart, at: Mapping[str, float]) -> Array:
    """The chart's centre (3,) from the lens, in the axes of a head at rest (x right, y down, z ahead), with axes `at`.

    By the positions of the rail, which are more accurate than a distance from the chart's size.
    """
    towards, base = ray(start.chart_at, start.shape, start.principal_px), start.base
    chart = direction(towards, base.get("pan_deg", 0.0), base.get("tilt_deg", 0.0)) * start.distance_mm / towards[2]
    x, y, z = (at.get(name, base.get(name, 0.0)) - base.get(name, 0.0) for name in ("x_mm", "y_mm", "z_mm"))
    return np.asarray(chart + np.array([-x, y, z]))


def depth_mm(start: TourStart, at: Mapping[str, float]) -> float:
    """Distance of the chart's centre from the lens along the optical axis."""
    return float(chart_mm(start, at) @ direction(AHEAD, at.get("pan_deg", 0.0), at.get("tilt_deg", 0.0)))


def to_depth(location: Location, depth: float, facts: Facts) -> dict[str, float]:
    """Positions of head or stage, and of the rail, for a place and a distance of the chart.

    The place is constant through the bracket, as the height of a tilted sensor depends on it.
    """
    known = facts_as(TiltFacts, facts)
    start = known.begun()
    places = with_head(location, depth, start) if "pan_deg" in start.base else with_stage(location, depth, start)
    return {**places, "z_mm": known.axes.get("z_mm", AxisTravel()).nearest(places["z_mm"])}


def with_head(location: Location, depth: float, start: TourStart) -> dict[str, float]:
    """Positions of head and rail, which depend on each other."""
    at = dict(start.base)
    for _ in range(ITERATIONS):
        towards = chart_mm(start, at)
        at["pan_deg"], at["tilt_deg"] = pan_tilt_deg(location, start.shape, start.principal_px, towards)
        axis = direction(AHEAD, at["pan_deg"], at["tilt_deg"])
        at["z_mm"] += (depth - depth_mm(start, at)) / float(axis[2])
    return {name: at[name] for name in ("pan_deg", "tilt_deg", "z_mm")}


def with_stage(location: Location, depth: float, start: TourStart) -> dict[str, float]:
    """Positions of a stage across the rail, if there is one, and of the rail."""
    towards, base = ray(location, start.shape, start.principal_px), start.base
    x, y, z = depth * towards / towards[2] - chart_mm(start, base)
    moves = {"x_mm": -x, "y_mm": y, "z_mm": z}
    return {name: base[name] + float(move) for name, move in moves.items() if name in base}


def say_depth(location: Location, depth: float, facts: Facts) -> str:
    """Required place and distance of the chart, for the operator."""
    where = f"{100 * location.x:.0f} % from the left and {100 * location.y:.0f} % from the top of the frame"
    return f"going where the chart appears {where}, {depth:.0f} mm away"


def check_bracket(location: Location, frame: RawFrame, facts: Facts) -> Advice:
    """Check place, light and camera settings; record the distance of the chart."""
    plane, known = shown(frame), facts_as(TiltFacts, facts)
    changed = changed_settings(frame.exposure, known)
    if changed:
        return Advice(False, f"This shot does not count: {changed}. Set it back.")
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, by_hand={}, moves={})
    advice = field_plan.place_advice(location, sighting, frame, known, NEAR)
    depth = {DEPTH + frame.sha256[:MARK]: depth_mm(known.begun(), known.where())}
    return replace(advice, facts=depth) if advice.good else advice
