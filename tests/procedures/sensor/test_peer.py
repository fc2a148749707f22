"""The same pictures through the published reference program for EMVA 1288, by its own data set and simulator."""

import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.sensor.defects import IntervalNumber
from station.calibration.sensor import measure_sensor
from station.calibration.sensor_folder import find_shots

from .peer import peer_numbers, repair_numpy

pytestmark = pytest.mark.slow

pytest.importorskip("emva1288")


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Numbers of the peer, and ours, of one data set on the disk."""
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore")
        repair_numpy()
        from emva1288.camera.dataset_generator import DatasetGenerator

        def save(self, picture: np.ndarray, name: str) -> None:
            cv2.imwrite(str(Path(self.outdir) / "images" / name), picture.astype(np.uint16))

        patch.setattr(DatasetGenerator, "save_image", save)  # Pillow writes its mode of 32 bits no more
        folder = tmp_path_factory.mktemp("emva") / "set"
        set_ = DatasetGenerator(
            steps=30, L=10, outdir=str(folder), bit_depth=12, width=120, height=80, K=0.1, blackoffset=60,
            sigma2_dark_0=900.0, dark_signal_0=300.0, u_esat=60000.0, seed=3, exposure_fixed=10_000_000,
            dsnu=15 * np.random.default_rng(1).standard_normal((80, 120)),
            prnu=1 + 0.01 * np.random.default_rng(2).standard_normal((80, 120)),
        )  # fmt: skip
    (plane,) = measure_sensor(find_shots(folder), None).planes
    assert plane.outcome.value is not None, plane.outcome.reason
    return peer_numbers(Path(set_.descriptor_path)), plane.outcome.value.numbers


@pytest.mark.parametrize(
    "name",
    ["system_gain", "quantum_efficiency", "temporal_dark_noise", "saturation_photons", "saturation_capacity", "snr_max",
     "dynamic_range", "dsnu", "prnu", "dsnu_pixel", "prnu_pixel"],
)  # fmt: skip
def test_numbers_agree_to_half_a_per_cent(both, name):
    theirs, ours = both
    assert ours[name].value == pytest.approx(theirs[name], rel=0.005)


@pytest.mark.parametrize("name", ["linearity_error_min", "linearity_error_max"])
def test_deviations_from_the_line_agree(both, name):
    theirs, ours = both
    number: IntervalNumber = ours[name]
    assert number.value == pytest.approx(theirs[name], abs=max(0.005 * abs(theirs[name]), 1e-6))
