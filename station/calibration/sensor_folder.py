"""Dark pictures and levels of light in a folder: from a manifest, or from folder names and EXIF."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, Miss
from procedures.reading.exposure import read_exposure
from procedures.reading.guard import decoding, open_file
from procedures.reading.text import read_rows, read_text, read_toml
from procedures.sensor.stacks import LEAST_PICTURES

DARK, LIGHT = "dark", "light"
LONGEST = 300
DESCRIPTOR_HEAD = 65_536
"""Bytes of a text file searched for the first line of an EMVA 1288 descriptor."""
DESCRIPTOR_WORDS = {"v": 2, "n": 4, "b": 3, "d": 2}
"""Words of a descriptor's lines: version; bits, width and height; exposure and photons; exposure of dark pictures."""
_REMEDY = "see station sensor --help for what the folder and its manifest hold"
_RAW_ONLY = "write a manifest (sensor.csv or sensor.toml) with the exposure of every picture"


@dataclass(frozen=True)
class Shots:
    """Pictures of one exposure.

    kind : "dark" or "light"
    photons, light : photons per pixel, or a number proportional to them, where the manifest has it
    only_stack : whether the pictures are a stack alone, and no level of the ladder
    """

    kind: str
    exposure_s: float
    photons: float | None
    light: float | None
    paths: tuple[Path, ...]
    only_stack: bool = False

    @property
    def level(self) -> float:
        """Amount of light: photons, relative light, or exposure in seconds."""
        if self.kind == DARK:
            return 0.0
        return next((one for one in (self.photons, self.light) if one is not None), self.exposure_s)


def _refuse(miss: Miss) -> None:
    raise BadInput(miss.reason, miss.remedy)


def find_shots(folder: Path, missed: Callable[[Miss], object] = _refuse) -> tuple[Shots, ...]:
    """The pictures of a folder by exposure, dark ones first, then by light.

    `missed` is called for each RAW file whose exposure time cannot be read, which raises by default.

    Raises BadInput if there is no manifest and no folder `dark` and `light`, or the manifest is invalid.
    """
    if not folder.is_dir():
        raise BadInput(f"{folder} is no folder", "name the folder of the sensor's pictures")
    shots = _listed(folder, missed)
    if len({(shot.photons is None, shot.light is None) for shot in shots if shot.kind == LIGHT}) > 1:
        raise BadInput(f"{folder}: all levels must have the same measure of light", "give photons for all, or light")
    missing = [str(path) for shot in shots for path in shot.paths if not _is_file(path)]
    if missing:
        reason = f"{len(missing)} listed pictures do not exist, first {missing[0][:LONGEST]}"
        raise BadInput(reason, "check the names")
    return tuple(sorted(shots, key=lambda one: (one.kind != DARK, one.level, one.exposure_s, len(one.paths))))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # an invalid name
        return False


def _listed(folder: Path, missed: Callable[[Miss], object]) -> list[Shots]:
    """The pictures from a manifest, a descriptor, or the camera's metadata."""
    if (path := folder / "sensor.toml").is_file():
        return _from_toml(path)
    if (path := folder / "sensor.csv").is_file():
        names, *rows = read_rows(path, _REMEDY) or [[]]
        if not {"file", "kind", "exposure_s"} <= set(names):
            raise BadInput(f"{path} must have the columns file, kind, exposure_s; it has {names}", _REMEDY)
        table = [(n, dict(zip(names, row, strict=False))) for n, row in enumerate(rows, 2) if row]
        return _merged(_shots(f"{path}, line {n}", path.parent, row, [row.get("file")]) for n, row in table)
    for path in sorted(folder.glob("*.txt")):
        if _is_descriptor(path):
            return _from_descriptor(path)
    return _merged(_from_camera(folder, missed))


def _is_descriptor(path: Path) -> bool:
    """Whether it is a readable file whose first line, comments aside, is one of an EMVA 1288 descriptor."""
    try:
        with open_file(path) as file:
            beginning = file.read(DESCRIPTOR_HEAD).decode("utf-8", "replace")
    except (BadInput, OSError):
        return False
    words = next((line.split() for line in beginning.splitlines() if not _is_comment(line)), [])
    return len(words) == DESCRIPTOR_WORDS.get(words[0] if words else "") and all(map(_is_number, words[1:]))


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _is_number(word: str) -> bool:
    try:
        return _finite(word) >= 0
    except ValueError:
        return False


