"""Lamps on DMX by Art-Net: packets over UDP to a node.

`Art-Net 0 | opcode, low byte first | version 14, high byte first | ...`. A node holds the last levels, and some fall
back to black without a packet for some seconds: the levels are therefore sent again. DMX is one-way; whether the node
is there shows its reply to a poll.
Source: Artistic Licence, Art-Net 4 specification.
"""

import socket
import struct
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated

from drivers.errors import Clock, LineLost, NoAnswer
from drivers.interfaces import Identity
from drivers.light import Channels, Lamp, LampProperties
from drivers.making import DriverOptions, MakerContext
from drivers.options import has_port, option
from drivers.wire.connection import not_connected

ID, VERSION, PORT = b"Art-Net\0", 14, 6454
DMX, POLL, POLL_REPLY = 0x5000, 0x2000, 0x2100
CHANNELS = 512
REPLY_S = 1.0
TRIES = 3
AGAIN_S = 0.8  # interval at which unchanged levels are sent; the specification requires at most 1 s


def packet(opcode: int, body: bytes) -> bytes:
    """Encode a packet."""
    return ID + struct.pack("<H", opcode) + struct.pack(">H", VERSION) + body


def dmx_packet(universe: int, slots: bytes, sequence: int = 0) -> bytes:
    """The levels of a universe, 0 to 32767; sequence 0 means that packets are not numbered."""
    return packet(DMX, struct.pack("<BBH", sequence, 0, universe) + struct.pack(">H", len(slots)) + slots)


class ArtNetLight(Lamp["ArtNetLight"]):
    """A Light on some channels of a universe of an Art-Net node, which is its own line."""

    def __init__(
        self, host: str, channels: Sequence[int] = (1,), *, universe: int = 0, panel: LampProperties | None = None,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(self, clock, panel)
        name, _, port = host.partition(":")
        self._node = (name, int(port or PORT))
        self._channels, self._universe = tuple(channels), universe
        self._socket: socket.socket | None = None
        self._slots, self._sequence = bytes(CHANNELS), 0
        self._turn = threading.Lock()
        self._closing = threading.Event()
        self._sender: threading.Thread | None = None

    @property
    def address(self) -> str:
        return f"artnet://{self._node[0]}:{self._node[1]}/{self._universe}"

    def connect(self) -> Identity:
        """Open a socket, and poll the node. Raises DeviceError."""
        self.close()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect(self._node)
            reply = self._poll()
        except (OSError, NoAnswer) as error:
            self.close()
            if isinstance(error, NoAnswer):
                raise
            raise LineLost(
                f"cannot reach {self.address}: {error}", "check the node's address and the network"
            ) from error
        self._closing = threading.Event()
        self._sender = threading.Thread(target=self._send_again, args=(self._closing,), name=self.address, daemon=True)
        self._sender.start()
        name, version = reply[26:44].split(b"\0")[0], struct.unpack_from(">H", reply, 16)[0]
        return Identity(name.decode("latin-1") or "Art-Net node", f"{version >> 8}.{version & 255}", "", self.address)

    def _poll(self) -> bytes:
        """The node's reply. Raises NoAnswer, OSError."""
        there = self._there()
        there.settimeout(REPLY_S)
        for _ in range(TRIES):
            there.send(packet(POLL, b"\x00\x00"))
            with suppress(TimeoutError):
                while True:
                    data = there.recv(1024)
                    if data.startswith(ID + struct.pack("<H", POLL_REPLY)) and len(data) >= 44:
                        return data
        raise NoAnswer(f"{self.address} did not answer a poll", "check power, network and address of the node")

    def _there(self) -> socket.socket:
        if self._socket is None:
            raise not_connected(self.address)
        return self._socket

    def _send(self) -> None:
        with self._turn:
            self._sequence = self._sequence % 255 + 1
            self._there().send(dmx_packet(self._universe, self._slots, self._sequence))

    def _send_again(self, closing: threading.Event) -> None:
        while not closing.wait(AGAIN_S):
            with suppress(OSError, LineLost):
                self._send()

    def close(self) -> None:
        """Release the socket; the node keeps the level."""
        self._closing.set()
        if self._sender is not None:
            self._sender.join(timeout=2.0)
            self._sender = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def _shine(self, level: float) -> None:
        """Set all channels, and check that the node still answers."""
        value = round(255 * level)
        slots = bytearray(CHANNELS)
        for channel in self._channels:
            slots[channel - 1] = value
        self._slots = bytes(slots)
        try:
            self._send()
            self._poll()
            self._send()  # one packet may be lost, and none follows the last level when the lamp is closed
        except OSError as error:
            raise LineLost(f"{self.address} went away: {error}", "check network and node") from error

    def emergency_stop(self) -> None:
        """Light is harmless, and people need it: it stays on."""


@dataclass(frozen=True, kw_only=True)
class ArtNetOptions(DriverOptions, LampProperties):
    """Options of driver "artnet"."""

    host: Annotated[
        str,
        option('"192.168.1.30"', "a node's address in quotes", pattern=r"^[^\s:/@]+(:\d{1,5})?\Z", holds=has_port),
    ]
    universe: Annotated[int, option("0", least=0, most=32767)] = 0
    channels: Channels = (1,)

    def make(self, parts: MakerContext) -> ArtNetLight:
        return ArtNetLight(self.host, self.channels, universe=self.universe, panel=self, clock=parts.clock)
