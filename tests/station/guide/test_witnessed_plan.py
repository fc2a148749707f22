"""The guided plan of a witnessed PSF: what each photograph requires, and the whole of it on the simulated bench."""

import json
from dataclasses import replace

import pytest

from procedures.plan import Tour
from procedures.raw import read_frame
from station.bench.opening import simulated_bench
from station.guide.plans import witnessed
from tests.benchmarks.guided_sessions import guided
from tests.station.sessions.short_plan import photographs


@pytest.fixture
def tours():
    (step,) = (one for one in witnessed.plan().steps if one.name == "witnesses")
    return [one for one in step.requests if isinstance(one, Tour)]


@pytest.fixture
def frame(tmp_path):
    path = tmp_path / "1.dng"
    path.write_bytes(photographs()["look"])
    return read_frame(path)


def exposed(frame, exposure_s):
    return replace(frame, exposure=replace(frame.exposure, exposure_s=exposure_s))


def test_four_photographs_are_taken_and_measured_in_the_order_of_the_command(tours):
    names = [stop.name for tour in tours for stop in tour.stops({})]
    assert names == ["long exposure", "short exposure", "slight defocus", "nearer"]
    assert [names[i] for i in witnessed.ORDER] == ["short exposure", "long exposure", "nearer", "slight defocus"]


def test_the_exposure_is_halved_and_restored_by_advice_that_the_camera_can_carry_out(tours, frame):
    _, short, defocused = tours[0].stops({})
    facts = {witnessed.EXPOSURE: 0.02}
    assert short.check(exposed(frame, 0.01), facts).good
    assert dict(short.check(exposed(frame, 0.02), facts).by_hand) == {"exposure_ev": -1.0}
    assert defocused.check(exposed(frame, 0.02), facts).good
    assert dict(defocused.check(exposed(frame, 0.01), facts).by_hand) == {"exposure_ev": 1.0}
    assert short.go.say(facts) == ""
    assert "Halve the exposure time" in short.go.say({})  # the camera records none
    assert dict(defocused.go.by_hand({})) == {"focus_steps": witnessed.DEFOCUS_STEPS}


@pytest.mark.nightly
def test_the_bench_takes_a_witnessed_psf_by_itself(tmp_path):
    (tmp_path / "incoming").mkdir()
    bench = simulated_bench(tmp_path / "incoming", seed=3, virtual_time=True)
    bench.simulated.show("chart")
    result = guided("witnessed", bench, tmp_path, {}, lambda event: None)
    bench.close()
    record = json.loads((result / "result.json").read_text())
    assert record["parameters"]["grade"] == "witnessed"
    plane = record["planes"]["G1"]
    assert plane["verdict"] == "pass", plane
    assert abs(plane["witness_ratio"]["value"] - 1) < 3 * plane["witness_ratio"]["uncertainty"]
    budget = plane["mtf50_horizontal"]["budget"]
    assert budget["print blur"] < plane["mtf50_horizontal"]["uncertainty"]
