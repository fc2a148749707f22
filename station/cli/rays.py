"""`station rays`: the picture of a Monte Carlo render without its noise, from the samples' histograms."""

from __future__ import annotations

import hashlib
import os
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from procedures.outcome import BadParameter
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.common.log import log, log_json_option

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from procedures.ray_histogram.film import Film
    from procedures.ray_histogram.filter import FilterParameters
    from procedures.ray_histogram.multiscale import FilteredFilm
    from station.results.result_files import ResultFolder

    Picture = npt.NDArray[np.float64]
    Picture32 = npt.NDArray[np.float32]

SCHEMA = "station/rays/1"
DESCRIPTION = "filtered render, linear, 1 = white, first row uppermost; calibration-station"
"""Of the picture."""
UNCERTAINTY = "standard uncertainty of the filtered render, linear, 1 = white; calibration-station"
FEW_SIMILAR = 4.0
"""Similar patches in the median below which a picture keeps most of its noise."""

_PATH = click.Path(path_type=Path)


@click.command("rays")
@click.argument("films", metavar="FILM...", nargs=-1, required=True, type=_PATH)
@click.option("--picture", type=_PATH, help="The picture's own file, where FILM is an OpenEXR of histograms only.")
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
    "--reach", type=click.IntRange(0, 64), default=1, show_default=True, help="Frames of a sequence before and after."
)
@click.option(
    "--neighbour", "neighbours", type=_PATH, multiple=True, help="A frame beside the only FILM; may be repeated."
)
@click.option(
    "--add", "added", type=_PATH, multiple=True, help="A film of more samples of the only FILM; may be repeated."
)
@click.option(
    "--reference", type=_PATH, help="A converged render (npz with `reference` or `image`) to measure against."
)
@click.option("--published", is_flag=True, help="Filter as Algorithms 1 and 2 state it, without what was added since.")
@click.option("--uncertainty", "uncertain", is_flag=True, help="Tell how far each pixel may be off, too.")
@click.option(
    "--budget", type=click.IntRange(0), help="Samples to cast next: writes how many each pixel needs to more.npy."
)
@click.option("--threads", type=click.IntRange(1, 1024), help="Threads.  [default: one for each processor]")
@click.option("--out", type=_PATH, required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def rays(films: tuple[Path, ...], out: Path, as_json: bool, published: bool, **options: Any) -> None:
    """Filter renders: each FILM is an npz of `image`, `hist` and `nsamples`, or of `samples`.

    Several are the frames of a sequence, in order: each is filtered with those before and after it, and has a folder
    of its own in --out.
    """
    from procedures.ray_histogram.filter import PAPER, FilterParameters
    from station.results.result_files import ResultFolder

    chosen = {name: options.pop(name) for name in ("kappa", "scales", "search", "patch")}
    parameters = replace(PAPER, **chosen) if published else FilterParameters(**chosen)
    told = {**chosen, **({"published": True} if published else {})}
    request = _Request(films, parameters, told, threads=options.pop("threads") or os.cpu_count() or 1, **options)
    request.check()
    results = request.filtered()
    for i, place in enumerate(_places(films, out)):
        start = time.perf_counter()
        with ResultFolder(place, force=forced()) as folder:
            film, found = next(results)
            text = _write_result(folder, request, i, film, found, start)
        log("written", f"wrote {place / 'result.json'}", path=str(place / "result.json"))
        if as_json:
            click.echo(text, nl=False)


@dataclass(frozen=True)
class _Request:
    """What was asked for; `told` is how the record tells the parameters."""

    films: tuple[Path, ...]
    parameters: FilterParameters
    told: dict[str, Any]
    picture: Path | None
    neighbours: tuple[Path, ...]
    added: tuple[Path, ...]
    reference: Path | None
    reach: int
    uncertain: bool
    budget: int | None
    threads: int

    def check(self) -> None:
        """Refuse options that do not go together."""
        alone = {"--picture": self.picture, "--neighbour": self.neighbours, "--add": self.added}
        for option, given in {**alone, "--reference": self.reference}.items():
            if given and len(self.films) > 1:
                raise BadParameter(f"{option} with {len(self.films)} films", "give one film, or leave the option out")
        if self.neighbours and self.uncertain:
            raise BadParameter("--uncertainty with --neighbour", "give all frames in order as a sequence instead")

    def filtered(self) -> Iterator[tuple[Film, FilteredFilm]]:
        """Every film and what the filter answers for it; films are read as they are needed."""
        from procedures.ray_histogram.film_files import read_film
        from procedures.ray_histogram.multiscale import filter_film
        from procedures.ray_histogram.sequence import filter_sequence

        if self.neighbours:
            film = self.read(self.films[0])
            others = [read_film(path) for path in self.neighbours]
            yield film, filter_film(film, self.parameters, neighbours=others, threads=self.threads)
            return
        kept: deque[Film] = deque()

        def films() -> Iterator[Film]:
            for path in self.films:
                kept.append(self.read(path))
                yield kept[-1]

        sequence = filter_sequence(
            films(), self.parameters, reach=self.reach, uncertain=self.uncertain, threads=self.threads
        )
        for found in sequence:
            yield kept.popleft(), found

    def read(self, path: Path) -> Film:
        """A film with what is to be added to it, checked."""
        from procedures.ray_histogram.film_files import read_film

        film = read_film(path, self.picture)
        for more in self.added:
            film = film.merge(read_film(more))
        film = film.checked()
        rows, columns = film.count.shape
        log("read", f"read {path}: {columns} x {rows} pixels, {film.count.sum()} samples", path=str(path))
        return film

    def sources(self, i: int) -> list[Path]:
        """The files that the result of frame i comes from, its own first."""
        beside = self.films[max(0, i - self.reach) : i] + self.films[i + 1 : i + 1 + self.reach]
        others = (self.picture, *self.added, *self.neighbours, self.reference)
        return [self.films[i], *beside, *(path for path in others if path is not None)]


def _places(films: tuple[Path, ...], out: Path) -> list[Path]:
    """The folder of each film's result: --out for one, one in it for each of several."""
    if len(films) == 1:
        return [out]
    twice = [stem for stem, n in Counter(path.stem for path in films).items() if n > 1]
    if twice:
        raise BadParameter(f"several films are called {twice[0]}", "results are named after films: give each its name")
    return [out / path.stem for path in films]


def _write_result(
    folder: ResultFolder, request: _Request, i: int, film: Film, found: FilteredFilm, start: float
) -> str:
    """Everything about one film; returns the record's text."""
    from station.common.versions import software
    from station.results.result_files import write_record

    judged = _judged(film, found)
    log("filtered", _sentence(found, judged), level=_LEVELS[judged["verdict"]], remedy=judged["remedy"])
    truth = None if request.reference is None else _reference(request.reference, film.mean.shape)
    _write_pictures(folder, film, found, truth)
    more = None if request.budget is None else _write_more(folder, film, found, request.budget)
    reach = {"reach": request.reach} if len(request.films) > 1 else {}
    record = {
        "schema": SCHEMA,
        "input": [_source(path) for path in request.sources(i)],
        "parameters": {**request.told, **reach},
        **judged,
        **_numbers(film, found),
        **({} if more is None else {"more_samples": more}),
        **({} if found.uncertainty is None else {"uncertainty": _uncertainty(found.picture, found.uncertainty, truth)}),
        **({} if truth is None else {"psnr_db": _decibels(film, found, truth)}),
        "software": software(),
        "duration_s": round(time.perf_counter() - start, 3),
    }
    return write_record(folder, record)


def _uncertainty(picture: Picture32, uncertainty: Picture32, truth: Picture | None) -> dict[str, float]:
    """What the record says of the uncertainty; with a truth, the share of values within two of it."""
    import numpy as np

    from procedures.ray_histogram.uncertainty import coverage

    covered = {} if truth is None else {"coverage_2_sigma": coverage(picture, uncertainty, truth)}
    return {"median": float(np.median(uncertainty)), "most": float(uncertainty.max()), **covered}


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
    import numpy as np

    from procedures.ray_histogram.comparison import psnr_db
    from station.demo.ray_page import RenderRow, ray_page
    from station.drawing.linear_pictures import described_tiff, display_png, float_tiff
    from station.results.result_files import npy

    folder.write("filtered.tiff", described_tiff(float_tiff(found.picture), DESCRIPTION))
    folder.write("filtered.png", display_png(found.picture))
    folder.write("similar.npy", npy(found.similar, found.similar.dtype))
    if found.uncertainty is not None:
        folder.write("uncertainty.tiff", described_tiff(float_tiff(found.uncertainty), UNCERTAINTY))
    shown: list[tuple[str, npt.NDArray[np.floating]]] = [("as rendered", film.mean), ("filtered", found.picture)]
    facts = [f"{film.count.mean():.0f} samples per pixel."]
    if truth is not None:
        shown.append(("converged", truth))
        before, after = (psnr_db(picture, truth)[0] for _, picture in shown[:2])
        facts.append(f"PSNR against the converged render: {before:.2f} dB as rendered, {after:.2f} dB filtered.")
    if found.uncertainty is not None:
        facts.append(f"Standard uncertainty of the filtered values: {np.median(found.uncertainty):.2g} in the median.")
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

    from procedures.outcome import BadInput
    from procedures.reading.arrays import checked_array, read_npz

    arrays, _ = read_npz(path, ("reference", "image"))
    truth = arrays.get("reference", arrays.get("image"))
    if truth is None:
        raise BadInput(f"{path} has no array `reference` or `image`", f"give a converged render of shape {shape}")
    return checked_array(truth, f"the reference {path}", shape, remedy="give a converged render of the film's size")


def _source(path: Path) -> dict[str, str]:
    return {"path": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
