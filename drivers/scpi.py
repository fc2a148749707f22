"""Instruments with SCPI, by a serial line, TCP or VISA: lamps on power supplies, probes of room and light.

Numbers come as text; by the standard, 9.9E37 is infinite and 9.91E37 not a number. The error queue is read after every
order.
Source: SCPI-99, volumes 1 and 2.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

from drivers.errors import Clock, NoReading, Rejected
from drivers.interfaces import PROBE_UNITS, Identity, ProbeReading, Transport
from drivers.light import Lamp, LampProperties
from drivers.making import LineOptions, MakerContext
from drivers.options import Baud, Uncertainty, option, positive, text
from drivers.protocols.framing import Decoder, LineSplitter, text_of
from drivers.wire.connection import InStepLine, LineDevice, StepQuestion, opened
from drivers.wire.visa import VISA, VisaTransport

REPLY_S = 2.0
NOT_A_NUMBER = 9.9e37
NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?)(?:[ ,].*|[A-Za-z%°]*)"
"""A number, and its unit or further numbers."""
QUESTIONS = 3
ERRORS_KEPT = 20


ScpiParser = partial(Decoder[str], partial(LineSplitter, 1024), text_of)


class ScpiInstrument(LineDevice[Transport[str]]):
    """Common part of these instruments: identity, queries, orders with their errors."""

    def __init__(self, transport: Transport[str], clock: Clock | None = None) -> None:
        super().__init__(transport, clock)
        self._line = InStepLine(transport, REPLY_S, QUESTIONS)
        self._question = StepQuestion[str](b"*IDN?\n", lambda line: line if line.count(",") >= 3 else None)

    def connect(self) -> Identity:
        """Open, identify, and forget errors from before. Raises DeviceError."""
        self._line.owed = None
        with opened(self._transport):
            maker, model, serial, firmware = self._ask("*IDN?", r"[^,]*,[^,]*,[^,]*,.*").split(",", 3)
            for _ in range(ERRORS_KEPT):
                if self._error()[0] == 0:
                    break
        return Identity(f"{maker.strip()} {model.strip()}", firmware.strip(), serial.strip(), self.address)

    def _ask(self, query: str, pattern: str = ".*") -> str:
        def answer(line: str) -> str | None:
            return line if re.fullmatch(pattern, line) else None

        return self._line.request(f"{query}\n".encode(), answer, self._question, tries=2)

    def _number(self, query: str) -> float:
        """The first number of the reply. Raises NoReading where the instrument reports none."""
        reply = self._ask(query, NUMBER)
        match = re.fullmatch(NUMBER, reply)
        value = float(match[1]) if match else NOT_A_NUMBER
        if abs(value) >= NOT_A_NUMBER:
            raise NoReading(f"{self.address} answers {query} with {reply}", "check sensor and range of the instrument")
        return value

    def _error(self) -> tuple[int, str]:
        code, words = self._ask("SYST:ERR?", r"[-+]?\d+ *, *\".*\".*").split(",", 1)
        return int(code), words.strip().strip('"')

    def _order(self, command: str) -> None:
        """An order, then the error queue. Raises Rejected."""
        self._transport.write(f"{command}\n".encode())
        code, words = self._error()
        if code:
            raise Rejected(f"{self.address} refused {command}: {words.lower()} ({code})", "see its manual", str(code))

    def emergency_stop(self) -> None:
        """Nothing moves: it goes on."""


Query = Annotated[str, option('"MEAS:TEMP?"', "a query in quotes", pattern=r"^\S.*\?.*\Z")]


@dataclass(frozen=True, kw_only=True)
class SupplySettings:
    """A supply whose setting `command` gives `full` at full light, within `tolerance` of it; `output` switches it."""

    full: Annotated[float, positive("2.0")]
    command: Annotated[str, text('"CURR"', "the header of a setting in quotes")] = "CURR"
    output: Literal["OUTP", "OUTP:STAT", "SOUR:ENAB", ""] = "OUTP"
    measured: Query = "MEAS:CURR?"
    tolerance: Annotated[float, positive("0.02")] = 0.02


class ScpiLight(ScpiInstrument, Lamp[Transport[str]]):
    """A Light on a power supply, or a lamp of its own: its setting is read back, and so is its output."""

    def __init__(
        self, transport: Transport[str], supply: SupplySettings, *, panel: LampProperties | None = None,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(transport, clock)
        self.panel = panel or LampProperties()
        self._supply = supply

    def _shine(self, level: float) -> None:
        """Set a fraction of full, and compare with the setting that the instrument reports; dark is switched first."""
        supply, value = self._supply, level * self._supply.full
        if supply.output and not level:
            self._order(f"{supply.output} 0")
        self._order(f"{supply.command} {value:.6f}")
        there = self._number(f"{supply.command}?")
        if abs(there - value) > supply.tolerance * supply.full:
            reason = f"{self.address} reports {supply.command} {there:g} after {value:g} was set"
            raise Rejected(reason, "check its limits, and `full` in station.toml")
        if supply.output and level:
            self._order(f"{supply.output} 1")

    def measured_level(self) -> float:
        """The measured output as a fraction of full. Raises DeviceError."""
        return self._number(self._supply.measured) / self._supply.full


@dataclass(frozen=True)
class ProbeChannel:
    """One quantity: its name in `PROBE_UNITS`, the query that measures it, and its uncertainty if it is specified."""

    quantity: str
    query: str
    uncertainty: float | None = None


class ScpiProbe(ScpiInstrument):
    """A Probe: thermometer, hygrometer, power meter, luxmeter."""

    def __init__(self, transport: Transport[str], channels: tuple[ProbeChannel, ...]) -> None:
        super().__init__(transport)
        self._channels = channels

    def read(self) -> Mapping[str, ProbeReading]:
        return {
            one.quantity: ProbeReading(self._number(one.query), PROBE_UNITS[one.quantity], one.uncertainty)
            for one in self._channels
        }


@dataclass(frozen=True, kw_only=True)
class InstrumentOptions(LineOptions):
    """A line to an instrument: a port, or a VISA resource that `visa_library` opens."""

    baud: Baud = 9600
    visa_library: Annotated[str, text('"@py"', "pyvisa's name of a VISA library in quotes")] = "@py"

    def line(self, parts: MakerContext) -> Transport[str]:
        if not self.port.lower().startswith(VISA):
            return parts.wire(self.port, ScpiParser, baud=self.baud)
        transcript = parts.transcript()
        return VisaTransport(self.port, ScpiParser, library=self.visa_library, clock=parts.clock, transcript=transcript)


@dataclass(frozen=True, kw_only=True)
class ScpiLightOptions(InstrumentOptions, SupplySettings, LampProperties):
    """Options of driver "scpi_light"."""

    def make(self, parts: MakerContext) -> ScpiLight:
        return ScpiLight(self.line(parts), self, panel=self, clock=parts.clock)


@dataclass(frozen=True, kw_only=True)
class ScpiProbeOptions(InstrumentOptions):
    """Options of driver "scpi_probe": the query of each quantity of `PROBE_UNITS`, and its uncertainty."""

    temperature: Query | None = None
    humidity: Query | None = None
    pressure: Query | None = None
    power: Query | None = None
    illuminance: Query | None = None
    temperature_uncertainty: Uncertainty | None = None
    humidity_uncertainty: Uncertainty | None = None
    pressure_uncertainty: Uncertainty | None = None
    power_uncertainty: Uncertainty | None = None
    illuminance_uncertainty: Uncertainty | None = None

    def _channels(self) -> tuple[ProbeChannel, ...]:
        queries = {name: getattr(self, name) for name in PROBE_UNITS}
        return tuple(
            ProbeChannel(name, query, getattr(self, f"{name}_uncertainty"))
            for name, query in queries.items()
            if query is not None
        )

    def problem(self) -> tuple[str, str] | None:
        if self._channels():
            return None
        return f"measures none of {', '.join(PROBE_UNITS)}", 'write temperature = "MEAS:TEMP?", for example'

    def make(self, parts: MakerContext) -> ScpiProbe:
        return ScpiProbe(self.line(parts), self._channels())
