"""Parts of a camera from other photographs: vignetting from flats, gain and noise from the sensor's ladder."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from procedures.sensor.photon_transfer import GainAndNoise
from procedures.vignetting.estimate import NAMES, UNITS, JointFormula
from procedures.whole_camera.joint import CameraPart

Array = npt.NDArray[np.float64]

FLATS, LADDER = "the flats", "the sensor's ladder of light"


def vignetting_parts(formula: JointFormula) -> list[CameraPart]:
    """The radial formulas of all planes, correlated by the slope of the flats' light."""
    if not formula.planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in formula.planes for name in NAMES)
    return [CameraPart("vignetting", names, UNITS * len(formula.planes), formula.values, formula.covariance, FLATS)]


def sensor_parts(planes: Mapping[str, GainAndNoise]) -> list[CameraPart]:
    """Gain and dark noise of all planes, independent between planes."""
    if not planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in planes for name in GainAndNoise.NAMES)
    values = np.array([value for one in planes.values() for value in one.values])
    covariance = np.zeros((len(values), len(values)))
    for i, one in enumerate(planes.values()):
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = one.covariance
    return [CameraPart("sensor", names, GainAndNoise.UNITS * len(planes), values, covariance, LADDER)]
