"""`station session report`: the report of a session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from station.cli.psf.terms import certificate_options, details_of, overlay_option
from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option


@click.command("report")
@session_argument
@click.option("--out", type=click.Path(path_type=Path), help="The HTML file.  [default: report.html in the session]")
@certificate_options
@overlay_option
@log_json_option
def session_report(name: str, root: Path, out: Path | None, overlays: tuple[Path, ...], **given: Any) -> None:
    """Write the report of SESSION's last result."""
    from station.common.atomic_files import write_whole
    from station.guide.session_report import certificate_files, overlaid_page, session_page
    from station.reports.report import PAGE
    from station.results.overlay import read_overlay

    folder, others, details = find_session(name, root), [read_overlay(path) for path in overlays], details_of(given)
    path = out or folder / PAGE
    page = overlaid_page(folder, others) if others else session_page(folder)
    write_whole(path, page.encode())
    log("written", f"wrote {path}", path=str(path))
    for name, data in certificate_files(folder, details=details).items() if details else ():
        write_whole(path.parent / name, data)
        log("written", f"wrote {path.parent / name}", path=str(path.parent / name))
