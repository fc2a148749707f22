"""A distance sensor of a package outside: its options and its maker in one file."""

from __future__ import annotations

from typing import Any

from drivers.interfaces import Condition, Identity
from station.bench.device_makers import MakerContext
from station.bench.device_options import DriverEntry, NumberOption, Option, Options


class FixedRangefinder:
    """Reports one distance."""

    def __init__(self, distance_mm: float) -> None:
        self.distance_mm = distance_mm

    def connect(self) -> Identity:
        """Nothing to connect."""
        return Identity("Fixed", "1.0", "", "nowhere")

    def condition(self) -> Condition:
        """Always usable."""
        return Condition("ready", True)

    def measure_mm(self) -> float:
        """The distance."""
        return self.distance_mm

    def emergency_stop(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing to close."""


def make(name: str, parts: MakerContext, **options: Any) -> FixedRangefinder:
    """The sensor."""
    return FixedRangefinder(**options)


DRIVER = DriverEntry(make, Options({"distance_mm": Option(NumberOption("1500", 0.0, above=True), required=True)}))
