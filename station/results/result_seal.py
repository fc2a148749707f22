"""Integrity of a result, by the hashes in its record of all files and of the record itself.

This detects errors of the disk and edited files, not forgery.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from station.common.durable_files import holds, read_own
from station.results.result_files import RECORD, SEAL, sealed_text


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
    """The record; None if it has changed."""
    try:
        data = read_own(folder / RECORD)
        record: dict[str, Any] = json.loads(data)
        rest = {name: value for name, value in record.items() if name != SEAL}
        whole = sealed_text(rest, rest["files"]).encode() == data
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return record if whole else None
