"""Vignetting from files to results and back: flats are read, their record is written, and read by the exports."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procedures.outcome import BadInput, BadParameter, Miss, Outcome
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.arrays import LONGEST, checked_array, checked_number, read_npy
from procedures.reading.guard import decoding
from procedures.reading.text import read_json
from procedures.vignetting.estimate import NAMES, JointFormula, PlaneVignetting, estimate_vignetting, joint_formula
from procedures.vignetting.formula import LightSurface
from station.calibration.folder_photographs import check_any, for_want, readable
from station.common.progress import Progress, silent
from station.results.exports import csv_bytes
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead
from station.results.result_files import RECORD, npy

SCHEMA = "station/vignetting/1"
COVARIANCE = "vignetting_covariance.npy"
_GIVE = "name the folder that `station vignetting` wrote"


@dataclass(frozen=True, eq=False)
class Flats:
    """What photographs of even light say: their paths with hashes, every plane's outcome, and what cannot be read."""

    inputs: tuple[tuple[Path, str], ...]
    planes: Mapping[str, Outcome[PlaneVignetting]]
    missed: tuple[Miss, ...] = ()


@dataclass(frozen=True, eq=False)
class StoredVignetting:
    """A plane's vignetting as its record tells: the light, and the centre (x, y) of the radial formula."""

    plane: str
    light: LightSurface
    centre: tuple[float, float]


def measure_flats(paths: Sequence[Path], told: Progress = silent) -> Flats:
    """Vignetting from those of the photographs of even light that can be read.

    Raises
    ------
    BadInput
        If none can be, or they are not of one camera.
    """
    missed: list[Miss] = []
    found = flats_of(_some(paths, missed), told)
    planes = {name: for_want(one, missed, len(paths)) for name, one in found.planes.items()}
    return Flats(found.inputs, planes, tuple(missed))


def _some(paths: Sequence[Path], missed: list[Miss]) -> Iterator[RawFrame]:
    """The photographs that can be read; raises BadInput at their end where there was none."""
    yield from readable(paths, read_frame, missed)
    check_any(missed, len(paths))


def flats_of(frames: Iterable[RawFrame], told: Progress = silent) -> Flats:
    """The same of photographs that are read one after the other."""
    flats: list[tuple[str, Mapping[str, Plane]]] = []
    inputs: list[tuple[Path, str]] = []
    for frame in frames:
        path = frame.path
        if flats and _kind(frame.planes) != _kind(flats[0][1]):
            raise BadInput(
                f"flats have the same planes and sizes; {path.name} has others than {inputs[0][0].name}",
                "give photographs of one camera, in one format",
            )
        flats.append((path.name, frame.planes))
        inputs.append((path, frame.sha256))
        told(path.name)
    return Flats(tuple(inputs), estimate_vignetting(flats))


def _kind(planes: Mapping[str, Plane]) -> dict[str, tuple[int, ...]]:
    return {name: plane.samples.shape for name, plane in planes.items()}


def vignetting_measurement(found: Flats) -> Measurement:
    """Each plane's numbers and map, and the radial formulas of all planes with their one covariance."""
    values = {name: one.value for name, one in found.planes.items() if one.value is not None}
    together = joint_formula(values)
    formula = {
        "planes": list(together.planes), "names": list(NAMES), "values": together.values.tolist(),
        "covariance": COVARIANCE,
    }  # fmt: skip
    maps = {f"vignetting_{name}.csv": csv_bytes(_map_rows(value)) for name, value in values.items()}
    head = RecordHead("vignetting", tuple(InputFile(str(path), sha256) for path, sha256 in found.inputs))
    return Measurement(
        SCHEMA, head, tuple(_plane(name, one) for name, one in found.planes.items()), {"formula": formula},
        {**maps, COVARIANCE: npy(together.covariance)}, found.missed,
    )  # fmt: skip


