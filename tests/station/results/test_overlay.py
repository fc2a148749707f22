from __future__ import annotations

import json

import numpy as np
import pytest

from procedures.outcome import BadParameter, Verdict
from procedures.psf import Psf
from procedures.quality import assess
from station.results.overlay import read_overlay
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, file_names, write_psf_result
from station.results.units import Pixels, Unit


@pytest.fixture(scope="module")
def plane():
    x = (np.arange(17) - 8) / 4
    h = np.exp(-(x[:, None] ** 2 + x**2))
    psf = Psf(h / h.sum(), 4, np.eye(289) * 1e-8)
    return PlaneResult.of("G1", Verdict.PASS, psf, assess(psf, n=9), pitch=2)


def write(folder, plane):
    with ResultFolder(folder) as results:
        return write_psf_result(results, [plane], RecordHead("pattern"))


def test_curves_of_a_result_and_of_a_sessions_newest_are_read(tmp_path, plane):
    told = plane.in_unit(Unit.LINE_PAIRS, Pixels(2, 4.0))
    for number in (1, 2, 10):
        write(tmp_path / "session" / "derived" / str(number), told if number == 10 else plane)
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


def test_files_that_a_page_links_are_those_that_are_written(tmp_path, plane):
    text = write(tmp_path / "a", plane)
    assert sorted(file_names([plane])) == sorted([*json.loads(text)["files"], "result.json"])
