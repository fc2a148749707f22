"""`station focus`: how sharp every photograph is that comes, and which way to turn the ring."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from procedures.numbers import EDGE_MTF50, S_OVER_T
from station.cli.psf.terms import plane_name
from station.cli.terminal.bench_options import existing_file
from station.cli.terminal.inherited import inherited
from station.cli.terminal.numbers import SEED
from station.common.errors import REFUSED
from station.results.record_head import other_causes_entry

if TYPE_CHECKING:
    from station.guide.focus.live import FocusReading, LiveFrame, PhotographSource

BAR = 30
"""Characters of the bar of the sharpest."""


@click.command()
@click.option("--watch", "folder", type=click.Path(path_type=Path), help="The folder in which photographs arrive.")
@inherited(
    "--config", type=click.Path(path_type=Path), callback=existing_file,
    help="Expose with the camera of this station.toml.",
)  # fmt: skip
@inherited("--simulate", is_flag=True, help="Sweep the focus of the simulated camera.")
@inherited(
    "--simulated-seed", inherits="--seed", type=SEED, default=0, show_default=True, help="Of the simulated bench."
)
@click.option("--bits", type=click.Path(path_type=Path), help="The chart's 256 x 256 cells as a grey image.")
@click.option("--seed", type=SEED, help="The chart's seed; 1 if neither this nor --bits is given.")
@click.option("-s", "s", type=click.IntRange(2, 16), default=4, show_default=True, help="PSF samples per pixel.")
@click.option("-k", "k", type=click.IntRange(3, 101), default=17, show_default=True, help="PSF samples along a side.")
@click.option("--plane", callback=plane_name, help="R, G1, G2, B or Y.  [default: G1 of a RAW file, Y of a grey image]")
@click.option("--equal-steps", is_flag=True, help="The ring is turned by one equal step from frame to frame.")
@click.option("--frames", type=click.IntRange(min=1), help="End after so many photographs.  [default: on Ctrl-C]")
@click.option("--json", "as_json", is_flag=True, help="Write one JSON object a photograph to stdout.")
def focus(
    folder: Path | None,
    config: Path | None,
    simulate: bool,
    simulated_seed: int,
    bits: Path | None,
    seed: int | None,
    s: int,
    k: int,
    plane: str | None,
    equal_steps: bool,
    frames: int | None,
    as_json: bool,
) -> None:
    """Tell the sharpness of every photograph of the chart as it comes, the best so far, and which way to turn the ring.

    MTF50 in cycles per pixel of the plane, along its rows and columns; their difference is the astigmatism. Where the
    settings are known (--simulate, --equal-steps) the top of a parabola through them is told with its error bar. No
    stage is moved; photographs stay where they are. Ends on Ctrl-C.
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
    seen = None
    with _frames(source, ended, folder, config, simulated_seed) as coming:
        for frame in coming:
            seen = live.measure(frame)
            click.echo(json.dumps(entry(seen)) if as_json else line(seen))
            if seen.number == frames:
                break
    if seen is not None:
        click.echo(summary(seen), err=True)
    if seen is None or seen.best is None:
        raise click.exceptions.Exit(REFUSED)


@contextmanager
def _frames(
    source: PhotographSource, ended: threading.Event, folder: Path | None, config: Path | None, seed: int
) -> Iterator[Iterator[LiveFrame]]:
    """The photographs; within, Ctrl-C ends them, after the one that is at work."""
    from station.bench.opening import make_bench, read_config, simulated_bench
    from station.common.leftovers import temporary_folder
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
        yield source.tethered(bench) if config is not None else source.simulated(bench)


def line(seen: FocusReading) -> str:
    """A photograph for people: its number, its sharpness with a bar, and what to do."""
    from station.common.sanitise import printable

    found = seen.sharpness.value
    name = printable(seen.frame.path.name)
    if found is None:
        return f"{seen.number:3}  {name}: {seen.sharpness.reason}; {seen.sharpness.remedy}"
    one, (difference, error) = found.mtf50, found.astigmatism
    bar = "#" * round(BAR * one.value / max(score for score in seen.scores if score == score))
    return (
        f"{seen.number:3}  {name}  MTF50 {one.value:.3f} +- {one.uncertainty:.3f} cycles/pixel of the plane, rows "
        f"{found.along_rows.value:.3f}, columns {found.along_columns.value:.3f}, astigmatism {difference:+.3f} +- "
        f"{error:.3f}, s/t {found.s_over_t:.2f}, {seen.took_s:.2f} s\n     {bar:<{BAR}}  {seen.say}"
    )


def summary(seen: FocusReading) -> str:
    """The best of all."""
    if seen.best is None:
        return f"none of {seen.number} photographs could be measured"
    told = f"sharpest: photograph {seen.best} of {seen.number}, MTF50 {seen.scores[seen.best - 1]:.3f}"
    peak = seen.peak
    if peak is None:
        return told
    beyond = "" if peak.inside else "; that is beyond what was tried: go on that way"
    return (
        f"{told}; the top is at {peak.place:+.2f} +- {peak.place_uncertainty:.2f} steps, MTF50 {peak.score:.3f} +- "
        f"{peak.score_uncertainty:.3f}{beyond}"
    )


def entry(seen: FocusReading) -> dict[str, Any]:
    """A photograph for programs."""
    found, peak = seen.sharpness.value, seen.peak
    numbers = (
        {EDGE_MTF50: found.mtf50, "mtf50_rows": found.along_rows, "mtf50_columns": found.along_columns} if found else {}
    )
    told = {
        name: {"value": one.value, "unit": one.unit, "uncertainty": one.uncertainty, "method": one.method, "n": one.n}
        for name, one in numbers.items()
    }
    return {
        "number": seen.number,
        "path": str(seen.frame.path),
        "verdict": str(seen.sharpness.verdict),
        "reason": seen.sharpness.reason,
        "remedy": seen.sharpness.remedy,
        **other_causes_entry(seen.sharpness),
        **told,
        S_OVER_T: found.s_over_t if found else None,
        "best": seen.best,
        "best_place": None if peak is None else {"value": peak.place, "uncertainty": peak.place_uncertainty},
        "best_mtf50": None if peak is None else {"value": peak.score, "uncertainty": peak.score_uncertainty},
        "say": seen.say,
        "took_s": round(seen.took_s, 3),
    }
