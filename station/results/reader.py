"""Results read back from their folders as the measurements that were written, and two compared."""

import csv
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numbers import NUMBERS
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, Miss, Quantity, Verdict
from procedures.reading.arrays import checked_array, parse_npy
from procedures.reading.text import parse_json
from station.common.durable_files import read_own
from station.results.comparison import Comparison
from station.results.measurement import BY_PLANE, Measurement
from station.results.overlay import table_columns
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, read_other_causes
from station.results.result_files import RECORD, SEAL, plain
from station.results.units import Unit, unit_in

_AGAIN = "compute the result again, or name another"
MAX_BYTES = 400_000_000
MAX_PLANE_NAME = 8
"""Longer names are of no plane; they would also be file names."""
RESULT_KEYS = ("result", "rig")
OF_HEAD = ("arguments", "settings", "specification", "batch", "field", "environment", "duration_s")
NOT_ENTRIES = ("schema", "procedure", "input", "parameters", "software", "files", "left_out", SEAL, *OF_HEAD)
PARSED = ("verdict", "reason", "remedy", "other_causes", "specification", "unavailable", "untold")
"""Entries of a plane that are attributes of its result."""


def read_result(folder: Path) -> Measurement:
    """The measurement in a folder, with the MTF and the samples of PSFs. Raises BadInput if it is damaged."""
    record = read_record(folder)
    key = next((one for one in (BY_PLANE, *RESULT_KEYS) if one in record), BY_PLANE)
    entries = record.get(key, {}) if key == BY_PLANE else {key: record[key]}
    if BY_PLANE not in record and "verdict" in record:  # a refusal, or a record of an earlier version
        key, entries = "result", {"result": {**_mapping(record.get(key)), "verdict": record["verdict"]}}
        entries["result"] |= {one: record[one] for one in PARSED if one in record}
    if (
        not entries
        or not isinstance(entries, dict)
        or not all(
            name.isalnum() and len(name) <= MAX_PLANE_NAME and isinstance(one, dict) for name, one in entries.items()
        )
    ):
        raise BadInput(f"{folder / RECORD} names no planes", _AGAIN)
    planes = tuple(_plane(folder, name, entry) for name, entry in entries.items())
    more = {name: value for name, value in record.items() if name not in (*NOT_ENTRIES, key)}
    missed = [one for one in _list(record.get("left_out")) if isinstance(one, dict)]
    return Measurement(
        str(record.get("schema", "")), _head(record), planes, entries=more, results_key=key,
        missed=tuple(Miss(*(str(one.get(name, "")) for name in ("source", "reason", "remedy"))) for one in missed)
        if "left_out" in record else None,
    )  # fmt: skip


def read_record(folder: Path) -> dict[str, Any]:
    """The contents of the record in a folder. Raises BadInput if it is damaged."""
    record = parse_json(_own(folder / RECORD), str(folder / RECORD), _AGAIN)
    if not isinstance(record, dict):
        raise BadInput(f"{folder / RECORD} is no record of a result", _AGAIN)
    return record


def record_of(folder: Path, plane: str) -> dict[str, Any]:
    """The entry of a plane, or of the only result, in the record of a folder. Raises BadInput if it is damaged."""
    record = read_record(folder)
    several = _mapping(record.get(BY_PLANE))
    return _mapping(several.get(plane, next((record[key] for key in RESULT_KEYS if key in record), None)))


def find_results(sessions: Path) -> list[Path]:
    """The folders of all results under a folder of sessions, newest first."""
    folders = [record.parent for record in sessions.glob(f"*/derived/*/{RECORD}") if not record.parent.is_symlink()]
    return sorted(folders, key=lambda folder: (folder / RECORD).lstat().st_mtime, reverse=True)


def _head(record: Mapping[str, Any]) -> RecordHead:
    files = [one for one in _list(record.get("input")) if isinstance(one, dict)]
    inputs = tuple(InputFile(str(file.get("path", "")), str(file.get("sha256", ""))) for file in files)
    optional = {name: record.get(name) for name in OF_HEAD}
    return RecordHead(str(record.get("procedure", "")), inputs, _mapping(record.get("parameters")), **optional)


