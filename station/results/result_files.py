"""The files of a result: written beside, then renamed, so that a folder holds one whole result or the older one."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from procedures.numbers import ENERGY_OUTSIDE_SUPPORT, SAMPLES_PER_PIXEL, SUPPORT
from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from station.common.durable_files import Disk, Unwritable, hashes_in, holds, make, read_own, release, sweep
from station.common.sanitise import encodable
from station.results.plane_result import PlaneResult
from station.results.record_head import verdict_entry

if TYPE_CHECKING:
    from procedures.cross_check.estimate import EdgeCheck
    from procedures.physics.estimate import Physics

RECORD = "result.json"
PUBLISHING = ".publishing.json"
"""Names of the program's own files while they are replaced."""
UNFINISHED = ".unfinished-"
"""How the name of a folder begins that receives a result."""
SEAL = "sha256"
CANDIDATES = 5
"""Physical models in a record, the best first."""


class ResultFolder:
    """A folder that receives one result, whole.

    Files are written into a hidden folder inside it, `staging`, and renamed by `publish`, the record last: whoever
    finds a record finds every file it speaks of, on the disk. Folders inside it are kept. Entering proves that the
    folder can be written, before any work is done, and that nothing in it has the name of a file of results that this
    program has not written as it is. `sealed` adds the hashes of all files and of the record itself; `force` writes
    foreign files over, and removes those that would pass for a part of this result. `inputs` are files from which the
    result is computed: they are never replaced or removed. Raises BadParameter on entering, if the folder cannot be
    made or written, or holds such a file.
    """

    def __init__(self, path: Path, *, sealed: bool = True, force: bool = False, inputs: Sequence[Path] = ()) -> None:
        self.path = path
        self.inputs = inputs
        self.sealed = sealed
        self.force = force
        self._created: list[Path] = []

    def __enter__(self) -> Self:
        missing = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._created = missing
            self._check(self._named())
            self._check_inputs([*own_hashes(self.path), *self._named()])
            sweep(self.path, UNFINISHED)
            self.staging, self._held = make(UNFINISHED, self.path)
        except OSError as error:
            raise Unwritable(self.path, error) from error
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.staging, ignore_errors=True)
        release(self._held)
        for folder in self._created:
            if any(folder.iterdir()):
                break
            folder.rmdir()

    def write(self, name: str, data: bytes | Callable[[Path], None]) -> None:
        """Stage one file: its bytes, or what a function writes. Raises BadParameter if the disk does not take it."""
        try:
            data(self.staging / name) if callable(data) else (self.staging / name).write_bytes(data)
        except OSError as error:
            raise Unwritable(self.path, error) from error

    def publish(self) -> None:
        """Put the staged files in the older result's place, and remove what only that had. Raises BadParameter if the
        disk refuses."""
        try:
            self._publish(Disk())
        except OSError as error:
            raise Unwritable(self.path, error) from error

    def _publish(self, disk: Disk) -> None:
        staged = sorted(file.relative_to(self.staging) for file in self.staging.rglob("*") if file.is_file())
        staged.sort(key=lambda name: name == Path(RECORD))
        self._check([name.as_posix() for name in staged])
        self._check_inputs([name.as_posix() for name in staged])
        for name in staged:
            disk.settle(self.staging / name)
        older = own_hashes(self.path)
        both = older | {name: [*older.get(name, ()), one] for name, one in hashes_in(self.staging).items()}
        (self.path / PUBLISHING).write_text(json_text({"files": both}))
        (self.path / RECORD).unlink(missing_ok=True)
        folders = {self.path / name.parent for name in staged}
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        for old in {*older, *self._named()} - {name.as_posix() for name in staged}:
            if self.force or self._is_own(old, older):
                (self.path / old).unlink(missing_ok=True)
        for name in staged:
            if name == Path(RECORD):
                disk.sync_folder(self.path)
            os.replace(self.staging / name, self.path / name)
        for folder in {*folders, self.path.parent}:
            disk.sync_folder(folder)
        (self.path / PUBLISHING).unlink(missing_ok=True)

    def _named(self) -> list[str]:
        return [old.name for old in self.path.iterdir() if _RESULT_FILE.fullmatch(old.name)]

    def _check(self, names: Sequence[str]) -> None:
        """Raise BadParameter if one of these files exists and is foreign."""
        if self.force:
            return
        older = own_hashes(self.path)
        foreign = [name for name in sorted(names) if (self.path / name).exists() and not self._is_own(name, older)]
        if foreign:
            raise BadParameter(
                f"{self.path} holds {', '.join(foreign[:5])}, which the program has not written in this form",
                "name a new folder with --out, move the file away, or add --force to write over it",
            )

    def _check_inputs(self, names: Sequence[str]) -> None:
        """Raise BadParameter if one of these files is an input."""
        there = [self.path / name for name in names if (self.path / name).exists()]
        for one in self.inputs:
            if one.exists() and any(file.samefile(one) for file in there):
                raise BadParameter(
                    f"the result would replace {one}, which is read for it", "name a new folder with --out"
                )

    def _is_own(self, name: str, older: Mapping[str, Sequence[str]]) -> bool:
        """Whether a file is what this program wrote under this name."""
        if name == RECORD:
            return str(json_object(self.path / RECORD).get("schema", "")).startswith("station/")
        return any(holds(self.path / name, digest) for digest in older.get(name, ()))


