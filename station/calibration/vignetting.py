"""Vignetting: measurement from flats, and stored results for exports."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from procedures.numbers import CORNER_LIGHT
from procedures.outcome import BadInput, BadParameter, Miss, Outcome
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.arrays import LONGEST, checked_array, checked_number, read_npy
from procedures.vignetting.estimate import NAMES, JointFormula, PlaneVignetting, estimate_vignetting, joint_formula
from procedures.vignetting.surface import LightSurface
from station.calibration.folder_photographs import check_any, for_want, readable
from station.calibration.stored_results import stored_record
from station.common.progress import Progress, silent
from station.results.exports import csv_columns
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, files_read
from station.results.result_files import npy

SCHEMA = "station/vignetting/1"
COVARIANCE = "vignetting_covariance.npy"
_GIVE = "name the folder that `station vignetting` wrote"


@dataclass(frozen=True, eq=False)
class Flats:
    """Flats: paths with hashes, the outcome of every plane, and unreadable photographs."""

    inputs: tuple[tuple[Path, str], ...]
    planes: Mapping[str, Outcome[PlaneVignetting]]
    missed: tuple[Miss, ...] = ()


@dataclass(frozen=True, eq=False)
class StoredVignetting:
    """A plane's vignetting from a record: the light, and the centre (x, y) of the radial formula."""

    plane: str
    light: LightSurface
    centre: tuple[float, float]


def measure_flats(paths: Sequence[Path], progress: Progress = silent) -> Flats:
    """Vignetting from the readable photographs of even light. Raises BadInput for none, or several cameras."""
    missed: list[Miss] = []
    flats = flats_of(_readable_flats(paths, missed), progress)
    planes = {name: for_want(plane, missed, len(paths)) for name, plane in flats.planes.items()}
    return Flats(flats.inputs, planes, tuple(missed))


def _readable_flats(paths: Sequence[Path], missed: list[Miss]) -> Iterator[RawFrame]:
    """The readable photographs. Raises BadInput at their end where there was none."""
    yield from readable(paths, read_frame, missed)
    check_any(missed, len(paths))


def flats_of(frames: Iterable[RawFrame], progress: Progress = silent) -> Flats:
    """Vignetting from photographs that are read one after the other."""
    flats: list[tuple[str, Mapping[str, Plane]]] = []
    inputs: list[tuple[Path, str]] = []
    for frame in frames:
        flats.append((frame.path.name, frame.planes))
        inputs.append((frame.path, frame.sha256))
        progress(f"read {frame.path.name}")
    return Flats(tuple(inputs), estimate_vignetting(flats))


def vignetting_measurement(flats: Flats) -> Measurement:
    """Each plane's numbers and map, and the radial formulas of all planes with their one covariance."""
    values = {name: plane.value for name, plane in flats.planes.items() if plane.value is not None}
    joint = joint_formula(values)
    formula = {
        "planes": list(joint.planes), "names": list(NAMES), "values": joint.values.tolist(),
        "covariance": COVARIANCE,
    }  # fmt: skip
    maps = {f"vignetting_{name}.csv": _map(value) for name, value in values.items()}
    head = RecordHead("vignetting", files_read([InputFile(str(path), sha256) for path, sha256 in flats.inputs]))
    return Measurement(
        SCHEMA, head, tuple(_plane(name, plane) for name, plane in flats.planes.items()), {"formula": formula},
        {**maps, COVARIANCE: npy(joint.covariance)}, flats.missed,
    )  # fmt: skip


def _map(vignetting: PlaneVignetting) -> bytes:
    x, y = vignetting.places.T
    return csv_columns({"x": x, "y": y, "light": vignetting.value, "uncertainty": vignetting.uncertainty}, 7)


def _plane(name: str, outcome: Outcome[PlaneVignetting]) -> PlaneResult:
    one = outcome.value
    if one is None:
        return PlaneResult.of_outcome(name, outcome, pitch=0)
    light = one.surface.light
    details = {
        "light": {"rows": light.shape[0], "columns": light.shape[1], "degree": light.degree,
                  "coefficients": light.coefficients.tolist()},
        "centre": one.radial.centre.tolist(),
        "diagnostics": {"scatter": one.surface.scatter, "structure": one.surface.structure,
                        "left_out": one.surface.excluded, "slopes": one.surface.slopes.tolist()},
        CORNER_LIGHT: asdict(one.numbers[CORNER_LIGHT]) | {"budget": one.corner_budget},
    }  # fmt: skip
    return PlaneResult.of_outcome(name, outcome, numbers=one.numbers, estimate=one, pitch=0, details=details)


def read_vignetting(result: Path) -> dict[str, StoredVignetting]:
    """The vignetting of every plane of a result. Raises BadInput if there is no such result, or it has none."""
    with stored_record(result, "vignetting", _GIVE) as stored:
        planes = {name: _stored(name, one) for name, one in stored.data["planes"].items() if "light" in one}
        if not planes:
            raise BadInput(f"{stored.path} has the light of no plane", "see its reasons; photograph the flats again")
        return planes


def read_joint_formula(result: Path) -> JointFormula:
    """The radial formulas of a result's planes, joint covariance. Raises BadInput for none, or a version without it."""
    read_vignetting(result)
    with stored_record(result, "vignetting", _GIVE) as stored:
        if (formula := stored.data.get("formula")) is None:
            raise BadInput(f"{stored.path} has no joint covariance", "measure the flats again with this version")
        planes = tuple(str(one) for one in formula["planes"])
        count, table = len(NAMES) * len(planes), stored.path.parent / COVARIANCE
        values = checked_array(formula["values"], f"the formula's values in {stored.path}", (count,), remedy=_GIVE)
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


def green_of(planes: Mapping[str, StoredVignetting]) -> StoredVignetting:
    """The vignetting of green, or of a grey image. Raises BadParameter where there is neither."""
    for name in ("G1", "G2", "Y"):
        if name in planes:
            return planes[name]
    raise BadParameter("vignetting of green is needed, which was refused", "photograph the flats again")
