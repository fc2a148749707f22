"""`station session report`: the report once more."""

from __future__ import annotations

from pathlib import Path

import click

from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option


@click.command("report")
@session_argument
@click.option("--out", type=click.Path(path_type=Path), help="The HTML file.  [default: report.html in the session]")
@log_json_option
def session_report(name: str, root: Path, out: Path | None) -> None:
    """Write the report of SESSION's last result."""
    from station.common.atomic_files import write_whole
    from station.guide.session_report import session_page
    from station.reports.pattern_report import PAGE

    folder = find_session(name, root)
    path = out or folder / PAGE
    write_whole(path, session_page(folder).encode())
    log("written", f"wrote {path}", path=str(path))
