"""The layout of a session's folder: names, frozen configuration, and the lock against other programs."""

import contextlib
import hashlib
import os
import re
import stat
import sys
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, ProcedureError
from station.common.durable_files import Disk, holds, read_own, sha256_of, write_errors
from station.common.sanitise import printable
from station.sessions.journal import Damaged

CONFIG = "session.toml"
JOURNAL = "journal.jsonl"
LOCK = ".lock"
SUMS = "SHA256SUMS"
ORIGINALS = "originals"
DERIVED = "derived"
WIRE = "wire"
FOLDERS = (ORIGINALS, DERIVED, WIRE)
SCHEMA = "station/session/1"
LONGEST = 40


class Busy(ProcedureError):
    """Another program has the session open."""

    exit_code = 75


def safe_name(text: str, otherwise: str) -> str:
    """A part of a file name that is valid on any system, from arbitrary text: a-z, 0-9 and single hyphens."""
    ascii_only = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    name = re.sub(r"[^a-z0-9]+", "-", ascii_only).strip("-")[:LONGEST].strip("-")
    return name or otherwise


def original_name(number: int, source: str) -> str:
    """The name of a photograph in originals/: its number, then the harmless part of the camera's own name."""
    stem, dot, suffix = source.rpartition(".")
    if not dot or not re.fullmatch(r"[A-Za-z0-9]{1,8}", suffix):
        stem, suffix = source, "raw"
    clean = re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-")[:LONGEST]
    return f"{number:04d}-{clean or 'shot'}.{suffix}"


def free_original(folder: Path, number: int, source: str, sha256: str) -> str:
    """The path of a new photograph, relative to the session's folder: unused, or holding this very photograph."""
    usual = Path(ORIGINALS, original_name(number, source))
    others = (usual.with_stem(f"{usual.stem}-{again}") for again in count(2))
    names = chain([usual], others)
    free = (name for name in names if not os.path.lexists(folder / name) or holds(folder / name, sha256))
    return next(free).as_posix()


def is_session(folder: Path) -> bool:
    """Whether this is a session's folder."""
    return (folder / CONFIG).is_file() and (folder / JOURNAL).is_file()


def has_parts(folder: Path) -> bool:
    """Whether this is a session's folder, or the remains of one."""
    return any((folder / name).is_file() for name in (CONFIG, JOURNAL)) and (folder / ORIGINALS).is_dir()


def check_layout(folder: Path) -> None:
    """Check that a session's parts are its own files and folders. Raises BadInput if it is none; Damaged for links and
    gaps."""
    if not is_session(folder):
        raise BadInput(f"{folder} is not a session: it needs {CONFIG} and {JOURNAL}", "name a session's folder")
    for name in (CONFIG, JOURNAL, *FOLDERS):
        try:
            mode = (folder / name).lstat().st_mode
        except OSError:
            mode = 0
        if not (stat.S_ISDIR(mode) if name in FOLDERS else stat.S_ISREG(mode)):
            kind = "a folder" if name in FOLDERS else "a file"
            raise Damaged(f"{folder / name} must be {kind} of the session's own, no link", "bring it back from a copy")


def read_config(folder: Path) -> tuple[Mapping[str, Any], str]:
    """The frozen configuration, and its hash, with which the journal begins. Raises Damaged."""
    try:
        data = read_own(folder / CONFIG)
        config = tomllib.loads(data.decode())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise Damaged(f"{folder / CONFIG} cannot be read: {error}", "bring it back from a copy") from error
    if config.get("schema") != SCHEMA:
        raise Damaged(f"{folder / CONFIG} is not of schema {SCHEMA}", "open it with the version that wrote it")
    return config, hashlib.sha256(data).hexdigest()


def inside(folder: Path, relative: str) -> Path:
    """A file of the session, which must exist and not be a link. Raises Damaged."""
    path = folder / relative
    try:
        regular = stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        regular = False
    if not regular:
        raise Damaged(f"{path} is missing, or is not a file of the session's own", "bring it back from a copy")
    return path


def own(path: Path) -> Path:
    """The path, which must not be a link. Raises Damaged."""
    if path.is_symlink():
        raise Damaged(f"{path} is a link; a session writes into folders of its own only", "remove the link")
    return path


class Lock:
    """Excludes other programs from a session until this one ends. Raises Busy with the holder that the lock names."""

    def __init__(self, folder: Path) -> None:
        path = folder / LOCK
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        with write_errors(path):
            self._descriptor = os.open(path, flags, 0o666)
        try:
            _lock(self._descriptor)
        except OSError as error:
            owner = os.read(self._descriptor, 200).decode("utf-8", "replace").strip()
            os.close(self._descriptor)
            raise Busy(
                f"{folder.name} is open in another program ({printable(owner) or 'which gave no name'})",
                "end that program, or work with another session",
            ) from error
        with contextlib.suppress(OSError):  # the name is informative: a full disk must not prevent opening
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{Path(sys.argv[0]).name or 'python'}, process {os.getpid()}\n".encode())

    def release(self) -> None:
        """Let others in."""
        os.close(self._descriptor)


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        os.lseek(descriptor, 1 << 20, os.SEEK_SET)  # beyond the name, which must stay readable to others
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


GIVEN = "given"
"""The folder of such files within a session; it exists only if there are any."""
FILE = re.compile(rf"{GIVEN}/[1-9][0-9]{{0,5}}/[A-Za-z0-9_][A-Za-z0-9._-]*")
"""Path of such a file, relative to the session's folder."""


def is_given(name: str) -> bool:
    """Whether a name is that of a file kept by the session."""
    return FILE.fullmatch(name) is not None


def copied(folder: Path, files: Sequence[Path], disk: Disk) -> dict[str, str]:
    """Read-only copies of files in a new folder of the session; hashes by path. Raises WriteFailed, ContentChanged."""
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
    with write_errors(root):
        root.mkdir(exist_ok=True)
        taken = [int(path.name) for path in root.iterdir() if path.name.isdecimal()]
        place = root / str(max(taken, default=0) + 1)
        place.mkdir()
    return place
