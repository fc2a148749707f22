"""Units of frequencies, what is asked of a result, the conditions it was made in, and its seal."""

import hashlib
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.outcome import BadInput, BadParameter, Quantity, Verdict
from procedures.psf import Psf
from station.calibration.stored_results import plane_entry, table_prefix
from station.results.comparison import Comparison, Compliance
from station.results.limits import Place, Specification
from station.results.plane_result import PlaneResult, line_numbers
from station.results.record_head import condition_words, environment_of, temperature_during
from station.results.result_files import ResultFolder, damage, is_sealed, write_record
from station.results.specification_file import parse_specification, read_specification
from station.results.terms import Terms, specification_verdict
from station.results.units import Frequency, Pixels, Unit, pixels_of

HALF = Quantity(0.25, "cycles/pixel", 0.01, "", 9)
POINT = Psf(np.pad([[1.0]], 2), 2, np.zeros((25, 25)))
OF_TWO = Pixels(2, 4.0, 3000)


def plane(psf=None, **numbers):
    return PlaneResult("G1", Verdict.PASS, "", "", numbers, psf=psf)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        (Unit.CYCLES, 1),
        (Unit.LINE_PAIRS, 1000 / 8),  # a pixel of a mosaic's plane is two of 4 um
        (Unit.LINE_WIDTHS, 2 * 3000),  # two line widths a cycle, over the picture's height
    ],
)
def test_a_frequency_has_the_same_meaning_in_every_unit(unit, factor):
    assert OF_TWO.factor(unit) == factor
    assert Frequency(0.123456 * factor, unit).per_pixel(OF_TWO) == pytest.approx(0.123456, rel=1e-5)


def test_units_and_frequencies_are_known_asked_once_or_refused():
    planes = {"G1": SimpleNamespace(samples=np.zeros((40, 30)), pitch=2)}
    frame = SimpleNamespace(planes=planes, exposure=SimpleNamespace(pixel_pitch_um=5.0))
    assert pixels_of(frame) == {"G1": Pixels(2, 5.0, 30)}
    assert Pixels() == Pixels(1, None, None)
    assert pixels_of(frame, 3.0) == {"G1": Pixels(2, 3.0, 30)}
    terms = Terms(Unit.LINE_WIDTHS)
    assert terms.with_known_unit(OF_TWO) is terms
    assert terms.with_known_unit(Pixels()).unit is Unit.CYCLES
    with pytest.raises(BadParameter, match="needs the size of the frame"):
        terms.frequencies(Pixels())
    assert terms.parameters() == {"unit": "lw/ph"}
    assert Terms().parameters() == {}
    specification = parse_specification('[[limit]]\nnumber = "mtf"\nat = 0.1\nmin = 0.5', "lens.toml")
    asked = (Frequency(0.25), Frequency(12.5, Unit.LINE_PAIRS))
    assert Terms(at=asked, specification=specification).frequencies(OF_TWO) == (0.1, 0.25)
    terms = Terms(at=(Frequency(0.2), Frequency(1.3), Frequency(0.9)))
    of_psf = terms.apply(plane(POINT, **{"mtf_at_0.2_horizontal": HALF}), Pixels())
    assert of_psf.unavailable == (
        "no MTF is reported at 1.3 cycles/pixel: a PSF of s = 2 ends at 1 cycles/pixel; ask for less, or give s = 3 or "
        "more",
        "no MTF is reported at 0.9 cycles/pixel: it is beyond the measured range",
    )
    assert terms.apply(plane(), Pixels()).unavailable == ()  # a refused plane has no numbers at all


def test_the_verdict_of_several_planes_is_the_worst_and_a_line_names_the_main_numbers():
    planes = [SimpleNamespace(specification=one and Comparison(one)) for one in (None, *Compliance)]
    assert specification_verdict(planes) is Compliance.MISSES
    assert specification_verdict(planes[:2]) is Compliance.MEETS
    assert specification_verdict(planes[:1]) is None
    undecided = Terms().undecided(plane(), "it is dark").specification
    assert (undecided.judged, undecided.against) == (
        Compliance.UNDECIDED,
        ("the specification cannot be judged: it is dark",),
    )
    assert Terms().specified([]) is None
    numbers = {"mtf_at_0.2_horizontal": HALF, "mtf_at_0.2_radial": HALF, "energy_outside_support": HALF}
    (line,) = line_numbers(plane(**numbers))
    assert line == "MTF at 0.2 cycles/pixel along rows 0.250 ± 0.010 cycles/pixel"


SPECIFICATION = """
title = "50 mm"
coverage = 1.5
unit = "lp/mm"
[limits]
energy_above_nyquist = { max = 0.05, planes = ["G1", "G2"] }
[[limit]]
number = "mtf"
at = 40.0
min = 0.5
place = "centre"
directions = ["horizontal"]
"""


