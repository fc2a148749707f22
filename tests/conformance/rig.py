"""A device under test with its clock and its surroundings."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from simulators.bench.bench import SimulatedBench
from station.bench.conform import StageRig


class Machine(Protocol):
    """A controller with its motors, as accessible to a person beside it."""

    line_stays: bool
    """Whether its power can fail without its line."""

    def cut_power(self, off_s: float, with_line: bool) -> None:
        """Switch it off, and on again so much later."""
        ...

    def set(self, *lines: str) -> None:
        """Write settings, from somewhere else than where the driver is."""
        ...

    def standing(self) -> tuple[float, ...]:
        """Where its axes are, whatever it assumes itself; () if unknown."""
        ...


@dataclass
class Rig:
    """A device under test, its clock, the simulated bench behind it (None at a real port).

    `carried` gives the position of the camera on a shaker; `places` are where a stage is sent, as parts of its travel;
    `pulse_error_s` is what a shutter is held to: across a network its server's answers are part of it.
    `machine` is what a person can do to a GRBL, and see of it, without its line.
    """

    device: Any
    clock: Any
    bench: SimulatedBench | None
    carried: Callable[[], tuple[float, float]] | None = None
    places: tuple[float, ...] = (0.5, 0.25, 1.0, 0.0, 0.75)
    pulse_error_s: float = 0.005
    machine: Machine | None = None

    def together(self, *works: Callable[[], object]) -> list[object]:
        """Do these at the same time; outcomes."""
        return StageRig(self.device, self.clock).together(*works)
