"""An append-only journal of JSON lines, each with its number and a hash over all before it.

```
{"seq":3,"at":"2026-03-14T09:26:53.589+00:00","clock_s":12.5,"event":"judged","shot":1,"counts":true,"sum":"9f2c..."}
```

`sum` is the SHA-256 of the previous sum and of the line up to it; for the first line, the previous sum is the hash of
the session's frozen configuration. A line that was altered, removed or inserted is thus detected, and so is another
configuration. An incomplete last line was being written during a power failure: it had not been confirmed.
A chain cannot detect that the last lines are missing; `journal.head` does (see `station.sessions.journal_head`).
"""

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procedures.outcome import ProcedureError
from station.common.durable_files import Disk, read_own, write_failed
from station.sessions.journal_head import HEAD, Head, HeadFile

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
    """The line, None if it is not complete."""
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
            raise write_failed(path, error) from error
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
            raise write_failed(self.path, error) from error
        line = _read(text)
        assert line is not None
        self._lines.append(line)
        self._last_sum, self._length = total, self._length + len(text)
        return line

    def _cut(self) -> None:
        """Remove what follows the last complete line."""
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
