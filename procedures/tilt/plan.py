"""Plan of a sensor's tilt: a focus bracket at places of the frame, turns of the screws, and verification.

The rail makes the bracket: the focus ring is unchanged, and the chart's image moves through the sensor. The chart's
distance along the optical axis follows from rail and head, not from its size, which distortion changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from procedures.advice import changed_settings
from procedures.drawings import steps as drawings
from procedures.drawings.screws import screws_drawing
from procedures.field import plan as field_plan
from procedures.field.focus import FREQUENCY
from procedures.field.measuring import Location, direction, pan_tilt_deg, ray
from procedures.field.plan import BEFORE, FieldFacts, TourStart
from procedures.numbers import HELPS, TILT_CORNER
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.pattern_print.sheet import SMALLEST_WIDTH_MM
from procedures.pattern_psf.checks import check_light, seen_chart, shown
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import SIZES
from procedures.pattern_psf.plan import LENS, check_sheets
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import (
    Advice,
    Ask,
    AxisTravel,
    Decide,
    Diagram,
    Estimate,
    Fact,
    Facts,
    Go,
    Goal,
    Home,
    Known,
    Look,
    Measure,
    Outcomes,
    Plan,
    Request,
    Show,
    Step,
    Tour,
    TourStop,
    facts_as,
    gathered,
    gathered_numbers,
    number,
    required,
)
from procedures.quality import mtf_along
from procedures.raw import Plane, RawFrame
from procedures.tilt.estimate import Tilt
from procedures.tilt.plane import SURE, Positions, Screws, behind_lens_um
from procedures.tilt.turning import FLANK, blur_logarithm, followed_turns, turn_advice

Estimator = Callable[[Sequence[RawFrame], Facts, Known], Outcomes]
USUAL, FEWEST, MOST = 9, 7, 25  # numbers of places: fewer than seven do not separate a tilt from field curvature
NEAR = 0.05  # accepted distance of the chart from its place, in fractions of the frame's width
ITERATIONS = 6  # alternating moves of head and rail, each of which reduces the error about tenfold
MARK = 16  # characters of a file's hash that identify it
AHEAD: Array = np.array([0.0, 0.0, 1.0])  # direction of the head's axis at zero
SURELY = 0.99  # greatest probability that is stated
MOST_SCREWS = 12


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
            Step(
                "turn", "Turn", "Turn the screws by the measured amounts.",
                (Show(turns_shown), Go(to_flank, say_flank), *screws_to_turn()), screws_drawing((0.0, 120.0, 240.0)),
            ),
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


# --- rail and lens: the chart's width ---

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
        replace(request, proposed=width_within_reach, check=check_width)
        if isinstance(request, Ask) and request.key == "chart_width_mm"
        else request
        for request in requests
    )


# --- screws ---


def screws_shown(facts: Facts) -> Diagram:
    """The screws from behind, the first as far as it is known."""
    say = "The screws as seen from behind the camera. Screw 1 at 0° is at the top, at 90° on the right, at 180° below."
    return Diagram("", (), (), say, drawing=screws_drawing(facts_as(TiltFacts, facts).screws.angles_deg.tolist()))


def turns_shown(facts: Facts) -> Diagram | None:
    """The screws before their turns; None before the measurement, or where they would not help."""
    helps = facts_as(TiltFacts, facts).helps or 0.0
    chance = "more than 99 %" if helps > SURELY else f"{100 * helps:.0f} %"
    say = f"The screws as seen from behind the camera. Their turns help with a probability of {chance}."
    return replace(screws_shown(facts), say=say) if worth_turning(facts) else None


def check_start(frame: RawFrame, facts: Facts) -> Advice:
    """`check_start` of the field, and check that the rail reaches all positions of the bracket."""
    advice = field_plan.check_start(frame, facts)
    if not advice.good:
        return advice
    known = facts_as(TiltFacts, {**facts, **advice.facts})
    optics, f_number = known.optics(shown(frame).pitch), f_number_of(known)
    distance_mm, aimed_mm = known.begun().distance_mm, optics.distance_mm(known.wanted_px_per_cell)
    if not off_reach_mm(known, bracket_mm(optics, f_number, distance_mm)):
        sharp = sharpness(shown(frame), known)
        return advice if sharp is None else replace(advice, facts={**advice.facts, "chart_mtf_noise": sharp[1]})
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


def sharpness(plane: Plane, known: TiltFacts) -> tuple[float, float] | None:
    """The MTF that is followed through focus, and its relative uncertainty by noise; None where it is refused."""
    estimate = estimate_psf(plane, known.chart, known.quick_parameters).value
    if estimate is None:
        return None
    value, slope = mtf_along(estimate.psf, np.array([FREQUENCY]), 0.0)
    noise = float(np.sqrt(slope[0] @ estimate.psf.parameter_covariance @ slope[0]))
    return float(value[0]), noise / float(value[0])


SCREWS = (
    Ask("places", "At how many places?", "number", "", USUAL, low=FEWEST, high=MOST),
    Ask("screw_count", "How many screws hold the sensor?", "number", "", 3, low=3, high=MOST_SCREWS),
    Ask("screw_radius_mm", "How far are they from the frame's centre?", "number", "mm", low=1.0, high=500.0),
    Ask("screw_pitch_mm", "By how much does a turn move the sensor?", "number", "mm", low=0.01, high=5.0),
    Show(screws_shown),
    Ask(
        "first_screw_deg", "Where is screw 1, clockwise from the top, seen from behind the camera?", "number", "°",
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
    tilts: list[Tilt] = [result for result in results.values() if result is not None]
    if not tilts:
        return {HELPS: 0.0}
    (tilt,) = tilts
    turns: dict[str, Fact] = {f"{TURN}{i}": turn.value for i, turn in enumerate(tilt.turns.turns, 1)}
    centre = float(tilt.sensor.plane[0])
    return {**turns, HELPS: tilt.turns.helps, "corner_um": tilt.numbers()[TILT_CORNER].value, "centre_um": centre}


def to_flank(facts: Facts) -> dict[str, float]:
    """Positions for a chart in the frame's middle, out of focus as the turns require; none where they are not known."""
    known = facts_as(TiltFacts, facts)
    if known.start is None or known.centre_um is None or not worth_turning(facts):
        return {}
    focal, image = known.optics(1).focal_length_mm, (known.centre_um - FLANK * known.depth_um) / 1000
    return to_depth(Location(0.5, 0.5), focal * image / (image - focal), facts)