def own_hashes(folder: Path) -> dict[str, list[str]]:
    """The hashes that the files of a result may have: by its record, and by one that was being published."""
    hashes: dict[str, list[str]] = {}
    for record in (json_object(folder / RECORD), json_object(folder / PUBLISHING)):
        files = record.get("files")
        for name, digests in files.items() if isinstance(files, dict) else ():
            inside = name and not name.startswith("/") and ".." not in Path(name).parts
            if isinstance(digests, str | list) and inside:
                hashes.setdefault(name, []).extend([digests] if isinstance(digests, str) else map(str, digests))
    return hashes


def json_object(path: Path) -> dict[str, Any]:
    """The object in a file; empty if it cannot be read."""
    try:
        value = json.loads(read_own(path))
    except (OSError, ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


_RESULT_FILE = re.compile(
    r"(psf|covariance|mtf|edge|heights|inter_image|profile|transfer|spectrogram|histogram|defects|nps|information|vignetting)"
    r"_(R|G1|G2|B|Y)\.(npy|csv|png|fits|tiff)|numbers\.csv|budget\.csv|emva1288\.xml|report\.html"
    r"|certificate\.(html|pdf)|field\.h5|tilt\.csv"
    r"|geometry_\w+\.(npy|csv)|(corrected|sharp|filtered|difference)\.(tiff|dng|png)|gain\.csv"
    r"|(w|w_std|moved|occlusion|similar)\.npy|imu_[12]\.csv"
    r"|sharp_std\.tiff|kernel_\d+\.(npy|fits|tiff)|depth\.png|rays\.html|result\.json"
)
"""Names of files of results: foreign ones are not overwritten."""


def write_record(folder: ResultFolder, record: Mapping[str, Any]) -> str:
    """Write the record, null where a number is not finite, and publish the folder; returns the record's text."""
    text = sealed_text(record, hashes_in(folder.staging)) if folder.sealed else json_text(record)
    folder.write(RECORD, text.encode())
    folder.publish()
    return text


def sealed_text(record: Mapping[str, Any], files: Mapping[str, str]) -> str:
    """The record with the SHA-256 of the files beside it, and of itself without that line."""
    whole = json_text({**record, "files": files})
    seal = hashlib.sha256(whole.encode()).hexdigest()
    return whole.removesuffix("\n}\n") + f',\n "{SEAL}": "{seal}"\n}}\n'


def json_text(record: Mapping[str, Any]) -> str:
    """A record as JSON that every parser takes: null for every number that is not finite."""
    return json.dumps(plain(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def plane_record(plane: PlaneResult) -> dict[str, Any]:
    """A plane as a record holds it: verdict, numbers with their budgets, and what belongs to its procedure alone."""
    entry: dict[str, Any] = verdict_entry(plane)
    if plane.specification is not None:
        entry["specification"] = plane.specification.to_record()
    if plane.unavailable:
        entry["unavailable"] = list(plane.unavailable)
    if plane.verdict is not Verdict.REFUSED and plane.pitch:
        entry["sensor_pixels_per_pixel"] = plane.pitch
    entry.update(plane.values)
    if plane.psf is not None:
        from procedures.quality import energy_outside_support  # here: mathematics, slow to load

        n = next((quantity.n for quantity in plane.quality.numbers.values()), 0) if plane.quality else 0
        outside = asdict(energy_outside_support(plane.psf, n))
        entry |= {SAMPLES_PER_PIXEL: plane.psf.s, SUPPORT: plane.psf.k, ENERGY_OUTSIDE_SUPPORT: outside}
    if plane.quality is not None:
        budgets = plane.quality.budgets
        numbers = plane.quality.numbers.items()
        entry.update({name: {**asdict(quantity), "budget": dict(budgets[name])} for name, quantity in numbers})
    else:
        entry.update({name: number_record(one) for name, one in plane.numbers.items()})
    if plane.variations:
        entry["variations"] = [asdict(variation) for variation in plane.variations]
    if plane.diffraction is not None:
        cutoff = plane.diffraction.cutoff * plane.factor
        entry["diffraction"] = {**asdict(plane.diffraction), "cutoff": cutoff, "cutoff_unit": str(plane.unit)}
    if plane.edges:
        entry["edges"] = [_edge_entry(edge) for edge in plane.edges]
    if plane.physics is not None:
        entry["physics"] = _physics_entry(plane.physics)
    if plane.information is not None:
        entry["information"] = {name: interval_entry(number) for name, number in plane.information.numbers.items()}
    if plane.diagnostics:
        entry["diagnostics"] = dict(plane.diagnostics)
    return entry | dict(plane.details)


def number_record(number: Quantity) -> dict[str, Any]:
    """Entry of a number, with its 95 % interval if it has one."""
    return interval_entry(number) if hasattr(number, "low") else asdict(number)


def interval_entry(number: Quantity) -> dict[str, Any]:
    """A number with its 95 % interval."""
    entry = asdict(number)
    interval = [entry.pop("low"), entry.pop("high")]
    return {**entry, "interval": interval}


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
    entry = verdict_entry(outcome)
    if (physics := outcome.value) is not None:
        entry |= {"aperture": physics.aperture, "missing_corner_deg": physics.missing_corner_deg}
        entry |= {"low_pass_filter": physics.low_pass, "chi_square": physics.chi_square, "freedom": physics.freedom}
        entry |= {"chi_square_share": physics.remaining}
        entry |= {name: asdict(number) for name, number in physics.numbers.items()}
        entry["candidates"] = [{"model": words, "criterion": more} for words, more in physics.candidates[:CANDIDATES]]
    return entry


def npy(array: npt.NDArray[Any], dtype: npt.DTypeLike = np.float64) -> bytes:
    """An array as the bytes of a file of NumPy."""
    data = io.BytesIO()
    np.save(data, np.asarray(array, dtype=dtype), allow_pickle=False)
    return data.getvalue()


def plain(value: Any) -> Any:
    """The record with plain Python numbers, null for every number that is not finite, and text that can be encoded."""
    if isinstance(value, str):
        return encodable(value)
    if isinstance(value, Mapping):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


# This detects errors of the disk and edited files, not forgery.


def is_sealed(folder: Path) -> bool:
    """Whether the record in a folder has hashes, which earlier versions lack; True if it cannot be read."""
    try:
        return SEAL in json.loads(read_own(folder / RECORD))
    except (OSError, ValueError, TypeError, RecursionError):
        return True


def damage(folder: Path) -> tuple[str, ...]:
    """The missing or changed files of a sealed result; the record alone if it has changed."""
    record = _record(folder)
    if record is None:
        return (RECORD,)
    return tuple(name for name, digest in record["files"].items() if not holds(folder / name, digest))


def _record(folder: Path) -> dict[str, Any] | None:
    try:
        data = read_own(folder / RECORD)
        record: dict[str, Any] = json.loads(data)
        rest = {name: value for name, value in record.items() if name != SEAL}
        whole = sealed_text(rest, rest["files"]).encode() == data
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return record if whole else None
