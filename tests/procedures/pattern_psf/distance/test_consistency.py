"""Wrong numbers about lens, sensor and print are named: by the thin lens's own formula, no photograph."""

import re
from dataclasses import replace

import numpy as np
import pytest

from procedures.numerics.warps import apply_homography
from procedures.pattern import CELLS, X_CORNERS, Chart
from procedures.pattern_psf.chart_finding.detection import ChartSighting
from procedures.pattern_psf.distance.consistency import (
    cautious_mm,
    cell_correlation,
    measured_scale,
    probe_mm,
    size_contradiction,
)
from procedures.pattern_psf.facts import SIZES, PatternFacts, RangeLook
from procedures.plan import AxisTravel
from procedures.raw import Exposure, Plane

TRUE = PatternFacts(focal_length_mm=24.0, pixel_pitch_um=5.94, chart_width_mm=96.0, ruler_mm=99.5)
OFFSET_MM = 120.0
WORDS = dict(zip(SIZES, ("focal length of", "pixel pitch of", "as wide as", "ruler that measures"), strict=True))
WRONG = [0.5, 0.8, 1.2, 2.0]
NOTED_NOTHING = Exposure()


def look(z_mm, *, laser=False, rail=False):
    """Size of the chart at a distance with the focus at 1.5 m, by a thin lens: F = f d / (d - f)."""
    F_px = 1000 * 24.0 * 1500.0 / (1500.0 - 24.0) / (2 * 5.94)
    cell_mm = 96.0 / 320 * 0.995
    return RangeLook(F_px * cell_mm / z_mm, z_mm + OFFSET_MM if laser else None, z_mm - 800.0 if rail else None)


def given(name, share, *before):
    return replace(TRUE, **{name: share * getattr(TRUE, name)}, looks=before)


def contradiction(known, now, exposure=NOTED_NOTHING):
    return size_contradiction(now, known.optics(), known, exposure)


@pytest.mark.parametrize("share", WRONG)
@pytest.mark.parametrize("name", SIZES)
def test_any_of_the_numbers_that_is_wrong_is_named_after_one_move_of_the_rail(name, share):
    known, now = given(name, share, look(1300.0, rail=True)), look(1400.0, rail=True)
    advice = contradiction(known, now)
    assert not advice.good
    assert advice.moves == {}
    assert name in advice.contradictory
    # what it would have to be is what it is, but for the focus, which a thin lens focused here would have elsewhere
    (fitting,) = re.findall(rf"{WORDS[name]} ([0-9.]+)", advice.say)
    assert float(fitting) == pytest.approx(getattr(TRUE, name), rel=0.025)


@pytest.mark.parametrize("share", [0.5, 1.5, 2.0])
@pytest.mark.parametrize("name", SIZES)
def test_the_laser_alone_names_what_puts_it_farther_from_the_lens_than_it_can_be(name, share):
    assert name in contradiction(given(name, share), look(1300.0, laser=True)).contradictory


@pytest.mark.parametrize("way", ["laser", "rail"])
def test_nothing_is_named_where_all_is_right_though_the_focus_is_elsewhere(way):
    known = replace(TRUE, looks=(look(1300.0, **{way: True}),))
    assert contradiction(known, look(1390.0, **{way: True})) is None
    assert contradiction(TRUE, look(1300.0, laser=True)) is None


def test_numbers_that_the_camera_noted_are_not_flagged_nor_are_those_insisted_on():
    known, now = given("ruler_mm", 0.8, look(1300.0, rail=True)), look(1400.0, rail=True)
    recorded = Exposure(focal_length_mm=24.0, pixel_pitch_um=5.94)
    assert contradiction(known, now, recorded).contradictory == ("chart_width_mm", "ruler_mm")
    assert contradiction(replace(known, insisted=frozenset(SIZES)), now) is None


@pytest.mark.parametrize("share", WRONG)
def test_a_tape_measure_names_them_where_there_is_neither_laser_nor_rail(share):
    known = replace(given("focal_length_mm", share), tape_mm=1500.0)
    assert "focal_length_mm" in contradiction(known, look(1500.0)).contradictory
    assert contradiction(replace(TRUE, tape_mm=1530.0), look(1500.0)) is None


def test_distances_tell_the_scale_by_two_and_short_moves_first():
    assert measured_scale([look(1300.0, rail=True), look(1310.0, rail=True)]) is None
    scale, by = measured_scale([look(1300.0, rail=True), look(1400.0, rail=True)])
    assert by == "rail's travel"
    assert scale == pytest.approx(look(1000.0).px_per_cell * 1000.0)
    first, then = look(1300.0, rail=True), look(1400.0, rail=True)
    assert cautious_mm(900.0, first, 1300.0, TRUE) == pytest.approx(0.16 * 1300.0)
    assert cautious_mm(900.0, then, 1400.0, replace(TRUE, looks=(first,))) == 900.0
    assert cautious_mm(-100.0, first, 1300.0, TRUE) == -100.0
    rail = {"z_mm": AxisTravel(580.0, 0.0, 600.0)}
    now = look(1380.0, rail=True)
    assert probe_mm(now, 1380.0, False, replace(TRUE, axes=rail)) == pytest.approx(-0.08 * 1380.0)
    assert probe_mm(now, 1380.0, True, replace(TRUE, axes=rail)) == pytest.approx(-0.08 * 1380.0)
    assert probe_mm(look(1380.0), 1380.0, True, TRUE) == 0.0


def test_cells_of_the_chart_correlate_with_its_number_alone():
    # pixels of 2.7 cells, each the mean of 8 x 8 points: the expected ones are means of 4 x 4, which differ by a tenth
    # of the variance. Half a pixel off they would correlate by half. Another chart's are independent: 1 / sqrt(5000)
    # over the central pixels, the largest of 49 shifts
    H = np.array([[0.37, 0.0, 20.2], [0.0, 0.37, 15.7], [0.0, 0.0, 1.0]])
    fine, shape = 8, (130, 140)
    v, u = ((np.arange(n * fine) + 0.5) / fine - 0.5 for n in shape)
    at = apply_homography(np.linalg.inv(H), np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    cells = Chart.from_seed(7).cells[tuple(np.clip(at[:, ::-1], 0, CELLS - 1).astype(int).T)]
    samples = cells.reshape(shape[0], fine, shape[1], fine).mean(axis=(1, 3)).astype(np.float32)
    sighting = ChartSighting(apply_homography(H, X_CORNERS), H, np.ones(12, bool), 1.0, False, False)
    plane = Plane("Y", samples, 1e-4)
    assert cell_correlation(plane, sighting, 7) > 0.8
    assert abs(cell_correlation(plane, sighting, 8)) < 5 / 5000**0.5
    grey = np.where(np.arange(shape[0])[:, None] < 10, 0.0, np.full(shape, 0.5)).astype(np.float32)
    assert cell_correlation(replace(plane, samples=grey), sighting, 7) is None