def test_a_specification_is_read_with_its_source(tmp_path):
    path = tmp_path / "lens.toml"
    path.write_text(SPECIFICATION)
    found = read_specification(path)
    digest = hashlib.sha256(SPECIFICATION.encode()).hexdigest()
    assert (found.title, found.source, found.sha256) == ("50 mm", str(path), digest)
    energy, mtf = found.limits
    assert (energy.number, energy.least, energy.most, energy.planes) == (
        "energy_above_nyquist", -math.inf, 0.05, ("G1", "G2"),
    )  # fmt: skip
    assert (mtf.at, mtf.least, mtf.most, mtf.place) == (40.0, 0.5, math.inf, Place.CENTRE)
    assert (mtf.directions, mtf.unit, mtf.coverage) == (("horizontal",), Unit.LINE_PAIRS, 1.5)
    assert found.frequencies == (Frequency(40.0, Unit.LINE_PAIRS),)
    assert parse_specification(SPECIFICATION.replace('title = "50 mm"', ""), "lens.toml").title == "lens.toml"
    assert Specification().places == ()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "sets no limit"),
        ("[limits]\nmtf50 = {}", "must leave a range"),
        ("[limits]\nmtf50 = { min = 0.3, max = 0.2 }", "must leave a range"),
        ('[[limit]]\nnumber = "mtf"\nmin = 0.3', "is the frequency of"),
        ('[[limit]]\nnumber = "mtf50"\nmin = 0.3\nat = 0.1', "is the frequency of"),
        ('[[limit]]\nnumber = "energy_above_nyquist"\nmax = 0.3\ndirections = ["vertical"]', "go with"),
    ],
)
def test_a_limit_that_cannot_be_meant_is_refused(text, complaint):
    with pytest.raises(BadParameter, match=complaint):
        parse_specification(text, "lens.toml")


def test_the_remedy_for_a_limit_without_a_number_names_one():
    with pytest.raises(BadParameter, match="number is missing") as refusal:
        parse_specification("[[limit]]\nmin = 0.3", "lens.toml")
    assert refusal.value.remedy == 'write number = "mtf50", for example'
    with pytest.raises(BadParameter, match="limit must be a list of tables") as refusal:
        parse_specification("[limit]\nmtf50 = { min = 0.3 }", "lens.toml")
    assert refusal.value.remedy == 'write limit = [{ number = "mtf50" }], for example'


def test_a_limit_may_be_one_number():
    (limit,) = parse_specification("[limits]\nmtf50 = { min = 0.3, max = 0.3 }", "lens.toml").limits
    assert (limit.least, limit.most) == (0.3, 0.3)


def test_conditions_are_the_mean_and_range_of_every_probe():
    def reading(value, u=None):
        return {"temperature": {"value": value, "unit": "°C", "uncertainty": u}}

    shots = [{"environment": {"a": reading(20.0, 0.1)}}, {"environment": {"a": reading(21.0, 0.2), "b": reading(5.0)}}]
    found = environment_of([*shots, {}])
    assert found["a"]["temperature"] == {
        "value": 20.5, "unit": "°C", "uncertainty": 0.2, "min": 20.0, "max": 21.0, "n": 2,
    }  # fmt: skip
    assert found["b"]["temperature"]["uncertainty"] is None
    assert environment_of([{}]) is None
    assert temperature_during(shots[1]) == 21.0
    assert temperature_during({"environment": {"a": {"humidity": {"value": 3}}}}) is None
    words = [condition_words(entry["temperature"]) for entry in found.values()]
    assert words == ["20.00 to 21.00 °C, standard uncertainty 0.20 °C", "5.00 °C"]
    for u, shown in (
        (0.0, "5.00 °C, standard uncertainty 0.00 °C"),
        (0.004, "5.0000 °C, standard uncertainty 0.0040 °C"),
        (20.0, "5 °C, standard uncertainty 20 °C"),
    ):
        assert condition_words({"min": 5.0, "max": 5.0, "unit": "°C", "uncertainty": u}) == shown


def test_the_plane_that_is_asked_for_or_green_is_taken(tmp_path):
    planes = {"R": {"a": 1}, "G1": {"a": 2}}
    assert plane_entry(planes, None, tmp_path) == ("G1", {"a": 2})
    assert plane_entry(planes, "R", tmp_path) == ("R", {"a": 1})
    assert plane_entry({"Y": {}}, None, tmp_path) == ("Y", {})
    assert [table_prefix("G1", count) for count in (1, 2)] == ["geometry_", "geometry_G1_"]
    with pytest.raises(BadParameter, match="has the planes R, G1, not 'B'"):
        plane_entry(planes, "B", tmp_path)
    with pytest.raises(BadInput, match="contains no plane"):
        plane_entry({}, None, tmp_path)


def test_a_seal_names_what_was_changed(tmp_path):
    out = tmp_path / "out"
    with ResultFolder(out) as folder:
        folder.write("numbers.csv", b"1")
        write_record(folder, {"schema": "station/psf/1"})
    assert is_sealed(out)
    assert damage(out) == ()
    (out / "numbers.csv").write_bytes(b"2")
    assert damage(out) == ("numbers.csv",)
    record = out / "result.json"
    whole = record.read_text()
    for changed in (whole.replace("psf/1", "psf/2"), "[]", "{", json.dumps({"files": {}})):
        record.write_text(changed)
        assert damage(out) == ("result.json",)
    assert not is_sealed(out)
    record.unlink()
    assert is_sealed(out)
