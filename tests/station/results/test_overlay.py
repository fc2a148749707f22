from dataclasses import replace

import numpy as np
import pytest

from procedures import BadParameter, Verdict, assess
from procedures.field.maps import HeightCurve
from station.reports.field.height_curves import heights_figure, heights_table
from station.reports.otf_figures import FrequencyAxis
from station.results.overlay import read_height_overlay, read_height_overlays, read_overlay
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from station.results.units import Pixels, Unit
from tests.psfs import gaussian


@pytest.fixture(scope="module")
def plane():
    psf = gaussian(0.7)
    return PlaneResult.of("G1", Verdict.PASS, psf, assess(psf, n=9), pitch=2)


def write(folder, plane):
    with ResultFolder(folder) as results:
        return write_psf_result(results, [plane], RecordHead("pattern"))


def test_curves_of_a_result_and_of_a_sessions_newest_are_read(tmp_path, plane):
    stated = plane.in_unit(Unit.LINE_PAIRS, Pixels(2, 4.0))
    for number in (1, 2, 10):
        write(tmp_path / "session" / "derived" / str(number), stated if number == 10 else plane)
    found = read_overlay(tmp_path / "session")
    assert (found.name, found.unit, list(found.planes)) == ("session", Unit.LINE_PAIRS, ["G1"])
    curves = found.of("G1", Unit.LINE_PAIRS)
    np.testing.assert_allclose(curves["frequency"], 125 * plane.curves["frequency"], rtol=1e-8)
    np.testing.assert_allclose(curves["vertical"], plane.curves["vertical"], rtol=1e-8)
    assert found.of("B", Unit.LINE_PAIRS) == {}
    with pytest.raises(BadParameter, match=r"in lp/mm, and this result in cycles/pixel; add --unit lp/mm"):
        found.of("G1", Unit.CYCLES)


def test_what_is_no_result_is_named(tmp_path, plane):
    with pytest.raises(BadParameter, match="has no result with an MTF"):
        read_overlay(tmp_path)
    write(tmp_path / "a", plane)
    (tmp_path / "a" / "mtf_G1.csv").write_text("frequency,horizontal\n0,one\n")
    with pytest.raises(BadParameter, match="is no table of an MTF"):
        read_overlay(tmp_path / "a")


HEIGHTS = np.array([0.0, 60.0, 120.0])
CURVE = HeightCurve(
    0.125, HEIGHTS, np.array([0.9, 0.8, 0.7]), np.full(3, 0.01), np.zeros(3),
    np.array([0.9, 0.7, 0.5]), np.full(3, 0.01), np.zeros(3), np.array([1, 8, 8]),
)  # fmt: skip
CURVES = [CURVE, replace(CURVE, frequency=0.25, sagittal=CURVE.sagittal / 2, meridional=CURVE.meridional / 2)]


def write_field(folder, plane, axis, mm_per_pixel):
    with ResultFolder(folder) as results:
        results.write("heights_G1.csv", heights_table(CURVES, axis, mm_per_pixel))
        return write_psf_result(results, [plane], RecordHead("field"))


def test_curves_over_image_height_are_read_as_they_were_written(tmp_path, plane):
    write_field(tmp_path / "a", plane, FrequencyAxis("lp/mm", 125.0), 0.008)
    found = read_height_overlay(tmp_path / "a")
    assert (found.name, found.unit, found.length) == ("a", Unit.LINE_PAIRS, "mm")
    columns = found.of("G1", Unit.LINE_PAIRS, "mm")
    np.testing.assert_allclose(columns["image_height"], np.tile(0.008 * HEIGHTS, 2), rtol=1e-5)
    np.testing.assert_allclose(columns["frequency"], np.repeat([15.625, 31.25], 3), rtol=1e-5)
    np.testing.assert_allclose(columns["meridional"][:3], CURVE.meridional, rtol=1e-5)
    assert found.of("G1", Unit.LINE_PAIRS, "pixel") == found.of("B", Unit.LINE_PAIRS, "mm") == {}
    with pytest.raises(BadParameter, match=r"in lp/mm, and this result in cycles/pixel; add --unit lp/mm"):
        read_height_overlays([tmp_path / "a"], Unit.CYCLES)


def test_a_result_of_one_place_is_no_field(tmp_path, plane):
    write(tmp_path / "a", plane)
    with pytest.raises(BadParameter, match="has no result with an MTF over image height"):
        read_height_overlay(tmp_path / "a")


@pytest.mark.parametrize(("factor", "words"), [(1.0, "older"), (0.5, "older, at 0.0625, 0.125 cycles/pixel")])
def test_another_field_is_drawn_and_named_with_its_frequencies_where_they_are_others(tmp_path, plane, factor, words):
    write_field(tmp_path / "older", plane, FrequencyAxis("cycles/pixel", factor), None)
    columns = read_height_overlay(tmp_path / "older").of("G1", Unit.CYCLES, "pixel")
    alone, over = (
        str(heights_figure(CURVES, "x", FrequencyAxis("cycles/pixel", 1.0), None, others))
        for others in ({}, {"older": columns})
    )
    assert f">{words}</text>" in over
    assert over.count("<path") > alone.count("<path")
