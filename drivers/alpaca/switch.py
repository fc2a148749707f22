"""Switches of an Alpaca server: one as a Light, one as a Shutter timed by the host."""

import threading
from dataclasses import dataclass
from typing import ClassVar

from drivers.alpaca.link import AlpacaAddress, AlpacaLink, NumberedOptions
from drivers.errors import BadConfiguration, Clock, EmergencyStopped, MoveFailed
from drivers.interfaces import Identity, ShutterTimes
from drivers.light import Lamp, LampProperties
from drivers.making import MakerContext
from drivers.options import SHUTTER, Count
from drivers.shutter import OneContact
from drivers.wire.connection import LineDevice, closed_after_errors, not_connected

SET = "setswitch"


class AlpacaSwitch(LineDevice[AlpacaLink]):
    """One switch, by its number on the device: connected and checked to be writable."""

    def __init__(self, server: AlpacaAddress, device: int, switch: int) -> None:
        self.link = AlpacaLink(server, "switch", device)
        super().__init__(self.link)
        self.switch = switch
        self.low, self.high = 0.0, 1.0

    @property
    def address(self) -> str:
        return f"number {self.switch} of {self.link.address}"

    @property
    def is_open(self) -> bool:
        return self.link.is_open

    def connect(self) -> Identity:
        """Connect, and read name and range. Raises DeviceError."""
        link, identity = self.link, self.link.open()
        with closed_after_errors(self.link):
            count = int(link.number_of("maxswitch"))
            if self.switch >= count:
                reason = f"{link.address} has {count} switches; number {self.switch} was requested"
                raise BadConfiguration(reason, "they are counted from 0")
            name = str(link.get("getswitchname", Id=self.switch))
            self.low, self.high = (link.number_of(f"{end}switchvalue", Id=self.switch) for end in ("min", "max"))
            if not link.get("canwrite", Id=self.switch):
                raise BadConfiguration(f"{name} at {self.address} is read only", "give the number of another switch")
        return Identity(f"{identity.model}, {name}", identity.firmware, "", self.address)

    def set(self, on: bool) -> None:
        """Switch it. Raises DeviceError."""
        self.link.put(SET, Id=self.switch, State=on)

    def preempt_off(self) -> None:
        """Switch it off without waiting for pending requests; never raises."""
        self.link.preempt(SET, Id=self.switch, State=False)


class AlpacaLight(Lamp[AlpacaSwitch]):
    """A Light on a switch of an Alpaca server."""

    def __init__(
        self, switch: AlpacaSwitch, *, panel: LampProperties | None = None, clock: Clock | None = None
    ) -> None:
        super().__init__(switch, clock, panel)
        self._switch = switch

    def connect(self) -> Identity:
        return self._switch.connect()

    def _shine(self, level: float) -> None:
        switch = self._switch
        value = switch.low + level * (switch.high - switch.low)
        switch.link.put("setswitchvalue", Id=switch.switch, Value=value)

    def emergency_stop(self) -> None:
        """Light is harmless, and people need it: it stays on."""


class AlpacaShutter(OneContact[AlpacaSwitch]):
    """A Shutter on a switch of an Alpaca server; its times are the host's times of the server's answers."""

    def __init__(self, switch: AlpacaSwitch, *, clock: Clock | None = None) -> None:
        super().__init__(switch, clock)
        self._switch = switch
        self._end = threading.Condition()
        self._aborts = 0
        self._stopped: EmergencyStopped | None = None

    def connect(self) -> Identity:
        identity = self._switch.connect()
        with closed_after_errors(self):
            self._switch.set(False)
        return identity

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        if not self._switch.link.is_open:
            raise not_connected(self.address)
        self._stopped = None
        aborts = self._aborts
        self.clock.sleep(focus_s)
        try:
            if self._aborts == aborts:
                self._switch.set(True)
            closed_s = self.clock.now_s()
            with self._end:
                self.clock.wait(self._end, lambda: self._aborts != aborts, closed_s + pulse_s)
            self._switch.set(False)
        except BaseException:
            self._switch.preempt_off()
            if self._stopped is None:  # else the stop's own order may have made the server refuse this one
                raise
        if self._stopped is not None:
            raise self._stopped
        if self._aborts != aborts:
            raise MoveFailed(f"the shot at {self.address} was cut short", "fire again")
        return ShutterTimes(closed_s, self.clock.now_s())

    def abort(self) -> None:
        self._interrupt()
        if self._switch.link.is_open:
            self._switch.set(False)
        elif self._switch.link.is_claimed:
            self._switch.preempt_off()

    def _interrupt(self) -> None:
        self._aborts += 1
        # a waiting shot wakes by itself at the end of its pulse at the latest; waiting for it here is not allowed
        if self._end.acquire(blocking=False):
            self._end.notify_all()
            self._end.release()

    def emergency_stop(self) -> None:
        """Open the contact without waiting for pending requests."""
        self._stopped = EmergencyStopped(f"emergency stop at {self.address}", "make it safe, then fire again")
        self._interrupt()
        if self._switch.link.is_claimed:
            self._switch.preempt_off()


@dataclass(frozen=True, kw_only=True)
class SwitchOptions(NumberedOptions):
    """A switch of a device."""

    switch: Count

    @property
    def line(self) -> AlpacaSwitch:
        return AlpacaSwitch(self.at, self.device, self.switch)


@dataclass(frozen=True, kw_only=True)
class AlpacaLightOptions(LampProperties, SwitchOptions):
    """Options of driver "alpaca_light"."""

    def make(self, parts: MakerContext) -> AlpacaLight:
        return AlpacaLight(self.line, panel=self, clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class AlpacaShutterOptions(SwitchOptions):
    """Options of driver "alpaca_shutter"."""

    provides: ClassVar[tuple[str, ...]] = (SHUTTER,)

    def make(self, parts: MakerContext) -> AlpacaShutter:
        return AlpacaShutter(self.line, clock=parts.clock)
