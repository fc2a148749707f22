"""The folder of a batch: one batch at a time, and no foreign file is overwritten."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from procedures.outcome import BadParameter
from station.batch.item import RESULTS
from station.common.durable_files import holds, read_own
from station.results.result_files import PUBLISHING, RECORD

LINES, TABLE, PARQUET, PAGE = "results.jsonl", "summary.csv", "summary.parquet", "report.html"
LINE_BEGINS = '{"files": '
"""Beginning of every line of results."""


def check_own(out: Path) -> None:
    """Raise BadParameter if a file that a batch would overwrite was not written by a batch."""
    known = known_hashes(out)
    own = {RECORD: bool(_object(out / RECORD).get("schema")), LINES: _begins(out / LINES, LINE_BEGINS)}
    own |= {name: any(holds(out / name, one) for one in known.get(name, ())) for name in (TABLE, PARQUET, PAGE)}
    foreign = [name for name, known in own.items() if (out / name).exists() and not known]
    if foreign:
        raise BadParameter(
            f"{out} holds {', '.join(foreign)}, which no batch has written as it is now",
            "name a new folder with --out, move the file away, or add --force to write over it",
        )


def known_hashes(out: Path) -> dict[str, list[str]]:
    """Possible hashes of a batch's files by name, from its record and from the note of an interrupted one."""
    record, by_name = _object(out / RECORD), dict[str, list[str]]()
    files_of_record = record.get("files") if str(record.get("schema", "")).startswith("station/") else {}
    for files in (files_of_record, _object(out / PUBLISHING).get("files")):
        for name, hashes in files.items() if isinstance(files, dict) else ():
            by_name.setdefault(name, []).extend(map(str, hashes) if isinstance(hashes, list) else [str(hashes)])
    return by_name


def _object(path: Path) -> dict[str, Any]:
    """The JSON object in a file; an empty one if there is none."""
    try:
        value = json.loads(read_own(path))
    except (OSError, ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def _begins(path: Path, letters: str) -> bool:
    """Whether a file is empty, or begins with these letters."""
    try:
        data = read_own(path)
    except OSError:
        return False
    return not data or data.startswith(letters.encode())


@contextmanager
def owned(out: Path) -> Iterator[None]:
    """Lock the folder for one batch; incomplete results of killed workers are removed before and after."""
    try:
        (out / RESULTS).mkdir(parents=True, exist_ok=True)
        lock = (out / ".lock").open("w")
    except OSError as error:
        raise unwritable(out, error) from error
    with lock:
        _lock(lock, out)
        _sweep(out)
        yield
        _sweep(out)


def _lock(lock: Any, out: Path) -> None:
    """Lock until the file is closed, also by a kill. Not on Windows, which has no such lock."""
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise BadParameter(f"another batch is writing {out}", "wait for it, or name another folder") from error


def _sweep(out: Path) -> None:
    for unfinished in (out / RESULTS).glob("*/.unfinished-*"):
        shutil.rmtree(unfinished, ignore_errors=True)
        if not any(unfinished.parent.iterdir()):
            unfinished.parent.rmdir()


def unwritable(out: Path, error: OSError) -> BadParameter:
    """The error of a folder that cannot be written."""
    reason = f"the results need a folder that can be written; {out}: {error.strerror}"
    return BadParameter(reason, "name another folder with --out, or make room")
