"""Whether a result is still what was written, by the hashes that its record tells of the files beside it and of itself.

What an error of the disk or an editor changed is found; whoever wants to deceive can sum up again.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from station.common.durable_files import holds, read_own
from station.results.result_files import RECORD, SEAL, sealed_text


def is_sealed(folder: Path) -> bool:
    """Whether the record in a folder tells hashes; those of earlier versions do not. One that cannot be read does."""
    try:
        return SEAL in json.loads(read_own(folder / RECORD))
    except (OSError, ValueError, TypeError, RecursionError):
        return True


def damage(folder: Path) -> tuple[str, ...]:
    """The files of a sealed result that are missing or not what was written; its record alone where that is not."""
    record = _record(folder)
    if record is None:
        return (RECORD,)
    return tuple(name for name, digest in record["files"].items() if not holds(folder / name, digest))


def _record(folder: Path) -> dict[str, Any] | None:
    """The record, None where it is not what was written."""
    try:
        data = read_own(folder / RECORD)
        record: dict[str, Any] = json.loads(data)
        rest = {name: value for name, value in record.items() if name != SEAL}
        whole = sealed_text(rest, rest["files"]).encode() == data
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return record if whole else None
