"""Writing that survives a power failure: every byte is on the disk before a write is confirmed. A small class of
primitives, so that tests can make any of them fail or be the last operation."""

import contextlib
import errno
import hashlib
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from procedures.outcome import BadParameter, ProcedureError

if sys.platform == "darwin":
    import fcntl

BLOCK = 1 << 20
READ_ONLY = 0o444
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)  # absent on Windows, where links need rights that users do not have
_BINARY = getattr(os, "O_BINARY", 0)
_NO_RIGHT = (errno.EACCES, errno.EPERM, errno.EROFS)


class WriteFailed(ProcedureError):
    """The disk refused: it is full, gone, or write-protected. Nothing half-written counts."""

    exit_code = 75

    def __init__(self, path: Path, error: OSError) -> None:
        reason = f"{path} could not be written: {error.strerror or error}"
        mend = "make it writable again" if error.errno in _NO_RIGHT else "make room or repair the disk"
        super().__init__(reason, f"{mend}, then resume the session; everything written before is intact")


class Unwritable(BadParameter):
    """A place that the operator named cannot be written."""

    def __init__(self, path: Path, error: OSError) -> None:
        reason = f"{path} cannot be written: {error.strerror or error}"
        super().__init__(reason, "name a place in a folder that can be written, or make room")
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
            self.exit_code = WriteFailed.exit_code


def check_writable(folder: Path) -> None:
    """Raises Unwritable where a folder, or the nearest existing one above it, cannot take new files."""
    # os.path: a Path raises where a folder above it cannot be entered
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if os.path.exists(path))
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        number = errno.EACCES if existing.is_dir() else errno.ENOTDIR
        raise Unwritable(folder, OSError(number, os.strerror(number)))


class ContentChanged(ProcedureError):
    """A file's content does not match its hash."""

    exit_code = 4


class Disk:
    """Writes, synchronises and renames files. Its five primitives raise OSError, all other methods WriteFailed."""

    def open(self, path: Path, flags: int, mode: int = 0o666) -> int:
        """Open a descriptor; a link at the path is not followed."""
        return os.open(path, flags | _NO_FOLLOW | _BINARY, mode)

    def write(self, descriptor: int, data: bytes) -> int:
        """Write; returns the number of bytes written."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """Wait until the file is on the disk."""
        if sys.platform == "darwin":  # whose fsync leaves data in the drive's cache
            fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
        else:
            os.fsync(descriptor)

    def replace(self, source: Path, target: Path) -> None:
        """Rename, replacing an existing file."""
        os.replace(source, target)

    def place(self, source: Path, target: Path) -> None:
        """Rename without replacing. Raises FileExistsError if the name is taken."""
        if os.name == "nt":
            os.rename(source, target)  # on Windows this does not replace
            return
        try:
            os.link(source, target, follow_symlinks=False)
        except FileExistsError:
            raise
        except OSError:  # a file system without links: an empty file reserves the name
            os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
            os.replace(source, target)
        else:
            source.unlink()

    def write_all(self, descriptor: int, data: bytes) -> None:
        """Write every byte, then synchronise. Raises OSError."""
        self._write(descriptor, data)
        self.sync(descriptor)

    def _write(self, descriptor: int, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self.write(descriptor, bytes(rest)) :]

    def settle(self, path: Path) -> None:
        """Make a file written elsewhere, and its name, durable. Raises OSError."""
        self._sync_at(path)
        self.sync_folder(path.parent)

    def sync_folder(self, folder: Path) -> None:
        """Make a folder's names, behind a link too, durable where folders can be opened. Raises OSError."""
        if os.name != "nt":
            self._sync_at(Path(os.path.realpath(folder)))

    def _sync_at(self, path: Path) -> None:
        descriptor = self.open(path, os.O_RDONLY)
        try:
            self.sync(descriptor)
        finally:
            os.close(descriptor)

    def write_whole(self, path: Path, data: bytes) -> None:
        """Write the file atomically. Raises WriteFailed."""
        beside = path.with_name(f".{path.name}.part")
        with write_errors(path, beside):
            beside.unlink(missing_ok=True)
            descriptor = self.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            try:
                self.write_all(descriptor, data)
            finally:
                os.close(descriptor)
            self.replace(beside, path)
            self.sync_folder(path.parent)

    def copy(self, source: Path, target: Path, sha256: str) -> None:
        """A read-only copy, verified by its hash; nothing is replaced. Raises WriteFailed, ContentChanged."""
        try:
            file = source.open("rb")
        except OSError as error:
            raise ContentChanged(f"{source} is no longer readable: {error.strerror}", "take the shot again") from error
        beside = target.with_name(f".{target.name}.part")
        with file, write_errors(target, beside):
            beside.unlink(missing_ok=True)
            descriptor = self.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            try:
                while block := file.read(BLOCK):
                    self._write(descriptor, block)
                self.sync(descriptor)
            finally:
                os.close(descriptor)
            digest = sha256_of(beside)
            if digest != sha256:
                raise ContentChanged(
                    f"{source} has changed since its exposure: SHA-256 was {sha256}, is {digest}",
                    "let nothing but the camera's software write there, and take the shot again",
                )
            beside.chmod(beside.stat().st_mode & READ_ONLY)
            self.place(beside, target)
            self.sync_folder(target.parent)


