"""The plan of the whole camera: sensor and flats before a light panel, the chart over the frame, the turned chart.

Its steps are those of the plans of sensor, field and geometry. The sensor comes first, so that places may be taken
again when the chart hangs already. Each place is a view of the geometry too; which turned view is next follows from all
before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from procedures.drawings import steps as drawings
from procedures.facts import facts_as
from procedures.field import plan as field_plan
from procedures.field.plan import Estimator
from procedures.geometry import plan as geometry_plan
from procedures.geometry.facts import ViewPose, as_pose, pose_facts
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
    Plan,
    Request,
    Shoot,
    Show,
    Step,
    Tour,
    TourStop,
)
from procedures.raw import RawFrame
from procedures.sensor import plan as sensor_plan
from procedures.sensor.facts import mark_of
from procedures.whole_camera.facts import FLAT, NO_PANEL, PANEL, PANEL_TURNED, TURNED, WholeCameraFacts

USUAL, MOST = 6, 30
"""Views of the turned chart."""
QUARTERS = 4
"""Ways round that the panel is photographed, so that its own slope averages out."""
TRIES = 4
"""Pictures taken for a flat until one counts."""
FORESEEN = (0, 2, 4, 6, 8)
"""Numbers of turned views for which it is told beforehand how well the projection will be known."""


def plan(estimate: Estimator, levels: int = sensor_plan.LEVELS, pictures: int = sensor_plan.PICTURES) -> Plan:
    """The guided calibration of everything that one mounting tells.

    Parameters
    ----------
    levels, pictures : int
        Of the sensor's ladder, and in each of its stacks.
    """
    sensor, field = sensor_plan.plan(estimate, levels, pictures), field_plan.plan(estimate)
    of_light = (panel_step(sensor.step("panel")), *(sensor.step(name) for name in ("dark", "ladder", "flat")), FLATS)
    places = field.step("tour")
    return Plan(
        "camera",
        "The whole camera: PSF, geometry, lateral colour, vignetting, sensor",
        (
            Step("parts", "Parts", "Choose what to measure.", (LIGHT,), drawings.PANEL),
            *(replace(one, when=with_panel) for one in of_light),
            *(field.step(name) for name in (*field_plan.BEFORE, "places")),
            replace(places, requests=(Tour(stops),)),
            Step(
                "views", "Turned views", "The chart turned to all sides: the geometry needs that beside the places.",
                (Show(foreseen), VIEWS, Tour(turned_stops)), drawings.VIEWS, gave_views,
            ),
            Step("estimate", "Estimate", "Put the camera together from all photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the chart's places again.", (Decide("places"),)),
        ),
        subject="frame",
        facts=WholeCameraFacts,
    )  # fmt: skip


# --- light -------------------------------------------------------------------------------------------------------

LIGHT = Ask(
    "light", "Is there a light panel, for the sensor and for vignetting?", "choice", default=PANEL,
    choices=(PANEL, NO_PANEL),
)  # fmt: skip


def with_panel(facts: Facts) -> bool:
    """Whether sensor and vignetting are measured."""
    return facts_as(WholeCameraFacts, facts).light != NO_PANEL


def panel_step(step: Step) -> Step:
    """The sensor's step with the lens on: its vignetting is measured in the same light."""
    question = "Put the light panel close before the lens, so that it fills the frame, at the chart's aperture."
    requests = (
        replace(one, question=question) if isinstance(one, Ask) and one.key == "panel" else one for one in step.requests
    )
    return replace(step, instruction="Let the camera see even light through its lens.", requests=tuple(requests))


def flats() -> tuple[Request, ...]:
    """A picture of the panel each way round."""
    found: list[Request] = []
    for quarters in range(QUARTERS):
        if quarters:
            found.append(Ask(f"{PANEL_TURNED}{quarters}", "Turn the panel by a quarter, about the lens's axis."))
        check = partial(check_flat, quarters)
        name, enough = f"flat {quarters + 1} of {QUARTERS}", partial(sensor_plan.enough, 1)
        found.append(Shoot(name, check, sensor_plan.estimate_none, enough, TRIES))
    return tuple(found)


def check_flat(quarters: int, frame: RawFrame, facts: Facts) -> Advice:
    """A flat that counts has the light and the settings of the sensor's flats."""
    advice = sensor_plan.check_picture(sensor_plan.trial_level(), frame, facts)
    return replace(advice, facts={FLAT + mark_of(frame.sha256): float(quarters)}) if advice.good else advice


FLATS = Step(
    "flats", "Panel turned", "The panel four ways round, so that its own slope is not taken for the lens's.", flats(),
    drawings.PANEL,
)  # fmt: skip

# --- places and views --------------------------------------------------------------------------------------------


def stops(facts: Facts) -> list[TourStop]:
    """The places of the field, whose poses are kept."""
    return [
        replace(one, check=partial(check_place, number, one)) for number, one in enumerate(field_plan.stops(facts), 1)
    ]


def check_place(number: int, stop: TourStop, frame: RawFrame, facts: Facts) -> Advice:
    """As the field's; how the chart stands in a place that counts becomes known."""
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
    """The views of the turned chart, which are counted on from the places."""
    known = facts_as(WholeCameraFacts, facts)
    first = len(field_plan.locations(facts))
    count = USUAL if known.views is None else int(known.views)
    return [
        TourStop(f"view {i} of {count}", geometry_plan.way_to(first + i), partial(check_turned, first + i))
        for i in range(1, count + 1)
    ]


def check_turned(number: int, frame: RawFrame, facts: Facts) -> Advice:
    """As the geometry's; the photograph is known for one of the turned chart."""
    advice = geometry_plan.check_view(number, frame, facts)
    if not advice.good:
        return advice
    return replace(advice, facts={**advice.facts, TURNED + mark_of(frame.sha256): float(number)})


VIEWS = Ask(
    "views", "How many views of the turned chart? Without them the geometry may not be told.", "number", "", USUAL,
    low=0, high=MOST,
)  # fmt: skip


def gave_views(facts: Facts) -> str:
    """How many were taken."""
    count = len(facts_as(WholeCameraFacts, facts).turned)
    return f"{count} views" if count else ""


def foreseen(facts: Facts) -> Diagram | None:
    """How well the projection will be known over the frame, without turned views and with them."""
    known, places = facts_as(WholeCameraFacts, facts), len(field_plan.locations(facts))
    errors = foreseen_px(known, places, FORESEEN[-1])
    told = [(count, errors[count]) for count in FORESEEN if count < len(errors)]
    if len(told) < 2:
        return None
    (_, without), (most, least) = told[0], told[-1]
    say = (
        f"Without turned views the projection will be known to {without:.2g} pixels over the frame, with {most} of "
        f"them to {least:.2g}."
    )
    rows = (("turned views", "uncertainty in pixels"), *((str(count), f"{error:.2g}") for count, error in told))
    counts, sizes = zip(*told, strict=True)
    return Diagram("projection uncertainty in pixels over turned views", tuple(map(float, counts)), sizes, say, rows)


def foreseen_px(known: WholeCameraFacts, places: int, most: int) -> Sequence[float]:
    """Uncertainty of the projection after the places and 0, 1, ... turned views, in pixels of the plane.

    The camera is the data sheet's; a view that comes next is the one that helps most.
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
        errors.append(view.before_px)
        poses.append(chart_at(camera, view.at, view.yaw_deg, view.pitch_deg, view.distance_mm))
    return errors
