"""Every byte on a line with its time: a ring buffer, and optionally a file."""

import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO


@dataclass(frozen=True, slots=True)
class TranscriptEntry:
    """Bytes on the line with time and direction.

    `>` to the device, `<` from it, `!` a stop ahead of the queue, `x` a stop that the port did not accept.
    """

    time_s: float
    way: str
    data: bytes

    def line(self) -> str:
        """One readable line: seconds, direction, bytes with escapes."""
        return f"{self.time_s:14.6f} {self.way} {self.data!r}"


class Transcript:
    """The last `length` entries, and all of them in `file` if given.

    If the file cannot be written, as on a full disk, it is abandoned: no line waits for it or fails because of it.
    """

    def __init__(self, length: int = 1000, file: Path | None = None) -> None:
        self._ring: deque[tuple[float, str, bytes]] = deque(maxlen=length)
        self._path = file
        self._file: TextIO | None = None
        self._waiting: deque[tuple[float, str, bytes]] = deque()
        self._lock = threading.Lock()

    def write_to(self, path: Path | None) -> None:
        """From now on, write to this file, or to none."""
        self.close()
        self._path = path

    def record(self, time_s: float, way: str, data: bytes) -> None:
        """Record bytes; from any thread, without waiting: a thread that is already writing takes them along."""
        entry = (time_s, way, data)
        self._ring.append(entry)
        if self._path is not None:
            self._waiting.append(entry)
            if self._lock.acquire(blocking=False):
                try:
                    self._write()
                finally:
                    self._lock.release()

    def _write(self) -> None:
        """Bring the file up to date."""
        try:
            while self._waiting and self._path is not None:
                if self._file is None:
                    self._file = self._path.open("a", encoding="utf-8", buffering=1)  # lines outlive the program
                self._file.write(TranscriptEntry(*self._waiting.popleft()).line() + "\n")
        except OSError:
            self._path = None
            self._waiting.clear()

    def last(self, n: int = 1000) -> list[TranscriptEntry]:
        """The newest `n` entries, oldest first."""
        return [TranscriptEntry(*entry) for entry in list(self._ring)[-n:]]

    def close(self) -> None:
        """Update the file and close it until the next record; the ring stays readable."""
        with self._lock, suppress(OSError):
            self._write()
            if self._file is not None:
                file, self._file = self._file, None
                file.close()
