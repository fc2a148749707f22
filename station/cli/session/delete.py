"""`station session delete`: delete a session with its photographs and results."""

from __future__ import annotations

from pathlib import Path

import click

from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option


@click.command("delete")
@session_argument
@click.option("--yes", is_flag=True, help="Skip the confirmation.")
@log_json_option
def session_delete(name: str, root: Path, yes: bool) -> None:
    """Delete SESSION with its photographs and results permanently, after confirmation."""
    from procedures.outcome import BadParameter
    from station.sessions.deletion import delete_session
    from station.sessions.layout import check_layout

    folder = find_session(name, root)
    check_layout(folder)
    photographs = sum(1 for path in (folder / "originals").iterdir() if path.is_file())
    if not (yes or click.confirm(f"Delete {folder} with {photographs} photographs permanently?", err=True)):
        raise BadParameter(f"{folder.name} was not deleted", "answer y, or give --yes")
    delete_session(folder)
    log("deleted", f"deleted {folder}", folder=str(folder))
