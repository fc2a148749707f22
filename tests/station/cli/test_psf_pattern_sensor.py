"""`station psf pattern --sensor`: the result of `station sensor` is read back and used."""

import csv
import json
from dataclasses import asdict

import numpy as np
import pytest

from procedures.clipping import SensorModel
from tests.program import run

MODEL = SensorModel(0.3, 0.001, 60.0, 4.0, 3800.0, 4000.0, (-0.05, 0.01), 0.0003, 1.5, 0.005)
SIGNAL, BLOCKS = 1800.0, 400


@pytest.fixture
def photograph(tmp_path):
    path = tmp_path / "photo.pgm"
    path.write_bytes(b"P5 4 4 255\n" + bytes(range(16)))
    return path


@pytest.fixture
def sensor(tmp_path):
    """A result of `station sensor`: white noise of 6000 electrons, at 0.3 DN each."""
    folder = tmp_path / "sensor"
    folder.mkdir()
    np.save(folder / "nps_Y.npy", np.full((32, 32), 0.3**2 * 6000))
    plane = {"verdict": "pass", "model": asdict(MODEL)}
    plane["noise_power"] = {"file": "nps_Y.npy", "signal": SIGNAL, "blocks": BLOCKS}
    record = {"procedure": "sensor", "iso": None, "planes": {"Y": plane, "G1": {"verdict": "refused"}}}
    (folder / "result.json").write_text(json.dumps(record))
    return folder / "result.json"


def test_model_reaches_the_estimate_and_the_record(estimator, photograph, sensor, tmp_path):
    run("psf", "pattern", photograph, "--sensor", sensor, "--out", tmp_path / "out")
    assert estimator.sensors == [MODEL]
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["parameters"]["sensor"]["path"] == str(sensor)
    assert len(record["parameters"]["sensor"]["sha256"]) == 64


def test_information_stands_beside_the_psf(estimator, photograph, sensor, tmp_path):
    run("psf", "pattern", photograph, "--sensor", sensor, "--out", tmp_path / "out")
    measured = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]["information"]
    zero = measured["neq_zero"]
    assert zero["interval"][0] < 6000 < zero["interval"][1]  # quanta of white noise are the electrons
    assert 0 < measured["information_capacity"]["value"] < np.log2(1 + 6000 / 3) / 2
    assert measured["information_capacity"]["unit"] == "bit/pixel"
    rows = list(csv.DictReader((tmp_path / "out" / "information_Y.csv").read_text().splitlines()))
    assert len(rows) == 17 * 32
    # the stand-in's Gaussian has a standard deviation of 1 / sqrt 2 pixels and is cut off at two
    unit = "[cycles/pixel]"
    at = next(row for row in rows if row[f"frequency_x {unit}"] == "0.25" and row[f"frequency_y {unit}"] == "0")
    sigma = 0.5**0.5
    assert float(at["neq"]) == pytest.approx(6000 * np.exp(-4 * np.pi**2 * sigma**2 / 16), rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda record: record.update(procedure="pattern"), "a result of station sensor is required"),
        (lambda record: record["planes"].pop("Y"), "contains no plane"),
        (lambda record: record["planes"]["Y"]["model"].pop("gain"), "incomplete"),
    ],
    ids=["another record", "another plane", "a part missing"],
)
def test_what_is_no_result_of_this_plane_is_refused(estimator, photograph, sensor, tmp_path, change, words):
    record = json.loads(sensor.read_text())
    change(record)
    sensor.write_text(json.dumps(record))
    run("psf", "pattern", photograph, "--sensor", sensor, "--out", tmp_path / "out", code=4, says=words)
    assert not estimator.asked


def test_missing_record_is_refused_as_every_missing_setting(estimator, photograph, tmp_path):
    done = run("psf", "pattern", photograph, "--sensor", tmp_path / "none.json", "--out", tmp_path / "out", code=2)
    assert "there is no file" in done.output


def test_another_sensitivity_is_refused(estimator, shared_data, sensor, tmp_path):
    record = json.loads(sensor.read_text())
    record["iso"] = 51200
    sensor.write_text(json.dumps(record))
    raw = shared_data / "raw" / "tinydng_colorchart.dng"
    done = run("psf", "pattern", raw, "--plane", "G1", "--sensor", sensor, "--out", tmp_path / "out", code=4)
    assert "ISO 51200" in done.stderr or "contains Y" in done.stderr
