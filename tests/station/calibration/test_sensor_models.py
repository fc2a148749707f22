"""Validation of a sensor's record and noise spectrum."""

import copy
import json
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.outcome import BadInput
from station.calibration import sensor_models
from station.calibration.sensor_models import read_models, read_sensor

PHOTOGRAPH = SimpleNamespace(exposure=SimpleNamespace(iso=100.0), planes={"G1": None})
MODEL = {"gain": 0.1, "gain_uncertainty": 1e-3, "dark_level": 64.0, "dark_variance": 9.0, "saturation": 4000.0,
         "signal_at_saturation": 4100.0, "bend": [-0.02, 0.001]}  # fmt: skip
RECORD = {
    "procedure": "sensor",
    "iso": 100,
    "planes": {"G1": {"model": MODEL, "noise_power": {"file": "nps.npy", "signal": 2000.0, "blocks": 60}}},
}


@pytest.fixture
def written(tmp_path):
    """written(change): the path of a record after `change` was called with its entry of the plane."""

    def write(change=lambda plane: None):
        record = copy.deepcopy(RECORD)
        change(record["planes"]["G1"])
        path = tmp_path / "result.json"
        path.write_text(json.dumps(record).replace("Infinity", "1e999"))
        return path

    np.save(tmp_path / "nps.npy", np.full((8, 8), 200.0))
    return write


def test_record_and_spectrum_are_read_as_written(written):
    known = read_sensor(written(), PHOTOGRAPH)
    assert known.models["G1"].bend == (-0.02, 0.001)
    assert (known.noise["G1"].power.mean(), known.noise["G1"].blocks) == (200.0, 60)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda plane: plane["model"].update(gain=1e400), "is not a finite number"),
        *(
            (
                lambda plane, name=name: plane["model"].update({name: [0.5]}),
                f"`{name}` of the sensor must be one number",
            )
            for name in ("gain", "dark_level", "dark_variance", "dsnu", "prnu", "gain_uncertainty")
        ),
        (lambda plane: plane["model"].update(dsnu="1"), "`dsnu` of the sensor must be real numbers"),
        (lambda plane: plane["model"].update(dsnu=True), "`dsnu` of the sensor must be real numbers"),
        (lambda plane: plane["model"].update(gain=10**400), "integers must have at most 64 bits"),
        (lambda plane: plane["model"].update(bend=[0.1, "x"]), "`bend` of the sensor must be real numbers"),
        (lambda plane: plane["model"].update(saturation=0), "`saturation` of the sensor must be finite, from 1e-30"),
        (lambda plane: plane["model"].update(dark_variance=-1), "`dark_variance` of the sensor must be finite, from 0"),
        (lambda plane: plane["model"].pop("gain"), "incomplete"),
        (lambda plane: plane.update(model=[1, 2]), "cannot be read as a result of station sensor"),
        (lambda plane: plane.update(noise_power={"file": "nps.npy"}), "incomplete"),
        (lambda plane: plane["noise_power"].update(signal=1e400), "is not a finite number"),
        (
            lambda plane: plane["noise_power"].update(blocks=0),
            "blocks of the noise spectrum .* must be finite, from 1 ",
        ),
        (lambda plane: plane["noise_power"].update(blocks=10**400), "integers must have at most 64 bits"),
    ],
)
def test_an_invalid_record_is_refused(written, change, words):
    with pytest.raises(BadInput, match=words):
        read_sensor(written(change), PHOTOGRAPH)


@pytest.mark.parametrize(
    "power",
    [np.zeros((8, 8)), np.ones((8, 7)), np.full((8, 8), np.nan), np.array([["a"]]), np.ones((0, 0)), np.ones((1, 1))],
    ids=str,
)
def test_an_invalid_spectrum_is_refused(written, tmp_path, power):
    np.save(tmp_path / "nps.npy", power)
    with pytest.raises(BadInput, match=r"the noise spectrum .* must"):
        read_sensor(written(), PHOTOGRAPH)


@pytest.mark.parametrize("text", ["[" * 100_000, "\xff", "3", '{"procedure": "x"}', '{"a": NaN}'])
def test_text_that_is_no_record_is_refused(tmp_path, text):
    (tmp_path / "r.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(BadInput):
        read_sensor(tmp_path / "r.json", PHOTOGRAPH)


def test_models_for_a_field_are_of_its_photographs_sensitivity(written, tmp_path, monkeypatch):
    files = [tmp_path / name for name in ("a.pgm", "b.pgm")]
    for file in files:
        file.write_bytes(b"P5 1 1 255\n0")
    assert set(read_models(written(), [*files, tmp_path / "none.pgm"])) == {"G1"}
    monkeypatch.setattr(sensor_models, "read_exposure", lambda file: SimpleNamespace(iso=400.0))
    with pytest.raises(BadInput, match=r"ISO 100, a\.pgm is of ISO 400"):
        read_models(written(), files)
