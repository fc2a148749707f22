"""The head of a journal in a second place: how many lines, and the sum of the last, told before the line is there.

```
0000000041 9f2c...  5be0a1c4
0000000042 ab12...  77d1f0e9
```

A file system that gives back an older length of the journal leaves one that looks whole where the cut is at the end of
a line; its head tells how many lines there were. The file never changes its length: two entries are written in turn,
each with a check of its own, so that one that was half written leaves the other. Where the power went between the head
and the line, the head tells of one line more than there is; nobody was told that this line is kept.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from station.common.durable_files import Disk, read_own, write_failed

HEAD = "journal.head"
WIDTH = 85
BLANK = (b" " * (WIDTH - 1) + b"\n") * 2


@dataclass(frozen=True)
class Head:
    """How many lines a journal has, and the sum of the last."""

    count: int
    last_sum: str

    def entry(self) -> bytes:
        """As it stands in the file: `WIDTH` bytes."""
        words = f"{self.count:010d} {self.last_sum}"
        return f"{words} {_check(words)}\n".encode()


def _check(words: str) -> str:
    return hashlib.sha256(words.encode()).hexdigest()[:8]


@dataclass(frozen=True)
class Gap:
    """What a journal lacks by its head: how many of the last lines, and in words what is odd, "" where nothing is."""

    lines: int = 0
    words: str = ""


def gap(path: Path, sums: Sequence[str], *, expected: bool) -> Gap:
    """How a journal whose lines have these sums compares with its head.

    Parameters
    ----------
    expected : whether there must be a head; journals of earlier versions have none
    """
    try:
        data = read_own(path)
    except FileNotFoundError:
        return Gap(0, f"{path.name} is missing: nothing tells whether the journal is whole") if expected else Gap()
    except OSError as error:
        return Gap(0, f"{path.name} cannot be read ({error.strerror}): nothing tells whether the journal is whole")
    entries = _entries(data)
    heads = [head for head in map(_read, entries) if head is not None]
    ahead = max((head.count for head in heads), default=0) - len(sums)
    if ahead > 0:
        return Gap(ahead, _lost(path, len(sums), ahead))
    if not heads or len(heads) < sum(bool(entry.strip()) for entry in entries):
        return Gap(0, f"{path.name} is not what was written: it does not tell whether the journal is whole")
    if ahead < 0 or any(head.last_sum != sums[head.count - 1] for head in heads):
        return Gap(0, f"{path.name} is another journal's, or an older one: it does not tell whether this one is whole")
    return Gap()


def _lost(path: Path, count: int, ahead: int) -> str:
    last = f"line {count + 1} is" if ahead == 1 else f"lines {count + 1} to {count + ahead} are"
    power = "; it was lost, or being written when the program ended" if ahead == 1 else ": they were lost"
    return f"the journal has {count} lines, {path.name} tells of {count + ahead}: {last} not there{power}"


def _entries(data: bytes) -> list[bytes]:
    """The two entries; of a file of another length, that whole as one, which is none."""
    return [data[:WIDTH], data[WIDTH:]] if len(data) == 2 * WIDTH else [data or b"?"]


def _read(entry: bytes) -> Head | None:
    words, _, check = entry.decode("ascii", "replace").removesuffix("\n").rpartition(" ")
    count, _, last_sum = words.partition(" ")
    whole = _check(words) == check and count.isdecimal() and int(count) > 0
    head = Head(int(count), last_sum) if whole else None
    return head if head is not None and head.entry() == entry else None


class HeadFile:
    """The head of a journal that is open; made where there is none. Raises NotKept."""

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
        """A line is about to be appended. Raises OSError."""
        os.lseek(self._descriptor, _place(head), os.SEEK_SET)
        self._announced = head, os.read(self._descriptor, WIDTH)
        self._put(head, head.entry())

    def retract(self, head: Head) -> None:
        """The line that was announced could not be appended. Raises OSError."""
        if self._announced is not None and self._announced[0] == head:
            self._put(*self._announced)

    def _put(self, head: Head, entry: bytes) -> None:
        os.lseek(self._descriptor, _place(head), os.SEEK_SET)
        self._disk.write_all(self._descriptor, entry)

    def close(self) -> None:
        """Give the file back."""
        os.close(self._descriptor)


def _place(head: Head) -> int:
    return head.count % 2 * WIDTH
