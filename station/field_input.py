"""Which photographs a field is made of: those of a folder, or the accepted ones of a session; their focus positions."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, BadParameter

JOURNAL = "journal.jsonl"
ORIGINALS = "originals"
SUFFIXES = frozenset(
    f".{name}"
    for name in (
        *("3fr", "arw", "cr2", "cr3", "crw", "dng", "erf", "fff", "iiq", "k25", "kdc", "mef", "mos", "mrw", "nef"),
        *("nrw", "orf", "pef", "raf", "raw", "rw2", "rwl", "sr2", "srf", "srw", "x3f", "pgm", "png", "tif", "tiff"),
    )
)


def photographs(folder: Path) -> list[Path]:
    """The photographs of a folder by name; of a session those that its journal says count.

    Raises
    ------
    BadParameter
        If there is no such folder, or no photograph in it.
    """
    if not folder.is_dir():
        raise BadParameter(f"there is no folder {folder}", "name the folder of the photographs, or a session's")
    journal = folder / JOURNAL
    if journal.is_file():
        found = _accepted(folder, journal)
    else:
        place = folder / ORIGINALS if (folder / ORIGINALS).is_dir() else folder
        found = sorted(path for path in place.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
        found = [path for path in found if not path.name.startswith(".")]
    if not found:
        what = "accepted photographs" if journal.is_file() else "photographs"
        raise BadParameter(f"there are no {what} in {folder}", "name a folder that holds RAW, PGM, PNG or TIFF files")
    return found


def _accepted(folder: Path, journal: Path) -> list[Path]:
    """The photographs of a session that count, in the order of their shots: a line tells a shot's path or judges it."""
    paths: dict[int, str] = {}
    counts: dict[int, bool] = {}
    for line in _lines(journal):
        shot = line.get("shot")
        if not isinstance(shot, int):
            continue
        if isinstance(line.get("path"), str):
            paths[shot] = line["path"]
        if isinstance(line.get("counts"), bool):
            counts[shot] = line["counts"]
    return [folder / path for shot, path in sorted(paths.items()) if counts.get(shot)]


def _lines(journal: Path) -> Iterator[Mapping[str, Any]]:
    """The journal's entries; a last line that is not whole was being written when the power went."""
    for text in journal.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            entry = json.loads(text)
        except ValueError:
            continue
        if isinstance(entry, dict):
            yield entry


def focus_positions(table: Path) -> dict[str, float]:
    """Focus position by name of photograph, from a CSV file of two columns: name, position.

    Raises
    ------
    BadInput
        If a row has no number; a first row of words is taken for headings.
    """
    try:
        with open(table, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{table} cannot be read: {error}", "give a CSV file: name, focus position") from error
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
    return positions


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
