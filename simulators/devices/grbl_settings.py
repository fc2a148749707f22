"""The `$` settings of GRBL 1.1 and its derivatives: which exist, and which values are accepted."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simulators.devices.grbl_code import Modes

FEED_MM_MIN, ACCELERATION_MM_S2 = 3000.0, 200.0
COMMON: dict[int, float] = {
    0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0, 20: 1, 21: 0, 22: 1, 23: 0, 24: 300,
    25: 3000, 26: 250, 27: 1, 30: 1000, 31: 0, 32: 0,
}  # fmt: skip
"""Settings of a bench: homing and soft limits on, motors always held."""
HAL: dict[int, float] = {
    9: 1, 14: 0, 15: 0, 17: 0, 18: 0, 19: 0, 28: 0.1, 29: 0, 33: 5000, 34: 0, 35: 0, 36: 100, 37: 0, 39: 1, 40: 0,
    41: 0, 42: 2, 43: 1, 44: 4, 45: 3, 46: 0, 56: 5, 57: 100, 58: -5, 59: 500, 60: 0, 61: 0, 62: 0, 63: 3, 64: 0,
    65: 0, 341: 0, 342: 30, 343: 25, 344: 200, 345: 200, 346: 1, 384: 0, 392: 4, 393: 1, 394: 0, 398: 100, 481: 0,
    485: 0, 486: 0, 539: 0, 673: 0, 676: 15, 680: 0,
}  # fmt: skip
"""Additional settings of grblHAL."""
FLUID = (10, 20, 21, 22, 23, 30, 32)
"""GRBL's numbers that FluidNC shows, besides those of the axes; all but the first are stored in its configuration."""
HAL_ONE_DECIMAL = {0, 24, 25, 29, 33, 34, 35, 36, 56, 57, 58, 59, 342, 343, 344, 345, 392, 393, 394, 539, 673}
THREE_DECIMALS = {11, 12, 24, 25, 27, 28}
BANNERS = {
    "GRBL": "Grbl 1.1h ['$' for help]",
    "grblHAL": "GrblHAL 1.1f ['$' or '$HELP' for help]",
    "FluidNC": "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
}
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")


def default_settings(travels: Sequence[float], variant: str = "GRBL") -> dict[int, float]:
    """`$n` of a bench with these travels."""
    settings = COMMON | ({**HAL, 10: 511} if variant == "grblHAL" else {})
    for i, travel in enumerate(travels):
        settings |= {100 + i: 250, 110 + i: FEED_MM_MIN, 120 + i: ACCELERATION_MM_S2, 130 + i: travel}
    return settings


def locked_at_first(settings: Mapping[int, float], variant: str) -> bool:
    """Whether it refuses motion after power-up: homing is on; on grblHAL bit 2 of `$22` must be set, too."""
    wanted = 5 if variant == "grblHAL" else 1
    return int(settings[22]) & wanted == wanted


def settings_lines(settings: Mapping[int, float], variant: str) -> list[str]:
    """The answer to `$$`."""
    shown = sorted(settings)
    if variant == "FluidNC":
        shown = [number for number in shown if number in FLUID or 100 <= number < 140]
    return [f"${number}={_shown(number, settings[number], variant)}" for number in shown]


def _shown(number: int, value: float, variant: str) -> str:
    if variant == "grblHAL":
        long = number in THREE_DECIMALS | {30, 31} or 110 <= number < 140
        digits = 5 if 100 <= number < 110 else 1 if number in HAL_ONE_DECIMAL else 3 if long else 0
        return f"{value:.{digits}f}"
    return f"{value:.3f}" if number in THREE_DECIMALS or number >= 100 else f"{value:.0f}"


def assign(settings: dict[int, float], line: str, variant: str) -> int:
    """Execute `$n=v`; returns the error number, or 0."""
    number = _NUMBER.match(line, 1)
    if number is None:
        return 3 if variant == "grblHAL" else 2
    if line[number.end() : number.end() + 1] != "=":
        return 3
    value = _NUMBER.match(line, number.end() + 1)
    if value is None:
        return 2
    if value.end() != len(line):
        return 3
    return _store(settings, int(float(number[0])), float(value[0]), variant)


