"""The bench: devices and their answers, homing, manual moves, light, and traffic on the wires."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

from textual import on
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal

from station.app import commands
from station.app.background import Finished
from station.app.bars import brief
from station.app.screens.dialogs import Choose
from station.app.screens.parts import StationScreen
from station.app.widgets import Part, lines_of, literal

if TYPE_CHECKING:
    from drivers.interfaces import Condition
    from station.bench.opening import Bench, DeviceRow

STEPS = (0.01, 0.1, 1.0, 10.0, 100.0)
LIGHT_STEP = 0.1
WIRE_EVERY_S = 0.25


@dataclass(frozen=True)
class MovableAxis:
    """An axis that can be moved: its device and its range."""

    device: str
    name: str
    low: float
    high: float

    @property
    def unit(self) -> str:
        """The unit: the last part of the name."""
        return self.name.rpartition("_")[2]


class BenchScreen(StationScreen):
    """Manual control of the bench."""

    COMMANDS_HERE = commands.BENCH
    BINDINGS: ClassVar[list[BindingType]] = commands.bindings(commands.BENCH)

    def __init__(self) -> None:
        super().__init__()
        self._axes: Sequence[MovableAxis] = ()
        self._positions: Mapping[str, float] = {}
        self._wire_shown: tuple[str, list[str]] = ("", [])
        self._axis, self._step, self._wire = 0, 2, 0
        self._busy = ""
        self._message = ""

    def body(self) -> ComposeResult:
        yield Part(id="rows")
        with Horizontal(id="hand"):
            yield Part(id="axes")
            yield Part(id="wire")
        yield Part(id="message")

    def on_mount(self) -> None:
        super().on_mount()
        self.set_interval(WIRE_EVERY_S, self._show_wire)
        self._show()

    def can(self, command: type[commands.Command]) -> bool:
        """No commands without a bench; only display during a run."""
        if command is commands.NextWire:
            return self.bench is not None
        return self.bench is not None and not self.app.bench_taken  # type: ignore[attr-defined]

    def refresh_frame(self) -> None:
        super().refresh_frame()
        if self.is_mounted:
            self._positions = {**self._positions, **self.app.places}  # type: ignore[attr-defined]
            self._axes = list(_axes(self.bench)) if self.bench is not None else []
            self._show()

    def done(self, finished: Finished) -> None:
        if finished.job.name != "by hand":
            return
        if finished.problem is not None:
            self._say(f"{finished.problem.reason}. {finished.problem.remedy}.")
        elif isinstance(finished.value, CommandOutcome):
            self._positions = finished.value.positions
            self._say(finished.value.words)
        self._show()

    def _say(self, words: str) -> None:
        self._message = words
        self.query_one("#message", Part).update(literal(words, "bold"))

    def _show(self) -> None:
        glyphs = self.query_one("#rows", Part).glyphs
        known: Sequence[DeviceRow] = self.app.rows  # type: ignore[attr-defined]
        conditions = self.app.conditions  # type: ignore[attr-defined]
        rows = [row_in_words(row, conditions.get(row.name, row.condition), glyphs.good, glyphs.bad) for row in known]
        self.query_one("#rows", Part).update(lines_of(*(rows or ["" if self.bench else self._without()])))
        lines = [f"Manual moves, in steps of {STEPS[self._step]:g}"]
        for i, axis in enumerate(self._axes):
            at = f"{self._positions[axis.name]:z.3f}" if axis.name in self._positions else "?"
            mark = glyphs.now if i == self._axis else " " * len(glyphs.now)
            lines.append(f"{mark} {axis.name:10} {at:>10}  ({axis.low:.4g} to {axis.high:.4g})")
        self.query_one("#axes", Part).update(lines_of(*lines))
        if self.app.bench_taken != self._busy:  # type: ignore[attr-defined]
            before, self._busy = self._busy, self.app.bench_taken  # type: ignore[attr-defined]
            if self._busy or self._message == before:  # keep the outcome of a later command
                self._say(self._busy)
        self._show_wire()

    def _without(self) -> str:
        return str(self.app.why_no_bench)  # type: ignore[attr-defined]

    def _show_wire(self) -> None:
        part, bench = self.query_one("#wire", Part), self.bench
        wires = {} if bench is None else bench.transcripts
        if not wires or not self.is_active:
            return
        name = list(wires)[self._wire % len(wires)]
        messages = wires[name].last(max(1, part.size.height - 1))
        lines = [f"{p.time_s:9.3f} {p.way} {p.data!r}"[: max(20, part.size.width)] for p in messages]
        if (name, lines) != self._wire_shown:
            self._wire_shown = name, lines
            part.update(lines_of(literal(f"Wire of {name} (W: next)", "bold"), *lines))

    def _do(self, words: str, work: Callable[[Bench], Any]) -> None:
        bench = self.bench
        if bench is None:
            self._say(self._without())
        elif taken := self.app.bench_taken:  # type: ignore[attr-defined]
            self._say(taken)
        else:
            self._say(words)
            self.app.by_hand(lambda: work(bench))  # type: ignore[attr-defined]

    @on(commands.Connect)
    def connect(self) -> None:
        self._do("Connecting every device.", lambda bench: bench.rows())

    @on(commands.HomeStages)
    def home(self) -> None:
        if self.bench is None or self.app.bench_taken:  # type: ignore[attr-defined]
            self._do("", _home)
            return
        names = ", ".join(axis.name for axis in self._axes)

        def decided(answer: int | None) -> None:
            if answer == 0:
                self._do("Homing: keep clear of all moving parts.", _home)

        question = f"Homing: {names} each move to a switch. Is the way clear? F12 stops."
        self.app.push_screen(Choose(question, ("home now", "not now"), moves=True), decided)

    @on(commands.JogBack)
    @on(commands.JogForward)
    def jog(self, message: commands.Command) -> None:
        if self._axes:
            axis = self._axes[self._axis]
            by = STEPS[self._step] if isinstance(message, commands.JogForward) else -STEPS[self._step]
            self._do(f"Moving {axis.name} by {by:g} {axis.unit}.", lambda bench: _jog(bench, axis, by))

    @on(commands.AxisBefore)
    @on(commands.AxisAfter)
    def choose_axis(self, message: commands.Command) -> None:
        by = 1 if isinstance(message, commands.AxisAfter) else -1
        self._axis = max(0, min(self._axis + by, len(self._axes) - 1))
        self._show()

    @on(commands.StepSmaller)
    @on(commands.StepLarger)
    def choose_step(self, message: commands.Command) -> None:
        by = 1 if isinstance(message, commands.StepLarger) else -1
        self._step = max(0, min(self._step + by, len(STEPS) - 1))
        self._show()

    @on(commands.Darker)
    def darker(self) -> None:
        self._do("Dimming.", lambda bench: _light(bench, -LIGHT_STEP))

    @on(commands.Brighter)
    def brighter(self) -> None:
        """Brighten the lamp; one that is dark asks first."""
        if self.bench is None or self.app.bench_taken or "light" not in self.bench.devices or self.bench.light.level():  # type: ignore[attr-defined]
            self._brighten(0)
        else:
            question = "The lamp goes on, and out again when the program ends. Do not look into it."
            self.app.push_screen(Choose(question, ("light it", "not now"), moves=True), self._brighten)

    def _brighten(self, answer: int | None) -> None:
        if answer == 0:
            self._do("Brightening.", lambda bench: _light(bench, LIGHT_STEP))

    @on(commands.NextWire)
    def next_wire(self) -> None:
        self._wire += 1
        self._show_wire()


def row_in_words(row: DeviceRow, now: Condition, good: str, bad: str) -> str:
    """A device with its identity and condition, or the problem and its remedy."""
    mark = good if now.usable else bad
    who = f"{row.identity.model} {row.identity.firmware}".strip() if row.identity else "no answer"
    words = f"{mark} {row.name:12} {row.driver:8} {who}: {brief(now)}"
    if row.error is not None:
        return f"{words}. {row.error.reason}. {row.error.remedy}"
    return words if now.usable else f"{words}. {now.remedy}"


@dataclass(frozen=True)
class CommandOutcome:
    """Outcome of a command, and the positions of the axes."""

    words: str
    positions: Mapping[str, float]


def _axes(bench: Bench) -> list[MovableAxis]:
    axes = []
    for device, stage in bench.devices.items():
        if hasattr(stage, "move_to") and device in bench.identities:
            axes += [
                MovableAxis(device, name, travel.low, travel.high) for name, travel in cast(Any, stage).travel().items()
            ]
    return axes


def _home(bench: Bench) -> CommandOutcome:
    stops = bench.stops
    for name, device in bench.devices.items():
        if hasattr(device, "home"):
            bench.motions.home(name, lambda: bench.check_stops(stops))
    return CommandOutcome("Every stage is homed.", _positions(bench))


def _jog(bench: Bench, axis: MovableAxis, by: float) -> CommandOutcome:
    stage: Any = bench.devices[axis.device]
    target = stage.position()[axis.name] + by
    bench.motions.move(axis.device, {axis.name: target})
    return CommandOutcome(f"{axis.name} is at {stage.position()[axis.name]:z.3f} {axis.unit}.", _positions(bench))


def _light(bench: Bench, by: float) -> CommandOutcome:
    level = min(max(bench.light.level() + by, 0.0), 1.0)
    bench.light.set_level(level)
    return CommandOutcome(f"The lamp is at {100 * level:.0f} %.", _positions(bench))


def _positions(bench: Bench) -> dict[str, float]:
    there: dict[str, float] = {}
    for device, stage in bench.devices.items():
        if hasattr(stage, "position") and device in bench.identities:
            there.update(stage.position())
    return there
