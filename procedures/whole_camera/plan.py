"""Plan of the whole camera: sensor and flats with a light panel, the chart over the frame, the turned chart.

Its steps are those of the plans of sensor, field and geometry. The sensor comes first, so that the places can be
repeated with the chart in place. Each place is also a view of the geometry; the next turned view follows from all
earlier ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from procedures.drawings import steps as drawings
from procedures.field import plan as field_plan
from procedures.field.plan import Estimator
from procedures.geometry import plan as geometry_plan
from procedures.geometry.facts import GeometryFacts, ViewPose, as_pose, pose_facts
from procedures.geometry.next_view import chart_at, planned_view
from procedures.geometry.views import chart_nodes
from procedures.pattern_psf.checks import seen_chart, shown
from procedures.pattern_psf.pose import chart_pose
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Diagram,
    Estimate,
    Facts,
    Goal,
    Outcomes,
    Plan,
    Request,
    Shoot,
    Show,
    Step,
    Tour,
    TourStop,
    facts_as,
    gathered_numbers,
)
from procedures.raw import RawFrame
from procedures.sensor import plan as sensor_plan
from procedures.sensor.plan import SensorFacts, mark_of

FLAT, TURNED = "flat_", "turned_"
"""Prefixes of a picture's mark: facts of the panel's quarter turns, and of the number of a view of the turned chart."""
PANEL, NO_PANEL = "with a light panel", "without"
PANEL_TURNED = "panel_turned_"  # prefix of a number of quarter turns: the fact that the panel was turned by it


@dataclass(frozen=True)
class WholeCameraFacts(GeometryFacts, SensorFacts):
    """Facts of the plan.

    light : `PANEL`, or `NO_PANEL` without sensor and vignetting
    flats : quarter turns of the panel, by the picture's mark
    turned : numbers of the views of the turned chart, by the photograph's mark
    """

    light: str = PANEL
    flats: Mapping[str, float] = gathered_numbers(FLAT)
    turned: Mapping[str, float] = gathered_numbers(TURNED)


USUAL, MOST = 6, 30  # views of the turned chart
QUARTERS = 4  # orientations of the panel, which average its slope
TRIES = 4  # attempts per flat
PREDICTED = (0, 2, 4, 6, 8)  # numbers of turned views for which the uncertainty of the projection is predicted


def plan(estimate: Estimator, levels: int = sensor_plan.LEVELS, pictures: int = sensor_plan.PICTURES) -> Plan:
    """The guided calibration of a camera in one mounting.

    levels, pictures : levels of the sensor's ladder, pictures in each stack
    """
    sensor, field = sensor_plan.plan(estimate, levels, pictures), field_plan.plan(estimate)
    light_steps = (panel_step(sensor.step("panel")), *(sensor.step(name) for name in ("dark", "ladder", "flat")), FLATS)
    places = field.step("tour")
    return Plan(
        "camera",
        "The whole camera: PSF, geometry, lateral colour, vignetting, sensor",
        (
            Step("parts", "Parts", "Choose what to measure.", (LIGHT,), drawings.PANEL),
            *(replace(step, when=with_panel) for step in light_steps),
            *(field.step(name) for name in (*field_plan.BEFORE, "places")),
            replace(places, requests=(Tour(stops),)),
            Step(
                "views", "Turned views", "The chart turned to all sides, for the geometry.",
                (Show(predicted), VIEWS, Tour(turned_stops)), drawings.VIEWS, views_summary,
            ),
            Step("estimate", "Estimate", "Put the camera together from all photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the chart's places again.", (Decide("places"),)),
        ),
        subject="frame",
        facts=WholeCameraFacts,
    )  # fmt: skip


# --- light ---

LIGHT = Ask(
    "light", "Is there a light panel, for the sensor and for vignetting?", "choice", default=PANEL,
    choices=(PANEL, NO_PANEL),
)  # fmt: skip


def with_panel(facts: Facts) -> bool:
    """Whether sensor and vignetting are measured."""
    return facts_as(WholeCameraFacts, facts).light != NO_PANEL


def panel_step(step: Step) -> Step:
    """The sensor's step with the lens on, whose vignetting is measured in the same light."""
    question = "Put the light panel close to the lens, so that it fills the frame, at the chart's aperture."
    requests = (
        replace(one, question=question) if isinstance(one, Ask) and one.key == "panel" else one for one in step.requests
    )
    return replace(step, instruction="Let the camera see even light through its lens.", requests=tuple(requests))


def flats() -> tuple[Request, ...]:
    """A picture of the panel in each orientation."""
    requests: list[Request] = []
    for quarters in range(QUARTERS):
        if quarters:
            requests.append(Ask(f"{PANEL_TURNED}{quarters}", "Turn the panel by a quarter, about the lens's axis."))
        check = partial(check_flat, quarters)
        name, enough = f"flat {quarters + 1} of {QUARTERS}", partial(one_of_four, quarters)
        requests.append(Shoot(name, check, sensor_plan.estimate_none, enough, TRIES))
    return tuple(requests)


