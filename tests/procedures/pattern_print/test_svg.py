import xml.etree.ElementTree as ET

import numpy as np
import pytest

from procedures.pattern import CELLS
from procedures.pattern_print.formats import svg
from procedures.pattern_print.sheet import Size, lay_out
from procedures.pattern_print.source import Source

from .filling import svg_loops, winding

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def data(source: Source) -> bytes:
    return svg(lay_out(source, Size(300)))


@pytest.fixture(scope="module")
def root(data: bytes) -> ET.Element:
    return ET.fromstring(data)


@pytest.mark.slow
def test_one_unit_is_one_millimetre_and_the_path_fills_the_cells_of_the_seed(root, source):
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("420mm", "594mm", "0 0 420 594")
    path = root.find(f"{SVG}path[@id='chart']")
    assert path is not None
    inside = winding(svg_loops(path.get("d", "")), 0.5, 1.0, CELLS)
    np.testing.assert_array_equal(inside == 0, source.chart.cells == 1)
    assert path is not None
    place, scale = path.get("transform", "").replace("(", " ").replace(")", "").split(" scale ")
    # 300 mm are 320 cells; the chart stands in the middle of 420 mm of paper, the noise a block of 30 mm further in
    assert float(scale) == pytest.approx(300 / 320)
    assert float(place.split()[1]) == pytest.approx((420 - 300) / 2 + 30)


def test_both_rulers_are_100_mm_long(root: ET.Element) -> None:
    ends = [[float(line.get(name, "nan")) for name in ("x1", "y1", "x2", "y2")] for line in root.iter(f"{SVG}line")]
    lengths = [(abs(x2 - x1), abs(y2 - y1)) for x1, y1, x2, y2 in ends]
    assert lengths.count(pytest.approx((100, 0))) == 1
    assert lengths.count(pytest.approx((0, 100))) == 1


@pytest.mark.parametrize(
    "words",
    [
        "seed 20120323",
        "whole chart 300 mm",
        "noise 240 mm",
        "no scaling",
        "no smoothing",
        "matt paper",
        "mount it flat",
    ],
)
def test_sheet_says(root: ET.Element, words: str) -> None:
    said = " ".join(text.text or "" for text in root.iter(f"{SVG}text")).lower()
    assert words in said


def test_file_stays_small(data: bytes) -> None:
    assert len(data) < 2e6
