"""The head of a journal in a second file: number of lines and sum of the last, written before the line itself.

```
0000000041 9f2c...  5be0a1c4
0000000042 ab12...  77d1f0e9
```

A file system that restores an older length of the journal may leave one that looks complete, cut at the end of
a line; the head gives the number of lines. The file has a constant length: two entries are written alternately,
each with its own check, so that a half-written one leaves the other valid. After a power failure between head
and line, the head counts one line too many; that line had not been confirmed.
"""

import hashlib
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from procedures.numerics.loops import COMPILER
from station.common.durable_files import Disk, read_own, write_failed
from station.common.versions import software

HEAD = "journal.head"
WIDTH = 85
BLANK = (b" " * (WIDTH - 1) + b"\n") * 2


@dataclass(frozen=True)
class Head:
    """Number of lines of a journal, and sum of the last."""

    count: int
    last_sum: str

    def entry(self) -> bytes:
        """The entry in the file: `WIDTH` bytes."""
        words = f"{self.count:010d} {self.last_sum}"
        return f"{words} {_check(words)}\n".encode()


def _check(words: str) -> str:
    return hashlib.sha256(words.encode()).hexdigest()[:8]


@dataclass(frozen=True)
class Gap:
    """Lines missing from a journal according to its head: how many, and a description, "" if consistent."""

    lines: int = 0
    words: str = ""


def gap(path: Path, sums: Sequence[str], *, expected: bool) -> Gap:
    """Compare a journal whose lines have these sums with its head; expected : whether there must be one, as in all
    recent versions."""
    try:
        data = read_own(path)
    except FileNotFoundError:
        return Gap(0, f"{path.name} is missing: whether the journal is whole is unknown") if expected else Gap()
    except OSError as error:
        return Gap(0, f"{path.name} cannot be read ({error.strerror}): whether the journal is whole is unknown")
    entries = [data[:WIDTH], data[WIDTH:]] if len(data) == 2 * WIDTH else [data or b"?"]
    heads = [head for head in map(_read, entries) if head is not None]
    ahead = max((head.count for head in heads), default=0) - len(sums)
    if ahead > 0:
        return Gap(ahead, _lost(path, len(sums), ahead))
    if not heads or len(heads) < sum(bool(entry.strip()) for entry in entries):
        return Gap(0, f"{path.name} is not what was written: whether the journal is whole is unknown")
    if ahead < 0 or any(head.last_sum != sums[head.count - 1] for head in heads):
        return Gap(0, f"{path.name} is another journal's, or an older one: whether this one is whole is unknown")
    return Gap()


def _lost(path: Path, count: int, ahead: int) -> str:
    last = f"line {count + 1} is" if ahead == 1 else f"lines {count + 1} to {count + ahead} are"
    power = "; it was lost, or being written when the program ended" if ahead == 1 else ": they were lost"
    return f"the journal has {count} lines, but {path.name} counts {count + ahead}: {last} missing{power}"


def _read(entry: bytes) -> Head | None:
    words, _, check = entry.decode("ascii", "replace").removesuffix("\n").rpartition(" ")
    count, _, last_sum = words.partition(" ")
    whole = _check(words) == check and count.isdecimal() and int(count) > 0
    head = Head(int(count), last_sum) if whole else None
    return head if head is not None and head.entry() == entry else None


class HeadFile:
    """The head of an open journal; created if absent. Raises WriteFailed."""

    def __init__(self, path: Path, disk: Disk) -> None:
        self._disk = disk
        self._announced: tuple[Head, bytes] | None = None
        try:
            if not path.exists() or path.stat().st_size != len(BLANK):
                disk.write_whole(path, BLANK)
            self._descriptor = disk.open(path, os.O_RDWR)
        except OSError as error:
            raise write_failed(path, error) from error

    def announce(self, head: Head) -> None:
        """Record that a line is about to be appended. Raises OSError."""
        os.lseek(self._descriptor, _place(head), os.SEEK_SET)
        self._announced = head, os.read(self._descriptor, WIDTH)
        self._put(head, head.entry())

    def retract(self, head: Head) -> None:
        """Withdraw the announcement of a line that could not be appended. Raises OSError."""
        if self._announced is not None and self._announced[0] == head:
            self._put(*self._announced)

    def _put(self, head: Head, entry: bytes) -> None:
        os.lseek(self._descriptor, _place(head), os.SEEK_SET)
        self._disk.write_all(self._descriptor, entry)

    def close(self) -> None:
        os.close(self._descriptor)


def _place(head: Head) -> int:
    return head.count % 2 * WIDTH


# The computing environment of a result: versions, processor, and BLAS libraries, all of which affect the last bits.
# The order of summation in a matrix product depends on the number of threads and the processor family. With one
# thread it depends on the processor's kernels only; these are recorded, so that two results can be compared.

KERNELS = "OPENBLAS_CORETYPE"
"""Environment variable that makes OpenBLAS compute like another processor family."""


@cache
def machine() -> Mapping[str, Any]:
    """Everything that may change the last bits of a result; constant during a run of the program."""
    import numpy as np

    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "blas": _libraries(),
        "loops": COMPILER,
    }


def _libraries() -> str:
    """The BLAS of numpy and scipy: "openblas 0.3.30 SkylakeX". OpenCV's own is ignored, as it only draws pictures."""
    import scipy.linalg  # noqa: F401  (only loaded libraries are listed)
    from threadpoolctl import threadpool_info

    libraries = {
        f"{info['internal_api']} {info['version']} {info.get('architecture', '')}".strip()
        for info in threadpool_info()
        if info["user_api"] == "blas" and "opencv" not in info["filepath"]
    }
    return ", ".join(sorted(libraries))


@contextmanager
def same_bits() -> Iterator[None]:
    """Context in which linear algebra has one thread, whatever the environment sets."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
