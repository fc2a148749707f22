"""`station rays`: the picture of a Monte Carlo render without its noise, from the samples' histograms."""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from procedures.ray_histogram.film import Film
    from procedures.ray_histogram.multiscale import FilteredFilm
    from station.results.result_files import ResultFolder

    Picture = npt.NDArray[np.float64]

SCHEMA = "station/rays/1"
DESCRIPTION = "filtered render, linear, 1 = white, first row uppermost; calibration-station"
"""Of the picture."""
FEW_SIMILAR = 4.0
"""Similar patches in the median below which a picture keeps most of its noise."""

_PATH = click.Path(path_type=Path)


@click.command("rays")
@click.argument("samples", type=_PATH)
@click.option("--picture", type=_PATH, help="The picture's own file, where SAMPLES is an OpenEXR of histograms only.")
@click.option("--kappa", type=Number(), default=1.0, show_default=True, help="Chi-square per bin that is half similar.")
@click.option(
    "--scales",
    type=click.IntRange(max=16),
    default=3,
    show_default=True,
    help="Scales; 1 leaves noise wider than a block.",
)
@click.option(
    "--search", type=click.IntRange(max=64), default=6, show_default=True, help="Half size of the search block, pixels."
)
@click.option(
    "--patch", type=click.IntRange(max=16), default=1, show_default=True, help="Half size of the patches, pixels."
)
@click.option(
    "--neighbour", "neighbours", type=_PATH, multiple=True, help="The frame before or after; may be repeated."
)
@click.option(
    "--reference", type=_PATH, help="A converged render (npz with `reference` or `image`) to measure against."
)
@click.option("--published", is_flag=True, help="Filter as Algorithms 1 and 2 state it, without what was added since.")
@click.option(
    "--budget", type=click.IntRange(0), help="Samples to cast next: writes how many each pixel needs to more.npy."
)
@click.option("--threads", type=click.IntRange(1, 1024), help="Threads.  [default: one for each processor]")
@click.option("--out", type=_PATH, required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def rays(
    samples: Path,
    picture: Path | None,
    neighbours: tuple[Path, ...],
    reference: Path | None,
    published: bool,
    budget: int | None,
    threads: int | None,
    out: Path,
    as_json: bool,
    **options: Any,
) -> None:
    """Filter the render whose film is SAMPLES, an npz of `image`, `hist` and `nsamples`, or of `samples`."""
    start = time.perf_counter()
    from procedures.ray_histogram.film_files import read_film
    from procedures.ray_histogram.filter import PAPER, FilterParameters
    from procedures.ray_histogram.multiscale import filter_film
    from station.common.versions import software
    from station.results.result_files import ResultFolder, write_record

    parameters = replace(PAPER, **options) if published else FilterParameters(**options)
    with ResultFolder(out, force=forced()) as folder:
        film = read_film(samples, picture).checked()
        rows, columns = film.count.shape
        log("read", f"read {samples}: {columns} x {rows} pixels, {film.count.sum()} samples", path=str(samples))
        others = [read_film(path) for path in neighbours]
        found = filter_film(film, parameters, neighbours=others, threads=threads or os.cpu_count() or 1)
        judged = _judged(film, found)
        log("filtered", _sentence(found, judged), level=_LEVELS[judged["verdict"]], remedy=judged["remedy"])
        truth = None if reference is None else _reference(reference, film.mean.shape)
        _write_pictures(folder, film, found, truth)
        more = None if budget is None else _write_more(folder, film, found, budget)
        record = {
            "schema": SCHEMA,
            "input": [_source(path) for path in (samples, picture, *neighbours, reference) if path is not None],
            "parameters": {**options, **({"published": True} if published else {})},
            **judged,
            **_numbers(film, found),
            **({} if more is None else {"more_samples": more}),
            **({} if truth is None else {"psnr_db": _decibels(film, found, truth)}),
            "software": software(),
            "duration_s": round(time.perf_counter() - start, 3),
        }
        text = write_record(folder, record)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)


_LEVELS = {"pass": "info", "doubtful": "warning"}


