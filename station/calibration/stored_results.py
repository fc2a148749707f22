"""Records of results, read back for other procedures and for exports."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, BadParameter, ProcedureError
from procedures.reading.guard import decoding, read_file
from procedures.reading.text import parse_json, read_json
from station.results.result_files import RECORD


@dataclass(frozen=True)
class StoredRecord:
    """A record with its path and hash."""

    path: Path
    sha256: str
    data: Mapping[str, Any]


def procedure_of(result: Path, remedy: str) -> object:
    """The procedure of a result, a folder or its record. Raises BadInput where it cannot be read."""
    return read_json(result / RECORD if result.is_dir() else result, remedy).get("procedure")


@contextmanager
def stored_record(
    result: Path, procedure: str, remedy: str, unreadable: type[ProcedureError] = BadInput
) -> Iterator[StoredRecord]:
    """The record of a result, a folder or the record itself; within, every error is one of its content. Raises
    BadInput if it is not a record of this procedure; `unreadable` if it cannot be read."""
    path = result / RECORD if result.is_dir() else result
    kind = f"a result of station {procedure}"
    try:
        data = read_file(path, kind.removeprefix("a "))
    except BadInput as error:
        raise unreadable(error.reason, error.remedy) from error
    record = parse_json(data, str(path), remedy)
    with decoding(str(path), kind, remedy):
        if (origin := record.get("procedure", "unknown origin")) != procedure:
            raise BadInput(f"{kind} is required; {path} is of {origin}", remedy)
        yield StoredRecord(path, hashlib.sha256(data).hexdigest(), record)


def table_prefix(plane: str, count: int) -> str:
    """Prefix of the names of a plane's tables, in a result of `count` planes."""
    return "geometry_" if count == 1 else f"geometry_{plane}_"


def plane_entry(planes: Mapping[str, Any], plane: str | None, record: Path) -> tuple[str, Mapping[str, Any]]:
    """Name and entry of this plane; None: green, or the first. Raises BadInput for no plane, BadParameter for not this
    one."""
    if not planes:
        raise BadInput(f"{record} contains no plane", "name the folder that station geometry wrote")
    name = plane or ("G1" if "G1" in planes else next(iter(planes)))
    if name not in planes:
        raise BadParameter(f"{record} has the planes {', '.join(planes)}, not {name!r}", "name one of these")
    return name, planes[name]
