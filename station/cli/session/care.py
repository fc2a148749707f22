"""`station session delete`, `report` and `index`."""

from pathlib import Path
from typing import Any

import click

from station.cli.psf.terms import certificate_options, details_of, overlay_option
from station.cli.result_log import check_strict
from station.cli.session.group import find_session, session_argument, sessions_option
from station.cli.terminal.command import StationCommand, strict_option
from station.cli.terminal.progress import progress
from station.common.errors import log, log_json_option


@click.command("delete", cls=StationCommand)
@session_argument
@click.option("--yes", is_flag=True, help="Skip the confirmation.")
@log_json_option
def session_delete(name: str, root: Path, yes: bool) -> None:
    """Delete SESSION with its photographs and results permanently, after confirmation."""
    from procedures.outcome import BadParameter
    from station.sessions.layout import check_layout
    from station.sessions.reader import delete_session

    folder = find_session(name, root)
    check_layout(folder)
    photographs = sum(1 for path in (folder / "originals").iterdir() if path.is_file())
    if not (yes or click.confirm(f"Delete {folder} with {photographs} photographs permanently?", err=True)):
        raise BadParameter(f"{folder.name} was not deleted", "answer y, or give --yes")
    delete_session(folder)
    log("deleted", f"deleted {folder}", folder=str(folder))


@click.command("report", cls=StationCommand)
@session_argument
@click.option("--out", type=click.Path(path_type=Path), help="The HTML file.  [default: report.html in the session]")
@certificate_options
@overlay_option
@strict_option
@log_json_option
def session_report(
    name: str, root: Path, out: Path | None, overlays: tuple[Path, ...], strict: bool, **given: Any
) -> None:
    """Write the report of SESSION's last result."""
    from station.common.durable_files import write_whole
    from station.guide.session_report import certificate_files, overlaid_page, session_page
    from station.reports.report import PAGE
    from station.results.overlay import read_overlay
    from station.sessions.reader import read_session

    folder, others, details = find_session(name, root), [read_overlay(path) for path in overlays], details_of(given)
    path = out or folder / PAGE
    with progress(1) as shown:
        shown("drawing the report", 0)
        page = overlaid_page(folder, others) if others else session_page(folder)
    write_whole(path, page.encode())
    log("written", f"wrote {path}", path=str(path))
    for name, data in certificate_files(folder, details=details).items() if details else ():
        write_whole(path.parent / name, data)
        log("written", f"wrote {path.parent / name}", path=str(path.parent / name))
    check_strict([one.verdict for one in read_session(folder).state.results[-1:]], strict=strict)


@click.command("index", cls=StationCommand)
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