def _judged(film: Film, found: FilteredFilm) -> dict[str, str]:
    """Verdict, reason and remedy."""
    dropped, cast = int(film.dropped.sum()), int(film.count.sum())
    if dropped:
        reason = f"{dropped} of {cast + dropped} samples were NaN or infinite and were dropped: their light is missing"
        return {"verdict": "doubtful", "reason": reason, "remedy": "look for the fault in the renderer"}
    if found.median_similar[0] < FEW_SIMILAR:
        reason = (
            f"few pixels are alike ({found.median_similar[0]:.1f} in the median), so most of the noise is still there"
        )
        return {"verdict": "doubtful", "reason": reason, "remedy": "cast more samples, or raise --kappa"}
    return {"verdict": "pass", "reason": "", "remedy": ""}


def _sentence(found: FilteredFilm, judged: dict[str, str]) -> str:
    similar = ", ".join(f"{n:.0f}" for n in found.median_similar)
    said = judged["reason"] or "each pixel shares its samples"
    return f"{judged['verdict']}: {said}; similar patches in the median, finest scale first: {similar}"


def _write_pictures(folder: ResultFolder, film: Film, found: FilteredFilm, truth: Picture | None) -> None:
    from procedures.ray_histogram.comparison import psnr_db
    from station.demo.ray_page import RenderRow, ray_page
    from station.drawing.linear_pictures import described_tiff, display_png, float_tiff
    from station.results.result_files import npy

    folder.write("filtered.tiff", described_tiff(float_tiff(found.picture), DESCRIPTION))
    folder.write("filtered.png", display_png(found.picture))
    folder.write("similar.npy", npy(found.similar, found.similar.dtype))
    shown: list[tuple[str, npt.NDArray[np.floating]]] = [("as rendered", film.mean), ("filtered", found.picture)]
    facts = [f"{film.count.mean():.0f} samples per pixel."]
    if truth is not None:
        shown.append(("converged", truth))
        before, after = (psnr_db(picture, truth)[0] for _, picture in shown[:2])
        facts.append(f"PSNR against the converged render: {before:.2f} dB as rendered, {after:.2f} dB filtered.")
    row = RenderRow(f"{film.count.shape[1]} x {film.count.shape[0]} pixels", tuple(shown), found.similar, tuple(facts))
    folder.write("rays.html", ray_page("A render, and the same without its noise", (row,)))


def _write_more(folder: ResultFolder, film: Film, found: FilteredFilm, budget: int) -> dict[str, float]:
    """Write how many samples each pixel needs, `budget` in all; returns what the record says of them."""
    from procedures.ray_histogram.adaptive import allot
    from station.results.result_files import npy

    more = allot(film, found.similar, budget)
    folder.write("more.npy", npy(more, more.dtype))
    return {"all": int(more.sum()), "most": int(more.max()), "pixels_without": float((more == 0).mean())}


def _numbers(film: Film, found: FilteredFilm) -> dict[str, Any]:
    """What the record says beside the verdict."""
    count = film.count
    return {
        "size": list(count.shape),
        "samples_per_pixel": {"least": int(count.min()), "mean": float(count.mean()), "most": int(count.max())},
        "dropped_samples": int(film.dropped.sum()),
        "similar_median": list(found.median_similar),
    }


def _decibels(film: Film, found: FilteredFilm, truth: Picture) -> dict[str, dict[str, float]]:
    from procedures.ray_histogram.comparison import psnr_db

    pictures: dict[str, npt.NDArray[np.floating]] = {"input": film.mean, "filtered": found.picture}
    measured = {name: psnr_db(picture, truth) for name, picture in pictures.items()}
    return {name: {"clipped": clipped, "unclipped": unclipped} for name, (clipped, unclipped) in measured.items()}


def _reference(path: Path, shape: tuple[int, ...]) -> Picture:
    import numpy as np

    from procedures.outcome import BadInput
    from procedures.reading.arrays import read_npz

    arrays, _ = read_npz(path, ("reference", "image"))
    truth = arrays.get("reference", arrays.get("image"))
    if truth is None or truth.shape != shape:
        came = "no array `reference` or `image`" if truth is None else f"a picture of shape {truth.shape}"
        raise BadInput(f"{path} has {came}", f"give a converged render of shape {shape}")
    if truth.dtype.kind not in "fiu" or not np.isfinite(truth).all():
        raise BadInput(f"{path} holds values that are no finite numbers", "give a converged render")
    return np.asarray(truth, np.float64)


def _source(path: Path) -> dict[str, str]:
    return {"path": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
