"""`station focus`: sharpness of every new photograph, and which way to turn the ring."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from procedures.numbers import EDGE_MTF50, S_OVER_T
from station.cli.psf.terms import plane_name
from station.cli.terminal.bench_options import existing_file
from station.cli.terminal.command import PATH, SEED, command
from station.cli.terminal.inherited import inherited
from station.common.errors import REFUSED
from station.results.record_head import other_causes_entry

if TYPE_CHECKING:
    from station.guide.focus.live import FocusReading, LiveFrame, PhotographSource

BAR = 30


@command("focus", log_json=False)
@click.option("--watch", "folder", type=PATH, help="Folder in which photographs arrive.")
@inherited("--config", type=PATH, callback=existing_file, help="Expose with the camera of this station.toml.")
@inherited("--simulate", is_flag=True, help="Sweep the focus of the simulated camera.")
@inherited(
    "--simulated-seed", inherits="--seed", type=SEED, default=0, show_default=True, help="Of the simulated bench."
)
@click.option("--bits", type=PATH, help="The chart's 256 x 256 cells as a grey image.")
@click.option("--seed", type=SEED, help="The chart's seed; 1 if neither this nor --bits is given.")
@click.option("-s", "s", type=click.IntRange(2, 16), default=4, show_default=True, help="PSF samples per pixel.")
@click.option("-k", "k", type=click.IntRange(3, 101), default=17, show_default=True, help="PSF samples along a side.")
@click.option("--plane", callback=plane_name, help="R, G1, G2, B or Y.  [default: G1 of a RAW file, Y of a grey image]")
@click.option("--equal-steps", is_flag=True, help="The ring is turned by equal steps between photographs.")
@click.option("--frames", type=click.IntRange(min=1), help="Number of photographs.  [default: until Ctrl-C]")
@click.option("--json", "as_json", is_flag=True, help="Write one JSON object per photograph to stdout.")
def focus(
    folder: Path | None, config: Path | None, simulate: bool, simulated_seed: int, bits: Path | None,
    seed: int | None, s: int, k: int, plane: str | None, equal_steps: bool, frames: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Report the sharpness of every new photograph of the chart, the best so far, and which way to turn the ring.

    MTF50 in cycles per pixel of the plane, along its rows and columns; their difference is the astigmatism. Where the
    settings are known (--simulate, --equal-steps) the maximum of a fitted parabola is given with its error bar. No
    stage is moved, no photograph is moved or deleted. Ends on Ctrl-C.
    """
    if sum(one is not None and one is not False for one in (folder, config, simulate)) != 1:
        raise click.UsageError("photographs come from --watch, --config or --simulate; give one of them")
    if k % 2 == 0:
        raise click.UsageError(f"k must be odd; got {k}")
    from procedures.pattern_psf.estimate import PatternParameters
    from station.guide.focus.live import LiveFocus, PhotographSource
    from station.procedure.base import chart_source

    ended = threading.Event()
    live = LiveFocus(chart_source(bits, seed).chart, PatternParameters(s, k, chosen=True), equal_steps)
    source = PhotographSource(ended.is_set, plane)
    reading = None
    with _frames(source, ended, folder, config, simulated_seed) as arriving:
        for frame in arriving:
            reading = live.measure(frame)
            click.echo(json.dumps(entry(reading)) if as_json else line(reading))
            if reading.number == frames:
                break
    if reading is not None:
        click.echo(summary(reading), err=True)
    if reading is None or reading.best is None:
        raise click.exceptions.Exit(REFUSED)