def say_flank(facts: Facts) -> str:
    """The place from which the turns are followed, for the operator; empty where they are not."""
    return "going where the chart is in the middle, out of focus, to follow the screws" if to_flank(facts) else ""


def check_screw(screw: int, frame: RawFrame, facts: Facts) -> Advice:
    """Follow the turn of a screw by the sharpness in the frame's middle; no outline where that is impossible."""
    plane, known = shown(frame), facts_as(TiltFacts, facts)
    before, now = known.sharpness.get(str(screw)), sharpness(plane, known)
    follow = partial(
        turn_advice, screw, known.turns[screw - 1], angle_deg=known.screws.angles_deg[screw - 1],
        shape=plane.samples.shape, largest=max(map(abs, known.turns)),
    )  # fmt: skip

    def turned(change: float) -> float:
        return followed_turns(screw, known.turns, change, known.screws, known.depth_um)

    if before is None:
        advice, followed = follow(turned=None, noise=0.0), now and known.start and not math.isnan(turned(0.0))
        facts = {f"{SHARPNESS}{screw}": now[0] if now and followed else 0.0}
        return replace(advice, facts=facts, outline=advice.outline if followed else None)
    if not before:
        return Advice(True, f"The focus does not show the turn of screw {screw}: the next bracket will.")
    if now is None:
        return Advice(False, "The chart is not recognised: uncover it, and leave the light as it was.")
    change = math.log(now[0] / before)
    return follow(turned=turned(change), noise=2**0.5 * abs(turned(change + now[1]) - turned(change)))


