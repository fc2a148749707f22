"""Atomic writing: a file is written next to its target, synchronised, then renamed."""

from __future__ import annotations

import os
from pathlib import Path

from procedures.outcome import BadParameter
from station.common.durable_files import Disk


def write_whole(path: Path, data: bytes) -> None:
    """Write the data atomically; an older file of that name stays unchanged until all is written.

    Raises
    ------
    BadParameter
        If the file cannot be written there; no remnant stays.
    """
    # in the same folder: a rename across file systems would be a copy
    disk, beside = Disk(), path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_bytes(data)
        disk.settle(beside)
        os.replace(beside, path)
        disk.sync_folder(path.parent)
    except OSError as error:
        raise BadParameter(
            f"{path} cannot be written: {error.strerror}", "name a file in a folder that exists and can be written"
        ) from error
    finally:
        _remove(beside)


def _remove(path: Path) -> None:
    # a path that is no folder, or cannot be entered, fails here as well, but was reported already
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
