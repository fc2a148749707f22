"""Writing and reading of a camera's file, and refusal of others."""

import h5py
import numpy as np
import pytest

from procedures import BadInput, Outcome, Verdict, read_camera_numbers
from procedures.sensor.photon_transfer import GainAndNoise
from procedures.vignetting.estimate import JointFormula
from procedures.whole_camera.camera_file import write_camera_numbers
from procedures.whole_camera.from_field import ZERO, WholeCamera, join, sensor_parts, vignetting_parts


@pytest.fixture
def others():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((10, 12))
    flats = JointFormula(("R", "G1"), rng.standard_normal(10), root @ root.T)
    sensor = {name: GainAndNoise(np.array([0.1, 30.0]), np.array([[1e-8, -2e-6], [-2e-6, 1e-2]])) for name in "RB"}
    return join([*vignetting_parts(flats), *sensor_parts(sensor)], {})


@pytest.fixture
def path(others, tmp_path):
    refused = Outcome(None, Verdict.REFUSED, "too few views", "photograph more")
    write_camera_numbers(tmp_path / "camera.h5", WholeCamera(others, (), (), refused), {"input": "[]"})
    return tmp_path / "camera.h5"


def test_a_camera_survives_writing_is_read_by_prefix_and_says_why_parts_are_missing(others, path):
    found = read_camera_numbers(path)
    assert found.names == others.names
    assert found.units == others.units
    assert found.blocks == others.blocks
    assert (found.model, found.size) == ("", (0, 0))
    np.testing.assert_array_equal(found.values, others.values)
    np.testing.assert_array_equal(found.covariance, others.covariance)
    found = read_camera_numbers(path)
    assert found.numbers("sensor.B.") == {
        "sensor.B.system_gain": (0.1, 1e-4),
        "sensor.B.temporal_dark_noise": (30.0, 0.1),
    }
    np.testing.assert_array_equal(found.block("vignetting.R.", "vignetting.G1."), others.covariance[:5, 5:10])
    assert not found.block("vignetting.", "sensor.").any()
    (block,) = found.blocks
    assert block.how == ZERO
    assert block.why == "other photographs: the flats, and the sensor's ladder of light"
    with h5py.File(path) as file:
        assert dict(file["geometry"].attrs) == {
            "verdict": "refused", "reason": "too few views", "remedy": "photograph more"
        }  # fmt: skip


@pytest.mark.parametrize("damage", ["schema", "asymmetric", "short", "infinite"])
def test_inconsistent_files_are_refused(path, damage):
    with h5py.File(path, "a") as file:
        if damage == "schema":
            file.attrs["schema"] = "station/psf-field/2"
        elif damage == "asymmetric":
            file["covariance"][0, 1] += 1.0
        elif damage == "short":
            del file["units"]
            file["units"] = np.array([b"1"])
        else:
            file["values"][0] = np.inf
    with pytest.raises(BadInput, match="camera"):
        read_camera_numbers(path)
