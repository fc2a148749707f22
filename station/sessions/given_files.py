"""Files referred to by answers, such as a measured PSF: a session keeps copies, so that it is self-contained."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from station.common.durable_files import Disk, sha256_of, write_errors
from station.sessions.layout import own

GIVEN = "given"
"""The folder of such files within a session; it exists only if there are any."""
FILE = re.compile(rf"{GIVEN}/[1-9][0-9]{{0,5}}/[A-Za-z0-9_][A-Za-z0-9._-]*")
"""Path of such a file, relative to the session's folder."""


def is_given(name: str) -> bool:
    """Whether a name is that of a file kept by the session."""
    return FILE.fullmatch(name) is not None


def copied(folder: Path, files: Sequence[Path], disk: Disk) -> dict[str, str]:
    """Make read-only copies of related files in a new folder of the session; returns hashes by path.

    Raises NotKept, Changed if the disk refuses, or they cannot be read.
    """
    place = _free(own(folder / GIVEN))
    hashes = {}
    for source in (file.resolve() for file in files):
        target = place / (re.sub(r"[^A-Za-z0-9._-]+", "-", source.name).lstrip(".-") or "file")
        with write_errors(source):
            digest = sha256_of(source)
        disk.copy(source, target, digest)
        hashes[target.relative_to(folder).as_posix()] = digest
    disk.sync_folder(place.parent)
    return hashes


def _free(root: Path) -> Path:
    """A new numbered folder in this one."""
    with write_errors(root):
        root.mkdir(exist_ok=True)
        taken = [int(path.name) for path in root.iterdir() if path.name.isdecimal()]
        place = root / str(max(taken, default=0) + 1)
        place.mkdir()
    return place
