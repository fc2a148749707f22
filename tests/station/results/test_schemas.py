"""The generated schemas describe the records that are written, and refuse others."""

import copy
import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from procedures import Diffraction, assess
from procedures.outcome import Cause, Verdict
from station.procedure.schema import procedure_named, schema_of
from station.results.limits import Limit, Place, Specification
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import InputFile, RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms
from station.results.units import Frequency, Pixels, Unit
from tests.psfs import gaussian

LIMITS = (
    Limit("mtf50", least=40.0, unit=Unit.LINE_PAIRS),
    Limit("mtf", least=0.5, at=20.0, place=Place.CENTRE, unit=Unit.LINE_PAIRS),
)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """With a specification, in lp/mm, and a plane that was refused."""
    psf = gaussian(0.7)
    terms, pixels = (
        Terms(
            Unit.LINE_PAIRS,
            (Frequency(30.0, Unit.LINE_PAIRS), Frequency(300.0, Unit.LINE_PAIRS)),
            Specification(LIMITS, "a lens"),
        ),
        Pixels(2, 4.0),
    )
    limit = Diffraction(5.6, 8.0, 530)
    plane = PlaneResult.of(
        "G1", Verdict.PASS, psf, assess(psf, n=9, diffraction=limit, at=terms.frequencies(pixels)),
        values={"gamma": 0.5, "residual_std": np.float64(1.02)}, diagnostics={"whiteness": float("nan")}, pitch=2,
    )  # fmt: skip
    refused = PlaneResult("B", Verdict.REFUSED, "dark", "light", other_causes=(Cause("blurred", "focus"),))
    planes = [terms.apply(replace(plane, diffraction=limit), pixels), refused]
    head = RecordHead("pattern", (InputFile("a", "0" * 64),), {"s": "auto"}, terms.specified(planes))
    with ResultFolder(tmp_path_factory.mktemp("result")) as folder:
        return json.loads(write_psf_result(folder, planes, head))


def refused(record):
    return [*jsonschema.Draft202012Validator(schema_of(procedure_named("pattern"))).iter_errors(record)]


def test_record_follows_its_schema(record):
    assert refused(record) == []
    assert record["planes"]["B"]["other_causes"] == [{"reason": "blurred", "remedy": "focus"}]
    plane = record["planes"]["G1"]
    assert "other_causes" not in plane
    assert plane["mtf50_horizontal"]["unit"] == "lp/mm"
    assert plane["diffraction"]["cutoff"] == pytest.approx(Diffraction(5.6, 8.0, 530).cutoff * 125)
    assert plane["diffraction"]["cutoff_unit"] == "lp/mm"
    assert {"mtf_at_20_horizontal", "mtf_at_30_horizontal"} <= plane.keys()
    # 125 pixels of the plane to a millimetre: 300 lp/mm are 2.4 cycles/pixel, more than s / 2
    assert plane["unavailable"] == [
        "no MTF is reported at 300 lp/mm: a PSF of s = 4 ends at 250 lp/mm; ask for less, or give s = 5 or more"
    ]
    assert record["specification"]["limits"][0]["min"] == 40.0  # a number, not a text
    assert record["specification"]["verdict"] == plane["specification"]["verdict"]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("planes", "G1", "verdict"), "good"),
        (("planes", "B", "other_causes", 0), {"reason": "blurred"}),
        (("planes", "G1", "mtf50_horizontal", "value"), "0.3"),
        (("specification", "limits", 0, "min"), "40"),
        (("planes", "G1", "specification", "limits", 0, "verdict"), "fail"),
        (("planes", "G1", "mtf50_horizontal", "n"), 4.5),
        (("planes", "G1", "mtf50_horizontal", "budget", "noise"), "much"),
        (("input", 0, "sha256"), "short"),
    ],
)
def test_what_is_not_as_it_is_written_is_refused(record, path, value):
    wrong = copy.deepcopy(record)
    place = wrong
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    assert refused(wrong)


@pytest.mark.parametrize(
    ("entry", "value", "allowed"),
    [("n", 0, True), ("n", -1, False), ("interval", [0.1, None], True), ("interval", [0.1], False),
     ("interval", [0.1, 0.2, 0.3], False)],
)  # fmt: skip
def test_bounds_of_a_number_are_those_of_its_kind(record, entry, value, allowed):
    other = copy.deepcopy(record)
    other["planes"]["G1"]["mtf50_horizontal"][entry] = value
    assert (not refused(other)) is allowed
