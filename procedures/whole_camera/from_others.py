"""The parts of a camera that other photographs tell: vignetting from flats, gain and noise from the sensor's ladder."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from procedures.sensor.photon_transfer import GainAndNoise
from procedures.vignetting.joint import NAMES, UNITS, JointFormula
from procedures.whole_camera.joint import Part

Array = npt.NDArray[np.float64]

FLATS, LADDER = "the flats", "the sensor's ladder of light"


def vignetting_parts(found: JointFormula) -> list[Part]:
    """The radial formulas of all planes, which share the slope of the flats' light."""
    if not found.planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in found.planes for name in NAMES)
    return [Part("vignetting", names, UNITS * len(found.planes), found.values, found.covariance, FLATS)]


def sensor_parts(planes: Mapping[str, GainAndNoise]) -> list[Part]:
    """Gain and dark noise of all planes; the samples of one plane are not those of another."""
    if not planes:
        return []
    names = tuple(f"{plane}.{name}" for plane in planes for name in GainAndNoise.NAMES)
    values = np.array([value for one in planes.values() for value in one.values])
    covariance = np.zeros((len(values), len(values)))
    for i, one in enumerate(planes.values()):
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = one.covariance
    return [Part("sensor", names, GainAndNoise.UNITS * len(planes), values, covariance, LADDER)]
