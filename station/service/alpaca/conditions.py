"""A probe of the bench as an Alpaca device for conditions: temperature, humidity, pressure, and the dew point."""

import math
from collections.abc import Mapping
from typing import Any, cast

from drivers.errors import DeviceError
from drivers.interfaces import Probe
from station.service.alpaca.device import AlpacaDevice, Member, absent, constant, not_implemented
from station.service.alpaca.protocol import INVALID_VALUE, AlpacaError, Parameters
from station.service.bench_state import ServedBench

MEASURED = ("temperature", "humidity", "pressure")
ABSENT = (
    "cloudcover", "rainrate", "skybrightness", "skyquality", "skytemperature", "starfwhm", "winddirection", "windgust",
    "windspeed",
)  # fmt: skip
"""Sensors of the standard that no probe of a bench has."""
MAGNUS, MAGNUS_C = 17.62, 243.12
"""Constants of the saturation vapour pressure over water; WMO, Guide to Instruments (WMO-No. 8), annex 4.B."""


class ProbeConditions(AlpacaDevice):
    """IObservingConditionsV2. Every value is read from the probe when it is requested."""

    interface_version = 2
    type_name = "ObservingConditions"

    def __init__(self, served: ServedBench, number: int, probe: str) -> None:
        assert served.bench is not None
        self._probe = cast(Probe, served.bench.devices[probe])
        super().__init__(served, "observingconditions", number, probe, {probe: self._probe})

    def readable(self) -> Mapping[str, Member]:
        return {
            **{name: (lambda given, name=name: self._value(name)) for name in MEASURED},  # type: ignore[misc]
            "averageperiod": constant(0.0),
            "dewpoint": lambda given: self._dew_point(),
            "sensordescription": lambda given: f"{self._sensor(given)} of the probe {self.name}",
            "timesincelastupdate": self._since_update,
            **absent(*ABSENT),
        }

    def writable(self) -> Mapping[str, Member]:
        return {"averageperiod": self._average, "refresh": constant(None)}

    def state(self) -> Mapping[str, Any]:
        """The measured values; none while the probe cannot measure."""
        try:
            return {name.capitalize(): one.value for name, one in self._probe.read().items() if name in MEASURED}
        except DeviceError:
            return {}

    def _value(self, name: str) -> float:
        readings = self._probe.read()
        if name not in readings:
            raise not_implemented(name)
        return readings[name].value

    def _dew_point(self) -> float:
        ratio = math.log(max(self._value("humidity"), 1e-3) / 100)
        temperature_c = self._value("temperature")
        ratio += MAGNUS * temperature_c / (MAGNUS_C + temperature_c)
        return MAGNUS_C * ratio / (MAGNUS - ratio)

    def _average(self, given: Parameters) -> None:
        hours = given.number("AveragePeriod")
        if hours != 0:
            raise AlpacaError(INVALID_VALUE, f"AveragePeriod can be 0 only: values are not averaged; got {hours:g}")

    def _since_update(self, given: Parameters) -> float:
        """0: values are read when they are requested. An empty name means any sensor."""
        if given.text("SensorName"):
            self._sensor(given)
        return 0.0

    def _sensor(self, given: Parameters) -> str:
        name = given.text("SensorName").lower()
        if name in ABSENT:
            raise not_implemented(name)
        if name not in (*MEASURED, "dewpoint"):
            raise AlpacaError(INVALID_VALUE, f"SensorName must be the name of a sensor; got {name[:40]!r}")
        for needed in ("humidity", "temperature") if name == "dewpoint" else (name,):
            self._value(needed)
        return name
