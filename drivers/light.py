"""Light panels: DMX through an Enttec USB Pro, or the spindle output of a GRBL controller as PWM.

Enttec: `7E label lenLSB lenMSB data E7`; label 6 sends DMX and must begin with start code 0, label 3 requests
parameters, 10 the serial number.
"""

import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import msgspec

from drivers.errors import BadConfiguration, Clock, EmergencyStopped, Rejected
from drivers.interfaces import Caveat, Condition, Identity, Transport
from drivers.making import DriverOptions, MakerContext, OutputOptions
from drivers.options import Port, Seconds, distinct, option
from drivers.protocols.framing import BAD, MORE, Decoder, FrameSplitter
from drivers.protocols.grbl_link import GrblLink, GrblOutput
from drivers.wire.connection import L, LineDevice, opened

PARAMETERS, SEND, SERIAL = 3, 6, 10
CHANNELS = 512
LONGEST = 600
REPLY_S = 1.0
PERIODS = 100  # periods of a lamp's modulation in an exposure, one more or less of which changes its light by 1 %
Channels = Annotated[
    tuple[Annotated[int, msgspec.Meta(ge=1, le=512)], ...],
    option("[1]", "a list in [ ] of whole numbers from 1 to 512, none twice", holds=distinct),
]


@dataclass(frozen=True)
class DmxFrame:
    """One valid message: label and data."""

    label: int
    data: bytes


def frame(label: int, data: bytes = b"") -> bytes:
    """Encode a message."""
    return b"\x7e" + struct.pack("<BH", label, len(data)) + data + b"\xe7"


def _measure(head: bytes) -> int:
    if len(head) < 4:
        return MORE
    length = 5 + int.from_bytes(head[2:4], "little")
    if length > LONGEST:
        return BAD
    if len(head) < length:
        return MORE
    return length if head[length - 1] == 0xE7 else BAD


DmxParser = partial(
    Decoder[DmxFrame], partial(FrameSplitter, b"\x7e", _measure, LONGEST), lambda one: DmxFrame(one[1], one[4:-1])
)


def check_level(level: float) -> float:
    """Return `level` if it is in [0, 1]. Raises BadConfiguration."""
    if not 0.0 <= level <= 1.0:
        raise BadConfiguration(f"a light level must be in 0 .. 1; got {level:g}", "give a fraction of full light")
    return level


@dataclass(frozen=True)
class LampProperties:
    """Properties of a lamp: warm-up time, and modulation frequency (0: none)."""

    warm_up_s: Seconds = 0.0
    pwm_hz: Annotated[float, option("1000", least=0)] = 0.0

    def flicker(self, exposure_s: float) -> Caveat | None:
        """The caveat about exposures so short that a period more or less of the modulation changes their light."""
        if self.pwm_hz == 0 or exposure_s * self.pwm_hz >= PERIODS:
            return None
        change = 100 / (exposure_s * self.pwm_hz)
        reason = f"an exposure must last {PERIODS} periods of the lamp's modulation, {PERIODS / self.pwm_hz:g} s"
        return Caveat(
            f"{reason}; at {exposure_s:g} s its light can change by {change:.2g} %",
            "expose longer, or use a lamp without modulation",
        )


class Lamp(LineDevice[L], ABC):
    """Common part of lamps: their properties, the level last set, and whether they have warmed up since."""

    def __init__(self, line: L, clock: Clock | None = None, panel: LampProperties | None = None) -> None:
        super().__init__(line, clock)
        self.panel = panel or LampProperties()
        self._level, self._since_s = 0.0, -float("inf")

    def set_level(self, level: float) -> None:
        """Set the level. After an order that failed without being refused, the lamp counts as lit: it may be."""
        before = self.level()
        self._remember(max(check_level(level), before))
        try:
            self._shine(level)
        except Rejected:
            self._remember(before)
            raise
        self._remember(level)

    @abstractmethod
    def _shine(self, level: float) -> None:
        """Order a level in [0, 1]. Raises DeviceError."""

    def _remember(self, level: float) -> None:
        """Record the level; setting the same level again is no change."""
        if level != self._level:
            self._level, self._since_s = level, self.clock.now_s()

    def level(self) -> float:
        return self._level

    def steady(self) -> bool:
        """Whether it has warmed up since the level was changed."""
        return self.clock.now_s() - self._since_s >= self.panel.warm_up_s

    def flicker(self, exposure_s: float) -> Caveat | None:
        return self.panel.flicker(exposure_s) if self.level() > 0 else None

    @property
    def _word(self) -> str:
        return f"{100 * self.level():.0f} %" + ("" if self.steady() else ", warming up")