@contextmanager
def _frames(
    source: PhotographSource, ended: threading.Event, folder: Path | None, config: Path | None, seed: int
) -> Iterator[Iterator[LiveFrame]]:
    """The photographs; within the context, Ctrl-C ends them after the current one."""
    from station.bench.opening import make_bench, read_config, simulated_bench
    from station.common.durable_files import temporary_folder
    from station.common.stop_signals import guarded

    with ExitStack() as stack:
        if folder is not None:
            stack.enter_context(guarded(lambda: None, ended.set, terminated=0))
            yield source.watched(folder, ended.wait)
            return
        if config is not None:
            bench = make_bench(read_config(config), folder=config.resolve().parent)
        else:
            bench = simulated_bench(stack.enter_context(temporary_folder()), seed=seed, virtual_time=True)
        stack.callback(bench.close)
        stack.enter_context(guarded(bench.emergency_stop, ended.set))
        bench.connect()
        yield until_ended(source.tethered(bench) if config is not None else source.simulated(bench), ended)


def until_ended(frames: Iterator[LiveFrame], ended: threading.Event) -> Iterator[LiveFrame]:
    """The photographs; an exposure that Ctrl-C has stopped is their end, not an error."""
    from drivers.errors import EmergencyStopped

    try:
        yield from frames
    except EmergencyStopped:
        if not ended.is_set():
            raise


def line(reading: FocusReading) -> str:
    """A photograph as text: number, sharpness with a bar, and advice."""
    from station.common.sanitise import printable

    one = reading.sharpness.value
    head = f"{reading.number:3}  {printable(reading.frame.path.name)}"
    if one is None:
        return f"{head}: {reading.sharpness.reason}; {reading.sharpness.remedy}"
    mtf50, (difference, error) = one.mtf50, one.astigmatism
    bar = "#" * round(BAR * mtf50.value / max(score for score in reading.scores if score == score))
    parts = (
        f"{head}  MTF50 {mtf50.value:.3f} +- {mtf50.uncertainty:.3f} cycles/pixel of the plane",
        f"rows {one.along_rows.value:.3f}", f"columns {one.along_columns.value:.3f}",
        f"astigmatism {difference:+.3f} +- {error:.3f}", f"s/t {one.s_over_t:.2f}", f"{reading.took_s:.2f} s",
    )  # fmt: skip
    return f"{', '.join(parts)}\n     {bar:<{BAR}}  {reading.say}"


def summary(reading: FocusReading) -> str:
    """The sharpest photograph, and the maximum of the sweep."""
    if reading.best is None:
        return f"none of {reading.number} photographs could be measured"
    score, peak = reading.scores[reading.best - 1], reading.peak
    words = f"sharpest: photograph {reading.best} of {reading.number}, MTF50 {score:.3f}"
    if peak is None:
        return words
    beyond = "" if peak.inside else "; that is beyond the settings so far: continue in that direction"
    place = f"the maximum is at {peak.place:+.2f} +- {peak.place_uncertainty:.2f} steps"
    return f"{words}; {place}, MTF50 {peak.score:.3f} +- {peak.score_uncertainty:.3f}{beyond}"


def entry(reading: FocusReading) -> dict[str, Any]:
    """A photograph as JSON."""
    sharpness, peak = reading.sharpness.value, reading.peak
    numbers = {}
    if sharpness is not None:
        numbers = {
            EDGE_MTF50: asdict(sharpness.mtf50),
            "mtf50_rows": asdict(sharpness.along_rows),
            "mtf50_columns": asdict(sharpness.along_columns),
        }
    return {
        "number": reading.number,
        "path": str(reading.frame.path),
        "verdict": str(reading.sharpness.verdict),
        "reason": reading.sharpness.reason,
        "remedy": reading.sharpness.remedy,
        **other_causes_entry(reading.sharpness),
        **numbers,
        S_OVER_T: sharpness.s_over_t if sharpness else None,
        "best": reading.best,
        "best_place": None if peak is None else {"value": peak.place, "uncertainty": peak.place_uncertainty},
        "best_mtf50": None if peak is None else {"value": peak.score, "uncertainty": peak.score_uncertainty},
        "say": reading.say,
        "took_s": round(reading.took_s, 3),
    }
