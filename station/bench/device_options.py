"""Options of each driver in station.toml: names, allowed values, examples."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Protocol

from station.common.toml_text import toml_value


class Rule(Protocol):
    """A condition on a value."""

    @property
    def words(self) -> str:
        """The condition, to follow "must be"."""
        ...

    @property
    def example(self) -> str:
        """An example value, as written in the file."""
        ...

    def holds(self, value: Any) -> bool:
        """Whether a value satisfies the condition."""
        ...


@dataclass(frozen=True)
class NumberOption:
    """A number between two limits; the low one is excluded if `above`."""

    example: str
    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    @property
    def words(self) -> str:
        """The condition as text."""
        if self.low == -math.inf:
            return "a number"
        if self.high < math.inf:
            return f"a number {'above' if self.above else 'from'} {self.low:g} up to {self.high:g}"
        return f"a number above {self.low:g}" if self.above else f"a number not below {self.low:g}"

    def holds(self, value: Any) -> bool:
        """Whether the value is such a number."""
        if type(value) not in (int, float) or not math.isfinite(value):
            return False
        return self.low <= value <= self.high and not (self.above and value == self.low)


@dataclass(frozen=True)
class Integer:
    """An integer between two limits, both included."""

    example: str
    low: int
    high: int

    @property
    def words(self) -> str:
        """The condition as text."""
        return f"a whole number from {self.low} to {self.high}"

    def holds(self, value: Any) -> bool:
        """Whether the value is such an integer."""
        return type(value) is int and self.low <= value <= self.high


@dataclass(frozen=True)
class OneOf:
    """One of these values."""

    values: tuple[Any, ...]

    @property
    def words(self) -> str:
        """The condition as text."""
        return "one of " + ", ".join(map(toml_value, self.values))

    @property
    def example(self) -> str:
        """The first value."""
        return toml_value(self.values[0])

    def holds(self, value: Any) -> bool:
        """Whether the value is one of them."""
        return any(type(value) is type(allowed) and value == allowed for allowed in self.values)


@dataclass(frozen=True)
class Quoted:
    """Text that is not empty, and matches the pattern if there is one."""

    example: str
    words: str = "text in quotes"
    pattern: str = r"(?s).*\S.*"

    def holds(self, value: Any) -> bool:
        """Whether the value is such text."""
        return isinstance(value, str) and re.fullmatch(self.pattern, value) is not None


@dataclass(frozen=True)
class Interval:
    """The low and the high end of a range."""

    example: str = "[-300.0, 0.0]"
    words: str = "two numbers, the smaller one first"

    def holds(self, value: Any) -> bool:
        """Whether the value is such a pair."""
        number = NumberOption("0")
        return isinstance(value, list) and len(value) == 2 and all(map(number.holds, value)) and value[0] < value[1]


@dataclass(frozen=True)
class ListOf:
    """A list of distinct values, at least one, each under the same rule."""

    each: Rule

    @property
    def words(self) -> str:
        """The condition as text."""
        return f"a list in [ ] with at least one value, each {self.each.words}, none twice"

    @property
    def example(self) -> str:
        """A list of one value."""
        return f"[{self.each.example}]"

    def holds(self, value: Any) -> bool:
        """Whether the value is such a list."""
        good = isinstance(value, list) and value and all(map(self.each.holds, value))
        return bool(good) and len(set(value)) == len(value)


@dataclass(frozen=True)
class Option:
    """One key: its rule, and whether it is required."""

    rule: Rule
    required: bool = False


@dataclass(frozen=True)
class Options:
    """The keys of a table; `rows` are those of each table in its list of axes, which must differ in `unlike`."""

    keys: Mapping[str, Option]
    rows: Mapping[str, Option] | None = None
    unlike: tuple[tuple[str, ...], ...] = ()


PORT = Option(Quoted('"/dev/ttyUSB0"', "the name of a port in quotes"), required=True)
MAYBE_PORT = Option(PORT.rule)
BAUD = Option(Integer("115200", 300, 4_000_000))
NAME = Option(Quoted('"z_mm"', "a name that ends in its unit, _mm or _deg", r"[a-z][a-z0-9_]*_(mm|deg)"), required=True)
FOLDER = Option(Quoted('"incoming"', "the name of a folder in quotes"), required=True)
DEVICE = Quoted('"stage"', "the name of a device in quotes")
SECONDS = Option(NumberOption("0.5", 0.0))
POLL = Option(NumberOption("0.2", 0.0, 5.0, above=True))
LAMP = {"warm_up_s": SECONDS, "pwm_hz": Option(NumberOption("1000", 0.0))}
LINE = {"port": PORT, "baud": BAUD}
LATENCY = {"latency_s": Option(NumberOption("0.012", 0.0)), "latency_within_s": Option(NumberOption("0.001", 0.0))}
ON_A_STAGE = {"on": Option(DEVICE), "port": MAYBE_PORT}
CORE = {
    "config": Option(Quoted('"microscope.cfg"', "the name of a configuration file in quotes"), required=True),
    "adapters": Option(Quoted('"/opt/micro-manager"', "the folder of Micro-Manager's adapters in quotes")),
}
LABEL = Option(Quoted('"Camera"', "a device's label in that configuration in quotes"), required=True)
FRAMES = {
    "folder": FOLDER,
    "f_number": Option(NumberOption("4.0", 0.0, above=True)),
    "focal_length_mm": Option(NumberOption("25", 0.0, above=True)),
    "lens": Option(Quoted('"Lens 25 mm"')),
    "pixel_pitch_um": Option(NumberOption("3.45", 0.0, above=True)),
    "black": Option(NumberOption("64", 0.0)),
}
HOST_AND_PORT = r"(\[[^\]\s]+\]|[^:@\s/]+):\d{1,5}"
SERVER = {
    "server": Option(Quoted('"192.168.1.20:11111"', "address and port of a server in quotes", HOST_AND_PORT), True),
    "password_variable": Option(
        Quoted('"STATION_TOKEN"', "the name of a variable of the environment", r"[A-Za-z_]\w*")
    ),
}
COUNTED = Integer("0", 0, 2**16)
ALPACA = {**SERVER, "device": Option(COUNTED)}
PATIENCE = Option(NumberOption("60", 0.0, above=True))

OPTIONS: dict[str, Options] = {
    "grbl": Options(
        {**LINE, "poll_s": POLL, "reset_on_open": Option(OneOf(("expect", "avoid")))},
        {
            "name": NAME,
            "letter": Option(OneOf(("X", "Y", "Z", "A", "B", "C")), required=True),
            "feed_per_min": Option(NumberOption("1500", 0.0, above=True), required=True),
            "origin": Option(NumberOption("0.0")),
            "direction": Option(OneOf((1, -1))),
            "travel": Option(NumberOption("300", 0.0, above=True)),
            "space": Option(Interval()),
        },
        (("name",), ("letter",)),
    ),
    "zaber": Options(
        {**LINE, "poll_s": POLL},
        {
            "name": NAME,
            "device": Option(Integer("1", 1, 99), required=True),
            "axis": Option(Integer("1", 1, 9)),
            "unit_per_step": Option(NumberOption("0.000234375", 0.0, above=True), required=True),
            "zero": Option(NumberOption("0.0")),
            "speed_per_s": Option(NumberOption("10", 0.0, above=True)),
        },
        (("name",), ("device", "axis")),
    ),
    "tmcl_stage": Options(
        {
            **LINE,
            "poll_s": POLL,
            "patience_s": Option(NumberOption("60", 0.0, above=True)),
            "variable": Option(Integer("55", 0, 255)),
        },
        {
            "name": NAME,
            "motor": Option(Integer("0", 0, 15), required=True),
            "travel": Option(Interval("[0.0, 300.0]"), required=True),
            "unit_per_step": Option(NumberOption("0.003125", 0.0, above=True), required=True),
            "module": Option(Integer("1", 1, 255)),
            "zero": Option(NumberOption("0.0")),
            "direction": Option(OneOf((1, -1))),
        },
        (("name",), ("module", "motor")),
    ),
    "strig": Options(LINE),
    "strig_shaker": Options(
        {"box": Option(DEVICE, required=True)},
        {
            "name": NAME,
            "channel": Option(OneOf((0, 1)), required=True),
            "stroke": Option(NumberOption("2.0", 0.0, above=True), required=True),
            "direction": Option(OneOf((1, -1))),
            "frequency_hz": Option(NumberOption("80", 0.0, above=True)),
            "damping": Option(NumberOption("0.5", 0.0, above=True)),
            "gain": Option(NumberOption("1", 0.0, above=True)),
            "within_s": Option(NumberOption("0.0005", 0.0)),
        },
        (("name",), ("channel",)),
    ),
    "strig_watchdog": Options({"box": Option(DEVICE, required=True), "stages": Option(ListOf(DEVICE), required=True)}),
    "rts": Options({"port": PORT}),
    "relay": Options(ON_A_STAGE),
    "folder": Options(
        {
            "folder": FOLDER,
            "shutter": Option(DEVICE, required=True),
            "pulse_s": Option(NumberOption("0.1", 0.0, above=True)),
            "focus_s": SECONDS,
            "bulb": Option(OneOf((True, False))),
            "rest_s": SECONDS,
            "patience_s": Option(NumberOption("20", 0.0, above=True)),
            "poll_s": POLL,
        }
    ),
    "gphoto": Options(
        {
            "folder": FOLDER,
            "model": Option(Quoted('"Canon EOS R5"')),
            "port": Option(Quoted('"usb:001,004"', "libgphoto2's name of a port in quotes")),
            "shutter": Option(DEVICE),
        }
    ),
    "micromanager_stage": Options(
        {**CORE, "patience_s": Option(NumberOption("60", 0.0, above=True))},
        {
            "name": NAME,
            "device": Option(Quoted('"Z"', "a device's label in that configuration in quotes"), required=True),
            "travel": Option(Interval("[0.0, 25.0]"), required=True),
            "part": Option(OneOf(("x", "y"))),
            "zero": Option(NumberOption("0.0")),
            "unit_per_um": Option(NumberOption("0.001", 0.0, above=True)),
            "direction": Option(OneOf((1, -1))),
            "homes": Option(OneOf((True, False))),
            "tolerance": Option(NumberOption("0.005", 0.0, above=True)),
        },
        (("name",), ("device", "part")),
    ),
    "micromanager_camera": Options(
        {**CORE, "device": LABEL, **FRAMES, "mosaic": Option(OneOf(("none", "RGGB", "BGGR", "GRBG", "GBRG")))}
    ),
    "micromanager_shutter": Options({**CORE, "device": Option(Quoted('"Shutter"'), required=True)}),
    "genicam": Options(
        {
            "camera": Option(Quoted('"192.168.1.20"', "a camera's name or address in quotes")),
            "pixel_format": Option(
                Quoted(
                    '"BayerRG12p"', "a grey or Bayer pixel format of 8 to 16 bits", r"(Mono|Bayer(RG|BG|GR|GB))\d+\w*"
                )
            ),
            "gain_db": Option(NumberOption("0.0")),
            "patience_s": Option(NumberOption("5", 0.0, above=True)),
            **FRAMES,
        }
    ),
    "alpaca_stage": Options(
        {**SERVER, "patience_s": PATIENCE},
        {
            "name": NAME,
            "focuser": Option(COUNTED, required=True),
            "unit_per_step": Option(NumberOption("0.001", 0.0, above=True)),
            "zero": Option(NumberOption("0.0")),
            "direction": Option(OneOf((1, -1))),
            "home": Option(Quoted('"Home"', "the name of the focuser's action that homes it in quotes")),
        },
        (("name",), ("focuser",)),
    ),
    "alpaca_camera": Options(
        {**ALPACA, "exposure_s": Option(NumberOption("0.1", 0.0, above=True)), "patience_s": PATIENCE, **FRAMES}
    ),
    "alpaca_light": Options({**ALPACA, "switch": Option(COUNTED, required=True), **LAMP}),
    "alpaca_shutter": Options({**ALPACA, "switch": Option(COUNTED, required=True)}),
    "strig_imu": Options({"box": Option(DEVICE, required=True)}),
    "wit": Options({**LINE, **LATENCY}),
    "fast": Options(
        {
            **LINE,
            **LATENCY,
            "full_scale_g": Option(NumberOption("8", 0.0, above=True)),
            "full_scale_deg_s": Option(NumberOption("500", 0.0, above=True)),
        }
    ),
    "jrt": Options(LINE),
    "bosch": Options(LINE),
    "dmx": Options({"port": PORT, "channels": Option(ListOf(Integer("1", 1, 512))), **LAMP}),
    "grbl_light": Options({**ON_A_STAGE, **LAMP}),
}
STAGES, SHUTTERS = ("grbl",), ("strig", "rts", "relay", "micromanager_shutter", "alpaca_shutter")
REFERS = {
    "on": (STAGES, "GRBL stage"),
    "shutter": (SHUTTERS, "shutter"),
    "box": (("strig",), "STRIG box"),
    "stages": (("grbl", "tmcl_stage"), "stage with a motor enable input"),
}
"""Keys that name other devices, the drivers allowed for these, and their description."""


def named(table: Mapping[str, Any], key: str) -> list[str]:
    """The devices named by a key of `REFERS`."""
    names = table.get(key, [])
    return names if isinstance(names, list) else [names]


EITHER = {"relay": ("on", "port"), "grbl_light": ("on", "port")}
"""Drivers that require one of two keys."""


# --- drivers of other packages ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DriverEntry:
    """A driver of another package: what its entry point in the group `station.drivers` names.

    Attributes
    ----------
    make : callable
        Makes the device: `make(name, parts, **options)`, `parts` as `station.bench.device_makers.Parts`.
    options : Options
        The keys of its table in station.toml.
    twin : callable, optional
        Makes its simulation for `station conform`, see `station.bench.conform.Twin`.
    """

    make: Callable[..., Any]
    options: Options
    twin: Callable[[], Any] | None = None


GROUP = "station.drivers"


@cache
def added_drivers() -> dict[str, DriverEntry]:
    """The drivers of installed packages by name; a built-in one cannot be replaced."""
    return {one.name: one.load() for one in entry_points(group=GROUP) if one.name not in OPTIONS}


def driver_names() -> list[str]:
    """All drivers, the built-in ones first."""
    return [*OPTIONS, *added_drivers()]


def options_of(driver: str) -> Options:
    """The options of a driver. Raises KeyError where there is none of that name."""
    return OPTIONS[driver] if driver in OPTIONS else added_drivers()[driver].options