class DmxLight(Lamp[Transport[DmxFrame]]):
    """A Light on some channels of a DMX line."""

    def __init__(
        self, transport: Transport[DmxFrame], channels: Sequence[int] = (1,), *, panel: LampProperties | None = None,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(transport, clock, panel)
        self._channels = tuple(channels)

    def connect(self) -> Identity:
        """Open, and read firmware and serial number. Raises DeviceError."""
        with opened(self._transport):
            parameters = self._ask(PARAMETERS, b"\0\0")
            number = self._ask(SERIAL)
        firmware = f"{parameters[1]}.{parameters[0]}" if len(parameters) > 1 else ""
        return Identity("Enttec DMX USB Pro", firmware, number[::-1].hex(), self.address)

    def _ask(self, label: int, data: bytes = b"") -> bytes:
        """The data of the reply, which is not an echo. Raises DeviceError."""
        return self._transport.request(
            frame(label, data), lambda one: one.data if one.label == label and one.data != data else None, REPLY_S, 3
        )

    def _shine(self, level: float) -> None:
        """Set all channels, and check that the widget still answers."""
        value = round(255 * level)
        slots = bytearray(CHANNELS)
        for channel in self._channels:
            slots[channel - 1] = value
        self._transport.write(frame(SEND, b"\0" + bytes(slots)))
        self._ask(PARAMETERS, b"\0\0")  # DMX is one-way: check at least that the widget answers

    def emergency_stop(self) -> None:
        """Light is harmless, and people need it: it stays on; waits end."""
        self._transport.preempt(b"", EmergencyStopped(f"emergency stop at {self.address}", "set the level again"))


class GrblLight(GrblOutput, Lamp[GrblLink]):
    """A Light on the spindle output of a GRBL controller (M3 S), which a stage may own."""

    name = "GRBL spindle output"

    def __init__(
        self, link: GrblLink, *, panel: LampProperties | None = None, clock: Clock | None = None, owns_link: bool = True
    ) -> None:
        super().__init__(link, clock=clock, owns_link=owns_link)
        self.panel = panel or LampProperties()
        self._resets = 0

    def condition(self) -> Condition:
        """The level; off after a reset of the controller, whatever caused it."""
        if self.link.is_open and self._level and self._resets != self.link.resets:
            reason = f"off: a reset of the controller ended its {100 * self._level:.0f} %"
            return Condition(reason, False, "set the level again")
        return super().condition()

    def _shine(self, level: float) -> None:
        full = self.link.setting(30, 1000.0) or 1000.0
        self._resets = self.link.resets
        self.link.command(f"M3 S{full * level:.1f}", 5.0)

    def level(self) -> float:
        """The level last set; 0 after a reset of the controller, which switches its outputs off."""
        return self._level if self._resets == self.link.resets else 0.0

    def emergency_stop(self) -> None:
        """Reset the controller, which switches the output off."""
        self._level = 0.0
        self.link.preempt(b"\x18", EmergencyStopped(f"emergency stop at {self.address}", "connect again"))


@dataclass(frozen=True, kw_only=True)
class DmxOptions(LampProperties, DriverOptions):
    """Options of driver "dmx"."""

    port: Port
    channels: Channels = (1,)

    def make(self, parts: MakerContext) -> DmxLight:
        return DmxLight(parts.wire(self.port, DmxParser), self.channels, panel=self, clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class GrblLightOptions(LampProperties, OutputOptions):
    """Options of driver "grbl_light"."""

    def make(self, parts: MakerContext) -> GrblLight:
        link, own = self.link(parts)
        return GrblLight(link, panel=self, clock=parts.clock, owns_link=own)
