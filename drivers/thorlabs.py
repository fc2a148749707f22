"""Thorlabs motion controllers with the APT protocol: K-Cubes, T-Cubes, benchtop controllers with bays.

A message is `id16 p1 p2 dest source`, or `id16 length16 dest|80 source` and data, little endian, without checksum: a
lost byte would turn a target into another one. A target is therefore set, read back, and only then approached. Nothing
marks the beginning of a message, so stops are sent at every offset by which a controller may misread them.
Source: Thorlabs, APT communications protocol, issue 29.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

from drivers.errors import Alarm, NoAnswer
from drivers.interfaces import Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME
from drivers.options import Interval, axes, option, positive
from drivers.polled_stage import AxisState, PolledAxis, PolledStage
from drivers.protocols.framing import BAD, MORE, Decoder, FrameSplitter
from drivers.wire.connection import StepQuestion, anything, roll_call

HOST, CONTROLLER, BAY, LONG, HEADER = 0x01, 0x50, 0x20, 0x80, 6
REQ_INFO, GET_INFO, ENABLE = 0x0005, 0x0006, 0x0210
SET_VELOCITY, REQ_VELOCITY, GET_VELOCITY = 0x0413, 0x0414, 0x0415
HOMING, MOVE, STOP = 0x0443, 0x0453, 0x0465
SET_TARGET, REQ_TARGET, GET_TARGET = 0x0450, 0x0451, 0x0452
REQ_STATUS, GET_STATUS = 0x0490, 0x0491
LENGTHS = {GET_INFO: 84, GET_VELOCITY: 14, GET_TARGET: 6, GET_STATUS: 14, 0x0464: 14, 0x0466: 14, 0x0444: 0}
"""Bytes of data of the messages to the host: answers, and the ends of moves and of homing."""
MOVING, HOMED, MOTION_ERROR = 0x02F0, 0x0400, 0x4000
PROFILED, CHANNEL, TRIES = 2, 1, 3


class AptMessage(NamedTuple):
    """One message: its id, the controller or bay that sent it, its data."""

    id: int
    source: int
    data: bytes


def header(number: int, dest: int, p1: int = 0, p2: int = 0) -> bytes:
    """A message without data."""
    return struct.pack("<HBBBB", number, p1, p2, dest, HOST)


def packet(number: int, dest: int, data: bytes) -> bytes:
    """A message with data."""
    return struct.pack("<HHBB", number, len(data), dest | LONG, HOST) + data


def _measure(head: bytes) -> int:
    if len(head) < HEADER:
        return MORE
    number, length, dest, _ = struct.unpack_from("<HHBB", head)
    data = LENGTHS.get(number, BAD)
    if data == BAD or dest & ~LONG not in (0, HOST) or bool(dest & LONG) != bool(data) or (data and length != data):
        return BAD
    total = HEADER + data
    return total if len(head) >= total else MORE


AptParser = partial(
    Decoder[AptMessage], partial(FrameSplitter, bytes(number & 0xFF for number in LENGTHS), _measure, 128),
    lambda one: AptMessage(int.from_bytes(one[:2], "little"), one[5], one[HEADER:]),
)  # fmt: skip


class AptStage(PolledStage[AptMessage]):
    """Axes at one port; an axis' number is its bay, 0 at a controller without bays, and its scale units per count.

    `cycle_s` is the unit of time of its speeds: 2048/6e6 for DC servos, 102.4e-6 for brushless, 819.2e-6 for steppers.
    """

    def __init__(
        self, transport: Transport[AptMessage], axes: Sequence[PolledAxis], *, cycle_s: float = 2048 / 6e6, **more: Any
    ) -> None:
        super().__init__(transport, axes, **more)
        self._speed_unit = 65536 * cycle_s
        stops = b"".join(header(STOP, self._dest(axis), CHANNEL, PROFILED) for axis in axes)
        self.stop_bytes = (stops + b"\0") * HEADER

    @staticmethod
    def _dest(axis: PolledAxis) -> int:
        return BAY + int(axis.number) if axis.number else CONTROLLER

    def _ask(
        self, axis: PolledAxis, data: bytes, reply: int, allowed: Callable[[], None] = anything, tries: int = TRIES
    ) -> bytes:
        """The data of this reply to these messages."""
        dest = self._dest(axis)

        def heard(message: AptMessage, number: int) -> bytes | None:
            return message.data if (message.id, message.source) == (number, dest) else None

        question = StepQuestion[AptMessage](header(REQ_INFO, dest), lambda message: heard(message, GET_INFO), b"\0")
        return self._line.request(data, lambda message: heard(message, reply), question, allowed, tries)

    def _get(self, axis: PolledAxis, request: int, reply: int) -> bytes:
        return self._ask(axis, header(request, self._dest(axis), CHANNEL), reply)

    def _introduce(self) -> tuple[str, str, str]:
        named = {int(axis.number): axis for axis in self._axes}
        where, remedy = f"{self.address}: no answer from bays", "check power, cable and bays"
        infos = roll_call(named, lambda bay: self._get(named[bay], REQ_INFO, GET_INFO), where, remedy)
        parts = [struct.unpack_from("<l8sH4B", info) for info in infos]
        models = (model.split(b"\0")[0].decode("ascii", "replace").strip() for _, model, *_ in parts)
        firmware = (f"{major}.{middle}.{minor}" for *_, minor, middle, major, _ in parts)
        serials = [str(serial) for serial, *_ in parts]
        return "Thorlabs " + "; ".join(models), "; ".join(dict.fromkeys(firmware)), "; ".join(serials)

    def _prepare(self, axis: PolledAxis) -> tuple[Travel, float]:
        self._transport.write(header(ENABLE, self._dest(axis), CHANNEL, 1))
        unit = self._speed_unit / abs(axis.scale)
        if axis.speed_per_s is not None:
            _, low, acceleration, _ = struct.unpack("<Hlll", self._get(axis, REQ_VELOCITY, GET_VELOCITY))
            data = struct.pack("<Hlll", CHANNEL, low, acceleration, round(axis.speed_per_s * unit))
            self._transport.write(packet(SET_VELOCITY, self._dest(axis), data))
        *_, speed = struct.unpack("<Hlll", self._get(axis, REQ_VELOCITY, GET_VELOCITY))
        return axis.travel_between(), max(speed / unit, 1e-3)

    def _status(self, axis: PolledAxis, order: bytes = b"", allowed: Callable[[], None] = anything) -> tuple[int, int]:
        """Position in counts and status bits, after an order, which is given only once."""
        data = order + header(REQ_STATUS, self._dest(axis), CHANNEL)
        answer = self._ask(axis, data, GET_STATUS, allowed, 1 if order else TRIES)
        _, counts, _, bits = struct.unpack("<HlLL", answer)
        return counts, bits

    def _state(self, axis: PolledAxis) -> AxisState:
        counts, bits = self._status(axis)
        if bits & MOTION_ERROR and self.trust.why is None:
            self.trust.lose(Alarm(f"{axis.name} at {self.address} has stopped with a motion error", HOME))
            self.trust.require()
        return AxisState(axis.to_unit(counts), bool(bits & MOVING), bool(bits & HOMED))

    def _begin_homing(self, axis: PolledAxis, allowed: Callable[[], None]) -> None:
        self._status(axis, header(HOMING, self._dest(axis), CHANNEL), allowed)

    def _begin_move(self, axis: PolledAxis, value: float, allowed: Callable[[], None]) -> None:
        dest, target = self._dest(axis), struct.pack("<Hl", CHANNEL, round(axis.to_device(value)))
        setting = packet(SET_TARGET, dest, target) + header(REQ_TARGET, dest, CHANNEL)
        for _ in range(TRIES):
            if self._ask(axis, setting, GET_TARGET) == target:
                self._status(axis, header(MOVE, dest, CHANNEL), allowed)
                return
        raise NoAnswer(f"{self.address} reports another target than was set", "check the cable")


@dataclass(frozen=True, kw_only=True)
class AptAxis(PolledAxis):
    """An axis of driver "apt": its number is its bay, 0 where there are none."""

    number: Annotated[int, option("0", least=0, most=10)]
    scale: Annotated[float, option("2.915e-5", "a number other than 0", holds=bool)]
    travel: Interval


@dataclass(frozen=True, kw_only=True)
class AptOptions(LineOptions):
    """Options of driver "apt"."""

    makes = AptStage
    parser = AptParser
    axes: Annotated[tuple[AptAxis, ...], axes("number")]
    cycle_s: Annotated[float, positive("102.4e-6")] = 2048 / 6e6
