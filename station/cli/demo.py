"""`station demo`: a complete simulated calibration."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.result_log import check_strict
from station.cli.terminal.command import PATH, SEED, command
from station.cli.terminal.inherited import inherited
from station.cli.terminal.progress import progress as progress_shown
from station.common.errors import REFUSED, log
from station.drawing.colours import TERMINAL_COLOURS

if TYPE_CHECKING:
    from station.demo.demo import ComparedPlane, Demonstration, Summary
    from station.guide.frontend import Result

HEADINGS = {"horizontal": "MTF50, rows", "vertical": "MTF50, columns"}
WIDE = 100
"""Least width of a terminal at which the table shows both directions, columns."""


@command("demo", strict=True, as_json=True)
@click.option("--out", type=PATH, default="demo", show_default=True, help="Folder for the results.")
@inherited("--seed", type=SEED, default=1, show_default=True, help="Seed of the camera's noise.")
@click.option("--rendered", is_flag=True, help="Also trace light through scenes in depth, filter and photograph them.")
@click.option("--guided", is_flag=True, help="Go through the guide on the simulated bench, into a session in --out.")
def demo(out: Path, seed: int, rendered: bool, guided: bool, strict: bool, as_json: bool) -> None:
    """Photograph the chart with a simulated camera, estimate the PSFs from its files, and compare with the truth."""
    if guided:
        from station.cli.guide import exit_code
        from station.demo.guided_demo import run_guided
        from station.results.result_files import RECORD

        def report(sentence: str, remedy: str) -> None:
            log("step", sentence, level="warning" if remedy else "info", remedy=remedy)

        ended, result = run_guided(out, seed, report)
        if as_json and result is not None:
            click.echo((result.folder / RECORD).read_text(encoding="utf-8"), nl=False)
        elif result is not None:
            click.echo("\n".join(plane_lines(result)))
        if ended.report is not None:
            log("written", f"wrote {ended.report}", path=str(ended.report))
        raise click.exceptions.Exit(exit_code(ended, result, strict=strict))
    from station.demo.demo import run_demo, steps, summary

    with progress_shown(steps()) as progress:
        demonstration, text = run_demo(out, seed, progress=progress)
    if as_json:
        click.echo(text, nl=False)
    else:
        _show(demonstration, summary(demonstration))
    log("written", f"wrote {out / 'index.html'}", path=str(out / "index.html"))
    if rendered:
        _render(out / "rendered", seed)
    if demonstration.refused:
        raise click.exceptions.Exit(REFUSED)
    check_strict([str(plane.result.verdict) for shot in demonstration.shots for plane in shot.planes], strict=strict)


def plane_lines(result: Result) -> list[str]:
    """Verdict of each plane, with its MTF50 if there is one."""
    from station.common.sanitise import stated

    lines = []
    for name, plane in result.planes.items():
        mtf50 = {heading: plane.numbers.get(f"mtf50_{way}") for way, heading in HEADINGS.items()}
        parts = [f"{heading} {stated(one.value, one.uncertainty)} {one.unit}" for heading, one in mtf50.items() if one]
        lines.append("; ".join([f"{name}: {plane.verdict}", *parts]))
    return lines


def _render(out: Path, seed: int) -> None:
    """Render the scenes in depth into their own folder; films there are reused."""
    from station.demo.rendered import PAGE, RenderPlan, rendered_demo, steps

    plan = RenderPlan(seed=seed)
    with progress_shown(steps(plan)) as progress:
        scenes, depth, _ = rendered_demo(out, plan, threads=os.cpu_count() or 1, progress=progress)
    for scene in scenes:
        before, after = scene.psnr_db["rendered"], scene.psnr_db["filtered"]
        sentence = f"{scene.name}: {before:.2f} dB as rendered, {after:.2f} dB filtered"
        log("rendered", sentence, scene=scene.name, rendered_db=before, filtered_db=after)
    if depth is not None:
        error = depth.figures["w_px"]["rms_error"]
        log("restored", f"{depth.outcome.verdict}: depth restored, w with an error of {error:.3f} samples", error=error)
    log("written", f"wrote {out / PAGE}", path=str(out / PAGE))


def _show(demonstration: Demonstration, summary: Summary) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    from rich import box
    from rich.table import Table

    directions = list(HEADINGS)[: 2 if console.width >= WIDE else 1]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), show_edge=False)
    table.add_column("plane", no_wrap=True)
    for direction in directions:
        table.add_column(HEADINGS[direction], justify="right", no_wrap=True)
        table.add_column("true", justify="right", no_wrap=True)
    table.add_column("PSF error", justify="right", no_wrap=True)
    table.add_column("bound", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for number, shot in enumerate(demonstration.shots, 1):
        table.add_row(f"[bold]{number} {shot.setup.title}[/]")
        for plane in shot.planes:
            table.add_row(*_cells(plane, directions))
    console.print(table)
    console.print("MTF50 in cycles per pixel of the plane, ± one standard uncertainty.", style="dim")
    if summary.refused < summary.planes:
        console.print(
            f"{summary.passed} of {summary.planes} planes pass. Errors are {summary.ratio_mean:.2f} times the expected "
            f"({summary.ratio_least:.2f} to {summary.ratio_most:.2f}); {summary.mtf50_within} of {summary.mtf50_n} "
            f"MTF50 lie within 2.5 σ of the truth; centres within {summary.centre_px:.4f} pixel."
        )


def _cells(plane: ComparedPlane, directions: Sequence[str]) -> list[str]:
    from station.common.sanitise import stated
    from station.reports.page import percent

    verdict = str(plane.result.verdict)
    cells = [f"  {plane.name}"]
    if plane.comparison is None:
        cells += [""] * (2 * len(directions) + 2)
    else:
        for direction in directions:
            against = plane.comparison.mtf50.get(direction)
            measured = against.measured if against else None
            cells += [stated(measured.value, measured.uncertainty)] if measured else ["—"]
            cells += [f"{against.true:.4f}"] if against else ["—"]
        cells += [percent(plane.comparison.error), percent(plane.comparison.expected)]
    return [*cells, f"[{TERMINAL_COLOURS[verdict]}]{verdict}[/]"]
