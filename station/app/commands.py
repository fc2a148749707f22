"""Commands of the operator: each is one small class with key, footer entry, palette entry and help.

A command is a message. Its key posts it to the current screen, which handles it or passes it to the application. The
docstring's first line is the text of help and palette.
"""

import inspect
from collections.abc import Iterable
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
        return (inspect.getdoc(cls) or "").splitlines()[0]

    @classmethod
    def key_name(cls) -> str:
        return cls.shown or cls.keys.split(",")[0].upper().replace("CTRL+", "^")

    @classmethod
    def binding(cls) -> Binding:
        action = f"app.command('{cls.__name__}')"
        shifted = [key.upper() for key in cls.keys.split(",") if len(key) == 1]  # the footer shows capitals
        return Binding(
            ",".join([cls.keys, *shifted]), action, cls.word, show=bool(cls.word), key_display=cls.key_name(),
            priority=cls.urgent, tooltip=cls.help(),
        )  # fmt: skip


def _command(
    name: str, words: str, keys: str, word: str = "", shown: str = "", pair: str = "", *, urgent: bool = False
) -> type[Command]:
    """The class of a command, whose docstring is `words`."""
    contents = {"keys": keys, "word": word, "shown": shown, "pair": pair, "urgent": urgent}
    return cast(type[Command], type(name, (Command,), {"__doc__": words, "__module__": __name__, **contents}))


def bindings(commands: Iterable[type[Command]]) -> list[BindingType]:
    """The keys of these commands."""
    return [command.binding() for command in commands]


StopEverything = _command(
    "StopEverything",
    "Emergency stop: halt every device now; stages must be homed again afterwards.",
    "f12,ctrl+x",
    urgent=True,
)  # the device bar shows it, so the footer need not
EndRun = _command(
    "EndRun",
    "End the run after this exposure; at once if an axis moves, or if pressed twice.",
    "ctrl+c",
    "end run",
    urgent=True,
)
ShowGuide = _command("ShowGuide", "The guide: step by step from the chart to the report.", "f2", "guide")
ShowBench = _command(
    "ShowBench", "The bench: devices, homing, manual moves, light, traffic on the wires.", "f3", "bench"
)
ShowResults = _command("ShowResults", "The results: PSF, MTF, verdicts; comparison of two.", "f4", "results")
ShowHelp = _command("ShowHelp", "This help.", "f1,question_mark", "help")
ShowPalette = _command("ShowPalette", "Every command by name; type to search.", "ctrl+p", "commands", shown="^P")
Leave = _command("Leave", "Leave the program; a run is ended first.", "ctrl+q", "quit", urgent=True)
ShowFocus = _command(
    "ShowFocus", "Live focus: sharpness of every new photograph, and which way to turn the ring.", "f7", "focus"
)

EVERYWHERE: tuple[type[Command], ...] = (
    StopEverything, ShowHelp, ShowGuide, ShowBench, ShowResults, EndRun, ShowPalette, Leave, ShowFocus,
)  # fmt: skip

GoOn = _command("GoOn", "Continue the session where it stopped; stages are homed first.", "f5", "go on")
StepBack = _command("StepBack", "Repeat the previous step; its photographs are kept.", "f6", "step back")
NewSession = _command("NewSession", "Back to the first screen: begin a new session or continue another.", "f8", "new")

GUIDE: tuple[type[Command], ...] = (GoOn, StepBack, NewSession)

Connect = _command("Connect", "Connect every device, and show the answers.", "c", "connect", shown="C")
HomeStages = _command("HomeStages", "Home every stage. Stages move: keep clear.", "h", "home", shown="H")
JogBack = _command("JogBack", "Move the chosen axis one step towards smaller numbers.", "left,minus", shown="Left")
JogForward = _command(
    "JogForward",
    "Move the chosen axis one step towards larger numbers.",
    "right,plus",
    "move",
    shown="Right",
    pair="Left/Right",
)
AxisBefore = _command("AxisBefore", "Choose the axis above.", "up", shown="Up")
AxisAfter = _command("AxisAfter", "Choose the axis below.", "down", "axis", shown="Down", pair="Up/Down")
StepSmaller = _command("StepSmaller", "Move by a tenth of the step.", "left_square_bracket", shown="[")
StepLarger = _command(
    "StepLarger", "Move by ten times the step.", "right_square_bracket", "step", shown="]", pair="[ ]"
)
Darker = _command("Darker", "Dim the lamp by a tenth of its full power.", "d", shown="D")
Brighter = _command("Brighter", "Brighten the lamp by a tenth of its full power.", "b", "light", shown="B", pair="D/B")
NextWire = _command("NextWire", "Show the traffic on the wire of the next device.", "w", "wire", shown="W")

BENCH: tuple[type[Command], ...] = (
    Connect, HomeStages, JogBack, JogForward, AxisBefore, AxisAfter,
    StepSmaller, StepLarger, Darker, Brighter, NextWire,
)  # fmt: skip

TurnNear = _command(
    "TurnNear", "Turn the simulated ring one step towards near, and take a photograph.", "left,minus", shown="Left"
)
TurnFar = _command(
    "TurnFar",
    "Turn the simulated ring one step towards infinity, and take a photograph.",
    "right,plus",
    "turn the ring",
    shown="Right",
    pair="Left/Right",
)
EndFocus = _command("EndFocus", "End live focus, or return to the choice of the source.", "escape", "end", shown="Esc")

FOCUS: tuple[type[Command], ...] = (TurnNear, TurnFar, EndFocus)

NextPlane = _command("NextPlane", "Show the next colour plane.", "p", "plane", shown="P")
Compare = _command(
    "Compare",
    "Compare: keep this result and show every other chosen one together with it. Again: end.",
    "c",
    "compare",
    shown="C",
)
Reload = _command("Reload", "Search the disk for results again.", "r", "look again", shown="R")

RESULTS: tuple[type[Command], ...] = (NextPlane, Compare, Reload)

BY_NAME = {command.__name__: command for command in (*EVERYWHERE, *GUIDE, *BENCH, *FOCUS, *RESULTS)}


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
        for command in self._source.offered():
            give = partial(self._source.action_command, command.__name__)
            yield DiscoveryHit(Content(command.title()), give, help=f"{command.key_name()}  {command.help()}")

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for command in self._source.offered():
            score = matcher.match(command.title())
            if score > 0:
                give, words = partial(self._source.action_command, command.__name__), matcher.highlight(command.title())
                yield Hit(score, words, give, help=f"{command.key_name()}  {command.help()}")
