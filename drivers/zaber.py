"""Zaber stages in ASCII: several devices on one chain, microsteps in, millimetres or degrees out.

Every command carries a checksum and a message id, so a late or damaged answer is never taken for another's. A move has
ended when the axis reports IDLE, found by polling and alerts, and succeeded if its position is the target.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

from drivers.errors import Alarm, Clock, NoAnswer, Rejected, WasReset
from drivers.interfaces import Identity, Transport, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME
from drivers.options import AxisName, PollInterval, axes, option, positive
from drivers.polled_stage import AxisStage, AxisState
from drivers.protocols.zaber import FLAGS, REJECTIONS, UNREFERENCED, Alert, Event, Reply, ZaberParser, checksum
from drivers.wire.connection import anything, roll_call

REPLY_S = 0.5
SPEED_UNIT = 1.6384  # of the setting per microstep per second, firmware 6 and 7
PRECISION_STEPS = 4
INTERRUPTED = "NI"  # flag of an axis whose movement was interrupted


@dataclass(frozen=True)
class ZaberAxis:
    """One axis: its name with the unit, its place on the chain, units per microstep, its value at microstep 0.

    `speed_per_s` None keeps the device's speed.
    """

    name: AxisName
    device: Annotated[int, option("1", least=1, most=99)]
    unit_per_step: Annotated[float, positive("0.000234375")]
    axis: Annotated[int, option("1", least=1, most=9)] = 1
    zero: Annotated[float, option("0.0")] = 0.0
    speed_per_s: Annotated[float, positive("10")] | None = None

    @property
    def tolerance(self) -> float:
        return PRECISION_STEPS * abs(self.unit_per_step)

    def to_steps(self, value: float) -> int:
        return round((value - self.zero) / self.unit_per_step)

    def to_unit(self, steps: float) -> float:
        return self.zero + steps * self.unit_per_step


class ZaberStage(AxisStage[Event, ZaberAxis]):
    """A Stage of Zaber devices."""

    stop_bytes = b"/0 0 stop\n"
    """To all devices of the chain; their replies carry no message id, so no request takes them."""
    emergency_bytes = b"\n/0 0 estop\n"
    has_checksums = True

    def __init__(
        self, transport: Transport[Event], axes: Sequence[ZaberAxis], *, clock: Clock | None = None, poll_s: float = 0.1
    ) -> None:
        super().__init__(transport, axes, clock=clock, poll_s=poll_s)
        self._ids = 0
        self._checking: set[int] = set()

    def connect(self) -> Identity:
        """Open, identify every device, read limits, set speeds. Raises DeviceError naming all missing devices."""
        self._checking.clear()
        return super().connect()

    def _introduce(self) -> tuple[str, str, str]:
        where, remedy = f"{self.address}: no answer from devices", "check power, cables, addresses"
        identities = roll_call((axis.device for axis in self._axes), self._identify, where, remedy)
        models, versions, serials = ("; ".join(dict.fromkeys(column)) for column in zip(*identities, strict=True))
        return f"Zaber {models}", versions, serials

    def _identify(self, device: int) -> tuple[str, str, str]:
        """Model, version and serial number; checksums from here on."""
        self._query(device, 0, "set comm.checksum 1")
        self._checking.add(device)
        model, version, serial = (self._query(device, 0, f"get {s}") for s in ("deviceid", "version", "system.serial"))
        return model, version, serial

    def _prepare(self, axis: ZaberAxis) -> tuple[Travel, float]:
        self._query(axis.device, 0, "set comm.alert 1")
        low, high = sorted(axis.to_unit(self._number(axis, f"limit.{end}")) for end in ("min", "max"))
        if axis.speed_per_s is not None:
            setting = round(axis.speed_per_s / abs(axis.unit_per_step) * SPEED_UNIT)
            self._query(axis.device, axis.axis, f"set maxspeed {setting}")
        steps_per_s = self._number(axis, "maxspeed") / SPEED_UNIT
        return Travel(low, high), steps_per_s * abs(axis.unit_per_step)

    def _send(
        self, device: int, axis: int, command: str, tries: int = 1, allowed: Callable[[], None] = anything
    ) -> Reply:
        self._ids = number = (self._ids + 1) % 100
        body = f"{device} {axis} {number} {command}".rstrip().encode()

        unchecked: list[Reply] = []

        def answer(event: Event) -> Reply | None:
            if not isinstance(event, Reply) or (event.device, event.number) != (device, number):
                return None
            # with checksums enabled, an answer without one was damaged at its colon, or the device was reset
            if event.checked or device not in self._checking:
                return event
            unchecked.append(event)
            return None

        order = b"/" + body + b":" + checksum(body) + b"\n"
        try:
            reply = self._transport.request(order, answer, REPLY_S, tries, allowed)
        except NoAnswer as error:
            if len(unchecked) < 2:
                raise
            reset = WasReset(f"device {device} at {self.address} was switched off and on, or reset", HOME)
            self.trust.lose(reset)
            raise reset from error
        if not reply.accepted:
            reason, remedy = REJECTIONS.get(reply.data, (f"it answered {reply.data}", "see the device's manual"))
            raise Rejected(f"{self.address} device {device} refused {command!r}: {reason}", remedy, reply.data)
        return reply

    def _query(self, device: int, axis: int, command: str) -> str:
        """A query, which may be repeated if unanswered."""
        return self._send(device, axis, command, tries=3).data

    def _number(self, axis: ZaberAxis, setting: str) -> float:
        value = self._query(axis.device, axis.axis, f"get {setting}")
        try:
            return float(value)
        except ValueError as error:
            raise Rejected(
                f"{self.address} device {axis.device} reports {setting} as {value!r}", "check the axis' number", value
            ) from error

    def _hear(self, event: Event, host_s: float) -> None:
        self._alerts += isinstance(event, Alert)

    def _reading(self, axis: ZaberAxis) -> float:
        return axis.to_unit(self._number(axis, "pos"))

    def _state(self, axis: ZaberAxis) -> AxisState:
        return self._state_of(axis, self._status(axis))

    def _state_of(self, axis: ZaberAxis, status: Reply) -> AxisState:
        return AxisState(self._reading(axis), status.busy, status.flag != INTERRUPTED)

    def _status(self, axis: ZaberAxis) -> Reply:
        return self._send(axis.device, axis.axis, "", tries=3)

    def _checked(self, axis: ZaberAxis) -> AxisState:
        """The axis' state. Raises what its flag reports."""
        status = self._status(axis)
        if not (status.busy and status.flag in UNREFERENCED):
            flag = status.flag
            reason, remedy = FLAGS.get(flag, (f"flag {flag}", "see the device's manual"))
            if flag.startswith("F"):
                error = Alarm(f"{axis.name} at {self.address}: {reason}", remedy, flag)
                self.trust.lose(error)
                raise error
            if flag in (*UNREFERENCED, "WL", "WM"):
                self.trust.lose(Alarm(f"{axis.name} at {self.address}: {reason}", remedy, flag))
                self.trust.require()
        return self._state_of(axis, status)

    def _begin_homing(self, axis: ZaberAxis, allowed: Callable[[], None]) -> None:
        self._query(axis.device, axis.axis, "warnings clear")
        self._send(axis.device, axis.axis, "home", allowed=allowed)

    def _begin_move(self, axis: ZaberAxis, value: float, allowed: Callable[[], None]) -> None:
        self._send(axis.device, axis.axis, f"move abs {axis.to_steps(value)}", allowed=allowed)


@dataclass(frozen=True, kw_only=True)
class ZaberOptions(LineOptions):
    """Options of driver "zaber"."""

    makes = ZaberStage
    parser = ZaberParser
    axes: Annotated[tuple[ZaberAxis, ...], axes("device", "axis")]
    poll_s: PollInterval = 0.1
