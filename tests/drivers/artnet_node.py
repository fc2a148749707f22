"""An Art-Net node with one lamp, on a UDP port of this machine.

Source: Artistic Licence, Art-Net 4 specification.
"""

import socket
import struct
import threading
from collections.abc import Callable

ID = b"Art-Net\0"
POLL_S = 0.1


class ArtNetNode:
    """Answers polls; `lit(level)` is called for every packet of levels of its universe."""

    def __init__(self, lit: Callable[[float], None], *, channel: int = 1, universe: int = 0) -> None:
        self.slots = bytes(512)
        self.packets = 0
        self._lit, self._channel, self._universe = lit, channel, universe
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(POLL_S)
        self.host = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="Art-Net node", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._closing.is_set():
            try:
                data, sender = self._socket.recvfrom(1024)
            except TimeoutError:
                continue
            if len(data) < 12 or not data.startswith(ID) or struct.unpack_from(">H", data, 10)[0] < 14:
                continue
            (opcode,) = struct.unpack_from("<H", data, 8)
            if opcode == 0x2000:
                self._socket.sendto(self._poll_reply(), sender)
            elif opcode == 0x5000 and len(data) >= 20:
                self._receive(data)

    def _receive(self, data: bytes) -> None:
        universe, length = struct.unpack_from("<H", data, 14)[0], struct.unpack_from(">H", data, 16)[0]
        if universe == self._universe and 2 <= length <= 512 and len(data) == 18 + length:
            self.slots = data[18:].ljust(512, b"\0")
            self.packets += 1
            self._lit(self.slots[self._channel - 1] / 255)

    def _poll_reply(self) -> bytes:
        address = socket.inet_aton("127.0.0.1") + struct.pack("<H", 6454)
        versions = struct.pack(">HBBHBBH", 0x0103, self._universe >> 8, self._universe >> 4 & 15, 0, 0, 0, 0)
        names = b"Simulated node".ljust(18, b"\0") + b"A lamp on channel 1".ljust(64, b"\0")
        return (ID + struct.pack("<H", 0x2100) + address + versions + names).ljust(239, b"\0")

    def close(self) -> None:
        """End the thread and close the port."""
        self._closing.set()
        self._thread.join(timeout=2.0)
        self._socket.close()
