"""Where one message ends and the next begins: lines, and frames that are known by their first bytes and checksum."""

from __future__ import annotations

from collections.abc import Callable

BAD = -1
MORE = 0


class LineSplitter:
    """Lines ended by CR, LF or both, without them; empty lines are dropped, overlong ones cut."""

    def __init__(self, longest: int = 512) -> None:
        self._longest = longest
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The lines completed by these bytes."""
        *lines, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = rest[-self._longest :]  # noise without an end must not fill the memory
        return [line[-self._longest :] for line in lines if line]


class FrameSplitter:
    """Frames that `measure` recognises at their first byte.

    `measure(bytes)` answers the length of the good frame at the start, MORE if it may become one, BAD if it is none;
    on BAD one byte is skipped, so that a frame hidden behind a false start is never lost.
    """

    def __init__(self, starts: bytes, measure: Callable[[bytes], int], longest: int = 64) -> None:
        self._starts = starts
        self._measure = measure
        self._longest = longest
        self._rest = b""
        self.skipped = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The frames completed by these bytes; what is skipped is counted."""
        buffer, at, frames = self._rest + data, 0, []
        while at < len(buffer):
            if buffer[at] not in self._starts:
                at, self.skipped = at + 1, self.skipped + 1
                continue
            length = self._measure(buffer[at : at + self._longest])
            if length == MORE:
                break
            if length == BAD:
                at, self.skipped = at + 1, self.skipped + 1
                continue
            frames.append(buffer[at : at + length])
            at += length
        self._rest = buffer[at:]
        return frames
