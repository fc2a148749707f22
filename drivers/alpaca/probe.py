"""Weather sensors of an Alpaca server (ObservingConditions) as a Probe of the room."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.alpaca.link import AlpacaAddress, AlpacaLink, NumberedOptions
from drivers.errors import BadConfiguration, NoReading, Rejected
from drivers.interfaces import PROBE_UNITS, Condition, Identity, ProbeReading
from drivers.making import MakerContext
from drivers.options import Uncertainty
from drivers.wire.connection import line_condition

QUANTITIES = ("temperature", "humidity", "pressure")
"""Members of the standard, which has them in the units of `PROBE_UNITS`."""


class AlpacaProbe:
    """A Probe; `uncertainties` by quantity, as stated by the sensors' makers."""

    def __init__(self, server: AlpacaAddress, number: int, uncertainties: Mapping[str, float | None]) -> None:
        self._link = AlpacaLink(server, "observingconditions", number)
        self._uncertainties = uncertainties
        self._quantities: tuple[str, ...] = ()

    @property
    def address(self) -> str:
        """Device and server."""
        return self._link.address

    def connect(self) -> Identity:
        """Connect, and see which quantities the device has. Raises DeviceError."""
        identity = self._link.open()
        self._quantities = tuple(name for name in QUANTITIES if self._has(name))
        if not self._quantities:
            self.close()
            raise BadConfiguration(f"{self.address} measures none of {', '.join(QUANTITIES)}", "name another device")
        return identity

    def _has(self, name: str) -> bool:
        try:
            self._link.number_of(name)
        except Rejected as error:
            return error.code != "0x400"  # not implemented; a value may come later
        return True

    def close(self) -> None:
        """Disconnect."""
        self._link.close()

    def condition(self) -> Condition:
        """Whether it is connected."""
        return line_condition(self._link.is_open)

    def read(self) -> Mapping[str, ProbeReading]:
        """Its quantities now. Raises DeviceError, NoReading if it cannot measure."""
        try:
            values = {name: self._link.number_of(name) for name in self._quantities}
        except Rejected as error:
            raise NoReading(error.reason, error.remedy) from error
        return {
            name: ProbeReading(value, PROBE_UNITS[name], self._uncertainties.get(name))
            for name, value in values.items()
        }

    def emergency_stop(self) -> None:
        """Nothing moves."""


@dataclass(frozen=True, kw_only=True)
class AlpacaProbeOptions(NumberedOptions):
    """Options of driver "alpaca_probe"."""

    temperature_uncertainty: Uncertainty | None = None
    humidity_uncertainty: Uncertainty | None = None
    pressure_uncertainty: Uncertainty | None = None

    def make(self, parts: MakerContext) -> AlpacaProbe:
        """The probe."""
        return AlpacaProbe(self.at, self.device, {name: getattr(self, f"{name}_uncertainty") for name in QUANTITIES})