def _map_rows(found: PlaneVignetting) -> list[list[str]]:
    rows = np.column_stack([found.places, found.value, found.uncertainty])
    return [["x", "y", "light", "uncertainty"], *([f"{value:.7g}" for value in row] for row in rows)]


def _plane(name: str, outcome: Outcome[PlaneVignetting]) -> PlaneResult:
    found = outcome.value
    if found is None:
        return PlaneResult.of_outcome(name, outcome, pitch=0)
    light = found.surface.light
    details = {
        "light": {"rows": light.shape[0], "columns": light.shape[1], "degree": light.degree,
                  "coefficients": light.coefficients.tolist()},
        "centre": found.radial.centre.tolist(),
        "diagnostics": {"scatter": found.surface.scatter, "structure": found.surface.structure,
                        "left_out": found.surface.excluded, "slopes": found.surface.slopes.tolist()},
    }  # fmt: skip
    return PlaneResult.of_outcome(name, outcome, numbers=found.numbers, found=found, pitch=0, details=details)


def is_vignetting(result: Path) -> bool:
    """Whether a result, a folder or its record, is of flats; raises BadInput where it is no record."""
    told: dict[str, Any] = read_json(result / RECORD if result.is_dir() else result, _GIVE)
    return told.get("procedure") == "vignetting"


def read_vignetting(result: Path) -> dict[str, StoredVignetting]:
    """The vignetting of every plane of a result that has one.

    Raises
    ------
    BadInput
        If there is no such result, or it has none.
    """
    record = result / RECORD if result.is_dir() else result
    told: dict[str, Any] = read_json(record, _GIVE)
    with decoding(str(record), "a vignetting's result", _GIVE):
        if told.get("procedure") != "vignetting":
            raise BadInput(f"{record} is of {told.get('procedure', 'nothing known')}, not of flats", _GIVE)
        found = {name: _stored(name, one) for name, one in told["planes"].items() if "light" in one}
        if not found:
            raise BadInput(f"{record} holds the light of no plane", "see its reasons; photograph the flats again")
        return found


def read_joint_formula(result: Path) -> JointFormula:
    """The radial formulas of all planes of a result with their one covariance.

    Raises
    ------
    BadInput
        If there is no such result, or it is of an older version that does not tell it.
    """
    record = result / RECORD if result.is_dir() else result
    read_vignetting(record)
    told: dict[str, Any] = read_json(record, _GIVE)
    if "formula" not in told:
        raise BadInput(f"{record} does not tell what its numbers share", "measure the flats again with this version")
    with decoding(str(record), "a vignetting's result", _GIVE):
        planes = tuple(str(one) for one in told["formula"]["planes"])
        count, table = len(NAMES) * len(planes), record.parent / COVARIANCE
        values = checked_array(told["formula"]["values"], f"the formula's values in {record}", (count,), remedy=_GIVE)
        covariance = read_npy(table, "covariance", _GIVE)
        return JointFormula(planes, values, checked_array(covariance, str(table), (count, count), remedy=_GIVE))


def _stored(name: str, entry: Mapping[str, Any]) -> StoredVignetting:
    light = entry["light"]
    coefficients = checked_array(light["coefficients"], f"the light's coefficients of plane {name}", (None,))
    x, y = checked_array(entry["centre"], f"the centre of plane {name}", (2,))
    rows, columns, degree = (
        int(checked_number(light[one], f"`{one}` of plane {name}", 1.0, LONGEST))
        for one in ("rows", "columns", "degree")
    )
    return StoredVignetting(name, LightSurface((rows, columns), degree, coefficients), (float(x), float(y)))


def green_of(found: Mapping[str, StoredVignetting]) -> StoredVignetting:
    """That of green, or the only one of a grey image; raises BadParameter where there is neither."""
    for name in ("G1", "G2", "Y"):
        if name in found:
            return found[name]
    raise BadParameter("vignetting of green is needed, which was refused", "photograph the flats again")
