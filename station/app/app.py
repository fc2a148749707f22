"""The operator's application: mounts screens and routes commands."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import on, work
from textual.await_complete import AwaitComplete
from textual.binding import BindingType
from textual.command import CommandPalette, Provider
from textual.css.query import NoMatches
from textual.message import Message
from textual.screen import Screen
from textual.widgets import Input, OptionList

from station.app import commands
from station.app.bars import DeviceBar, KeyLine
from station.app.screens.dialogs import Choose, Help
from station.app.screens.parts import StationScreen
from station.app.screens.start import StartScreen
from station.app.terminal_report import Graphics
from station.app.widgets import Part, literal
from station.app.working_app import BENCH, FOCUS, GUIDE, RESULTS, WorkingApp
from station.common.stop_signals import EXIT_DEVICE

if TYPE_CHECKING:
    from station.drawing.glyphs import Glyphs
    from station.guide.workspace import StationLab

END_TIMEOUT_S = 5.0
"""Wait for a run to end after an emergency stop, before the program exits anyway."""
STAY, AFTER_THIS, NOW = range(3)


def share_the_lock() -> None:
    """Let threads alternate every half millisecond. A paint releases the interpreter lock about fifty times to poll for
    input, and waits this interval each time until an estimate releases it. The default is 5 ms."""
    sys.setswitchinterval(0.0005)


class Palette(CommandPalette):
    """Textual's palette without three of its errors: paging through a list that is not drawn yet, keys handled after
    Enter has closed it, and a search that begins after it has closed."""

    @work(exclusive=True, group=CommandPalette._GATHER_COMMANDS_GROUP)
    async def _gather_commands(self, search_value: str) -> None:
        with suppress(NoMatches):
            await inspect.unwrap(CommandPalette._gather_commands)(self, search_value)

    @on(Input.Submitted)
    @on(OptionList.OptionSelected)
    def _handle_while_open(self, event: Message) -> None:
        if not self.is_active:
            event.prevent_default()

    def dismiss(self, result: None = None) -> AwaitComplete:
        """Close it, once."""
        return super().dismiss(result) if self.is_active else AwaitComplete()

    def _action_command_list(self, action: str) -> None:
        with suppress(LookupError):
            super()._action_command_list(action)


class StationApp(WorkingApp):
    """The application; its value is the exit code."""

    TITLE = "Calibration station"
    ENABLE_COMMAND_PALETTE = False  # ours is opened by a command
    COMMANDS: ClassVar[set[type[Provider] | Callable[[], type[Provider]]]] = {commands.CommandsByName}
    BINDINGS: ClassVar[list[BindingType]] = commands.bindings(commands.EVERYWHERE)
    DEFAULT_MODE = GUIDE
    HORIZONTAL_BREAKPOINTS = [(0, "-tiny"), (60, "-narrow"), (110, "-wide")]  # noqa: RUF012 - Textual declares it so
    VERTICAL_BREAKPOINTS = [(0, "-low"), (15, "-high")]  # noqa: RUF012
    CSS_PATH = Path(__file__).with_name("app.tcss")

    def __init__(
        self, lab: StationLab, glyphs: Glyphs | None = None, plan: str | None = None, graphics: Graphics | None = None
    ) -> None:
        super().__init__(lab, glyphs, graphics)
        self.animation_level = "none"  # an animated page is painted twenty times, perhaps over ssh
        self.add_mode(GUIDE, lambda: StartScreen(*lab.names, plan))
        self.add_mode(BENCH, lambda: self._styled(_screen("Bench")))
        self.add_mode(FOCUS, lambda: self._styled(_screen("Focus")))
        self.add_mode(RESULTS, lambda: self._styled(_screen("Results", lab.sessions)))

    def _styled(self, screen: Screen[Any]) -> Screen[Any]:
        """Mark the styles of a screen as up to date. Textual would otherwise read the stylesheet again when a mode is
        first shown, which blocks the loop for 0.1 s."""
        screen._css_update_count = self._css_update_count
        return screen

    def _handle_exception(self, error: Exception) -> None:
        """An error ends the program, except for missing parts of a screen that is being removed."""
        if not (isinstance(error, NoMatches) and self.return_code is not None):
            super()._handle_exception(error)

    def offered(self) -> list[type[commands.Command]]:
        """The available commands: first the way back to the guide, then the screen's and those of every screen."""
        front = self.front
        here = [command for command in front.COMMANDS_HERE if front.can(command)]
        modes = {
            commands.ShowGuide: GUIDE,
            commands.ShowBench: BENCH,
            commands.ShowFocus: FOCUS,
            commands.ShowResults: RESULTS,
        }
        away = [command for command in commands.EVERYWHERE if modes.get(command) != self.current_mode]
        if all(self.running(name) is None for name in ("run", "by hand", "focus")):
            away.remove(commands.EndRun)
        stop, help_, *others = away
        back = [command for command in others if command is commands.ShowGuide]
        return [stop, help_, *back, *here, *(command for command in others if command not in back)]

    async def action_command(self, name: str) -> None:
        command = commands.BY_NAME[name]
        if command is commands.StopEverything:
            self.stop_everything()
        elif command in self.offered() or command.urgent:
            self.front.post_message(command())
        else:
            self.notify(self.bench_taken or "That command is not available now.", markup=False)

    @on(commands.ShowGuide)
    def _show_guide(self) -> None:
        self._show_mode(GUIDE)

    @on(commands.ShowBench)
    def _show_bench(self) -> None:
        self._show_mode(BENCH)

    @on(commands.ShowFocus)
    def _show_focus(self) -> None:
        self._show_mode(FOCUS)

    @on(commands.ShowResults)
    def _show_results(self) -> None:
        self._show_mode(RESULTS)

    def _show_mode(self, mode: str) -> None:
        if not self._is_loaded:
            self._wanted_mode = mode
            self.notify("One moment: the program is still loading.", markup=False)
        else:
            self.switch_mode(mode)

    @on(commands.ShowHelp)
    def _show_help(self) -> None:
        self.push_screen(Help(self.offered(), self.front.question_help()))

    @on(commands.ShowPalette)
    def _show_palette(self) -> None:
        if not isinstance(self.screen, CommandPalette):
            self.push_screen(Palette())

    @on(commands.NewSession)
    def _new_session(self) -> None:
        if self._guide is not None and self.front is self._guide:
            self._guide = self._session = None
            self._subject = self._alarm = ""
            self.pop_screen()
            self._start("sessions", self.lab.kept)

    @on(commands.Leave)
    def _leave(self) -> None:
        if self.running("run") is None and self.running("by hand") is None:
            self.exit(0)
            return
        if isinstance(self.screen, Choose):  # the question is open already
            return
        answers = ("stay", "quit after this exposure", "stop every device now, and quit")
        self.push_screen(Choose("A run or a movement is in progress.", answers), self._leave_how)

    def _leave_how(self, how: int | None) -> None:
        if how in (AFTER_THIS, NOW):
            self._afterwards = lambda: self.exit(0)
            if how == NOW:
                self.stop_everything()
                self.set_timer(END_TIMEOUT_S, lambda: self.exit(EXIT_DEVICE))
            self._end_run_then_go_on()

    def fill_frame(self, screen: StationScreen) -> None:
        if screen.is_mounted:
            title = " - ".join(part for part in (self.TITLE, self._subject) if part)
            words = literal(f" {self._alarm} ", "bold reverse") if self._alarm else literal(f" {title}")
            screen.query_one("#title", Part).update(words, layout=False)
            screen.query_one(DeviceBar).show(self._states, self._bench_words)
            screen.query_one(KeyLine).show()


def _screen(name: str, *given: Any) -> Screen[Any]:
    """The screen of this name, whose module is imported when it is first shown."""
    module = import_module(f"station.app.screens.{name.lower()}")
    screen: Screen[Any] = getattr(module, f"{name}Screen")(*given)
    return screen