def _store(settings: dict[int, float], number: int, value: float, variant: str) -> int:
    if value < 0:
        return 2 if variant == "grblHAL" else 4
    if number not in settings or (variant == "FluidNC" and number != 10):
        return 3
    if number == 0 and value < 3:
        return 6
    if number == 20 and value and not int(settings[22]) & 1:
        return 10
    if number == 22 and not int(value):
        settings[20] = 0
    whole = number not in THREE_DECIMALS and not 30 <= number <= 31 and number < 100
    flag = variant == "GRBL" and number in (4, 5, 6, 13, 20, 21, 22, 32)
    settings[number] = float(bool(int(value))) if flag else float(int(value)) if whole else value
    return 0


def config_item(settings: Mapping[int, float], letters: str, path: str, forced_origin: bool) -> str | None:
    """The value of one item of FluidNC's configuration, for this machine; None if it does not exist."""
    machine = {"stepping/idle_ms": f"{settings[1]:.0f}", "report_inches": _word(settings[13])}
    if path in machine:
        return machine[path]
    parts = path.split("/")
    if len(parts) < 3 or parts[0] != "axes" or parts[1].upper() not in letters:
        return None
    at = letters.index(parts[1].upper())
    down = bool(int(settings[23]) >> at & 1)
    length = settings[130 + at]
    items = {
        "steps_per_mm": settings[100 + at],
        "max_rate_mm_per_min": settings[110 + at],
        "acceleration_mm_per_sec2": settings[120 + at],
        "max_travel_mm": length,
        "homing/feed_mm_per_min": settings[24],
        "homing/seek_mm_per_min": settings[25],
        "motor0/pulloff_mm": settings[27],
        "homing/mpos_mm": 0.0 if forced_origin or not down else -length,
    }
    switches = {"soft_limits": settings[20], "motor0/hard_limits": settings[21], "homing/positive_direction": not down}
    item = "/".join(parts[2:])
    if item in switches:
        return _word(switches[item])
    return f"{items[item]:.3f}" if item in items else None


def _word(on: float | bool) -> str:
    return "true" if on else "false"


def identity(variant: str, asked: str, letters: str, rx_bytes: int, note: str, options: str) -> list[str]:
    """The answer to `$I` or `$I+`; empty if the firmware does not know the query."""
    if variant == "grblHAL":
        return [
            f"[VER:1.1f.20260817:{note}]", f"[OPT:VNML+{options},100,{rx_bytes},{len(letters)},0]",
            f"[AXS:{len(letters)}:{letters}]", "[NEWOPT:ENUMS,RT+,TC,SED]", "[FIRMWARE:grblHAL]", "[SIGNALS:D]",
            "[NVS STORAGE:*EEPROM]", "[DRIVER:Simulator]", "[DRIVER VERSION:260324]",
        ]  # fmt: skip
    if asked == "$I+":
        return []
    if variant == "FluidNC":
        return [f"[VER:3.7 FluidNC v3.7.8 (esp32-wifi) :{note}]", "[OPT:PHSEW]", "[MSG:INFO: Machine: Bench]"]
    return [f"[VER:1.1h.20190830:{note}]", f"[OPT:V{options},15,{rx_bytes}]"]


# --- GRBL's reports: the status report with its occasional fields, offsets, modes ---

BUSY = ("Run", "Jog", "Hold", "Door", "Home")
OFFSETS_EVERY = {True: 30, False: 10}
OVERRIDES_EVERY = {True: 20, False: 10}
"""Number of reports between two occurrences of a field, while moving and at rest."""


@dataclass
class Counters:
    """Counts reports to decide which one carries the offsets and the overrides next."""

    offsets: int = 0
    overrides: int = 0
    outputs: str = ""
    fresh: bool = True

    def offsets_due(self, busy: bool) -> bool:
        """Whether this report carries WCO; the next one then carries Ov."""
        if self.offsets > 0:
            self.offsets -= 1
            return False
        self.offsets = OFFSETS_EVERY[busy] - 1
        self.overrides = self.overrides or 1
        return True

    def overrides_due(self, busy: bool) -> bool:
        """Whether this report carries Ov."""
        if self.overrides > 0:
            self.overrides -= 1
            return False
        self.overrides = OVERRIDES_EVERY[busy] - 1
        return True


