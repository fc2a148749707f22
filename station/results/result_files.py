"""The files of a result: written beside, then renamed, so that a folder holds one whole result or the older one."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from procedures.cross_check.estimate import EdgeCheck
from procedures.outcome import BadParameter, Outcome
from procedures.quality import energy_outside_support
from station.common.durable_files import Disk, hashes_in
from station.common.leftovers import make, release, sweep
from station.common.sanitise import encodable
from station.drawing.psf_picture import psf_picture
from station.results.budget_table import budget_csv
from station.results.exports import csv_bytes, numbers_table, profile_table, psf_fits, psf_tiff
from station.results.plane_result import PlaneResult

if TYPE_CHECKING:
    from procedures.physics.estimate import Physics
    from procedures.sensor.information import Information
    from procedures.sensor.measured import Measured

RECORD = "result.json"
UNFINISHED = ".unfinished-"
"""How the name of a folder begins that receives a result."""
SEAL = "sha256"
SCHEMA = "station/psf/1"
CANDIDATES = 5
"""Physical models told of, the best first."""
METADATA = re.compile(r"(?P<name>[^-]+)-(?P<version>[^-]+)(-py[\d.]+)?\.(dist|egg)-info")
"""Folders that tell what is installed."""
PACKAGES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "rawpy")

Array = npt.NDArray[np.float64]


class ResultFolder:
    """A folder that receives one result, whole.

    Files are written into a hidden folder inside it, `staging`, and renamed by `publish`, the record last: whoever
    finds a record finds every file it speaks of, on the disk. Folders inside it are kept. Entering proves that the
    folder can be written, before any work is done. `sealed` has the record tell the hashes of all files and its own.

    Raises
    ------
    BadParameter
        On entering, if the folder cannot be made or written.
    """

    def __init__(self, path: Path, *, sealed: bool = True) -> None:
        self.path = path
        self.sealed = sealed
        self._created: list[Path] = []

    def __enter__(self) -> Self:
        missing = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._created = missing
            sweep(self.path, f"{UNFINISHED}*")
            self.staging, self._held = make(UNFINISHED, self.path)
        except OSError as error:
            raise self._unwritable(error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self.staging, ignore_errors=True)
        release(self._held)
        for folder in self._created:
            if any(folder.iterdir()):
                break
            folder.rmdir()

    def write(self, name: str, data: bytes) -> None:
        """Stage one file. Raises BadParameter if the disk does not take it."""
        try:
            (self.staging / name).write_bytes(data)
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> BadParameter:
        reason = f"the results need a folder that can be written; {self.path}: {error.strerror}"
        return BadParameter(reason, "name another folder with --out, or make room")

    def publish(self) -> None:
        """Put the staged files in the place of the older result's, and remove what only that one had.

        Raises
        ------
        BadParameter
            If the disk does not take it.
        """
        try:
            self._publish(Disk())
        except OSError as error:
            raise self._unwritable(error) from error

    def _publish(self, disk: Disk) -> None:
        staged = sorted(file.relative_to(self.staging) for file in self.staging.rglob("*") if file.is_file())
        staged.sort(key=lambda name: name == Path(RECORD))
        for name in staged:
            disk.settle(self.staging / name)
        (self.path / RECORD).unlink(missing_ok=True)
        folders = {self.path / name.parent for name in staged}
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
            for old in folder.iterdir():
                if _RESULT_FILE.fullmatch(old.name) and old.relative_to(self.path) not in staged:
                    old.unlink()
        for name in staged:
            if name == Path(RECORD):
                disk.sync_folder(self.path)
            os.replace(self.staging / name, self.path / name)
        for folder in {*folders, self.path.parent}:
            disk.sync_folder(folder)


_RESULT_FILE = re.compile(
    r"(psf|covariance|mtf|edge|inter_image|profile|transfer|spectrogram|histogram|defects|nps|information)_(R|G1|G2|B|Y)\.(npy|csv|png|fits|tiff)|numbers\.csv|budget\.csv|emva1288\.xml|report\.html|field\.h5|geometry_\w+\.(npy|csv)|corrected\.(tiff|dng)|gain\.csv"
)


def write_psf_result(folder: ResultFolder, planes: Sequence[PlaneResult], about: Mapping[str, Any]) -> str:
    """Write the files of every plane and the record; returns the record's text.

    Parameters
    ----------
    about : procedure, input, parameters, duration_s: what the record says besides its planes
    """
    for plane in planes:
        _write_plane(folder, plane)
    if any(plane.quality is not None for plane in planes):
        folder.write(
            "numbers.csv", numbers_table((plane.name, *one) for plane in planes for one in plane.numbers.items())
        )
        folder.write("budget.csv", budget_csv(planes))
    record = {
        "schema": SCHEMA,
        **about,
        "parameters": {**about.get("parameters", {}), **_sampling(planes)},
        "choice": {plane.name: [asdict(trial) for trial in plane.choice] for plane in planes if plane.choice},
        "planes": {plane.name: _plane_entry(plane) for plane in planes},
        "software": software(),
    }
    return write_record(folder, record)


def _sampling(planes: Sequence[PlaneResult]) -> dict[str, Any]:
    """s and k as they were used: one number where all planes have the same, else one a plane."""
    used = {plane.name: plane.psf for plane in planes if plane.psf is not None}
    found: dict[str, Any] = {}
    for name in ("s", "k") if used else ():
        values = {plane: psf.s if name == "s" else psf.k for plane, psf in used.items()}
        found[name] = next(iter(values.values())) if len(set(values.values())) == 1 else values
    return found


def write_record(folder: ResultFolder, record: Mapping[str, Any]) -> str:
    """Write the record, null where a number is not finite, and publish the folder; returns the record's text."""
    text = sealed_text(record, hashes_in(folder.staging)) if folder.sealed else json_text(record)
    folder.write(RECORD, text.encode())
    folder.publish()
    return text


