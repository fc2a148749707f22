"""Files that an answer names, such as a measured PSF: a session keeps copies, so that it is complete in itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from station.common.durable_files import Disk, sha256_of, write_errors
from station.sessions.layout import own

GIVEN = "given"
"""The folder of such files in a session's; there is one only where something was given."""
FILE = re.compile(rf"{GIVEN}/[1-9][0-9]{{0,5}}/[A-Za-z0-9_][A-Za-z0-9._-]*")
"""Path of such a file from the session's folder."""


def is_given(name: str) -> bool:
    """Whether a name is that of a file that the session keeps."""
    return FILE.fullmatch(name) is not None


def copied(folder: Path, files: Sequence[Path], disk: Disk) -> dict[str, str]:
    """Read-only copies of files that belong together, in a folder of their own in the session's: hash by path.

    Raises
    ------
    NotKept, Changed
        If the disk does not take them, or they cannot be read.
    """
    place = _free(own(folder / GIVEN))
    found = {}
    for source in (one.resolve() for one in files):
        target = place / (re.sub(r"[^A-Za-z0-9._-]+", "-", source.name).lstrip(".-") or "file")
        with write_errors(source):
            digest = sha256_of(source)
        disk.copy(source, target, digest)
        found[target.relative_to(folder).as_posix()] = digest
    disk.sync_folder(place.parent)
    return found


def _free(root: Path) -> Path:
    """A new folder in this one, numbered."""
    with write_errors(root):
        root.mkdir(exist_ok=True)
        taken = [int(one.name) for one in root.iterdir() if one.name.isdecimal()]
        place = root / str(max(taken, default=0) + 1)
        place.mkdir()
    return place