def _mapping(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _plane(folder: Path, name: str, entry: Mapping[str, Any]) -> PlaneResult:
    try:
        verdict = Verdict(entry.get("verdict", ""))
    except ValueError as error:
        raise BadInput(f"{folder / RECORD}: plane {name} has no verdict", _AGAIN) from error
    numbers = {key: quantity for key, value in entry.items() if (quantity := _quantity(value)) is not None}
    values = {key: float(value) for key, value in entry.items() if key in NUMBERS and isinstance(value, int | float)}
    rest = {key: value for key, value in entry.items()
            if key not in PARSED and not (key in numbers and plain(asdict(numbers[key])) == value)}  # fmt: skip
    unit, curves = Unit.CYCLES, dict[str, Array]()
    if verdict is not Verdict.REFUSED and (table := folder / f"mtf_{name}.csv").is_file():
        unit, curves = _curves(table)
    samples = folder / f"psf_{name}.npy"
    return PlaneResult(
        name, verdict, str(entry.get("reason", "")), str(entry.get("remedy", "")), numbers, curves,
        checked_array(parse_npy(_own(samples), str(samples), _AGAIN), f"the PSF {samples}", ("k", "k"), remedy=_AGAIN)
        if verdict is not Verdict.REFUSED and samples.is_file() else None,
        values=values, unit=unit, pitch=0, specification=Comparison.from_record(entry.get("specification")),
        unavailable=tuple(map(str, _list(entry.get("unavailable", entry.get("untold"))))), details=rest,
        other_causes=read_other_causes(entry),
    )  # fmt: skip


def _quantity(value: object) -> Quantity | None:
    if not isinstance(value, dict) or not {"value", "unit", "uncertainty"} <= value.keys():
        return None
    number, uncertainty, n = (_number(value.get(key, 0)) for key in ("value", "uncertainty", "n"))
    count = int(n) if math.isfinite(n) else 0
    return Quantity(number, str(value["unit"]), uncertainty, str(value.get("method", "")), count)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def _own(path: Path) -> bytes:
    try:
        if path.lstat().st_size > MAX_BYTES:
            raise BadInput(f"{path} is larger than {MAX_BYTES} bytes", _AGAIN)
        return read_own(path)
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", _AGAIN) from error


def _curves(path: Path) -> tuple[Unit, dict[str, Array]]:
    """The MTF of a plane and the unit of its frequencies."""
    try:
        units, columns = table_columns(list(csv.reader(_own(path).decode().splitlines())), ("frequency",))
    except ValueError as error:
        raise BadInput(f"{path} is no table of an MTF: {error}", _AGAIN) from error
    if columns["frequency"].max() <= 0 or not {"radial", "mtf"} & columns.keys():
        raise BadInput(f"{path} is no table of an MTF", _AGAIN)
    return unit_in(units[0]), columns


def read_picture(path: Path) -> npt.NDArray[np.uint8]:
    """Brightness (rows, columns) of a picture. Raises BadInput."""
    import cv2  # here: it is slow to load

    data = _own(path)
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    if picture is None:
        raise BadInput(f"{path} is no picture", _AGAIN)
    return np.asarray(picture, dtype=np.uint8)


@dataclass(frozen=True)
class Change:
    """One number in two results."""

    name: str
    one: Quantity
    other: Quantity

    @property
    def sigmas(self) -> float:
        """Other less one, in standard uncertainties of the difference; NaN if both are exact."""
        spread = math.hypot(self.one.uncertainty, self.other.uncertainty)
        return (self.other.value - self.one.value) / spread if spread > 0 else math.nan


def changes(result: PlaneResult, other: PlaneResult) -> list[Change]:
    """The numbers that both have."""
    return [Change(name, value, other.numbers[name]) for name, value in result.numbers.items() if name in other.numbers]
