"""GRBL's reports: the status report with its occasional fields, offsets, modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simulators.devices.grbl_code import Modes

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