def one_of_four(quarters: int, results: Sequence[Outcomes], facts: Facts) -> Advice:
    """Whether the picture in this orientation is taken."""
    left = QUARTERS - quarters - len(results)
    return Advice(bool(results), f"Flats: {quarters + len(results)} of {QUARTERS}.", goal=Goal(left))


def check_flat(quarters: int, frame: RawFrame, facts: Facts) -> Advice:
    """Check light and settings of a flat."""
    advice = sensor_plan.check_picture(sensor_plan.TRIAL_LEVEL, frame, facts)
    return replace(advice, facts={FLAT + mark_of(frame.sha256): float(quarters)}) if advice.good else advice


FLATS = Step(
    "flats", "Panel turned", "The panel in four orientations, so that its slope averages out.", flats(),
    drawings.PANEL,
)  # fmt: skip

# --- places and views ---


def stops(facts: Facts) -> list[TourStop]:
    """The places of the field, with recorded poses."""
    return [
        replace(one, check=partial(check_place, number, one)) for number, one in enumerate(field_plan.stops(facts), 1)
    ]


def check_place(number: int, stop: TourStop, frame: RawFrame, facts: Facts) -> Advice:
    """The field's check; records the pose of the chart."""
    advice = stop.check(frame, facts)
    if not advice.good:
        return advice
    plane, known = shown(frame), facts_as(WholeCameraFacts, facts)
    sighting = seen_chart(plane, known)
    if isinstance(sighting, Advice):
        return sighting
    pose = chart_pose(sighting.H_sensor_pattern, plane.samples.shape, known.optics(plane.pitch))
    return replace(advice, facts={**advice.facts, **pose_facts(ViewPose(number, pose))})


def turned_stops(facts: Facts) -> list[TourStop]:
    """The views of the turned chart, numbered after the places."""
    known = facts_as(WholeCameraFacts, facts)
    first = len(field_plan.locations(facts))
    count = USUAL if known.views is None else int(known.views)
    return [
        TourStop(f"view {i} of {count}", geometry_plan.way_to(first + i), partial(check_turned, first + i))
        for i in range(1, count + 1)
    ]


def check_turned(number: int, frame: RawFrame, facts: Facts) -> Advice:
    """The geometry's check; records that the photograph shows the turned chart."""
    advice = geometry_plan.check_view(number, frame, facts)
    if not advice.good:
        return advice
    return replace(advice, facts={**advice.facts, TURNED + mark_of(frame.sha256): float(number)})


VIEWS = Ask(
    "views", "How many views of the turned chart? Without them the geometry may be undetermined.", "number", "", USUAL,
    low=0, high=MOST,
)  # fmt: skip


def views_summary(facts: Facts) -> str:
    """Number of views taken."""
    count = len(facts_as(WholeCameraFacts, facts).turned)
    return f"{count} views" if count else ""


def predicted(facts: Facts) -> Diagram | None:
    """Predicted uncertainty of the projection over the frame, without and with turned views."""
    known, places = facts_as(WholeCameraFacts, facts), len(field_plan.locations(facts))
    errors = predicted_px(known, places, PREDICTED[-1])
    predictions = [(count, errors[count]) for count in PREDICTED if count < len(errors)]
    if len(predictions) < 2:
        return None
    (_, without), (most, least) = predictions[0], predictions[-1]
    say = (
        f"Without turned views the projection will be known to {without:.2g} pixels over the frame, with {most} of "
        f"them to {least:.2g}."
    )
    rows = (("turned views", "uncertainty in pixels"), *((str(count), f"{error:.2g}") for count, error in predictions))
    counts, sizes = zip(*predictions, strict=True)
    return Diagram("projection uncertainty in pixels over turned views", tuple(map(float, counts)), sizes, say, rows)


def predicted_px(known: WholeCameraFacts, places: int, most: int) -> Sequence[float]:
    """Uncertainty of the projection after the places and 0, 1, ... turned views, in pixels of the plane.

    The camera is that of the data sheet; each next view is the most informative one.
    """
    start = known.begun()
    camera = geometry_plan.nominal_camera(start.shape, start.principal_px)
    poses = [as_pose(one) for one in known.before(1 + places)]
    rim, nodes = geometry_plan.rim_of(start), chart_nodes(known.cell_mm)
    errors: list[float] = []
    while len(errors) <= most:
        view = planned_view(camera, poses, nodes, start.distance_mm, geometry_plan.SCATTER_PX, rim)
        if view is None:
            break
        errors.append(view.before)
        poses.append(chart_at(camera, view.at, view.yaw_deg, view.pitch_deg, view.distance_mm))
    return errors
