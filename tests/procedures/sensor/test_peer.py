"""The same pictures through the published reference program for EMVA 1288, by its own data set and simulator."""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.sensor.measured import IntervalNumber
from station.calibration.sensor import measure_sensor
from station.calibration.sensor_folder import find_shots

pytest.importorskip("emva1288")


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Numbers of the peer's results object, and ours, of one data set on the disk."""
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore")
        # it calls a function that NumPy 2 has no more
        patch.setattr(np, "asfarray", partial(np.asarray, dtype=np.float64), raising=False)
        from emva1288.camera.dataset_generator import DatasetGenerator
        from emva1288.process.data import Data1288
        from emva1288.process.loader import LoadImageData
        from emva1288.process.parser import ParseEmvaDescriptorFile
        from emva1288.process.results import Results1288

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
        parsed = ParseEmvaDescriptorFile(set_.descriptor_path)
        data = Data1288(LoadImageData(parsed.images).data)
        peer = Results1288(data.data)
        theirs = {
            "system_gain": peer.K,
            "quantum_efficiency": peer.QE / 100,
            "temporal_dark_noise": peer.sigma_d,
            "saturation_photons": peer.u_p_sat,
            "saturation_capacity": peer.u_e_sat,
            "snr_max": peer.SNR_max,
            "dynamic_range": peer.DR,
            "dsnu": peer.DSNU1288,
            "prnu": peer.PRNU1288,
            "linearity_error_min": peer.LE_min,
            "linearity_error_max": peer.LE_max,
            "dsnu_pixel": peer.DSNU1288_pixel,
            "prnu_pixel": peer.PRNU1288_pixel,
        }
    (plane,) = measure_sensor(find_shots(folder), None).planes
    assert plane.outcome.value is not None, plane.outcome.reason
    return theirs, plane.outcome.value.numbers


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["system_gain", "quantum_efficiency", "temporal_dark_noise", "saturation_photons", "saturation_capacity", "snr_max",
     "dynamic_range", "dsnu", "prnu", "dsnu_pixel", "prnu_pixel"],
)  # fmt: skip
def test_numbers_agree_to_half_a_per_cent(both, name):
    theirs, ours = both
    assert ours[name].value == pytest.approx(theirs[name], rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["linearity_error_min", "linearity_error_max"])
def test_deviations_from_the_line_agree(both, name):
    theirs, ours = both
    number: IntervalNumber = ours[name]
    assert number.value == pytest.approx(theirs[name], abs=max(0.005 * abs(theirs[name]), 1e-6))
