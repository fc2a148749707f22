"""`station explain`: causes and budgets of results and batches, and what the digital twin predicts."""

import json
import math
from dataclasses import replace

import pytest

from procedures.choice import COMMON, TERMS, combined
from procedures.outcome import BadInput, Quantity, Verdict
from station.demo import digital_twin
from station.results.explanation import REMEDIES, TWIN, explain_batch, explain_result, result_folder
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.reader import record_of
from station.results.record_head import RecordHead
from tests.program import run

from ...golden.cases import chart_photograph

SLOW_FIXTURES = {"batch"}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explain")
    limits = folder / "limits.toml"
    limits.write_text("[limits]\nmtf50_horizontal = { min = 2 }\n")
    photograph = chart_photograph(folder / "photo.dng", 1)
    run("psf", "pattern", photograph, "--specification", limits, "--out", folder / "out", code=1)
    return folder / "out"


def test_every_term_has_a_remedy_and_the_last_result_is_meant(tmp_path):
    assert REMEDIES.keys() >= TERMS.keys()
    assert digital_twin.TWINS.keys() == TWIN
    for number in (1, 2, 10):
        (tmp_path / "derived" / str(number)).mkdir(parents=True)
        (tmp_path / "derived" / str(number) / "result.json").touch()
    assert result_folder(tmp_path) == tmp_path / "derived" / "10"
    two = tmp_path / "derived" / "2"
    assert result_folder(two) == result_folder(two / "result.json") == two


def test_terms_that_remain_are_those_that_the_remedy_halves():
    planes = PlaneResult("G1", Verdict.PASS), PlaneResult("B", Verdict.REFUSED, "dark", "light")
    blue, green = explain_result(Measurement("station/psf/1", RecordHead("pattern"), planes))
    assert (blue.plane, blue.verdict, blue.reason, blue.remedy) == ("B", "refused", "dark", "light")
    assert (green.number, green.value, green.uncertainty, green.terms) == ("", "", 0.0, ())
    number = Quantity(51.4, "um", 0.6, "", 9)
    budget = {"tilt_corner": {"budget": {"noise": 0.36, "squareness": 0.48}}}
    plane = PlaneResult("Y", Verdict.PASS, numbers={"tilt_corner": number}, details=budget)
    (one,) = explain_result(Measurement("station/tilt/1", RecordHead("tilt"), (plane,)))
    assert [(term.term, term.uncertainty_then) for term in one.terms] == [
        ("squareness", pytest.approx(0.36)), ("noise", pytest.approx((0.48**2 + 0.18**2) ** 0.5)),
    ]  # fmt: skip
    budgets = {"noise": 0.3, "ghost": 0.0}, {"noise": 0.0, "ghost": 0.4}
    edges = [{"verdict": "refused"}, *({"mtf50": {"value": 0.3, "budget": budget}} for budget in budgets)]
    plane = PlaneResult("Y", Verdict.PASS, numbers={"mtf50": Quantity(0.3, "cycles/pixel", 0.05, "", 9)})
    (one,) = explain_result(
        Measurement("station/edge/1", RecordHead("edge"), (replace(plane, details={"edges": edges}),))
    )
    assert [(term.term, term.share) for term in one.terms] == [
        ("ghost", pytest.approx(0.64)), ("noise", pytest.approx(0.36)),
    ]  # fmt: skip
    assert one.terms[0].uncertainty_then == pytest.approx(0.03)


def test_parts_of_the_variance_add_up_and_words_name_their_remedy(result):
    done = run("explain", result, "--json")
    (plane,) = json.loads(done.stdout)["planes"]
    record = json.loads((result / "result.json").read_text())["planes"]["G1"][plane["number"]]
    shares = [one["share"] for one in plane["terms"]]
    assert sum(shares) == pytest.approx(1)
    assert shares == sorted(shares, reverse=True)
    first = plane["terms"][0]
    assert first["share"] == pytest.approx((record["budget"][first["term"]] / record["uncertainty"]) ** 2)
    without = record["uncertainty"] ** 2 - first["uncertainty_then"] ** 2
    removed = 0.75 if first["term"] == "noise" else 1.0  # four times the light halves the noise
    assert without == pytest.approx(removed * record["budget"][first["term"]] ** 2)
    text = run("explain", result / "result.json").stdout
    assert text.startswith("G1: pass")
    assert "against the specification: the limit MTF50 along rows ≥ 2 cycles/pixel is missed" in text
    assert any(one in text for one in REMEDIES.values())
    run("explain", result, "--strict", code=int(not text.startswith("G1: pass")))


def test_a_folder_without_a_result_is_refused(tmp_path):
    run("explain", tmp_path, code=4, says="holds no result")


