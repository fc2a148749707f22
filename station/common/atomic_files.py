"""Files that are either whole or not there: written beside their place, on the disk, then renamed into it."""

from __future__ import annotations

import os
from pathlib import Path

from procedures.outcome import BadParameter
from station.common.durable_files import Disk


def write_whole(path: Path, data: bytes) -> None:
    """Put the data into the file; an older file of that name stays as it is until all is written.

    Raises
    ------
    BadParameter
        If the file cannot be written there; nothing is left behind.
    """
    # in the same folder, because a rename across file systems is a copy
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
    # a folder that is no folder, or cannot be entered, fails here as well: it was reported already
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
