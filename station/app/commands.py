"""Commands of the operator: each is one small class with key, footer entry, palette entry and help.

A command is a message. Its key posts it to the current screen, which handles it or passes it to the application. The
docstring's first line is the text of help and palette.
"""

import inspect
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import Any, ClassVar, Protocol, cast

from textual.binding import Binding, BindingType
from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.content import Content
from textual.message import Message


class Command(Message):
    """A command."""

    keys: ClassVar[str]
    """The keys, separated by commas; the first one is displayed."""
    shown: ClassVar[str] = ""
    """Displayed name of the first key, if different."""
    word: ClassVar[str] = ""
    """Label in the footer; empty: not in the footer."""
    pair: ClassVar[str] = ""
    """Keys in the footer, where one entry names two commands."""
    urgent: ClassVar[bool] = False
    """Whether it takes precedence over the focused widget, also in dialogs."""

    def __init_subclass__(cls, **options: Any) -> None:
        # a namespace of its own: the command Leave must not reach Textual's handlers of its event Leave
        super().__init_subclass__(namespace="command", **options)

    @classmethod
    def title(cls) -> str:
        """The palette's entry: the class name in words."""
        return "".join(f" {c.lower()}" if c.isupper() else c for c in cls.__name__).strip().capitalize()

    @classmethod
    def help(cls) -> str:
        """One line on what it does."""
        return (inspect.getdoc(cls) or "").splitlines()[0]

    @classmethod
    def key_name(cls) -> str:
        """Displayed name of the key."""
        return cls.shown or cls.keys.split(",")[0].upper().replace("CTRL+", "^")

    @classmethod
    def binding(cls) -> Binding:
        """The key, for a screen or the application."""
        action = f"app.command('{cls.__name__}')"
        shifted = [key.upper() for key in cls.keys.split(",") if len(key) == 1]  # the footer shows capitals
        return Binding(
            ",".join([cls.keys, *shifted]), action, cls.word, show=bool(cls.word), key_display=cls.key_name(),
            priority=cls.urgent, tooltip=cls.help(),
        )  # fmt: skip


def bindings(commands: Iterable[type[Command]]) -> list[BindingType]:
    """The keys of these commands."""
    return [command.binding() for command in commands]


# --- everywhere --------------------------------------------------------------------------------------------------


class StopEverything(Command):
    """Emergency stop: halt every device now; stages must be homed again afterwards."""

    keys, urgent = "f12,ctrl+x", True  # the device bar shows it, so the footer need not


class EndRun(Command):
    """End the run after this exposure; at once if an axis moves, or if pressed twice."""

    keys, word, urgent = "ctrl+c", "end run", True


class ShowGuide(Command):
    """The guide: step by step from the chart to the report."""

    keys, word = "f2", "guide"


class ShowBench(Command):
    """The bench: devices, homing, manual moves, light, traffic on the wires."""

    keys, word = "f3", "bench"


class ShowResults(Command):
    """The results: PSF, MTF, verdicts; comparison of two."""

    keys, word = "f4", "results"


class ShowHelp(Command):
    """This help."""

    keys, word = "f1,question_mark", "help"


class ShowPalette(Command):
    """Every command by name; type to search."""

    keys, word, shown = "ctrl+p", "commands", "^P"


class Leave(Command):
    """Leave the program; a run is ended first."""

    keys, word, urgent = "ctrl+q", "quit", True


class ShowFocus(Command):
    """Live focus: sharpness of every new photograph, and which way to turn the ring."""

    keys, word = "f7", "focus"


EVERYWHERE: tuple[type[Command], ...] = (
    StopEverything, ShowHelp, ShowGuide, ShowBench, ShowResults, EndRun, ShowPalette, Leave, ShowFocus,
)  # fmt: skip


# --- guide -------------------------------------------------------------------------------------------------------


class GoOn(Command):
    """Continue the session where it stopped; stages are homed first."""

    keys, word = "f5", "go on"


class StepBack(Command):
    """Repeat the previous step; its photographs are kept."""

    keys, word = "f6", "step back"


class NewSession(Command):
    """Back to the first screen: begin a new session or continue another."""

    keys, word = "f8", "new"


