"""Every byte on a wire with its time: a ring in memory, and a file where one is wanted."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO


@dataclass(frozen=True, slots=True)
class Passage:
    """Bytes that passed: when, which way (`>` to the device, `<` from it, `!` past the locks), what."""

    time_s: float
    way: str
    data: bytes

    def line(self) -> str:
        """One line for people: seconds, direction, bytes with escapes."""
        return f"{self.time_s:14.6f} {self.way} {self.data!r}"


class Transcript:
    """The last `length` passages, and all of them in `file` if given."""

    def __init__(self, length: int = 1000, file: Path | None = None) -> None:
        self._ring: deque[tuple[float, str, bytes]] = deque(maxlen=length)
        self._path = file
        self._file: TextIO | None = None

    def record(self, time_s: float, way: str, data: bytes) -> None:
        """Note bytes that passed; safe from any thread."""
        self._ring.append((time_s, way, data))
        if self._path is not None:
            if self._file is None:
                self._file = self._path.open("a", encoding="utf-8")
            self._file.write(Passage(time_s, way, data).line() + "\n")

    def last(self, n: int = 1000) -> list[Passage]:
        """The newest `n` passages, oldest first."""
        return [Passage(*entry) for entry in list(self._ring)[-n:]]

    def close(self) -> None:
        """Bring the file up to date and close it until more passes; the ring stays readable."""
        if self._file is not None:
            self._file.close()
            self._file = None