@pytest.fixture(scope="module")
def batch(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch")
    photographs = folder / "in"
    photographs.mkdir()
    for name in "ab":
        (photographs / f"{name}.png").write_bytes(b"no picture")
    (folder / "p.toml").write_text('procedure = "pattern"\n')
    run("batch", photographs, "--procedure", folder / "p.toml", "--jobs", 1, "--out", folder / "out", code=None)
    return folder / "out"


def test_causes_of_a_batch_are_counted(batch):
    done = run("explain", batch, "--json")
    (cause,) = json.loads(done.stdout)["causes"]
    run("explain", batch, "--strict", code=1)
    assert cause["count"] == 2
    assert cause["remedy"]


def test_batch_names_outliers_and_a_typical_photograph(result, tmp_path):
    """Six photographs that agree and one that does not; the uncertainties' median is the fourth's."""
    values = [0.5, 0.501, 0.499, 0.502, 0.498, 0.5, 0.6]
    rows = [{"files": [f"{i}.png"], "reason": "", "remedy": "", "folder": str(result), "planes": {"Y": {"numbers": {
        "mtf50_horizontal": {"value": value, "unit": "cycles/pixel", "uncertainty": 0.001 * (i + 1)}}}}}
        for i, value in enumerate(values)]  # fmt: skip
    (tmp_path / "results.jsonl").write_text("\n".join(map(json.dumps, rows)))
    batch = explain_batch(tmp_path)
    assert [one.partition(":")[0] for one in batch.outliers] == ["6.png"]
    assert batch.typical == str(result)


@pytest.mark.slow
def test_twin_predicts_the_gain_of_light_and_of_distance(result):
    """Noise falls by half with four times the light; a chart twice too small is worse than one at s/t = 1."""
    record = record_of(result, "G1")
    budget = record["mtf50_horizontal"]["budget"]
    shared = combined({term: one for term, one in budget.items() if term in COMMON})
    own = combined({term: one for term, one in budget.items() if term not in COMMON})
    light, *_ = digital_twin.predictions(record, "mtf50_horizontal", budget)
    assert light.before == pytest.approx(record["mtf50_horizontal"]["uncertainty"])
    assert 0.4 * own < (light.after**2 - shared**2) ** 0.5 < 0.8 * own
    _, wider = digital_twin.predictions({**record, "pixels_per_pattern": 50.0}, "mtf50_horizontal", budget)
    print_blur = budget["print blur"]
    grown = math.hypot(shared, print_blur * math.sqrt((digital_twin.pixels_at(1.0, record["s"]) / 50.0) ** 4 - 1))
    assert grown < wider.after < math.hypot(grown, 0.9 * own)


SUBJECTS = {
    "mtf50_horizontal": {
        "scale": 4.2, "samples": 3500.0, "noise": 0.0017, "s": 3, "k": 13, "mtf50_horizontal": {"value": 0.46},
    },
    "mtf50": {
        "edges": [{"roi": [0, 0, 40, 90], "mtf50": {"value": 0.4}, "diagnostics": {"noise": 0.002, "contrast": 0.4}}],
    },
    "system_gain": {
        "system_gain": {}, "rows": 240, "columns": 320,
        "model": {"gain": 0.42, "dark_level": 512.0, "saturation": 15458.0, "dark_variance": 1.6},
    },
}  # fmt: skip


@pytest.mark.nightly
@pytest.mark.parametrize("number", SUBJECTS)
def test_twins_of_walls_edges_and_sensors_gain_by_light(number):
    """Four times the light, or the pictures, halves the noise, within the scatter of the twin's few photographs."""
    light, *_ = digital_twin.predictions(SUBJECTS[number], number, {"noise": 0.03, "ghost": 0.04})
    assert light.before == pytest.approx(0.05)
    assert (light.after**2 - 0.04**2) ** 0.5 == pytest.approx(0.015, rel=0.3)


def test_subjects_without_a_twin_are_named_and_refused_ones_not_predicted():
    noisy = SUBJECTS["mtf50_horizontal"] | {"s": 4, "noise": 0.05}
    effects = digital_twin.predictions(noisy, "mtf50_horizontal", {"noise": 0.03})
    assert [effect.after for effect in effects] == [None] * 3
    with pytest.raises(BadInput, match="no digital twin photographs this subject"):
        digital_twin.predictions({"tilt_corner": {}}, "tilt_corner", {"noise": 0.3})
    details = {"budgets": {"picture_std": {"noise": 0.03, "detail": 0.04}}, "with_four_times_the_light": 0.04}
    plane = PlaneResult("result", Verdict.PASS, values={"picture_std": 0.05}, details=details)
    (one,) = explain_result(Measurement("station/restore/1", RecordHead("restoration"), (plane,)))
    assert (one.number, one.value, one.uncertainty) == ("picture_std", "0.05", pytest.approx(0.05))
    assert [(term.term, term.uncertainty_then) for term in one.terms] == [
        ("detail", pytest.approx(0.03)), ("noise", pytest.approx(0.0427, abs=1e-4)),
    ]  # fmt: skip
    (light,) = digital_twin.predictions(details, one.number, {"noise": 0.03, "detail": 0.04})
    assert (light.before, light.after) == (pytest.approx(0.05), 0.04)
