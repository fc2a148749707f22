"""A distance sensor of a package outside: its options and its maker in one file."""

from dataclasses import dataclass
from typing import Annotated

from drivers.interfaces import Condition, Identity
from drivers.making import DriverOptions, MakerContext
from drivers.options import positive


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


@dataclass(frozen=True, kw_only=True)
class FixedOptions(DriverOptions):
    """Its table."""

    distance_mm: Annotated[float, positive("1500")]

    def make(self, parts: MakerContext) -> FixedRangefinder:
        """The sensor."""
        return FixedRangefinder(self.distance_mm)
