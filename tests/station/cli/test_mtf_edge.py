"""`station mtf edge`: its files, its record, and its exit codes."""

import csv
import json

import cv2
import pytest

from tests.program import run
from tests.station.manual.conftest import edge_of


@pytest.fixture
def picture(tmp_path):
    """An edge of MTF50 0.25 as a 16 bit PNG."""
    cv2.imwrite(str(tmp_path / "edge.png"), edge_of(0.25))
    return tmp_path / "edge.png"


@pytest.mark.slow
def test_region_gives_record_table_and_picture(picture, tmp_path):
    run("mtf", "edge", picture, "--roi", "5,5,50,70", "--out", tmp_path / "out", "--json", "--at", "0.3,9")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["schema"] == "station/mtf/1"
    assert record["parameters"]["roi"] == [5, 5, 50, 70]
    plane = record["planes"]["Y"]
    # point samples: nothing blurs but the Gaussian
    assert plane["mtf50"]["value"] == pytest.approx(0.25, rel=0.002)
    assert plane["mtf50"]["unit"] == "cycles/pixel"
    assert "mtf_at_0.3" in plane
    assert plane["unavailable"] == ["no MTF is reported at 9 cycles/pixel: it is beyond the measured range"]
    assert plane["angle"]["value"] == pytest.approx(5.5, abs=0.01)
    (edge,) = plane["edges"]
    assert edge["orientation"] == "near-vertical"
    assert (edge["verdict"], edge["roi"]) == ("pass", [5, 5, 50, 70])
    table = list(csv.DictReader((tmp_path / "out" / "mtf_Y.csv").read_text().splitlines()))
    assert float(table[0]["mtf"]) == 1
    at_half = next(row for row in table if row["frequency [cycles/pixel]"] == "0.25")
    assert float(at_half["mtf"]) == pytest.approx(0.5, abs=0.002)
    assert (tmp_path / "out" / "edge_Y.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(("roi", "code"), [("0,0,99,20", 2), ("0,0,x,20", 2), ("1,2,3", 2), ("0,0,12,80", 5)])
def test_regions_that_hold_no_edge_are_refused(picture, tmp_path, roi, code):
    run("mtf", "edge", picture, "--roi", roi, "--out", tmp_path / "out", code=code)


@pytest.mark.slow
def test_refusal_leaves_its_reason_and_no_table(picture, tmp_path):
    run("mtf", "edge", picture, "--out", tmp_path / "out")
    run("mtf", "edge", picture, "--roi", "0,0,12,80", "--out", tmp_path / "out", code=5)
    plane = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]
    assert plane["verdict"] == "refused"
    assert "no edge" in plane["reason"]
    assert [(edge["verdict"], edge["roi"]) for edge in plane["edges"]] == [("refused", [0, 0, 12, 80])]
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["result.json"]


def test_the_aperture_goes_into_record_and_verdict(picture, tmp_path):
    # a Gaussian has no tail: an aperture that throws 2 % of a pixel is not this picture's
    optics = ("--pixel-pitch-um", "5", "--f-number", "2.8")
    run("mtf", "edge", picture, "--roi", "5,5,50,70", *optics, "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["parameters"]["f_number"] == 2.8
    assert record["planes"]["Y"]["verdict"] == "doubtful"
    assert "by the aperture" in record["planes"]["Y"]["reason"]


@pytest.mark.slow
def test_a_named_edge_has_the_verdict_it_has_in_the_list(picture, tmp_path):
    run("mtf", "edge", picture, "--out", tmp_path / "all")
    (edge,) = json.loads((tmp_path / "all" / "result.json").read_text())["planes"]["Y"]["edges"]
    run("mtf", "edge", picture, "--roi", ",".join(map(str, edge["roi"])), "--out", tmp_path / "one")
    assert json.loads((tmp_path / "one" / "result.json").read_text())["planes"]["Y"]["edges"] == [edge]
