"""Message boundaries: lines, and frames recognised by their first bytes and checksum."""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Generic, TypeVar

E = TypeVar("E")
BAD = -1
MORE = 0


@dataclass(frozen=True)
class UnrecognisedLine:
    """A line that is no known message, or whose checksum is wrong."""

    raw: bytes


class LineSplitter:
    """Splits at CR, LF or both; empty lines are dropped, overlong ones cut."""

    def __init__(self, longest: int = 512) -> None:
        self._longest = longest
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        *lines, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = rest[-self._longest :]  # noise without a line end must not fill the memory
        return [line[-self._longest :] for line in lines if line]


class FrameSplitter:
    """Frames that `measure` recognises at their first byte.

    `measure(bytes)` returns the length of the valid frame at the start, MORE if it may become one, BAD if not;
    on BAD one byte is skipped, so that a frame after a false start is not lost.
    """

    def __init__(self, starts: bytes, measure: Callable[[bytes], int], longest: int = 64) -> None:
        self._starts, self._measure, self._longest = starts, measure, longest
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The frames completed by these bytes."""
        buffer, at, frames = self._rest + data, 0, []
        while at < len(buffer):
            length = self._measure(buffer[at : at + self._longest]) if buffer[at] in self._starts else BAD
            if length == MORE:
                break
            if length != BAD:
                frames.append(buffer[at : at + length])
            at += 1 if length == BAD else length
        self._rest = buffer[at:]
        return frames


class Decoder(Generic[E]):
    """Bytes to events: the lines or frames of a new splitter, decoded; those decoded to None are dropped."""

    def __init__(
        self, splitter: Callable[[], LineSplitter | FrameSplitter], decode: Callable[[bytes], E | None]
    ) -> None:
        self._splitter, self._decode = splitter(), decode

    def feed(self, data: bytes) -> list[E]:
        return [event for piece in self._splitter.feed(data) if (event := self._decode(piece)) is not None]


def text_of(line: bytes) -> str:
    """A line of ASCII without blanks at its ends."""
    return line.decode("ascii", "replace").strip()


# --- Codes that devices send, with reason and remedy: the tables of `codes.csv` ---


@cache
def _rows() -> list[list[str]]:
    return list(csv.reader(files(__package__).joinpath("codes.csv").read_text("utf-8").splitlines()))


def codes(table: str) -> dict[str, tuple[str, str]]:
    """Reason and remedy by code."""
    return {code: (reason, remedy) for name, code, reason, remedy in _rows() if name == table}


def numbered(table: str) -> dict[int, tuple[str, str]]:
    """Reason and remedy by number."""
    return {int(code): words for code, words in codes(table).items()}
