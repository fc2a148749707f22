"""Faults of a cable, on request or at random from a seed."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Faults:
    """Faults of one cable. Probabilities are per byte, except `duplicate`, which is per chunk.

    `silent`: spans of seconds in which nothing passes; `clogged`: in which the port takes no bytes; `delay_s`: delay of
    every reply, up to `jitter_s` longer at random; `slip`: a reply comes only when the next one is due;
    `unplugged_at_s`, `replugged_at_s`: when the cable is disconnected and reconnected; `wrong_baud`: all is noise.
    """

    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    lost: float = 0.0
    garbage: float = 0.0
    duplicate: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    slip: bool = False
    silent: tuple[tuple[float, float], ...] = ()
    clogged: tuple[tuple[float, float], ...] = ()
    unplugged_at_s: float = float("inf")
    replugged_at_s: float = float("inf")
    wrong_baud: bool = False
    begin_s: float = 0.0
    _late: deque[tuple[float, bytes]] = field(default_factory=deque)
    _held: bytes = b""

    def unplugged(self, now_s: float) -> bool:
        """Whether the cable is disconnected."""
        return self.unplugged_at_s <= now_s < self.replugged_at_s

    def is_clogged(self, now_s: float) -> bool:
        """Whether the port takes no bytes."""
        return any(begin <= now_s < end for begin, end in self.clogged)

    def scramble(self, data: bytes) -> bytes:
        """The bytes received at a wrong baud rate: noise of the same length or slightly shorter."""
        keep = self.rng.random(len(data)) < 0.8
        return self.rng.integers(0, 256, int(keep.sum()), dtype=np.uint8).tobytes()

    def spoil(self, data: bytes, now_s: float) -> bytes:
        """The part of `data` that arrives now, with its errors."""
        if self.wrong_baud:
            return self.scramble(data)
        if any(begin <= now_s < end for begin, end in self.silent):
            return b""
        if now_s < self.begin_s or not (self.lost or self.garbage or self.duplicate):
            return data
        return self._spoilt(data)

    def _spoilt(self, data: bytes) -> bytes:
        draws = self.rng.random(len(data))
        noise = self.rng.integers(0, 256, len(data), dtype=np.uint8)
        kept = bytearray()
        for byte, draw, other in zip(data, draws, noise, strict=True):
            if draw < self.lost:
                continue
            kept.append(int(other) if draw < self.lost + self.garbage else byte)
        return bytes(kept) * (2 if self.rng.random() < self.duplicate else 1)

    def spoil_reply(self, data: bytes, now_s: float) -> bytes:
        """The part of a reply that arrives now; nothing if replies are delayed."""
        spoilt = self.spoil(data, now_s)
        if spoilt and self.slip:
            self._held, spoilt = spoilt, self._held
        if self.delay_s and spoilt and now_s >= self.begin_s:
            due_s = now_s + self.delay_s + (self.rng.uniform(0.0, self.jitter_s) if self.jitter_s else 0.0)
            self._late.append((max([due_s, *(moment for moment, _ in self._late)]), spoilt))
            return b""
        return spoilt

    def late(self, now_s: float) -> bytes:
        """Delayed bytes that are due."""
        due = b""
        while self._late and self._late[0][0] <= now_s:
            due += self._late.popleft()[1]
        return due

    def next_event_s(self, now_s: float) -> float | None:
        """When a delayed byte arrives or the plug state changes."""
        moments = [self._late[0][0]] if self._late else []
        moments += [moment for moment in (self.unplugged_at_s, self.replugged_at_s) if now_s < moment < float("inf")]
        return min(moments, default=None)
