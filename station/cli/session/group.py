"""`station session ...`: the commands, and options that select a session."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from station.cli.terminal.command import PATH, completed
from station.cli.terminal.inherited import inherited
from station.cli.terminal.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
SESSION_COMMANDS = {
    "list": ("session.several", "session_list", "List all sessions, or those of a camera, lens, plan or verdict."),
    "show": ("session.one", "session_show", "Show the content of a session, and verify it."),
    "resume": ("session.one", "session_resume", "Continue a session where it stopped."),
    "delete": ("session.one", "session_delete", "Delete a session with its photographs."),
    "recompute": ("session.one", "session_recompute", "Recompute results and compare every byte."),
    "report": ("session.one", "session_report", "Write its report again."),
    "trend": ("session.several", "session_trend", "Report the change of a camera's numbers over its sessions."),
    "index": ("session.several", "session_index", "Update or rebuild the index of the sessions."),
}

Command = Callable[..., Any]

USUAL = Path("sessions")


def _existing(context: click.Context, option: click.Parameter, root: Path) -> Path:
    """The folder of the sessions; the usual one need not exist yet."""
    if root != USUAL and not root.is_dir():
        raise click.BadParameter(f"there is no folder {root}; name the one that holds the sessions", context, option)
    return root


sessions_option = inherited(
    "--sessions", "root", type=PATH, default=USUAL, show_default=True, callback=_existing,
    help="Folder of the sessions.",
)  # fmt: skip


@click.group(cls=LazyGroup, table=SESSION_COMMANDS)
def session() -> None:
    """List, resume, recompute and compare sessions."""


def session_argument(command: Command) -> Command:
    """Give a command the argument SESSION, and --sessions, the folder of bare names."""
    return click.argument("name", metavar="SESSION", shell_complete=completed(session_names))(sessions_option(command))


def session_names(ctx: click.Context) -> list[str]:
    """The names of the kept sessions."""
    return sorted(one.name for one in Path(ctx.params.get("root") or "sessions").glob("*/"))


def newest_unfinished(root: Path) -> Path:
    """The folder of the newest unfinished session. Raises BadParameter where there is none."""
    from procedures.outcome import BadParameter
    from station.guide.workspace import kept_in

    for one in kept_in(root):
        if one.ended != "finished":
            return one.folder
    raise BadParameter(f"no session in {root} is unfinished", "name the session to continue")


def find_session(name: str, root: Path) -> Path:
    """The folder of a session, given by its path or its name in the folder of sessions."""
    here = Path(name)
    return here if here.exists() or here.name != name else root / name
