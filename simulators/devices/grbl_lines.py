"""Realtime bytes, and line assembly as in GRBL's main loop: capitals, without spaces and comments."""

from __future__ import annotations

RESET, CANCEL, DOOR = 0x18, 0x85, 0x84
OVERRIDES = {
    0x90: (0, 0), 0x91: (0, 10), 0x92: (0, -10), 0x93: (0, 1), 0x94: (0, -1), 0x95: (1, 100), 0x96: (1, 50),
    0x97: (1, 25), 0x99: (2, 0), 0x9A: (2, 10), 0x9B: (2, -10), 0x9C: (2, 1), 0x9D: (2, -1),
}  # fmt: skip
"""Realtime bytes of the overrides: the change in percent, 0 for back to 100 %; rapids are absolute."""


class Overflow:
    """A line longer than the line buffer."""


class LineReader:
    """Assembles one line at a time; `limit` is the size of the line buffer, `drops` the characters it skips."""

    def __init__(self, limit: int = 79, drops: str = "/") -> None:
        self.limit = limit
        self.drops = drops
        self._begin()

    def _begin(self) -> None:
        self._text, self._until, self._long = "", "", False

    def clear(self) -> None:
        """Discard the partial line."""
        self._begin()

    def take(self, byte: int) -> str | type[Overflow] | None:
        """The line completed by this byte, if any."""
        char = chr(byte)
        if char in "\r\n":
            line = Overflow if self._long else self._text
            self._begin()
            return line
        if self._long or self._until:
            self._until = "" if char == self._until else self._until
        elif char in "(;":
            self._until = {"(": ")", ";": "\n"}[char]
        elif char > " " and char not in self.drops:
            self._long = len(self._text) >= self.limit
            self._text += "" if self._long else char.upper()
        return None
