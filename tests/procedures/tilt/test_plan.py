"""Computations of the guided tilt: distance of the chart, distances of the bracket, and turns."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procedures.field.focus import FREQUENCY
from procedures.field.measuring import Location
from procedures.field.plan import TourStart
from procedures.outcome import BadParameter
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Ask, Give, Home, facts_as
from procedures.tilt.plan import (
    BY_HAND,
    TiltFacts,
    bracket_mm,
    check_width,
    depth_mm,
    off_reach_mm,
    plan,
    to_depth,
    turns_shown,
    width_within_reach,
    worth_turning,
)
from procedures.tilt.plane import Screws
from procedures.tilt.turning import FLANK, followed_turns, turn_advice
from simulators.camera.pupil import Wavefront, aberrated_otf, defocus_um

SHAPE, PRINCIPAL_PX = (480, 640), 2071.0
BASE = {"pan_deg": 2.0, "tilt_deg": -1.0, "z_mm": 150.0, "x_mm": 150.0, "y_mm": 100.0}
FOUND = {"turn_1": 0.05, "turn_2": -0.1, "turn_3": 0.05, "helps": 0.99, "screw_count": 3.0, "first_screw_deg": 30.0}


def seen_from(at: dict, chart_mm: np.ndarray) -> np.ndarray:
    """The chart relative to a rotated and moved camera: x to the right, y up, z away from it."""
    x, y, z = (at[name] - BASE[name] for name in ("x_mm", "y_mm", "z_mm"))
    turn = Rotation.from_euler("YX", [at.get("pan_deg", 0.0), at.get("tilt_deg", 0.0)], degrees=True)
    return turn.inv().apply(chart_mm + np.array([-x, y, z]))


def begun(chart_mm: np.ndarray) -> TourStart:
    """Start of a tour with a chart at (x, y, z) from the rail at its base."""
    x, y, z = seen_from(BASE, chart_mm)
    rows, columns = SHAPE
    at = Location(0.5 + PRINCIPAL_PX * x / z / columns, 0.5 + PRINCIPAL_PX * y / z / rows)
    return TourStart(SHAPE, PRINCIPAL_PX, float(z), at, (0.1, 0.13), BASE)


def test_the_chart_s_distance_follows_from_rail_and_head():
    chart_mm = np.array([12.0, -7.0, 950.0])
    at = {"pan_deg": -6.0, "tilt_deg": 4.0, "z_mm": 260.0, "x_mm": 163.0, "y_mm": 90.0}
    assert depth_mm(begun(chart_mm), at) == pytest.approx(seen_from(at, chart_mm)[2], abs=1e-9)


def facts_of(start: TourStart) -> dict:
    start_facts = {"rows": 480.0, "columns": 640.0, "principal_px": PRINCIPAL_PX, "distance_mm": start.distance_mm,
            "x": start.chart_at.x, "y": start.chart_at.y, "half_x": 0.1, "half_y": 0.13}  # fmt: skip
    lens = {"focal_length_mm": 24.0, "pixel_pitch_um": 11.88, "f_number": 2.8, "chart_width_mm": 48.0}
    at = {f"at_{name}": place for name, place in BASE.items()}
    begun = {f"tour_from_{name}": place for name, place in BASE.items()}
    return {f"tour_{name}": one for name, one in start_facts.items()} | lens | at | begun


def test_a_bracket_steps_the_image_by_depths_of_focus():
    known = facts_as(TiltFacts, facts_of(begun(np.array([0.0, 0.0, 950.0]))))
    images = [24.0 * z / (z - 24.0) for z in bracket_mm(known.optics(1), 2.8, 950.0)]
    np.testing.assert_allclose(np.diff(images), -2.8 * 11.88e-3, rtol=1e-6)  # f-number times a pixel


@pytest.mark.parametrize("axes", [("pan_deg", "tilt_deg", "z_mm"), ("x_mm", "y_mm", "z_mm")])
def test_the_rig_brings_the_chart_to_that_distance_at_its_place(axes):
    chart_mm = np.array([11.0, -8.0, 950.0])
    facts = {key: one for key, one in facts_of(begun(chart_mm)).items() if not key.startswith("tour_from_")}
    facts |= {f"tour_from_{name}": BASE[name] for name in axes}
    if "pan_deg" not in axes:  # the camera looks along the rail
        facts |= {"tour_x": 0.5 + PRINCIPAL_PX * 11 / 950 / 640, "tour_y": 0.5 - PRINCIPAL_PX * 8 / 950 / 480}
        facts["tour_distance_mm"] = 950.0
    straight = {name: 0.0 if name.endswith("_deg") else place for name, place in BASE.items()}
    places = (BASE if "pan_deg" in axes else straight) | to_depth(Location(0.2, 0.7), 1040.0, facts)
    x, y, z = seen_from(places, chart_mm)
    assert z == pytest.approx(1040.0, abs=1e-6)
    assert (x / z * PRINCIPAL_PX / 640, y / z * PRINCIPAL_PX / 480) == pytest.approx((-0.3, 0.2), abs=1e-6)


def test_screws_are_turned_where_it_was_measured_and_helps():
    assert not worth_turning({**FOUND, "helps": 0.5})
    assert turns_shown({**FOUND, "helps": 0.5}) is None
    first, _, third, fourth = plan(lambda *_: {}).step("turn").requests[2:6]
    assert (first.when(FOUND), third.when(FOUND), fourth.when(FOUND)) == (True, True, False)
    assert not first.when({**FOUND, "helps": 0.5})


@pytest.mark.parametrize("turn", [0.1, -0.2])
def test_the_turn_of_a_screw_is_followed_on_the_flank_of_the_focus_curve(turn):
    # diffraction at f/2.8 and defocus of pixels of 11.88 um: MTF at a quarter of a cycle
    bracket_step_mm, screws = 2.8 * 11.88e-3, Screws(3, 12.0, 0.35)

    def logarithm(turns):
        shift = 2 * FREQUENCY / 11.88 * 0.55 * 2.8
        blurred = Wavefront(defocus_um=defocus_um(FLANK * bracket_step_mm + turns * 0.35 / 3, 2.8))
        otf = aberrated_otf(np.array([shift]), np.zeros(1), blurred, 0.55)
        return float(np.log(np.abs(otf[0])))

    change = logarithm(turn) - logarithm(0.0)
    turned = followed_turns(1, (turn, 0.0, -turn), change, screws, 1000 * bracket_step_mm)
    assert turned == pytest.approx(turn, rel=0.15)
    assert turn_advice(1, turn, turned, 0.3, 30.0, 0.002, (480, 640)).good
    short = turn_advice(1, turn, 0.5 * turn, 0.3, 30.0, 0.002, (480, 640))
    assert short.by_hand == {"screw_1_turns": pytest.approx(0.5 * turn)}
    assert short.outline.growth > 1
    assert np.isnan(followed_turns(1, (9.0, 0.0, -9.0), change, screws, 1000 * bracket_step_mm))


def test_another_round_begins_with_the_screws():
    steps = [step.name for step in plan(lambda frames, facts, known: {}).steps]
    assert steps.index("turn") == steps.index("bracket") - 1


LENS = {"focal_length_mm": 24.0, "pixel_pitch_um": 11.88, "sensor_kind": "monochrome", "typed_f_number": 2.8,
        "paper": "a4"}  # fmt: skip
RAIL = {"at_z_mm": 1499.0, "low_z_mm": 0.0, "high_z_mm": 1500.0}
LASER = {"distance_mm": 2430.0}
PX_PER_CELL = 1.3 / 4


def bracket_of(width_mm: float) -> list[float]:
    optics = ImagingGeometry(24.0, 11.88, width_mm / 320)
    return bracket_mm(optics, 2.8, optics.distance_mm(PX_PER_CELL))


def test_charts_and_brackets_are_proposed_that_the_rail_reaches():
    width = width_within_reach({**LENS, **RAIL, **LASER})
    near, far = 2430.0 - 1499.0, 2430.0 + 1.0  # the rail's ends, from the wall
    depths, wider = bracket_of(width), bracket_of(width + 1)
    assert near < depths[0] < depths[-1] < far
    assert wider[-1] > far - 250.0  # what is kept free there
    check_width(width, {**LENS, **RAIL, **LASER})
    depths = bracket_of(width_within_reach({**LENS, **RAIL}))
    assert 900.0 < depths[-1] - depths[0] <= 1500.0
    with pytest.raises(BadParameter, match=r"a chart 96 mm wide needs the lens .* the rail reaches"):
        check_width(96.0, {**LENS, **RAIL, **LASER})
    with pytest.raises(BadParameter, match="no chart that can be printed") as raised:
        width_within_reach({**LENS, "typed_f_number": 22.0, **RAIL, **LASER})
    assert "wider aperture" in raised.value.remedy
    with pytest.raises(BadParameter, match="the axis z_mm") as raised:
        width_within_reach(LENS)
    assert raised.value.remedy == BY_HAND
    requests = [request for step in plan(lambda frames, facts, known: {}).steps for request in step.requests]
    printed = next(i for i, one in enumerate(requests) if isinstance(one, Give))
    asked = [one.key for one in requests if isinstance(one, Ask)]
    assert {"focal_length_mm", "pixel_pitch_um"} <= {one.key for one in requests[:printed] if isinstance(one, Ask)}
    assert [i < printed for i, one in enumerate(requests) if isinstance(one, Home)] == [True]
    assert (asked.count("focal_length_mm"), asked.count("pixel_pitch_um")) == (1, 1)


@pytest.mark.parametrize(
    ("depths", "nearer"),
    [([900.0, 1200.0], 0.0), ([780.0, 1000.0], 20.0), ([1500.0, 2350.0], -50.0), ([700.0, 2300.0], float("inf"))],
)
def test_the_chart_is_brought_where_the_rail_reaches_the_bracket(depths, nearer):
    # the rail stands at 150 mm, 950 mm before the chart: it reaches 800 to 2300 mm
    facts = facts_of(begun(np.array([0.0, 0.0, 950.0]))) | {"low_z_mm": 0.0, "high_z_mm": 1500.0}
    facts["tour_distance_mm"] = 950.0
    assert off_reach_mm(facts_as(TiltFacts, facts), depths) == pytest.approx(nearer)
