"""Writing that survives a power cut: every byte is on the disk before anyone is told that it is kept.

One small class of primitives, so that tests can let any of them fail or be the last thing that happens.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

from procedures.outcome import ProcedureError

if sys.platform == "darwin":
    import fcntl

BLOCK = 1 << 20
READ_ONLY = 0o444
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)  # Windows has neither; its links need rights that users do not have
_BINARY = getattr(os, "O_BINARY", 0)


class NotKept(ProcedureError):
    """The disk did not take it: it is full, gone, or must not be written. Nothing half-written counts."""

    exit_code = 75


class Changed(ProcedureError):
    """A file's content is not what its hash says."""

    exit_code = 4


class Disk:
    """Files written, synchronised and renamed. Its five primitives raise OSError, everything else NotKept."""

    def open(self, path: Path, flags: int, mode: int = 0o666) -> int:
        """A descriptor; never through a link that lies where the file should be."""
        return os.open(path, flags | _NO_FOLLOW | _BINARY, mode)

    def write(self, descriptor: int, data: bytes) -> int:
        """How many bytes it took."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """Wait until the file is on the disk."""
        if sys.platform == "darwin":  # whose fsync leaves it in the drive's own memory
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
        else:
            os.fsync(descriptor)

    def replace(self, source: Path, target: Path) -> None:
        """Rename, over a file that may be there."""
        os.replace(source, target)

    def place(self, source: Path, target: Path) -> None:
        """Rename to a name that nothing has. Raises FileExistsError where something has it."""
        if os.name == "nt":
            os.rename(source, target)  # which there replaces nothing
            return
        try:
            os.link(source, target, follow_symlinks=False)
        except FileExistsError:
            raise
        except OSError:  # a file system without links: an empty file takes the name first
            os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
            os.replace(source, target)
        else:
            source.unlink()

    # --- built of them -------------------------------------------------------------------------------------------

    def write_all(self, descriptor: int, data: bytes) -> None:
        """Write every byte, then synchronise. Raises OSError."""
        self._write(descriptor, data)
        self.sync(descriptor)

    def _write(self, descriptor: int, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self.write(descriptor, bytes(rest)) :]

    def settle(self, path: Path) -> None:
        """Make a file and its name last that somebody else wrote. Raises OSError."""
        descriptor = self.open(path, os.O_RDONLY)
        try:
            self.sync(descriptor)
        finally:
            os.close(descriptor)
        self.sync_folder(path.parent)

    def sync_folder(self, folder: Path) -> None:
        """Make the names in it last; where folders cannot be opened, the system does it by itself. Raises OSError.

        A link to a folder is followed: the names are where it leads.
        """
        if os.name == "nt":
            return
        descriptor = self.open(Path(os.path.realpath(folder)), os.O_RDONLY)
        try:
            self.sync(descriptor)
        finally:
            os.close(descriptor)

    def write_whole(self, path: Path, data: bytes) -> None:
        """The file with this content, or the older one. Raises NotKept."""
        beside = path.with_name(f".{path.name}.part")
        with kept(path, beside):
            self._fill(beside, data)
            self.replace(beside, path)
            self.sync_folder(path.parent)

    def _fill(self, path: Path, data: bytes) -> None:
        path.unlink(missing_ok=True)
        descriptor = self.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
        try:
            self.write_all(descriptor, data)
        finally:
            os.close(descriptor)

    def copy(self, source: Path, target: Path, sha256: str) -> None:
        """A read-only copy whose bytes, read back, have this hash; it replaces nothing. Raises NotKept, Changed."""
        try:
            file = source.open("rb")
        except OSError as error:
            raise Changed(f"{source} cannot be read any more: {error.strerror}", "take the shot again") from error
        beside = target.with_name(f".{target.name}.part")
        with file, kept(target, beside):
            beside.unlink(missing_ok=True)
            self._pour(file, beside)
            found = sha256_of(beside)
            if found != sha256:
                raise Changed(
                    f"{source} is not any more what was exposed: SHA-256 {sha256} was noted, {found} came",
                    "let nothing but the camera's software write there, and take the shot again",
                )
            beside.chmod(beside.stat().st_mode & READ_ONLY)
            self.place(beside, target)
            self.sync_folder(target.parent)

    def _pour(self, file: BinaryIO, target: Path) -> None:
        descriptor = self.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
        try:
            while block := file.read(BLOCK):
                self._write(descriptor, block)
            self.sync(descriptor)
        finally:
            os.close(descriptor)


def sha256_of(path: Path) -> str:
    """The hash of a regular file, in hex; a link in its place is not followed. Raises OSError."""
    with _open_own(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_own(path: Path) -> bytes:
    """The content of a regular file; a link in its place is not followed. Raises OSError."""
    with _open_own(path) as file:
        return file.read()


def _open_own(path: Path) -> BufferedReader:
    descriptor = os.open(path, os.O_RDONLY | _NO_FOLLOW | _BINARY | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):  # a pipe would be waited for without end
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    return os.fdopen(descriptor, "rb")


def files_in(folder: Path) -> list[Path]:
    """All that lies in a folder and below, except folders; links are among it."""
    return [path for path in sorted(folder.rglob("*")) if path.is_symlink() or not path.is_dir()]


def hashes_in(folder: Path) -> dict[str, str]:
    """The hash of every file in a folder, by its path from there. Raises OSError, where one is a link too."""
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files_in(folder)}


def holds(path: Path, sha256: str) -> bool:
    """Whether it is a file with this hash."""
    try:
        return sha256_of(path) == sha256
    except OSError:
        return False


def holds_all(folder: Path, files: Mapping[str, str]) -> bool:
    """Whether a folder has these files with these hashes, and no others."""
    names = {path.relative_to(folder).as_posix() for path in files_in(folder)}
    return names == files.keys() and all(holds(folder / name, digest) for name, digest in files.items())


@contextmanager
def kept(path: Path, *halves: Path) -> Iterator[None]:
    """Within, an OSError becomes NotKept about `path`, and the halves are removed. Raises NotKept."""
    try:
        yield
    except OSError as error:
        _remove(*halves)
        raise not_kept(path, error) from error
    except BaseException:
        _remove(*halves)
        raise


def _remove(*paths: Path) -> None:
    for path in paths:
        with contextlib.suppress(OSError):  # the reason why it was not written is told already
            path.unlink(missing_ok=True)


def not_kept(path: Path, error: OSError) -> NotKept:
    """The error for people."""
    return NotKept(
        f"{path} could not be kept: {error.strerror or error}",
        "make room or mend the disk, then resume the session; what was kept before is whole",
    )
