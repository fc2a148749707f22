"""Datagrams of TMCL modules: nine bytes in each direction, the last one the sum of the others.

`host module status command value(4) checksum` is an answer, `module command type motor value(4) checksum` an order.
Nothing marks the beginning of a datagram, and datagrams have no number.
Source: TMCL firmware manuals, "binary command format" and "reply format".
"""

from __future__ import annotations

LENGTH = 9
OK, LOADED, DAMAGED = 100, 101, 1
"""Statuses: done, stored for later, and wrong checksum of the order."""
STATUSES = frozenset({*range(1, 16), OK, LOADED})
MODULE, STATUS, COMMAND = 1, 2, 3
"""Byte positions in an answer."""


def checksum(body: bytes) -> int:
    """The sum of these bytes modulo 256."""
    return sum(body) & 0xFF


class TmclParser:
    """Bytes to datagrams with a valid checksum; at an invalid one it advances by one byte."""

    def __init__(self) -> None:
        self._received = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The datagrams completed by these bytes."""
        self._received += data
        frames = []
        while len(self._received) >= LENGTH:
            frame = bytes(self._received[:LENGTH])
            good = frame[STATUS] in STATUSES and checksum(frame[:-1]) == frame[-1]
            if good:
                frames.append(frame)
            del self._received[: LENGTH if good else 1]
        return frames
