"""Moves of a field's tour, compared with an independent projection by the bench's geometry."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from procedures.field.measuring import Location
from procedures.field.plan import (
    BASE,
    NEAR,
    FieldFacts,
    bring,
    check_place,
    check_places,
    corner_goal,
    locations,
    say_place,
    to_place,
)
from procedures.geometry.plan import check_start
from procedures.pattern import Chart
from procedures.plan import facts_as
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.exposure import Exposure
from simulators.camera.camera import pixels_at
from simulators.camera.sensor import Sensor
from simulators.camera.sheets import frame_camera
from simulators.world.scene import Scene

ROWS, COLUMNS, F_PX, AWAY_MM = 240, 320, 2050.0, 1900.0
FACTS = {
    "tour_rows": float(ROWS),
    "tour_columns": float(COLUMNS),
    "tour_principal_px": F_PX,
    "tour_distance_mm": AWAY_MM,
    "tour_x": 0.5,
    "tour_y": 0.5,
    "tour_half_x": 0.165,
    "tour_half_y": 0.22,
}
parts = st.floats(0.1, 0.9)
angles = st.floats(-15.0, 15.0)


def projected(chart_mm, pan_deg=0.0, tilt_deg=0.0, x_mm=0.0, y_mm=0.0, z_mm=0.0):
    """Projection of a point: stages move the camera right, up and back, the head turns it."""
    offset = np.asarray(chart_mm) + np.array([-x_mm, y_mm, z_mm])
    ray = Rotation.from_euler("YX", [pan_deg, tilt_deg], degrees=True).inv().apply(offset)
    x, y = F_PX * ray[:2] / ray[2]
    return Location((x + COLUMNS / 2) / COLUMNS, (y + ROWS / 2) / ROWS), ray[2]


def from_base(chart_mm, base):
    at, _ = projected(chart_mm, **base)
    return {**FACTS, "tour_x": at.x, "tour_y": at.y, **{BASE + name: place for name, place in base.items()}}


@settings(max_examples=50, deadline=None)
@given(parts, parts, angles, angles)
def test_head_brings_the_chart_to_its_place_from_wherever_it_looks(x, y, pan, tilt):
    chart = Rotation.from_euler("YX", [pan, tilt], degrees=True).apply([15.0, -20.0, AWAY_MM])
    base = {"pan_deg": pan, "tilt_deg": tilt}
    facts = from_base(chart, base)
    there, _ = projected(chart, **to_place(Location(x, y), facts))
    assert (there.x, there.y) == pytest.approx((x, y), abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(parts, parts)
def test_rail_behind_the_head_keeps_the_distance_along_the_axis(x, y):
    base = {"pan_deg": 0.0, "tilt_deg": 0.0, "z_mm": 700.0}
    chart = np.array([0.0, 0.0, AWAY_MM - 700.0])
    places = to_place(Location(x, y), from_base(chart, base))
    there, depth_mm = projected(chart, **places)
    assert (there.x, there.y) == pytest.approx((x, y), abs=1e-9)
    assert depth_mm == pytest.approx(AWAY_MM, rel=1e-9)


def test_the_rail_does_not_go_beyond_its_travel():
    base = {"pan_deg": 0.0, "tilt_deg": 0.0, "z_mm": 700.0}
    facts = from_base([0, 0, AWAY_MM - 700.0], base) | {"low_z_mm": 0.0, "high_z_mm": 700.5}
    assert to_place(Location(0.1, 0.1), facts)["z_mm"] == 700.5


@settings(max_examples=50, deadline=None)
@given(parts, parts)
def test_cross_slides_replace_a_head(x, y):
    chart, base = np.array([42.0, 3.0, AWAY_MM]), {"x_mm": 30.0, "y_mm": -10.0}
    places = to_place(Location(x, y), from_base(chart, base))
    there, _ = projected(chart, **places)
    assert (there.x, there.y) == pytest.approx((x, y), abs=1e-9)


def test_without_axes_the_operator_gets_the_position_of_the_chart():
    assert to_place(Location(0.2, 0.7), FACTS) == {}
    assert bring(Location(0.5, 0.5), Location(0.2, 0.7), {"z_mm": 3.0}, facts_as(FieldFacts, FACTS).begun()) == {}
    assert say_place(Location(0.2, 0.7), FACTS) == (
        "Turn the camera, and leave the chart, until the chart's middle is 20 % from the left and 70 % from the top "
        "of the frame."
    )


@pytest.mark.parametrize("count", [6, 9, 25, 100])
def test_all_of_the_sheet_stays_in_the_frame_at_every_place(count):
    # the check lets the chart lie NEAR its place
    points = np.array([(one.x, one.y) for one in locations({**FACTS, "places": float(count)})])
    assert len(np.unique(points.round(9), axis=0)) == count
    half = np.array([FACTS["tour_half_x"], FACTS["tour_half_y"]])
    assert np.all(points - half >= NEAR - 1e-12)
    assert np.all(points + half <= 1 - NEAR + 1e-12)


@pytest.mark.parametrize("count", [6, 9, 25])
def test_the_tour_brings_the_sheet_to_the_frame_s_corners(count):
    facts = {**FACTS, "tour_half_x": 0.02, "tour_half_y": 0.03, "places": float(count)}
    points = {(round(one.x, 9), round(one.y, 9)) for one in locations(facts)}
    assert {(x, y) for x in (0.05, 0.95) for y in (0.06, 0.94)} <= points


@pytest.mark.parametrize(
    ("check", "side", "good"),
    [(check_places, 320, True), (check_places, 160, False), (check_start, 420, True), (check_start, 240, False)],
)
def test_a_frame_too_small_for_the_chart_is_refused_before_the_tour(check, side, good, rng, tmp_path):
    camera = replace(frame_camera(), sensor=Sensor(rows=side, columns=side, cfa=None), oversampling=5)
    placed = camera.place(Chart.from_seed(), pixels=pixels_at(1.3), cell_mm=0.3)
    camera.photograph(Scene((placed,)), rng, tmp_path / "frame.dng", exposure_s=0.02)
    facts = {"chart_width_mm": 96.0, "focal_length_mm": 24.0, "pixel_pitch_um": 11.88, "sensor_kind": "monochrome"}
    advice = check(read_frame(tmp_path / "frame.dng"), facts)
    assert advice.good is good
    assert ("set the camera to its whole sensor" in advice.say) is not good


def test_an_empty_frame_of_the_tour_gets_advice_and_no_moves():
    plane = Plane("Y", np.full((ROWS, COLUMNS), 0.5, np.float32), 1e-4)
    frame = RawFrame(Path("empty.dng"), "", {"Y": plane}, Exposure())
    advice = check_place(Location(0.2, 0.7), frame, FACTS)
    assert (advice.good, advice.moves, advice.by_hand) == (False, {}, {})
    assert advice.say.startswith("No chart is found")


def test_the_corners_are_known_from_the_sixth_place_on_and_better_with_each():
    places = locations({**FACTS, "places": 9.0})
    facts = {"chart_mtf50_uncertainty": 0.002}
    steps = [corner_goal(places, i, facts) for i in range(1, 10)]
    known = [one.after for one in steps]
    assert [one.left for one in steps] == list(range(9, 0, -1))
    assert np.isinf(known[:5]).all()
    finite = [one for one in known if np.isfinite(one)]
    assert len(finite) >= 3
    assert finite == sorted(finite, reverse=True)
    # the variance of the nine places' quadratic in a corner, by many draws
    at = 2 * np.array([(one.x, one.y) for one in places]) - 1
    basis = lambda x, y: np.stack([x**0, x, y, x * x, x * y, y * y], axis=-1)  # noqa: E731
    noise = np.random.default_rng(1).normal(scale=0.002, size=(9, 4000))
    corner = basis(np.ones(1), np.ones(1)) @ np.linalg.lstsq(basis(*at.T), noise, rcond=None)[0]
    assert finite[-1] == pytest.approx(float(corner.std()), rel=0.05)
