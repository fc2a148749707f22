"""Target distance of the plan before the chart is in sight, by lens, print and the sensor's planes."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Chart, read_frame
from procedures.pattern_psf.checks import check_light
from procedures.pattern_psf.facts import RATIO, PatternFacts
from procedures.pattern_psf.plan import DISTANCE, PRINT, chart_page, plan, rail_places, say_distance, towards_distance
from procedures.plan import Ask, facts_as
from simulators.camera.camera import Lens, SimulatedCamera, pixels_at
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

COLOUR = SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=160, columns=200), pitch_um=5.94, oversampling=4)
GREY = replace(COLOUR, sensor=Sensor(rows=160, columns=200, cfa=None))
CHART, CELL_MM = Chart.from_seed(), 0.3
FACTS = {"chart_width_mm": 320 * CELL_MM, "focal_length_mm": 24.0, "pixel_pitch_um": 5.94}


def right_mm(camera):
    """The simulator's own answer: from where the chart has the pixels of its planes that the ratio wants."""
    return camera.place(CHART, pixels=pixels_at(RATIO), cell_mm=CELL_MM).pose.centre_mm[2]


@pytest.mark.slow
def test_a_monochrome_camera_is_sent_to_its_own_distance_by_the_photograph_of_the_light(rng, tmp_path):
    path = tmp_path / "frame.dng"
    scene = Scene((GREY.place(CHART, pixels=pixels_at(RATIO), cell_mm=CELL_MM),))
    GREY.photograph(scene, rng, path, exposure_s=0.02)
    facts = {**FACTS, **check_light(read_frame(path), FACTS).facts}
    assert say_distance(facts) == f"Put the camera {right_mm(GREY) / 1000:.2f} m from the chart, by a tape measure."
    rail = {"at_z_mm": 100.0, "distance_mm": 900.0, "laser_offset_mm": 0.0}
    assert towards_distance({**facts, **rail})["z_mm"] == pytest.approx(100.0 + right_mm(GREY) - 900.0)


def test_the_kind_of_sensor_is_told_though_there_is_no_chart_in_sight(rng, tmp_path):
    path = tmp_path / "frame.dng"
    GREY.photograph(Scene(), rng, path)
    assert check_light(read_frame(path), FACTS).facts["sensor_kind"] == "monochrome"


@pytest.mark.parametrize(("answer", "camera"), [("mosaic", COLOUR), ("monochrome", GREY)])
def test_where_no_photograph_told_it_is_asked_before_the_distance_is(answer, camera):
    (ask,) = (one for one in DISTANCE if isinstance(one, Ask) and one.key == "sensor_kind")
    assert DISTANCE.index(ask) < len([one for one in DISTANCE if isinstance(one, Ask)])
    assert ask.when(FACTS)
    assert answer in ask.choices
    facts = {**FACTS, "sensor_kind": answer}
    assert not ask.when(facts)
    assert facts_as(plan().facts, facts).wanted_distance_mm() == pytest.approx(right_mm(camera))
    assert facts_as(PatternFacts, facts).optics().plane_pitch_um == 5.94 * camera.plane_pitch_px


def printing(key):
    """The question of the step `print` with this key."""
    (ask,) = (one for one in PRINT if isinstance(one, Ask) and one.key == key)
    return ask


@pytest.mark.parametrize(
    ("locale", "paper", "width_mm"), [("de_DE.UTF-8", "a4", 145.0), ("en_US.UTF-8", "letter", 130.0)]
)
def test_the_proposed_chart_is_the_largest_that_the_locales_paper_holds(monkeypatch, locale, paper, width_mm):
    monkeypatch.setenv("LC_ALL", locale)
    assert printing("paper").proposed({}) == paper
    assert printing("chart_width_mm").proposed({"paper": paper}) == width_mm


def test_the_distance_follows_from_the_paper():
    facts = {**FACTS, "paper": "a4", "chart_width_mm": printing("chart_width_mm").proposed({"paper": "a4"})}
    cell_mm = 145 / 320
    wanted = COLOUR.place(CHART, pixels=pixels_at(RATIO), cell_mm=cell_mm).pose.centre_mm[2]
    assert facts_as(PatternFacts, facts).wanted_distance_mm() == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("paper", "width_mm", "pages"),
    [("a4", 145.0, 1), ("a4", 300.0, 5), ("a2", 300.0, 1), (None, 300.0, 1)],  # four sheets after an assembly drawing
)
def test_a_chart_that_exceeds_the_paper_is_given_on_several_sheets(paper, width_mm, pages):
    facts = {"chart_width_mm": width_mm} if paper is None else {"paper": paper, "chart_width_mm": width_mm}
    assert chart_page(facts).count(b"/Type /Page\n") == pages
    assert printing("joined").when(facts) == (pages > 1)


def test_steps_of_the_rail_blur_by_three_quarters_of_a_pixel():
    # thin lens: 1/f = 1/z + 1/v, and a pupil f/N; the mean of both sides is of first order in f/z, 1.3 %
    f, n, at = FACTS["focal_length_mm"], 1.0, 500.0
    facts = {**FACTS, "sensor_kind": "mosaic", "focus_by": "rail", "f_number": n, "at_z_mm": at}
    z, places = right_mm(COLOUR), np.array(rail_places(facts))
    image, images = (1 / (1 / f - 1 / distance) for distance in (z, z + places - at))
    blur_px = f / n * np.abs(images - image) / images / (2 * FACTS["pixel_pitch_um"] / 1000)
    np.testing.assert_allclose((blur_px + blur_px[::-1]) / 2, [1.5, 0.75, 0, 0.75, 1.5], rtol=0.02)
    short = rail_places({**facts, "low_z_mm": at, "high_z_mm": at + 1e3})
    assert short == [place for place in places if place >= at]
    assert rail_places({**facts, "focus_by": "ring"}) == ()
