"""Results of station vignetting and station sensor as parts of a whole camera."""

from pathlib import Path

from procedures.outcome import BadInput
from procedures.reading.arrays import checked_array
from procedures.sensor.photon_transfer import GainAndNoise
from procedures.whole_camera.from_field import CameraPart, sensor_parts, vignetting_parts
from station.calibration.sensor_models import sensor_record
from station.calibration.vignetting import read_joint_formula

_GIVE = "measure it again: results of older versions have no joint covariance"
SHAPES = {"values": (2,), "covariance": (2, 2)}


def other_parts(vignetting: Path | None, sensor: Path | None) -> list[CameraPart]:
    """The parts from results of `vignetting` and `sensor`. Raises BadInput for others, or without a covariance."""
    parts = vignetting_parts(read_joint_formula(vignetting)) if vignetting else []
    return parts + (sensor_parts(read_gain_and_noise(sensor)) if sensor else [])


def read_gain_and_noise(path: Path) -> dict[str, GainAndNoise]:
    """Gain and dark noise of every plane of a sensor's record. Raises BadInput where it has none."""
    with sensor_record(path) as stored:
        planes = stored.data["planes"]
        entries = {name: plane["gain_and_noise"] for name, plane in planes.items() if "gain_and_noise" in plane}
        if not entries:
            raise BadInput(f"{path} has no covariance of gain and noise for any plane", _GIVE)
        return {
            name: GainAndNoise(*(
                checked_array(entry[key], f"{key} of gain and noise", shape, remedy=_GIVE)
                for key, shape in SHAPES.items()
            ))
            for name, entry in entries.items()
        }  # fmt: skip