@dataclass(frozen=True)
class State:
    """All values of a status report; lengths in mm."""

    name: str
    machine: Sequence[float]
    offset: Sequence[float]
    feed: float
    speed: float
    free_blocks: int
    free_bytes: int
    overrides: Sequence[int]
    outputs: str
    switches: str
    homed: str | None = None
    job: str = ""


def numbers(values: Sequence[float], inches: bool) -> str:
    """Comma-separated lengths: three decimals of a millimetre, four of an inch."""
    return ",".join(f"{value / 25.4 + 0.0:.4f}" if inches else f"{value + 0.0:.3f}" for value in values)


def status(state: State, settings: Mapping[int, float], counters: Counters, variant: str) -> str:
    """One report between `<` and `>`."""
    inches, mask = settings[13] == 1, int(settings[10])
    busy = state.name.partition(":")[0] in BUSY
    place = state.machine if mask & 1 else [a - b for a, b in zip(state.machine, state.offset, strict=True)]
    fields = [state.name, ("MPos:" if mask & 1 else "WPos:") + numbers(place, inches)]
    if mask & 2:
        fields.append(f"Bf:{state.free_blocks},{state.free_bytes}")
    feed = f"{state.feed / 25.4:.1f}" if inches and variant != "grblHAL" else f"{state.feed:.0f}"
    fields.append(f"FS:{feed},{state.speed:.0f}")
    if state.switches:
        fields.append("Pn:" + state.switches)
    now_and_then = _of_grblhal if variant == "grblHAL" else _now_and_then
    fields += now_and_then(state, counters, "WCO:" + numbers(state.offset, inches), busy=busy)
    if state.homed is not None:
        fields.append("H:" + state.homed)
    if state.job:
        fields.append(state.job)
    return "<" + "|".join(fields) + ">"


def _now_and_then(state: State, counters: Counters, offsets: str, *, busy: bool) -> list[str]:
    """The fields that only some reports carry."""
    fields = [offsets] if counters.offsets_due(busy) else []
    if counters.overrides_due(busy):
        fields.append("Ov:" + ",".join(map(str, state.overrides)))
        if state.outputs:
            fields.append(f"A:{state.outputs}")
    return fields


def _of_grblhal(state: State, counters: Counters, offsets: str, *, busy: bool) -> list[str]:
    """These fields in grblHAL: overrides first, outputs also when they change, TLR after a reset."""
    changed, counters.outputs = counters.outputs != state.outputs, state.outputs
    fields = []
    if counters.overrides_due(busy):
        fields = ["Ov:" + ",".join(map(str, state.overrides)), f"A:{state.outputs}"]
        fields += ["TLR:0"] if counters.fresh else []
        counters.offsets = 0 if counters.fresh else counters.offsets
        counters.fresh = False
    elif counters.offsets_due(busy):
        fields = [offsets]
    return [*fields, f"A:{state.outputs}"] if changed and not any(one.startswith("A:") for one in fields) else fields


def modes_line(modes: Modes, inches: bool, variant: str) -> str:
    """The answer to `$G`."""
    more = " G40 G49 G98 G50" if variant == "grblHAL" else ""
    feed = f"{modes.feed / 25.4:.1f}" if inches else f"{modes.feed:.0f}"
    active = (modes.motion, modes.system, modes.plane, modes.units, modes.distance, modes.feed_mode)
    words = " ".join(f"G{number}" for number in active)
    speed = f"{modes.speed:.0f}" + ("." if more else "")
    return f"[GC:{words}{more} M{modes.spindle} M{modes.flood} T{modes.tool} F{feed} S{speed}]"


def offsets_lines(
    systems: Mapping[float, Sequence[float]], shift: Sequence[float], length: float, inches: bool, variant: str
) -> list[str]:
    """The answer to `$#`: coordinate systems, stored positions, G92 and G43.1 offsets, the last probing."""
    none = [0.0] * len(shift)
    lines = [f"[G{name:g}:{numbers(place, inches)}]" for name, place in systems.items()]
    lengths = [0.0, 0.0, length] if variant == "grblHAL" else [length]
    last = [f"[TLO:{numbers(lengths, inches)}]", f"[PRB:{numbers(none, inches)}:0]"]
    return [*lines, f"[G92:{numbers(shift, inches)}]", *last]