def screws_to_turn() -> tuple[Look, ...]:
    """The turn of each screw, where turns help."""

    def turns(screw: int, facts: Facts) -> bool:
        return worth_turning(facts) and screw <= len(facts_as(TiltFacts, facts).turns)

    screws = range(1, MOST_SCREWS + 1)
    return tuple(Look(f"screw {i}", partial(check_screw, i), tries=4, when=partial(turns, i)) for i in screws)


# --- bracket ---


def stops(facts: Facts) -> list[TourStop]:
    """All places at all distances of the bracket."""
    known = facts_as(TiltFacts, facts)
    start = known.begun()
    pitch = round(known.optics(1).principal_px(start.distance_mm) / start.principal_px)
    depths = bracket_mm(known.optics(pitch), f_number_of(known), start.distance_mm)
    focus = focus_um(known.chart_mtf_noise, known.depth_um)
    nearer = start.distance_mm / depths[0]
    as_nearest = {name: half * nearer for name, half in zip(("tour_half_x", "tour_half_y"), start.half, strict=True)}
    locations = field_plan.locations({**facts, **as_nearest})  # the chart is not cut where it is largest
    return [
        TourStop(
            f"place {i} of {len(locations)}, {depth:.0f} mm",
            Go(partial(to_depth, location, depth), partial(say_depth, location, depth)),
            partial(check_bracket, location),
            partial(corner_goal, locations, (i - 1) * len(depths) + j, len(depths), focus),
        )
        for i, location in enumerate(locations, 1)
        for j, depth in enumerate(depths if i % 2 else depths[::-1])
    ]