def sealed_text(record: Mapping[str, Any], files: Mapping[str, str]) -> str:
    """The record with the SHA-256 of the files beside it, and of itself without that line."""
    whole = {**record, "files": files}
    return json_text({**whole, SEAL: hashlib.sha256(json_text(whole).encode()).hexdigest()})


def json_text(record: Mapping[str, Any]) -> str:
    """A record as JSON that every parser takes: null for every number that is not finite."""
    return json.dumps(plain(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _write_plane(folder: ResultFolder, plane: PlaneResult) -> None:
    if plane.psf is not None:
        folder.write(f"psf_{plane.name}.npy", npy(plane.psf.h))
        folder.write(f"covariance_{plane.name}.npy", npy(plane.psf.covariance))
        folder.write(f"psf_{plane.name}.fits", psf_fits(plane.psf, plane.name, software()["version"]))
        folder.write(f"psf_{plane.name}.tiff", psf_tiff(plane.psf))
        folder.write(f"profile_{plane.name}.csv", profile_table(plane.psf, plane.pitch))
        folder.write(f"psf_{plane.name}.png", psf_picture(plane.psf, f"{plane.name}  {plane.verdict}"))
    if plane.information is not None:
        folder.write(f"information_{plane.name}.csv", information_table(plane.information))
    if plane.inter_image is not None:
        folder.write(f"inter_image_{plane.name}.npy", npy(plane.inter_image))
    if plane.curves:
        folder.write(f"mtf_{plane.name}.csv", mtf_table(plane.curves))


def mtf_table(curves: Mapping[str, Array]) -> bytes:
    """The MTF as CSV: frequency in cycles/pixel; horizontal, vertical, radial mean, each with its uncertainty."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(curves)
    table.writerows([f"{value:.9g}" for value in row] for row in zip(*curves.values(), strict=True))
    return text.getvalue().encode()


def information_table(found: Information) -> bytes:
    """NPS, NEQ and noise-equivalent MTF as CSV, over all frequencies of the upper half plane, in cycles/pixel."""
    rows = [["frequency_x", "frequency_y", "mtf", "nps", "neq", "neq_uncertainty", "equivalent_mtf",
             "equivalent_mtf_uncertainty"]]  # fmt: skip
    maps = (found.mtf, found.nps, found.neq, found.neq_uncertainty, found.equivalent_mtf,
            found.equivalent_mtf_uncertainty)  # fmt: skip
    for j in range(len(found.frequencies) // 2 + 1):
        for i, fx in enumerate(found.frequencies):
            rows.append([f"{value:.7g}" for value in (fx, abs(found.frequencies[j]), *(one[j, i] for one in maps))])
    return csv_bytes(rows)


def software() -> dict[str, Any]:
    """Versions of this program and of the packages its numbers come from."""
    return {"version": _version("calibration-station"), "packages": {name: _version(name) for name in PACKAGES}}


def _version(distribution: str) -> str | None:
    return _versions().get(distribution.replace("-", "_"))


@cache
def _versions() -> dict[str, str]:
    """Versions of what is installed, as the folders of metadata are named: reading those takes thirty times as long.

    Source: PyPA, "Recording installed projects". The first on Python's path counts.
    """
    folders = [Path(place) for place in reversed(sys.path) if os.path.isdir(place or ".")]
    named = [METADATA.fullmatch(name) for folder in folders for name in os.listdir(folder)]
    return {found["name"].lower(): found["version"] for found in named if found}


def _plane_entry(plane: PlaneResult) -> dict[str, Any]:
    entry: dict[str, Any] = {"verdict": str(plane.verdict), "reason": plane.reason, "remedy": plane.remedy}
    entry.update(plane.values)
    if plane.psf is not None:
        n = next((quantity.n for quantity in plane.quality.numbers.values()), 0) if plane.quality else 0
        outside = asdict(energy_outside_support(plane.psf, n))
        entry |= {"s": plane.psf.s, "k": plane.psf.k, "energy_outside_support": outside}
    if plane.quality is not None:
        budgets = plane.quality.budgets
        numbers = plane.quality.numbers.items()
        entry.update({name: {**asdict(quantity), "budget": dict(budgets[name])} for name, quantity in numbers})
    if plane.variations:
        entry["variations"] = [asdict(one) for one in plane.variations]
    if plane.diffraction is not None:
        entry["diffraction"] = {**asdict(plane.diffraction), "cutoff": plane.diffraction.cutoff}
    if plane.edges:
        entry["edges"] = [_edge_entry(edge) for edge in plane.edges]
    if plane.physics is not None:
        entry["physics"] = _physics_entry(plane.physics)
    if plane.information is not None:
        entry["information"] = {name: interval_entry(number) for name, number in plane.information.numbers.items()}
    if plane.diagnostics:
        entry["diagnostics"] = dict(plane.diagnostics)
    return entry


def interval_entry(number: Measured) -> dict[str, Any]:
    """A number with its 95 % interval."""
    told = asdict(number)
    interval = [told.pop("low"), told.pop("high")]
    return {**told, "interval": interval}


def _edge_entry(check: EdgeCheck) -> dict[str, Any]:
    """MTF50 across one printed edge and by the PSF, all light counted in both, and how far they differ."""
    return {
        "orientation": check.edge.orientation,
        "normal_deg": check.edge.normal_deg,
        "mtf50_edge": asdict(check.by_edge),
        "mtf50_psf": asdict(check.by_psf),
        "difference": check.difference,
        "sigmas": check.sigmas,
    }


def _physics_entry(outcome: Outcome[Physics]) -> dict[str, Any]:
    """The parts of the best model, their sizes, what they leave unexplained, and the next best models."""
    entry: dict[str, Any] = {"verdict": str(outcome.verdict), "reason": outcome.reason, "remedy": outcome.remedy}
    if (found := outcome.value) is not None:
        entry |= {"aperture": found.aperture, "missing_corner_deg": found.missing_corner_deg}
        entry |= {"low_pass_filter": found.low_pass, "chi_square": found.chi_square, "freedom": found.freedom}
        entry |= {"chi_square_share": found.remaining}
        entry |= {name: asdict(number) for name, number in found.numbers.items()}
        entry["candidates"] = [{"model": words, "criterion": more} for words, more in found.candidates[:CANDIDATES]]
    return entry


def npy(array: Array) -> bytes:
    """An array as the bytes of a file of NumPy, float64."""
    data = io.BytesIO()
    np.save(data, np.asarray(array, dtype=np.float64), allow_pickle=False)
    return data.getvalue()


def plain(value: Any) -> Any:
    """The same with plain Python numbers, null for every number that is not finite, and text that can be encoded."""
    if isinstance(value, str):
        return encodable(value)
    if isinstance(value, Mapping):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