def sha256_of(path: Path) -> str:
    """SHA-256 of a regular file, in hex; links are not followed. Raises OSError."""
    with _open_own(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_own(path: Path) -> bytes:
    """Content of a regular file; links are not followed. Raises OSError."""
    with _open_own(path) as file:
        return file.read()


def _open_own(path: Path) -> BufferedReader:
    descriptor = os.open(path, os.O_RDONLY | _NO_FOLLOW | _BINARY | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):  # reading a pipe might never end
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    return os.fdopen(descriptor, "rb")


def files_in(folder: Path) -> list[Path]:
    """All files in and below a folder, links included."""
    return [path for path in sorted(folder.rglob("*")) if path.is_symlink() or not path.is_dir()]


def hashes_in(folder: Path) -> dict[str, str]:
    """SHA-256 of every file in a folder, by relative path. Raises OSError, also for a link."""
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files_in(folder)}


def holds(path: Path, sha256: str) -> bool:
    """Whether this is a file with this hash."""
    try:
        return sha256_of(path) == sha256
    except OSError:
        return False


def holds_all(folder: Path, files: Mapping[str, str]) -> bool:
    """Whether a folder has exactly these files with these hashes."""
    names = {path.relative_to(folder).as_posix() for path in files_in(folder)}
    return names == files.keys() and all(holds(folder / name, digest) for name, digest in files.items())


@contextmanager
def write_errors(path: Path, *halves: Path) -> Iterator[None]:
    """Context that converts OSError to WriteFailed about `path` and removes the partial files. Raises WriteFailed."""
    try:
        yield
    except OSError as error:
        _remove(*halves)
        raise WriteFailed(path, error) from error
    except BaseException:
        _remove(*halves)
        raise


def _remove(*paths: Path) -> None:
    for path in paths:
        with contextlib.suppress(OSError):  # the cause is reported already
            path.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write the data atomically, in place of an older file. Raises BadParameter if it cannot be written; no remnant
    stays."""
    with written(path, lambda beside: beside.write_bytes(data)) as file:
        file.publish()


@dataclass(frozen=True)
class WrittenFile:
    """A file that is complete under a name of its own, its hash, and the name that it shall have."""

    beside: Path
    path: Path
    sha256: str

    def publish(self) -> None:
        """Give it its name. Raises BadParameter."""
        try:
            os.replace(self.beside, self.path)
            Disk().sync_folder(self.path.parent)
        except OSError as error:
            raise Unwritable(self.path, error) from error


@contextmanager
def written(path: Path, write: Callable[[Path], object]) -> Iterator[WrittenFile]:
    """The file that `write` makes beside this path, until published. Raises BadParameter if it cannot be written."""
    # in the same folder: a rename across file systems would be a copy
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            write(beside)
            Disk().settle(beside)
            with beside.open("rb") as file:
                sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise Unwritable(path, error) from error
        yield WrittenFile(beside, path, sha256)
    finally:
        _remove(beside)


# A folder is in use while its descriptor is locked; the system releases the lock of a program that ends.

PREFIX = "station-"
RANDOM_BYTES = 8
"""Hexadecimal part after the prefix: a user's folder called `station-demo` does not match."""


def hold(folder: Path) -> int | None:
    """Lock a folder against `sweep`; its descriptor, or None without such locks. Raises BlockingIOError if locked."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = os.open(folder, os.O_RDONLY | _NO_FOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # some network file systems cannot lock folders
        os.close(descriptor)
        return None
    return descriptor


def release(descriptor: int | None) -> None:
    """Release the lock of `hold`."""
    if descriptor is not None:
        os.close(descriptor)


def make(prefix: str, within: Path, mode: int = 0o700) -> tuple[Path, int | None]:
    """Create a folder and `hold` it. Raises OSError."""
    for _ in range(100):
        folder = within / f"{prefix}{secrets.token_hex(RANDOM_BYTES)}"
        folder.mkdir(mode)
        with contextlib.suppress(BlockingIOError, FileNotFoundError):  # a sweep intervened
            descriptor = hold(folder)
            if folder.exists():
                return folder, descriptor
            release(descriptor)
    raise OSError(f"{within} keeps no new folder")


def sweep(within: Path, prefix: str) -> None:
    """Remove this user's folders made by `make` that are not locked; failures are ignored."""
    for folder in within.glob(prefix + 2 * RANDOM_BYTES * "[0-9a-f]"):
        with contextlib.suppress(OSError):
            status = folder.lstat()
            if folder.is_symlink() or not folder.is_dir() or status.st_uid != os.getuid():
                continue
            descriptor = hold(folder)
            if descriptor is not None:
                shutil.rmtree(folder, ignore_errors=True)
                release(descriptor)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A temporary folder, removed at the end; those of killed runs are removed, too."""
    among = Path(tempfile.gettempdir())
    sweep(among, PREFIX)
    folder, descriptor = make(PREFIX, among)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        release(descriptor)
