"""Datagrams of TMCL modules: nine bytes each way, the last of them the sum of the others.

`host module status command value(4) checksum` is an answer, `module command type motor value(4) checksum` an order.
Nothing marks where a datagram begins, and none has a number.
Source: TMCL firmware manuals, "binary command format" and "reply format".
"""

from __future__ import annotations

LENGTH = 9
OK, LOADED, DAMAGED = 100, 101, 1
"""Statuses: done, kept for later, and that the order's checksum was wrong."""
STATUSES = frozenset({*range(1, 16), OK, LOADED})
MODULE, STATUS, COMMAND = 1, 2, 3
"""Where an answer has what."""


def checksum(body: bytes) -> int:
    """The sum of these bytes as one byte."""
    return sum(body) & 0xFF


class TmclParser:
    """Bytes to datagrams whose checksum is right; where there is none, it looks one byte further on."""

    def __init__(self) -> None:
        self._heard = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The datagrams completed by these bytes."""
        self._heard += data
        found = []
        while len(self._heard) >= LENGTH:
            frame = bytes(self._heard[:LENGTH])
            good = frame[STATUS] in STATUSES and checksum(frame[:-1]) == frame[-1]
            if good:
                found.append(frame)
            del self._heard[: LENGTH if good else 1]
        return found
