"""`station session report`: the report of a session."""

from __future__ import annotations

from pathlib import Path

import click

from station.cli.psf.terms import overlay_option
from station.cli.session.group import find_session, session_argument
from station.common.log import log, log_json_option


@click.command("report")
@session_argument
@click.option("--out", type=click.Path(path_type=Path), help="The HTML file.  [default: report.html in the session]")
@click.option("--certificate", is_flag=True, help="Write certificate.html and certificate.pdf next to it.")
@overlay_option
@log_json_option
def session_report(name: str, root: Path, out: Path | None, certificate: bool, overlays: tuple[Path, ...]) -> None:
    """Write the report of SESSION's last result."""
    from station.common.atomic_files import write_whole
    from station.guide.session_report import certificate_files, overlaid_page, session_page
    from station.reports.report import PAGE
    from station.results.overlay import read_overlay

    folder, others = find_session(name, root), [read_overlay(path) for path in overlays]
    path = out or folder / PAGE
    page = overlaid_page(folder, others) if others else session_page(folder)
    write_whole(path, page.encode())
    log("written", f"wrote {path}", path=str(path))
    for name, data in certificate_files(folder).items() if certificate else ():
        write_whole(path.parent / name, data)
        log("written", f"wrote {path.parent / name}", path=str(path.parent / name))
