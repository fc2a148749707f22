"""Everything the operator can tell the application: one small class each is key, footer entry, palette entry and help.

A command is a message. Its key posts it to the screen that is shown; the screen answers it, or lets it rise to the
application. The docstring's first line is what help and palette say.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import Any, ClassVar, Protocol, cast

from textual.binding import Binding, BindingType
from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.content import Content
from textual.message import Message


class Command(Message):
    """A command."""

    keys: ClassVar[str]
    """The keys, separated by commas; the first is the one that is shown."""
    shown: ClassVar[str] = ""
    """The first key as people call it, where that is not its name."""
    word: ClassVar[str] = ""
    """The footer's word; none: not in the footer."""
    pair: ClassVar[str] = ""
    """The keys as the footer writes them, where it names two commands as one."""
    urgent: ClassVar[bool] = False
    """Whether it is heard before whatever has the keyboard, in dialogs too."""

    def __init_subclass__(cls, **options: Any) -> None:
        # their own namespace: a command called Leave must not reach Textual's handlers of its event Leave
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
        """How the key is written on screen."""
        return cls.shown or cls.keys.split(",")[0].upper().replace("CTRL+", "^")

    @classmethod
    def binding(cls) -> Binding:
        """The key, for a screen or the application."""
        action = f"app.command('{cls.__name__}')"
        return Binding(
            cls.keys, action, cls.word, show=bool(cls.word), key_display=cls.key_name(), priority=cls.urgent,
            tooltip=cls.help(),
        )  # fmt: skip


def bindings(commands: Iterable[type[Command]]) -> list[BindingType]:
    """The keys of these commands."""
    return [command.binding() for command in commands]


# --- everywhere --------------------------------------------------------------------------------------------------


class StopEverything(Command):
    """Emergency stop: halt every device now; stages must be homed again afterwards."""

    keys, urgent = "f12,ctrl+x", True  # the devices' line shows it, so the footer need not


class EndRun(Command):
    """End the run after this exposure; at once if an axis moves, or if pressed twice."""

    keys, word, urgent = "ctrl+c", "end run", True


class ShowGuide(Command):
    """The guide: step by step from the chart to the report."""

    keys, word = "f2", "guide"


class ShowBench(Command):
    """The bench: devices, homing, moving by hand, light, what passes on the wires."""

    keys, word = "f3", "bench"


class ShowResults(Command):
    """The results: PSF, MTF, verdicts; two of them side by side."""

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
    """Live focus: how sharp every photograph is that comes, and which way to turn the ring."""

    keys, word = "f7", "focus"


EVERYWHERE: tuple[type[Command], ...] = (
    StopEverything, ShowHelp, ShowGuide, ShowBench, ShowResults, EndRun, ShowPalette, Leave, ShowFocus,
)  # fmt: skip


# --- guide -------------------------------------------------------------------------------------------------------


class GoOn(Command):
    """Go on with the session where it stopped; stages are homed first."""

    keys, word = "f5", "go on"


class StepBack(Command):
    """Open the step before again; what was taken is kept."""

    keys, word = "f6", "step back"


class NewSession(Command):
    """Back to the first screen: a new session, or another one to go on with."""

    keys, word = "f8", "new"


GUIDE: tuple[type[Command], ...] = (GoOn, StepBack, NewSession)


# --- bench -------------------------------------------------------------------------------------------------------


class Connect(Command):
    """Connect every device, and say what answered."""

    keys, word, shown = "c", "connect", "C"


class HomeStages(Command):
    """Let every stage find its reference. Stages move: keep hands away."""

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
    """Dim the lamp by a tenth of its full light."""

    keys, shown = "d", "D"


class Brighter(Command):
    """Brighten the lamp by a tenth of its full light."""

    keys, word, shown, pair = "b", "light", "B", "D/B"


class NextWire(Command):
    """Show what passes on the wire of the next device."""

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
    """End live focus, or go back to where the photographs come from."""

    keys, word, shown = "escape", "end", "Esc"


FOCUS: tuple[type[Command], ...] = (TurnNear, TurnFar, EndFocus)


# --- results -----------------------------------------------------------------------------------------------------


class NextPlane(Command):
    """Show the next colour plane."""

    keys, word, shown = "p", "plane", "P"


class Compare(Command):
    """Keep this result to compare with: every result chosen then is shown beside it. Again: no more."""

    keys, word, shown = "c", "compare", "C"


class Reload(Command):
    """Look for results on the disk again."""

    keys, word, shown = "r", "look again", "R"


RESULTS: tuple[type[Command], ...] = (NextPlane, Compare, Reload)

BY_NAME = {command.__name__: command for command in (*EVERYWHERE, *GUIDE, *BENCH, *FOCUS, *RESULTS)}


# --- the palette -------------------------------------------------------------------------------------------------


class Offers(Protocol):
    """An application that says which commands can be given now."""

    def offered(self) -> list[type[Command]]:
        """Those of the screen that is shown, and those that are everywhere."""
        ...

    async def action_command(self, name: str) -> None:
        """Give one."""
        ...


class CommandsByName(Provider):
    """The palette's entries."""

    @property
    def _offers(self) -> Offers:
        return cast(Offers, self.app)

    async def discover(self) -> Hits:
        """All of them."""
        for command in self._offers.offered():
            yield DiscoveryHit(Content(command.title()), self._give(command), help=_help(command))

    async def search(self, query: str) -> Hits:
        """Those that match what was typed."""
        matcher = self.matcher(query)
        for command in self._offers.offered():
            score = matcher.match(command.title())
            if score > 0:
                yield Hit(score, matcher.highlight(command.title()), self._give(command), help=_help(command))

    def _give(self, command: type[Command]) -> _Given:
        return _Given(self._offers, command.__name__)


class _Given:
    """What the palette calls when an entry is chosen."""

    def __init__(self, app: Offers, name: str) -> None:
        self.app, self.name = app, name

    async def __call__(self) -> None:
        await self.app.action_command(self.name)


def _help(command: type[Command]) -> str:
    return f"{command.key_name()}  {command.help()}"