def corner_goal(places: Sequence[Location], taken: int, depths: int, focus: float, facts: Facts) -> Goal:
    """Progress of the corners' heights over the centre, by the uncertainty `focus` of best focus at one place, in
    um."""
    now, after = (focus * field_plan.corner_spread(places[: n // depths], plane=True) for n in (taken, taken + 1))
    return Goal(len(places) * depths - taken, "Height of the corners by noise", "µm", now, after)


def focus_um(noise: float | None, depth_um: float) -> float:
    """Predicted standard uncertainty of best focus at one place, by a quartic through its bracket, in um; NaN where the
    relative noise of the MTF is not known.

    The blur circle t depths of focus away has t pixels: the logarithm of the MTF at f falls by (pi f t)^2 / 8, and its
    noise grows as the MTF falls.
    """
    if noise is None:
        return math.nan
    design = np.vander(STEPS, 5, increasing=True) * np.exp([[blur_logarithm(step)] for step in STEPS])
    slope = noise * np.linalg.inv(design.T @ design)[1, 1] ** 0.5
    return float(depth_um * slope / (2 * (math.pi * FREQUENCY) ** 2 / 8))


def chart_mm(start: TourStart, at: Mapping[str, float]) -> Array:
    """The chart's centre (3,) from the lens, in a resting head's axes, by the rail's positions, better than the chart's
    size."""
    towards, base = ray(start.chart_at, start.shape, start.principal_px), start.base
    chart = direction(towards, base.get("pan_deg", 0.0), base.get("tilt_deg", 0.0)) * start.distance_mm / towards[2]
    x, y, z = (at.get(name, base.get(name, 0.0)) - base.get(name, 0.0) for name in ("x_mm", "y_mm", "z_mm"))
    return np.asarray(chart + np.array([-x, y, z]))


def depth_mm(start: TourStart, at: Mapping[str, float]) -> float:
    """Distance of the chart's centre from the lens along the optical axis."""
    return float(chart_mm(start, at) @ direction(AHEAD, at.get("pan_deg", 0.0), at.get("tilt_deg", 0.0)))


def to_depth(location: Location, depth: float, facts: Facts) -> dict[str, float]:
    """Positions of head or stage, and of the rail, for a distance of the chart at a place, constant through the
    bracket."""
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
    if changed := changed_settings(frame.exposure, known):
        return Advice(False, f"This shot does not count: {changed}. Set it back.")
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return replace(sighting, by_hand={}, moves={})
    advice = field_plan.place_advice(location, sighting, frame, known, NEAR)
    depth = {DEPTH + frame.sha256[:MARK]: depth_mm(known.begun(), known.where())}
    return replace(advice, facts=depth) if advice.good else advice


# --- reach of the rail ---

STEPS = (-3, -2, -1, 0, 1, 2, 3)
"""Range of the bracket in depths of focus behind the lens: f-number times a pixel of the plane."""
MARGIN_MM = 200.0
"""Margin at either end of the rail for a proposed chart: the rangefinder's zero is not the lens, and s/t has a
tolerance."""
BY_HAND = "take the bracket as your camera can, and give it to `station tilt` with a table of its positions"


def rail_of(known: TiltFacts) -> AxisTravel:
    """The rail. Raises BadParameter if the bench has none, or its travel is unknown."""
    rail = known.axes.get("z_mm")
    if rail is None or None in (rail.at, rail.low, rail.high):
        raise BadParameter("the bracket is made by a rail, the axis z_mm, which the bench has not", BY_HAND)
    return rail


def f_number_of(known: TiltFacts) -> float:
    """The f-number. Raises BadParameter if it is unknown."""
    return required(known.aperture, "the f-number", "give it in the step `rail`")


def bracket_mm(optics: ImagingGeometry, f_number: float, distance_mm: float) -> list[float]:
    """Distances of the chart at which its image (thin lens) steps through the sensor, the nearest first."""
    f, depth_um = optics.focal_length_mm, f_number * optics.plane_pitch_um
    image_um = behind_lens_um(distance_mm, Positions.SET, f)
    images_mm = [(image_um - step * depth_um) / 1000 for step in STEPS]
    return sorted(f * image / (image - f) for image in images_mm)


# --- before the chart is printed ---


def expected_bracket_mm(known: TiltFacts) -> list[float]:
    """The bracket of a chart at the target s/t of the guide."""
    optics = known.optics()
    return bracket_mm(optics, f_number_of(known), optics.distance_mm(known.wanted_px_per_cell))


def reach_mm(known: TiltFacts) -> tuple[float, float]:
    """Guaranteed smallest and largest distance of chart and lens, from an end of the rail where no rangefinder
    measured."""
    rail = rail_of(known)
    at, low, high = (cast(float, one) for one in (rail.at, rail.low, rail.high))
    start = 0.0 if known.distance_mm is None else known.distance_mm - at
    return start + low + MARGIN_MM, start + high - MARGIN_MM


def reaches(known: TiltFacts, depths: Sequence[float]) -> bool:
    """Whether the rail reaches a bracket; without a rangefinder, whether it is long enough."""
    low, high = reach_mm(known)
    if known.distance_mm is None:
        return depths[-1] - depths[0] <= high - low
    return low <= depths[0] and depths[-1] <= high


def check_width(width: Fact, facts: Facts) -> None:
    """Raise BadParameter if a chart of this width needs a bracket beyond the rail, or too many sheets."""
    check_sheets(width, facts)
    known = facts_as(TiltFacts, {**facts, "chart_width_mm": width})
    depths, (low, high) = expected_bracket_mm(known), reach_mm(known)
    if not reaches(known, depths):
        reach = f"goes {high - low:.0f} mm" if known.distance_mm is None else f"reaches {low:.0f} to {high:.0f} mm"
        needed = f"{depths[0]:.0f} to {depths[-1]:.0f} mm"
        raise BadParameter(
            f"a chart {width:g} mm wide needs the lens {needed} before it; the rail {reach}",
            "print a chart of another width: a narrower one is photographed from nearer, and its bracket is shorter",
        )


def width_within_reach(facts: Facts) -> float:
    """Whole mm of the largest chart of one sheet whose bracket fits the rail. Raises BadParameter if there is none."""
    known = replace(facts_as(TiltFacts, facts), chart_width_mm=None)
    for width in range(int(known.size.whole_mm), math.ceil(SMALLEST_WIDTH_MM) - 1, -1):
        if reaches(known, expected_bracket_mm(replace(known, chart_width_mm=float(width)))):
            return float(width)
    raise BadParameter(
        "no chart that can be printed has its bracket within the rail's reach",
        "hang it nearer to the rail or farther from it; a wider aperture or a longer lens shortens the bracket",
    )


# --- before the first photograph of the bracket ---


def off_reach_mm(known: TiltFacts, depths: Sequence[float]) -> float:
    """Required reduction of the distance between chart and rail; infinite if the rail is too short."""
    rail, start = rail_of(known), known.begun()
    at, low, high = (cast(float, one) for one in (rail.at, rail.low, rail.high))
    nearest, farthest = (at + depth - start.distance_mm for depth in (depths[0], depths[-1]))
    if farthest - nearest > high - low:
        return math.inf
    return max(low - nearest, 0.0) + min(high - farthest, 0.0)


def without_laser(facts: Facts) -> Facts:
    """The facts without the rangefinder's reading: the chart may be mounted anywhere."""
    return {name: fact for name, fact in facts.items() if name != "distance_mm"}


# --- Facts of a guided tilt: the screws, the distance of each photograph of the bracket, and the required turns ---

DEPTH, TURN, SHARPNESS = "depth_", "turn_", "sharpness_"
"""Prefixes of a photograph's mark for the chart's distance, and of a screw's number for its turns, and for the MTF in
the frame's middle before them."""


def turns_of(facts: Facts) -> tuple[float, ...]:
    """The required turns of the screws, away from the lens; empty before they are measured. Raises BadParameter."""
    screws = sorted(int(name.removeprefix(TURN)) for name in facts if name.startswith(TURN))
    return tuple(number(facts, f"{TURN}{i}") for i in screws)


@dataclass(frozen=True)
class TiltFacts(FieldFacts):
    """Facts of the plan.

    screw_count, screw_radius_mm, screw_pitch_mm, first_screw_deg : of `Screws`
    depths : distance of the chart along the optical axis in mm, by the photograph's mark
    turns : required turns of the screws
    helps : probability that they improve the alignment
    chart_mtf_noise : uncertainty of the MTF in the photograph at the start
    corner_um, centre_um : height of the sensor's highest corner over its centre, and its centre behind the lens
    sharpness : MTF in the frame's middle before the turn of each screw, by its number
    """

    screw_count: float | None = None
    screw_radius_mm: float | None = None
    screw_pitch_mm: float | None = None
    first_screw_deg: float | None = None
    depths: Mapping[str, float] = gathered_numbers(DEPTH)
    turns: tuple[float, ...] = gathered(turns_of, prefix=TURN)
    helps: float | None = None
    chart_mtf_noise: float | None = None
    corner_um: float | None = None
    centre_um: float | None = None
    sharpness: Mapping[str, float] = gathered_numbers(SHARPNESS, "centre_um")

    @property
    def depth_um(self) -> float:
        """Depth of focus: f-number times a pixel of the plane. Raises BadParameter before the start."""
        start = self.begun()
        pitch = round(self.optics(1).principal_px(start.distance_mm) / start.principal_px)
        return f_number_of(self) * self.optics(pitch).plane_pitch_um

    @property
    def screws(self) -> Screws:
        """The given screws, with defaults for unknown values."""
        given: dict[str, Any] = {
            "count": None if self.screw_count is None else int(self.screw_count),
            "radius_mm": self.screw_radius_mm,
            "pitch_mm": self.screw_pitch_mm,
            "first_deg": self.first_screw_deg,
        }
        return Screws(**{name: value for name, value in given.items() if value is not None})