def _merged(shots: Iterable[Shots]) -> list[Shots]:
    merged: dict[tuple[str, float, float | None, float | None], tuple[Path, ...]] = {}
    for shot in shots:
        key = (shot.kind, shot.exposure_s, shot.photons, shot.light)
        merged[key] = (*merged.get(key, ()), *shot.paths)
    return [Shots(*key, paths) for key, paths in merged.items()]


def _shots(where: str, folder: Path, entry: Mapping[str, Any], files: object) -> Shots:
    kind = str(entry.get("kind", "")).strip().lower()
    if kind not in (DARK, LIGHT):
        raise BadInput(f'{where}: kind must be "dark" or "light"; got {entry.get("kind")!r}', _REMEDY)
    if not isinstance(files, list) or not files or not all(isinstance(name, str) and name for name in files):
        raise BadInput(f"{where}: every level needs its files", _REMEDY)
    exposure = _number(where, "exposure_s", entry.get("exposure_s"))
    if exposure is None:
        raise BadInput(f"{where}: exposure_s is missing", _REMEDY)
    given = {
        name: None if kind == DARK else _number(where, name, entry.get(name), zero=False)
        for name in ("photons", "light")
    }
    return Shots(kind, exposure, given["photons"], given["light"], tuple(folder / name for name in files))


def _number(where: str, name: str, value: object, *, zero: bool = True) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = float(value)  # type: ignore[arg-type]  # float raises for other types
    except (TypeError, ValueError):
        number = -1.0
    if not (0 <= number < float("inf")) or (number == 0 and not zero):
        raise BadInput(f"{where}: {name} must be a number above 0; got {value!r}", _REMEDY)
    return number


def _from_toml(path: Path) -> list[Shots]:
    levels = read_toml(path, _REMEDY).get("level")
    if not isinstance(levels, list) or not all(isinstance(level, dict) for level in levels):
        raise BadInput(f"{path} must contain [[level]] tables; it has none", _REMEDY)
    return [_shots(f"{path}, level {n}", path.parent, level, level.get("files")) for n, level in enumerate(levels, 1)]


def _from_descriptor(path: Path) -> list[Shots]:
    """EMVA's format: "b" exposure in ns and photons, or "d" exposure, then "i" and names; two pictures belong to the
    ladder, more are a stack, maybe in other light."""
    shots: list[Shots] = []
    for n, line in enumerate(read_text(path, "EMVA 1288 descriptor", _REMEDY, "replace").splitlines(), 1):
        words = line.split()
        if _is_comment(line) or words[0] in ("v", "n"):
            continue
        try:
            if words[0] in ("b", "d"):
                photons = _finite(words[2]) if words[0] == "b" else None
                kind = LIGHT if words[0] == "b" else DARK
                shots.append(Shots(kind, _finite(words[1]) * 1e-9, photons, None, ()))
            elif words[0] == "i":
                last = shots.pop()
                name = Path(*line.split(maxsplit=1)[1].strip().split("\\"))
                shots.append(replace(last, paths=(*last.paths, path.parent / name)))
        except (IndexError, ValueError) as error:
            reason = f"{path}, line {n} must be a line of an EMVA 1288 descriptor; got {line!r}"
            raise BadInput(reason, _REMEDY) from error
    return [replace(shot, only_stack=len(shot.paths) >= LEAST_PICTURES) for shot in shots]


def _finite(word: str) -> float:
    """A number from 0, with a decimal point or comma. Raises ValueError."""
    number = float(word.replace(",", "."))
    if not 0 <= number < float("inf"):
        raise ValueError(word)
    return number


def _from_camera(folder: Path, missed: Callable[[Miss], object]) -> Iterator[Shots]:
    if not all((folder / kind).is_dir() for kind in (DARK, LIGHT)):
        raise BadInput(f"{folder} has neither a manifest nor folders {DARK} and {LIGHT}", _REMEDY)
    for kind in (DARK, LIGHT):
        for path in sorted(p for p in (folder / kind).rglob("*") if not p.is_dir() and not p.name.startswith(".")):
            try:
                with open_file(path) as file, decoding(str(path), "a photograph", _RAW_ONLY):
                    exposure = read_exposure(file).exposure_s
                if exposure is None:
                    raise BadInput(f"{path} has no exposure time in its metadata", _RAW_ONLY)
            except BadInput as error:
                missed(Miss(str(path), error.reason, error.remedy))
            else:
                yield Shots(kind, exposure, None, None, (path,))
