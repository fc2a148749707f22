"""The program that `stops.py` stops: again and again a run of a small plan on the bench of a station.toml.

    python stops_program.py WHERE FRONT CONFIG SESSIONS CONTROL STATUS

`WHERE` is what the run does when it is stopped (`homing`, `move`, `exposure`), `FRONT` is `plain` or `app`. A byte on
the descriptor CONTROL begins a run; STATUS shows `m` before the move, which waits for another byte, and `e` at the end.
SIGUSR1 raises an exception in what the front end is doing.
"""

import asyncio
import io
import os
import select
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from procedures.plan import Advice, Ask, Fact, Go, Home, Plan, Request, Shoot, Step
from station.app.app import StationApp
from station.cli import app as app_command
from station.cli.guide import Watched, conduct
from station.guide import catalogue
from station.guide.dialogue import AGAIN
from station.guide.frontend import MOVE
from station.guide.workspace import StationLab

WHERE, FRONT, CONFIG, SESSIONS, CONTROL, STATUS = sys.argv[1:]
MOVES = {"homing": 1, "move": 2, "exposure": 0}
"""How often the operator begins a move, by where the program is stopped."""
LABS: list[StationLab] = []
ABOUT_TO_MOVE: list[bool] = []
"""Filled once the run has come to its move."""


class Fault(Exception):
    """The program is wrong."""


def boom(*_: object) -> None:
    raise Fault


def report(word: str) -> None:
    os.write(int(STATUS), word.encode())


def go_ahead() -> bytes:
    """The byte on CONTROL; nothing where the parent has gone."""
    return os.read(int(CONTROL), 1)


def before_the_move(facts: object) -> str:
    """The parent may now spoil the head's port; where it says so, nothing more goes into it."""
    ABOUT_TO_MOVE.append(True)
    report("m")
    if go_ahead() == b"c":
        head: Any = LABS[-1].open().bench.devices["head"]  # type: ignore[union-attr]
        port = head._transport._port.fd
        while select.select([], [port], [], 0.03)[1]:
            with suppress(BlockingIOError):
                os.write(port, b" " * 512)
    return "moving"


def plan() -> Plan:
    """What is done before it is stopped."""
    good = Advice(True, "")
    shoot = Shoot("shots", lambda f, k: good, lambda f, k, r, n: {}, lambda r, k: good, record_motion=True)
    move = Go(lambda facts: {"z_mm": 100.0}, before_the_move)
    requests: dict[str, tuple[Request, ...]] = {"homing": (Home(),), "move": (Home(), move), "exposure": (shoot,)}
    return Plan("stops", "Stops", (Step("only", "Only", "", requests[WHERE]),))


catalogue.PLANS |= {"stops": catalogue.GuidedProcedure("stops", plan)}


def new_lab() -> StationLab:
    LABS[:] = [StationLab(sessions=Path(SESSIONS), config=Path(CONFIG))]
    return LABS[0]


def plain() -> None:
    signal.signal(signal.SIGUSR1, boom)
    lab = new_lab()
    said = io.StringIO()
    operator = Watched(io.StringIO("\n" * MOVES[WHERE] + "s\n" * 9), said)
    with suppress(SystemExit, KeyboardInterrupt, Fault):
        conduct(lab, operator, lambda: lab.begin("stops", "camera", "lens", operator))
    sys.stdout.write(said.getvalue())  # the reason, where it ended before it was stopped
    sys.stdout.flush()


class Begins:
    """An operator who begins every move at once, and leaves all else to the application.

    Trouble before the move is answered by "try again": a bench on a starved machine may answer too late.
    """

    def __init__(self, desk: Any) -> None:
        self.notify, self._desk = desk.notify, desk

    def answer(self, ask: Ask) -> Fact:
        if ask.key == "trouble" and WHERE == "move" and not ABOUT_TO_MOVE:
            return AGAIN
        return True if ask.key == MOVE else self._desk.answer(ask)


class BegunApp(StationApp):
    """The application, which begins a run by itself and leaves with it."""

    def _loaded(self, finished: Any) -> None:
        super()._loaded(finished)
        self._begin(lambda desk: self.lab.begin("stops", "camera", "lens", Begins(desk)))

    def _run_ended(self, finished: Any) -> None:
        self.exit(0)


def application() -> None:
    lab = new_lab()
    app = BegunApp(lab)

    def fault(*_: object) -> None:  # a loop that sleeps must be woken: a fault of the program comes while it works
        asyncio.get_running_loop().call_soon_threadsafe(app.call_next, boom)

    signal.signal(signal.SIGUSR1, fault)
    with app_command.ended_by_signals(app, lab):
        try:
            app.run()
        finally:
            app.finish(3.0)
            lab.close()


def main() -> None:
    from station.app.app import share_the_lock

    if FRONT == "app":
        share_the_lock()
    while go_ahead():
        ABOUT_TO_MOVE.clear()
        plain() if FRONT == "plain" else application()
        report("e")


if __name__ == "__main__":
    main()
