"""The table of numbers: complete, without contradiction, and the only place where a number's name is written."""

import ast
import copy
import json
import pickle
from pathlib import Path

import pytest

from procedures.numbers import (
    MTF50_RADIAL,
    NUMBERS,
    Group,
    frequency_of,
    in_group,
    label,
    name_at,
    projection_at,
    reference_text,
    short,
)
from tests.golden.cases import CASES
from tests.golden.frozen import FROZEN

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("station", "drivers", "procedures", "simulators")
OTHER_MEANINGS = {
    *("s", "k", "scale", "gain", "noise", "f", "angle", "side", "turn", "helps", "shim", "gamma", "baseline"),
    *("defocus", "astigmatism", "spherical", "alpha", "beta", "omega", "xi", "shear", "stretch", "separation"),
    *("notch", "diffusion", "fill_factor", "coma_x", "coma_y", "trefoil_x", "trefoil_y", "astigmatism_oblique"),
    *("undetermined", "backfocus", "p1", "p2"),
}
"""Names that are words of other things too: a literal says nothing."""
COEFFICIENTS = {"fx", "fy", "cx", "cy", *(f"k{i}" for i in range(1, 9)), *(f"s{i}" for i in range(5)), "sx1", "sy1"}
"""Parameters of camera models, whose names are those of COLMAP and OpenCV."""


def literals(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def quantities(entry):
    """Names and units of all numbers with an uncertainty in a record."""
    if isinstance(entry, list):
        entry = {str(at): one for at, one in enumerate(entry)}
    if isinstance(entry, dict):
        for name, value in entry.items():
            if isinstance(value, dict) and {"value", "unit", "uncertainty"} <= value.keys():
                yield name, value["unit"]
            else:
                yield from quantities(value)


def test_no_name_is_written_anywhere_else():
    names = set(NUMBERS) - OTHER_MEANINGS - COEFFICIENTS
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    written = {str(path): found for path in files if path.name != "numbers.py" and (found := literals(path) & names)}
    written = {path: found for path, found in written.items() if not path.endswith("geometry/shape.py")}
    assert written == {}


@pytest.mark.parametrize("case", CASES)
def test_every_number_of_a_record_is_in_the_table_with_its_unit(case):
    records = json.loads((FROZEN / f"{case}.json").read_text(encoding="utf-8"))
    found = {one for record in records.values() for one in quantities(record.get("planes", record.get("rig", {})))}
    of_items = {"distance", "move", "turn"}  # of a view of geometry, of a screw
    projection = projection_at(0.0).removesuffix("0_mm")
    for name, unit in found:
        if not (name in of_items or name.isdigit() or frequency_of(name) or name.startswith(projection)):
            assert NUMBERS[name].unit in ("", unit), name


def test_every_number_has_words_and_a_definition_with_its_parameter():
    for one in NUMBERS.values():
        assert one.definition, one
        assert one.label or one == "astigmatism", one
    assert pickle.loads(pickle.dumps(MTF50_RADIAL)) == "mtf50_radial"
    assert copy.deepcopy({MTF50_RADIAL: 1}) == {"mtf50_radial": 1}
    assert json.dumps({MTF50_RADIAL: 1}) == '{"mtf50_radial": 1}'
    assert frequency_of(name_at(0.25, "horizontal")) == (0.25, "horizontal")
    assert frequency_of(name_at(0.1)) == (0.1, "")
    assert projection_at(466.2) == "projection_uncertainty_at_466_mm"
    assert projection_at(float("inf")) == "projection_uncertainty_at_infinity"
    assert frequency_of("mtf50_horizontal") is None
    assert label(name_at(0.25, "vertical"), "lp/mm") == "MTF at 0.25 lp/mm along columns"
    assert short(name_at(0.25)) == "at 0.25, edge"
    assert label("mtf50_sagittal_median") == "MTF50 of sagittal detail, median over the frame"


@pytest.mark.parametrize("group", Group)
def test_no_group_is_empty_and_each_keeps_the_order_of_the_table(group):
    found = in_group(group)
    order = list(NUMBERS)
    assert found
    assert [order.index(one) for one in found] == sorted(order.index(one) for one in found)


def test_the_reference_has_every_number_once():
    text = reference_text()
    assert all(text.count(f"`{name}`") >= 1 for name in NUMBERS)
