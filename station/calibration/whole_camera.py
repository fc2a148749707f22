"""What flats and a sensor's ladder of light told of a camera, as parts of the whole of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput
from procedures.reading.arrays import checked_array
from procedures.reading.guard import decoding
from procedures.sensor.photon_transfer import GainAndNoise
from procedures.whole_camera.from_others import sensor_parts, vignetting_parts
from procedures.whole_camera.joint import CameraPart
from station.calibration.sensor_models import read_record
from station.calibration.vignetting import read_joint_formula

_GIVE = "measure it again: results of older versions do not tell what their numbers share"


def other_parts(vignetting: Path | None, sensor: Path | None) -> list[CameraPart]:
    """The parts; `vignetting` and `sensor` are results of those commands.

    Raises
    ------
    BadInput
        If one of them is no such result, or too old to tell a covariance.
    """
    parts = vignetting_parts(read_joint_formula(vignetting)) if vignetting else []
    return parts + (sensor_parts(read_gain_and_noise(sensor)) if sensor else [])


def read_gain_and_noise(path: Path) -> dict[str, GainAndNoise]:
    """Gain and dark noise of every plane of a sensor's record. Raises BadInput where it has none."""
    record, _ = read_record(path)
    with decoding(str(path), "a sensor's record", _GIVE):
        planes: Mapping[str, Any] = record["planes"]
        found = {
            name: _gain_and_noise(one["gain_and_noise"]) for name, one in planes.items() if "gain_and_noise" in one
        }
        if not found:
            raise BadInput(f"{path} has gain and noise of no plane with their covariance", _GIVE)
        return found


def _gain_and_noise(told: Mapping[str, Any]) -> GainAndNoise:
    shapes = {"values": (2,), "covariance": (2, 2)}
    values, covariance = (
        checked_array(told[name], f"{name} of gain and noise", shape, remedy=_GIVE) for name, shape in shapes.items()
    )
    return GainAndNoise(values, covariance)
