"""`station session index`: update or rebuild the index."""

from __future__ import annotations

from pathlib import Path

import click

from station.cli.session.group import sessions_option
from station.common.log import log, log_json_option


@click.command("index")
@sessions_option
@click.option("--rebuild", is_flag=True, help="Discard it and read every session.")
@log_json_option
def session_index(root: Path, rebuild: bool) -> None:
    """Update the index of the sessions. It is derived from their folders and may be rebuilt."""
    from station.sessions.index import Index

    with Index(root, rebuild=rebuild) as index:
        entries, cameras, lenses = index.sessions(), index.names("cameras"), index.names("lenses")
    damaged = sum(bool(one.damage) for one in entries)
    sentence = f"{len(entries)} sessions, {len(cameras)} cameras, {len(lenses)} lenses; {damaged} sessions are damaged"
    log("index", sentence, sessions=len(entries), cameras=len(cameras), lenses=len(lenses), damaged=damaged)
