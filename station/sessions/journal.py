"""An append-only journal of JSON lines, each with its number and a hash over all before it.

```
{"seq":3,"at":"2026-03-14T09:26:53.589+00:00","clock_s":12.5,"event":"judged","shot":1,"counts":true,"sum":"9f2c..."}
```

`sum` is the SHA-256 of the previous sum and of the line up to it; for the first line, the previous sum is the hash of
the session's frozen configuration. A line that was altered, removed or inserted is thus detected, and so is another
configuration. An incomplete last line was being written during a power failure: it had not been confirmed.
A chain cannot detect that the last lines are missing; `journal.head` does.
"""

import contextlib
import hashlib
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from procedures.numerics.loops import COMPILER
from procedures.outcome import ProcedureError
from station.common.durable_files import Disk, WriteFailed, read_own
from station.common.versions import software

# ```
# 0000000041 9f2c...  5be0a1c4
# 0000000042 ab12...  77d1f0e9
# ```
#
# A file system that restores an older length of the journal may leave one that looks complete, cut at the end of
# a line; the head gives the number of lines. The file has a constant length: two entries are written alternately,
# each with its own check, so that a half-written one leaves the other valid. After a power failure between head
# and line, the head counts one line too many; that line had not been confirmed.

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
    heads = [head for head in map(_read_head, entries) if head is not None]
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


def _read_head(entry: bytes) -> Head | None:
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
            raise WriteFailed(path, error) from error

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
    import scipy.linalg  # noqa: F401  (only loaded libraries are listed)
    from threadpoolctl import threadpool_info

    libraries = {
        f"{info['internal_api']} {info['version']} {info.get('architecture', '')}".strip()
        for info in threadpool_info()
        if info["user_api"] == "blas" and "opencv" not in info["filepath"]
    }
    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "blas": ", ".join(sorted(libraries)),
        "loops": COMPILER,
    }


@contextmanager
def same_bits() -> Iterator[None]:
    """Context in which linear algebra has one thread, whatever the environment sets."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


BEGIN, SUM, END = b'{"seq":', b',"sum":"', b'"}\n'
"""How each line begins and ends; within a JSON string the quotes would be escaped."""


class Damaged(ProcedureError):
    """A session differs from what was written: the difference, and the remedy."""

    exit_code = 4


@dataclass(frozen=True)
class JournalLine:
    """One entry: number from 1, time (UTC, and by the bench's clock), event, data; its sum."""

    seq: int
    at: str
    clock_s: float
    event: str
    data: Mapping[str, Any]
    sum: str = ""


@dataclass(frozen=True)
class Contents:
    """Contents of a journal: lines, last sum, length of the complete lines, and the incomplete rest after them."""

    lines: tuple[JournalLine, ...]
    last_sum: str
    length: int
    torn: bytes = b""


def read_journal(path: Path, first_sum: str) -> Contents:
    """Every complete line, verified. Raises Damaged if a line before the last is wrong."""
    try:
        data = read_own(path)
    except OSError as error:
        raise Damaged(
            f"{path} cannot be read: {error.strerror}", "bring the session's folder back from a copy"
        ) from error
    return parse(data, first_sum, str(path))


def parse(data: bytes, first_sum: str, name: str) -> Contents:
    """The lines in a journal's bytes. Raises Damaged."""
    lines: list[JournalLine] = []
    last, start = first_sum, 0
    while start < len(data):
        end = data.find(b"\n", start) + 1
        text = data[start : end or len(data)]
        line = _read(text) if end else None
        if line is None:
            if start + len(text) < len(data) or text.count(BEGIN) > 1:
                raise _altered(name, len(lines) + 1, "is not a line of a journal")
            return Contents(tuple(lines), last, start, text)
        body, _, recorded = text.rpartition(SUM)
        computed = _sum(last, body)
        if recorded != computed.encode() + END or line.seq != len(lines) + 1:
            raise _altered(name, len(lines) + 1, "is not what was written after the line before it")
        lines.append(line)
        last, start = computed, end
    return Contents(tuple(lines), last, start)


def _altered(name: str, number: int, what: str) -> Damaged:
    return Damaged(
        f"{name}: line {number} {what}",
        "bring the journal back from a copy; `station psf` still accepts the photographs in originals/",
    )


def _read(text: bytes) -> JournalLine | None:
    try:
        entry = json.loads(text)
        seq, at, clock_s, event = (entry.pop(name) for name in ("seq", "at", "clock_s", "event"))
        total, data = str(entry.pop("sum")), _restored(entry)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
        return None
    known = isinstance(seq, int) and isinstance(at, str) and isinstance(clock_s, int | float)
    if not (known and isinstance(event, str)):
        return None
    return JournalLine(seq, at, float(clock_s), event, data, total)


def _sum(before: str, body: bytes) -> str:
    return hashlib.sha256(before.encode() + body).hexdigest()


class Journal:
    """The journal of an open session: an appended line is on the disk when `append` returns."""

    def __init__(self, path: Path, contents: Contents, disk: Disk) -> None:
        self.path = path
        self._disk = disk
        self._lines, self._last_sum, self._length = list(contents.lines), contents.last_sum, contents.length
        try:
            self._descriptor = disk.open(path, os.O_RDWR | os.O_APPEND)
        except OSError as error:
            raise WriteFailed(path, error) from error
        try:
            self._head = HeadFile(path.with_name(HEAD), disk)
        except BaseException:
            os.close(self._descriptor)
            raise

    @property
    def lines(self) -> Sequence[JournalLine]:
        return self._lines

    def append(self, event: str, at: str, clock_s: float, data: Mapping[str, Any]) -> JournalLine:
        """Append a line, first removing the rest of a failed attempt. On WriteFailed the line is absent."""
        begin = {"seq": len(self._lines) + 1, "at": at, "clock_s": clock_s, "event": event}
        body = json.dumps({**begin, **_jsonable(data)}, separators=(",", ":"), allow_nan=False).encode()[:-1]
        total = _sum(self._last_sum, body)
        text, head = body + SUM + total.encode() + END, Head(len(self._lines) + 1, total)
        try:
            self._cut()
            self._head.announce(head)
            self._disk.write_all(self._descriptor, text)
        except OSError as error:
            with contextlib.suppress(OSError):  # the next append, or opening the journal, cuts again
                self._cut()
                self._head.retract(head)
            raise WriteFailed(self.path, error) from error
        line = _read(text)
        assert line is not None
        self._lines.append(line)
        self._last_sum, self._length = total, self._length + len(text)
        return line

    def _cut(self) -> None:
        if os.fstat(self._descriptor).st_size != self._length:
            os.ftruncate(self._descriptor, self._length)
            self._disk.sync(self._descriptor)

    def close(self) -> None:
        os.close(self._descriptor)
        self._head.close()


def _jsonable(value: Any) -> Any:
    """A JSON form: non-finite numbers as `{"not_finite": "nan"}`, paths as text."""
    if isinstance(value, Mapping):
        return {str(name): _jsonable(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(part) for part in value]
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):  # a number of numpy's
        return _jsonable(value.item())
    number = float(value)
    return number if math.isfinite(number) else {"not_finite": repr(number)}


def _restored(value: Any) -> Any:
    if isinstance(value, dict):
        if list(value) == ["not_finite"]:
            return float(value["not_finite"])
        return {name: _restored(part) for name, part in value.items()}
    return [_restored(part) for part in value] if isinstance(value, list) else value
