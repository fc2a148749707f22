"""Lamp, release contact, laser and distance of the bench as one Alpaca switch device."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from drivers.interfaces import Device, Light, Rangefinder, Shutter
from station.bench.opening import Bench
from station.service.alpaca.device import AlpacaDevice, Member, constant, not_implemented
from station.service.alpaca.protocol import INVALID_VALUE, NOT_IMPLEMENTED, AlpacaError, Parameters
from station.service.bench_state import ServedBench

PULSE_S = 0.1
FARTHEST_MM = 1e5


@dataclass(frozen=True)
class SwitchLine:
    """One switch: its range, reading, and writing (None: read only)."""

    name: str
    description: str
    highest: float
    step: float
    read: Callable[[], float]
    write: Callable[[float], None] | None = None


class BenchSwitch(AlpacaDevice):
    """ISwitchV3 of the bench's devices."""

    interface_version = 3

    def __init__(self, served: ServedBench, number: int) -> None:
        assert served.bench is not None
        self._lines = lines_of(served.bench)
        has = ("light", "shutter", "rangefinder")
        devices: dict[str, Device] = {name: served.bench.devices[name] for name in has if name in served.bench.devices}
        super().__init__(served, "switch", number, "lamp, shutter and laser", devices)

    def readable(self) -> Mapping[str, Member]:
        return {
            "maxswitch": constant(len(self._lines)),
            "canasync": self._of(lambda line: False),
            "canwrite": self._of(lambda line: line.write is not None),
            "getswitch": self._of(lambda line: line.read() > 0),
            "getswitchdescription": self._of(lambda line: line.description),
            "getswitchname": self._of(lambda line: line.name),
            "getswitchvalue": self._of(lambda line: line.read()),
            "maxswitchvalue": self._of(lambda line: line.highest),
            "minswitchvalue": self._of(lambda line: 0.0),
            "switchstep": self._of(lambda line: line.step),
            "statechangecomplete": self._absent("StateChangeComplete"),
        }

    def writable(self) -> Mapping[str, Member]:
        return {
            "setswitch": lambda given: self._set(self._line(given), given.flag("State") * self._line(given).highest),
            "setswitchvalue": lambda given: self._set(self._line(given), given.number("Value")),
            "setasync": self._absent("SetAsync"),
            "setasyncvalue": self._absent("SetAsyncValue"),
            "cancelasync": self._absent("CancelAsync"),
            "setswitchname": self._absent("SetSwitchName"),
        }

    def _line(self, given: Parameters) -> SwitchLine:
        number = given.whole("Id")
        if not 0 <= number < len(self._lines):
            raise AlpacaError(INVALID_VALUE, f"Id must be between 0 and {len(self._lines) - 1}; got {number}")
        return self._lines[number]

    def _of(self, ask: Callable[[SwitchLine], Any]) -> Member:
        return lambda given: ask(self._line(given))

    def _absent(self, name: str) -> Member:
        def refuse(given: Parameters) -> Any:
            self._line(given)
            raise not_implemented(name)

        return refuse

    def _set(self, line: SwitchLine, value: float) -> None:
        if line.write is None:
            raise AlpacaError(NOT_IMPLEMENTED, f"{line.name} is read only")
        if not 0 <= value <= line.highest:
            raise AlpacaError(
                INVALID_VALUE, f"Value must be between 0 and {line.highest:g} for {line.name}; got {value:g}"
            )
        with self.served.tenancy.held(f"the switching of {line.name}"):
            line.write(value)


def lines_of(bench: Bench) -> Sequence[SwitchLine]:
    """The switches of a bench, in order, for the devices it has."""
    lines: list[SwitchLine] = []
    if "light" in bench.devices:
        lamp = cast(Light, bench.devices["light"])
        lines.append(SwitchLine("light", "level of the lamp, 1 is full light", 1.0, 0.01, lamp.level, lamp.set_level))
    if "shutter" in bench.devices:
        shutter = cast(Shutter, bench.devices["shutter"])
        pressed = [0.0]

        def release(value: float) -> None:
            if value > 0:
                shutter.fire(PULSE_S)
            else:
                shutter.abort()

        def focus(value: float) -> None:
            shutter.focus(value > 0)
            pressed[0] = float(value > 0)

        words = f"closes the release contact for {PULSE_S:g} s: one photograph; off opens it at once"
        lines += [
            SwitchLine("release", words, 1.0, 1.0, lambda: 0.0, release),
            SwitchLine("half-press", "the half-pressed button", 1.0, 1.0, lambda: pressed[0], focus),
        ]
    if "rangefinder" in bench.devices:
        lines += laser_of(cast(Rangefinder, bench.devices["rangefinder"]))
    return lines


def laser_of(laser: Rangefinder) -> list[SwitchLine]:
    """The laser spot, and the distance, which every read measures."""
    shining = [0.0]

    def shine(value: float) -> None:
        laser.laser(value > 0)
        shining[0] = float(value > 0)

    return [
        SwitchLine("laser", "the rangefinder's spot, for aiming", 1.0, 1.0, lambda: shining[0], shine),
        SwitchLine(
            "distance", "millimetres, measured on each read", FARTHEST_MM, 0.1, lambda: laser.measure().distance_mm
        ),
    ]
