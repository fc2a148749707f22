"""Which photographs a field is made of: those of a folder, or the accepted ones of a session; their focus positions."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from procedures.outcome import BadInput, BadParameter
from procedures.reading.exposure import check_typed, read_exposure
from procedures.reading.guard import open_file
from procedures.reading.text import read_rows
from station.calibration.folder_photographs import GREY_SUFFIXES, RAW_SUFFIXES
from station.sessions.layout import ORIGINALS, inside, is_session
from station.sessions.reader import read_session


def photographs(folder: Path) -> list[Path]:
    """A folder's photographs by name; of a session those that count. Raises BadParameter if there is none."""
    if not folder.is_dir():
        raise BadParameter(f"there is no folder {folder}", "name the folder of the photographs, or a session's")
    session = is_session(folder)
    paths = [inside(folder, shot.path) for shot in read_session(folder).state.counting()] if session else _plain(folder)
    if not paths:
        what = "accepted photographs" if session else "photographs"
        raise BadParameter(f"there are no {what} in {folder}", "name a folder that holds RAW, PGM, PNG or TIFF files")
    return paths


def _plain(folder: Path) -> list[Path]:
    """The photographs that lie in the folder itself, or in its `originals`, by name."""
    place = folder / ORIGINALS if (folder / ORIGINALS).is_dir() else folder
    paths = (path for path in place.iterdir() if path.suffix.lower() in RAW_SUFFIXES | GREY_SUFFIXES)
    return sorted(path for path in paths if not path.is_dir() and not path.name.startswith("."))


def check_noted(paths: Sequence[Path], typed: Mapping[str, float | None], insist: str) -> None:
    """Raise BadParameter for settings that contradict a camera's record in a file, before hours of work; unreadable
    ones pass."""
    if not any(typed.values()):
        return
    for path in paths:
        try:
            with open_file(path) as file:
                noted = read_exposure(file)
        except (BadInput, OSError):
            continue
        check_typed(noted, typed, str(path), insist)


def focus_positions(table: Path, photographs: Sequence[Path]) -> dict[str, float]:
    """Focus positions by photograph from a CSV file: name, position; headings are allowed. Raises BadInput for a row
    without number, or none of these photographs."""
    rows = [row for row in read_rows(table, "give a CSV file: name, focus position") if any(map(str.strip, row))]
    positions = {}
    for number, row in enumerate(rows):
        value = _number(row[1]) if len(row) > 1 else None
        if value is not None:
            positions[row[0].strip()] = value
        elif number > 0:
            raise BadInput(
                f"{table}, row {number + 1}: a name and a focus position are needed; got {','.join(row)!r}",
                "write for example: frame-01.dng,12.35",
            )
    if positions.keys().isdisjoint(path.name for path in photographs):
        named = ", ".join(sorted(positions)[:3]) or "none"
        reason = f"{table} has the position of none of {len(photographs)} photographs; it names {named}"
        raise BadInput(reason, f"name the files as they are called, as {photographs[0].name}")
    return positions


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
