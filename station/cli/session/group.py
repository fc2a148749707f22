"""`station session ...`: what is done with sessions, one file each; and how a command finds a session."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from station.cli.terminal.inherited import inherited
from station.cli.terminal.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
SESSION_COMMANDS = {
    "list": ("session.list", "session_list", "All sessions, or those of a camera, lens, plan or verdict."),
    "show": ("session.show", "session_show", "What a session holds, and whether it is still as it was written."),
    "resume": ("session.resume", "session_resume", "Go on with a session where it stopped."),
    "delete": ("session.delete", "session_delete", "Delete a session with its photographs."),
    "recompute": ("session.recompute", "session_recompute", "Compute its results again and compare every byte."),
    "report": ("session.report", "session_report", "Write its report again."),
    "trend": ("session.trend", "session_trend", "How a camera's numbers change over its sessions."),
    "index": ("session.index", "session_index", "The index over the sessions, rebuilt if wanted."),
}

Command = Callable[..., Any]

sessions_option = inherited(
    "--sessions",
    "root",
    type=click.Path(path_type=Path),
    default=Path("sessions"),
    show_default=True,
    help="Folder of the sessions.",
)


@click.group(cls=LazyGroup, table=SESSION_COMMANDS)
def session() -> None:
    """List, resume, recompute and compare sessions."""


def session_argument(command: Command) -> Command:
    """Give a command the argument SESSION, and --sessions, in which a bare name is looked for."""
    return click.argument("name", metavar="SESSION")(sessions_option(command))


def newest_unfinished(root: Path) -> Path:
    """The folder of the session that began last and is not finished. Raises BadParameter where there is none."""
    from procedures.outcome import BadParameter
    from station.guide.workspace import kept_in

    for one in kept_in(root):
        if one.ended != "finished":
            return one.folder
    raise BadParameter(f"no session in {root} is unfinished", "name the session that is to be gone on with")


def find_session(name: str, root: Path) -> Path:
    """The folder of a session that was named by its path, or by its name in the folder of sessions."""
    here = Path(name)
    return here if here.exists() or here.name != name else root / name
