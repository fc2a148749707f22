"""Sensor models and noise spectra from results of station sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.clipping import SensorModel
from procedures.outcome import BadInput, BadParameter
from procedures.psf import Psf
from procedures.raw import RawFrame
from procedures.reading.arrays import LARGEST, SMALLEST, checked_array, checked_number
from procedures.reading.exposure import read_exposure
from procedures.reading.guard import open_file
from station.calibration.stored_results import StoredRecord, stored_record

if TYPE_CHECKING:
    from procedures.sensor.information import Information
    from procedures.sensor.spectrograms import NoisePower

SEED = 1288
MINIMA = {"gain": SMALLEST, "saturation": SMALLEST, "signal_at_saturation": SMALLEST, "dark_variance": 0.0}
"""Lower bounds of parameters of a model; others may be negative."""
_GIVE = "give the result.json of station sensor, of the same camera at the same sensitivity"


@dataclass(frozen=True)
class StoredSensor:
    """Models and noise spectra of planes by name, and the record that they come from."""

    models: Mapping[str, SensorModel]
    noise: Mapping[str, NoisePower] = field(default_factory=dict)
    path: str = ""
    sha256: str = ""

    def information(self, plane: str, psf: Psf) -> Information:
        """Information content of pictures of a plane with this PSF."""
        from procedures.sensor.information import information

        return information(psf, self.noise[plane], np.random.default_rng(SEED))

    def record(self) -> dict[str, Any]:
        """Its entry in a record; none without models."""
        return {"sensor": {"path": self.path, "sha256": self.sha256}} if self.models else {}


NO_SENSOR = StoredSensor({})


@contextmanager
def sensor_record(path: Path) -> Iterator[StoredRecord]:
    """A sensor's record; raises as `stored_record`, BadParameter where it cannot be read."""
    with stored_record(path, "sensor", _GIVE, BadParameter) as stored:
        yield stored


def read_sensor(path: Path, frame: RawFrame) -> StoredSensor:
    """The models of a photograph's planes. Raises as `sensor_record`, or if it is of another sensitivity, or has no
    such plane."""
    with sensor_record(path) as stored:
        _check_iso(stored.data, "the photograph", frame.exposure.iso)
        models = _models(stored.data)
        common = [name for name in frame.planes if name in models]
        if not common:
            names = ", ".join(models) or "no plane"
            raise BadInput(f"{path} contains {names}; the photograph has {', '.join(frame.planes)}", _GIVE)
        noise = {name: one for name in common if (one := _noise(stored.path, stored.data["planes"][name])) is not None}
        return StoredSensor({name: models[name] for name in common}, noise, str(path), stored.sha256)


def read_models(path: Path, photographs: Sequence[Path]) -> dict[str, SensorModel]:
    """The models of a record's planes. Raises BadInput if it is none, or of another sensitivity than a photograph."""
    with sensor_record(path) as stored:
        for photograph in photographs:
            _check_iso(stored.data, photograph.name, _iso_of(photograph))
        return _models(stored.data)


def _iso_of(photograph: Path) -> float | None:
    """Sensitivity in a photograph's metadata; None for an unreadable file, which is reported when it is read."""
    try:
        with open_file(photograph) as file:
            return read_exposure(file).iso
    except (BadInput, OSError):
        return None


def _check_iso(record: Mapping[str, Any], source: str, iso: float | None) -> None:
    measured = record.get("iso")
    if measured and iso and measured != iso:
        raise BadInput(f"the sensor was measured at ISO {measured:g}, {source} is of ISO {iso:g}", _GIVE)


def _noise(record: Path, plane: Mapping[str, Any]) -> NoisePower | None:
    """The noise spectrum next to the record; None where it was not measured, or its file is missing."""
    from procedures.reading.arrays import read_npy
    from procedures.sensor.spectrograms import LEAST_SIDE, NoisePower

    entry = plane.get("noise_power")
    if entry is None or not (file := record.parent / Path(str(entry["file"])).name).is_file():
        return None
    what = f"the noise spectrum {file}"
    power = checked_array(read_npy(file, "noise spectrum", _GIVE), what, ("n", "n"), low=0.0, remedy=_GIVE)
    if len(power) < LEAST_SIDE or power.mean() < SMALLEST:
        reason = f"{what} must have {LEAST_SIDE} frequencies or more along each axis, and a mean above 0"
        raise BadInput(f"{reason}; got {len(power)}, and {power.mean():.3g}", _GIVE)
    signal, blocks = (
        checked_number(entry[name], f"{name} of {what}", least, remedy=_GIVE)
        for name, least in (("signal", SMALLEST), ("blocks", 1))
    )
    return NoisePower(power, signal, int(blocks))


def _models(record: Mapping[str, Any]) -> dict[str, SensorModel]:
    planes = record.get("planes", {})
    return {name: _model(plane["model"]) for name, plane in planes.items() if "model" in plane}


def _model(entry: Mapping[str, Any]) -> SensorModel:
    names = [one.name for one in fields(SensorModel) if one.name in entry and one.name != "bend"]
    values: dict[str, Any] = {
        name: checked_number(entry[name], f"`{name}` of the sensor", MINIMA.get(name, -LARGEST), remedy=_GIVE)
        for name in names
    }
    bend = [checked_number(one, "`bend` of the sensor", remedy=_GIVE) for one in entry.get("bend", ())]
    return SensorModel(**values, bend=tuple(bend))
