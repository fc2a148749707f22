"""Numbers of the published reference program for EMVA 1288, by our names."""

import warnings
from functools import partial
from pathlib import Path

import cv2
import numpy as np

NAMES = {
    "system_gain": "K",
    "responsivity": "R",
    "quantum_efficiency": "QE",
    "temporal_dark_noise": "sigma_d",
    "temporal_dark_noise_dn": "sigma_y_dark",
    "sensitivity_threshold": "u_e_min",
    "saturation_photons": "u_p_sat",
    "saturation_capacity": "u_e_sat",
    "snr_max": "SNR_max",
    "dynamic_range": "DR",
    "dsnu": "DSNU1288",
    "dsnu_row": "DSNU1288_row",
    "dsnu_column": "DSNU1288_col",
    "dsnu_pixel": "DSNU1288_pixel",
    "prnu": "PRNU1288",
    "prnu_row": "PRNU1288_row",
    "prnu_column": "PRNU1288_col",
    "prnu_pixel": "PRNU1288_pixel",
    "linearity_error_min": "LE_min",
    "linearity_error_max": "LE_max",
}
PER_CENT = ("quantum_efficiency",)


def repair_numpy() -> None:
    """Give back the function of NumPy 1 that the program calls."""
    setattr(np, "asfarray", partial(np.asarray, dtype=np.float64))  # noqa: B010  (the stubs do not have it)


def peer_numbers(descriptor: Path, saturation: int | None = None) -> dict[str, float]:
    """The program's numbers of a data set.

    Parameters
    ----------
    saturation : index of the level at saturation, where the program shall not search for it
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        repair_numpy()
        from emva1288.process.data import Data1288
        from emva1288.process.loader import LoadImageData
        from emva1288.process.parser import ParseEmvaDescriptorFile
        from emva1288.process.results import Results1288

        images = ParseEmvaDescriptorFile(str(descriptor)).images
        loaded = LoadImageData(images, fload=lambda name: cv2.imread(name, cv2.IMREAD_UNCHANGED))
        peer = Results1288(Data1288(loaded.data).data, index_u_ysat=saturation)
        return {ours: float(getattr(peer, name)) / (100 if ours in PER_CENT else 1) for ours, name in NAMES.items()}