GUIDE: tuple[type[Command], ...] = (GoOn, StepBack, NewSession)


# --- bench -------------------------------------------------------------------------------------------------------


class Connect(Command):
    """Connect every device, and show the answers."""

    keys, word, shown = "c", "connect", "C"


class HomeStages(Command):
    """Home every stage. Stages move: keep clear."""

    keys, word, shown = "h", "home", "H"


class JogBack(Command):
    """Move the chosen axis one step towards smaller numbers."""

    keys, shown = "left,minus", "Left"


class JogForward(Command):
    """Move the chosen axis one step towards larger numbers."""

    keys, word, shown, pair = "right,plus", "move", "Right", "Left/Right"


class AxisBefore(Command):
    """Choose the axis above."""

    keys, shown = "up", "Up"


class AxisAfter(Command):
    """Choose the axis below."""

    keys, word, shown, pair = "down", "axis", "Down", "Up/Down"


class StepSmaller(Command):
    """Move by a tenth of the step."""

    keys, shown = "left_square_bracket", "["


class StepLarger(Command):
    """Move by ten times the step."""

    keys, word, shown, pair = "right_square_bracket", "step", "]", "[ ]"


class Darker(Command):
    """Dim the lamp by a tenth of its full power."""

    keys, shown = "d", "D"


class Brighter(Command):
    """Brighten the lamp by a tenth of its full power."""

    keys, word, shown, pair = "b", "light", "B", "D/B"


class NextWire(Command):
    """Show the traffic on the wire of the next device."""

    keys, word, shown = "w", "wire", "W"


BENCH: tuple[type[Command], ...] = (
    Connect, HomeStages, JogBack, JogForward, AxisBefore, AxisAfter,
    StepSmaller, StepLarger, Darker, Brighter, NextWire,
)  # fmt: skip


# --- live focus --------------------------------------------------------------------------------------------------


class TurnNear(Command):
    """Turn the simulated ring one step towards near, and take a photograph."""

    keys, shown = "left,minus", "Left"


class TurnFar(Command):
    """Turn the simulated ring one step towards infinity, and take a photograph."""

    keys, word, shown, pair = "right,plus", "turn the ring", "Right", "Left/Right"


class EndFocus(Command):
    """End live focus, or return to the choice of the source."""

    keys, word, shown = "escape", "end", "Esc"


FOCUS: tuple[type[Command], ...] = (TurnNear, TurnFar, EndFocus)


# --- results -----------------------------------------------------------------------------------------------------


class NextPlane(Command):
    """Show the next colour plane."""

    keys, word, shown = "p", "plane", "P"


class Compare(Command):
    """Compare: keep this result and show every other chosen one together with it. Again: end."""

    keys, word, shown = "c", "compare", "C"


class Reload(Command):
    """Search the disk for results again."""

    keys, word, shown = "r", "look again", "R"


RESULTS: tuple[type[Command], ...] = (NextPlane, Compare, Reload)

BY_NAME = {command.__name__: command for command in (*EVERYWHERE, *GUIDE, *BENCH, *FOCUS, *RESULTS)}


# --- the palette -------------------------------------------------------------------------------------------------


class CommandSource(Protocol):
    """An application with its available commands."""

    def offered(self) -> list[type[Command]]:
        """The commands of the current screen and of every screen."""

    async def action_command(self, name: str) -> None:
        """Give a command."""
        ...


class CommandsByName(Provider):
    """The palette's entries."""

    @property
    def _source(self) -> CommandSource:
        return cast(CommandSource, self.app)

    async def discover(self) -> Hits:
        """All available commands."""
        for command in self._source.offered():
            yield DiscoveryHit(Content(command.title()), self._give(command), help=_help(command))

    async def search(self, query: str) -> Hits:
        """The commands that match the query."""
        matcher = self.matcher(query)
        for command in self._source.offered():
            score = matcher.match(command.title())
            if score > 0:
                yield Hit(score, matcher.highlight(command.title()), self._give(command), help=_help(command))

    def _give(self, command: type[Command]) -> Callable[[], Awaitable[None]]:
        return partial(self._source.action_command, command.__name__)


def _help(command: type[Command]) -> str:
    return f"{command.key_name()}  {command.help()}"
