"""What a sensor's result tells other procedures: read back from its record."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.outcome import BadInput, BadParameter
from procedures.psf import Psf
from procedures.raw import RawFrame
from procedures.reading.arrays import LARGEST, SMALLEST, checked_array, checked_number
from procedures.reading.exposure import read_exposure
from procedures.reading.guard import decoding, open_file, read_file
from procedures.reading.text import parse_json
from procedures.sensor_model import SensorModel

if TYPE_CHECKING:
    from procedures.sensor.information import Information
    from procedures.sensor.noise_power import NoisePower

SCHEMA = "station/sensor/1"
SEED = 1288
"""Of the draws of uncertainties."""
LEAST = {"gain": SMALLEST, "saturation": SMALLEST, "signal_at_saturation": SMALLEST, "dark_variance": 0.0}
"""Of these numbers of a model; others may be negative."""
_GIVE = "give the result.json of station sensor, of the same camera at the same sensitivity"


@dataclass(frozen=True)
class KnownSensor:
    """Planes' models and noise spectra by name, and the record that they come from."""

    models: Mapping[str, SensorModel]
    noise: Mapping[str, NoisePower] = field(default_factory=dict)
    path: str = ""
    sha256: str = ""

    def information(self, plane: str, psf: Psf) -> Information:
        """What pictures of a plane with this PSF can tell."""
        from procedures.sensor.information import information

        return information(psf, self.noise[plane], np.random.default_rng(SEED))

    def told(self) -> dict[str, Any]:
        """What a record says of it."""
        return {"sensor": {"path": self.path, "sha256": self.sha256}} if self.models else {}


NO_SENSOR = KnownSensor({})


def read_record(path: Path) -> tuple[dict[str, Any], str]:
    """A sensor's record and its hash.

    Raises
    ------
    BadParameter
        If there is no such file, or it cannot be read.
    BadInput
        If it is no sensor's record.
    """
    try:
        data = read_file(path, "sensor's record")
    except BadInput as error:
        raise BadParameter(error.reason, error.remedy) from error
    record = parse_json(data, str(path), _GIVE)
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise BadInput(f"{path} is no result of station sensor", _GIVE)
    return record, hashlib.sha256(data).hexdigest()


def read_sensor(path: Path, frame: RawFrame) -> KnownSensor:
    """The models of a photograph's planes.

    Raises
    ------
    BadParameter, BadInput
        As `read_record`; or if the record is of another sensitivity, or tells of none of the planes.
    """
    record, sha256 = read_record(path)
    with decoding(str(path), "a sensor's record", _GIVE):
        _check_iso(record, "the photograph", frame.exposure.iso)
        models = models_of(record)
        if not set(models) & set(frame.planes):
            names = ", ".join(models) or "no plane"
            raise BadInput(f"{path} contains {names}; the photograph has {', '.join(frame.planes)}", _GIVE)
        common = [name for name in frame.planes if name in models]
        noise = {name: one for name in common if (one := _noise(path, record["planes"][name])) is not None}
        return KnownSensor({name: models[name] for name in common}, noise, str(path), sha256)


def read_models(path: Path, photographs: Sequence[Path]) -> dict[str, SensorModel]:
    """The models of all planes that a record tells of, for photographs of which none was read yet.

    Raises
    ------
    BadInput
        If the record is none, or of another sensitivity than a camera noted in one of the files.
    """
    record, _ = read_record(path)
    with decoding(str(path), "a sensor's record", _GIVE):
        for one in photographs:
            _check_iso(record, one.name, _noted_iso(one))
        return models_of(record)


def _noted_iso(photograph: Path) -> float | None:
    """What the camera noted; None of a file that cannot be opened: whoever reads it tells that."""
    try:
        with open_file(photograph) as file:
            return read_exposure(file).iso
    except (BadInput, OSError):
        return None


def _check_iso(record: Mapping[str, Any], whose: str, own: float | None) -> None:
    iso = record.get("iso")
    if iso and own and iso != own:
        raise BadInput(f"the sensor was measured at ISO {iso:g}, {whose} is of ISO {own:g}", _GIVE)


def _noise(path: Path, plane: Mapping[str, Any]) -> NoisePower | None:
    """The noise spectrum that lies beside the record; None where it was not measured, or is not there."""
    from procedures.reading.arrays import read_npy
    from procedures.sensor.noise_power import LEAST_SIDE, NoisePower

    told = plane.get("noise_power")
    if told is None or not (file := path.parent / Path(str(told["file"])).name).is_file():
        return None
    what = f"the noise spectrum {file}"
    power = checked_array(read_npy(file, "noise spectrum", _GIVE), what, ("n", "n"), low=0.0, remedy=_GIVE)
    if len(power) < LEAST_SIDE or power.mean() < SMALLEST:
        reason = f"{what} must have {LEAST_SIDE} frequencies or more along each axis, and a mean above 0"
        raise BadInput(f"{reason}; got {len(power)}, and {power.mean():.3g}", _GIVE)
    signal, blocks = (
        checked_number(told[name], f"{name} of {what}", least, remedy=_GIVE)
        for name, least in (("signal", SMALLEST), ("blocks", 1))
    )
    return NoisePower(power, signal, int(blocks))


def models_of(record: Mapping[str, Any]) -> dict[str, SensorModel]:
    """The models of a record's planes; refused ones have none."""
    planes = record.get("planes", {})
    return {name: _model(plane["model"]) for name, plane in planes.items() if "model" in plane}


def _model(told: Mapping[str, Any]) -> SensorModel:
    names = [one.name for one in fields(SensorModel) if one.name in told and one.name != "bend"]
    values: dict[str, Any] = {
        name: checked_number(told[name], f"`{name}` of the sensor", LEAST.get(name, -LARGEST), remedy=_GIVE)
        for name in names
    }
    bend = [checked_number(one, "`bend` of the sensor", remedy=_GIVE) for one in told.get("bend", ())]
    return SensorModel(**values, bend=tuple(bend))
