"""The project's own renders, filtered: gain over the same samples unfiltered, and its slope as samples grow.

python -m tests.benchmarks.ray_scenes [--columns 320] [--reference 512] [--out FOLDER] [scene ...]; with a folder it
keeps the films there and writes a page that shows noisy, filtered and converged side by side.

Errors are against a render with another seed, less what that render's own noise adds to them.
"""

import argparse
import os
import platform
import time
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procedures.ray_histogram.adaptive import allot
from procedures.ray_histogram.comparison import decibels, shown_error
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import write_film
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from simulators.rays.path_tracer import RayScene, ThinLensCamera, cast
from simulators.rays.ray_scenes import SCENES
from station.reports.ray_page import RenderRow, ray_page
from tests.benchmarks.ray_histograms import nl_means

SAMPLES = (16, 64, 256)
SHOWN = 64
THREADS = os.cpu_count() or 1


def _cast_more(scene: RayScene, camera: ThinLensCamera, film: Film, wanted: npt.NDArray[np.int64]) -> None:
    taken = film.count.astype(np.int64) + film.dropped
    cast(scene, camera, wanted, film.add, seed=3, taken=taken, threads=THREADS)


def measure(name: str, columns: int, converged: int, out: Path | None) -> RenderRow:
    """Render, filter and print one scene."""
    scene, camera = SCENES[name](3 * columns // 4, columns)
    reference, film = (Film.blank(camera.rows, camera.columns) for _ in range(2))
    start = time.perf_counter()
    cast(scene, camera, converged, reference.add, seed=2, threads=THREADS)
    seconds = time.perf_counter() - start
    paths = converged * camera.rows * camera.columns / 1e6
    print(f"\n{name}: {camera.columns} x {camera.rows}, reference {seconds:.0f} s, {paths / seconds:.2f} M paths/s")
    ends: list[tuple[float, float]] = []
    for n in SAMPLES:
        cast(scene, camera, n, film.add, seed=1, taken=film.count.astype(np.int64) + film.dropped, threads=THREADS)
        found = filter_film(film, threads=THREADS)
        ends.append(judge(film, found, reference))
        if n == SHOWN:
            row = shown(name, film, found, reference)
            if out is not None:
                write_film(film, out / f"{name}.npz")
    adapt(scene, camera, reference)
    doublings = np.log2(SAMPLES[-1] / SAMPLES[0])
    slopes = [(ends[-1][i] - ends[0][i]) / doublings for i in (0, 1)]
    print(f"slope per doubling: {slopes[0]:.2f} dB unfiltered, {slopes[1]:.2f} dB filtered")
    return row


def judge(film: Film, found: FilteredFilm, reference: Film) -> tuple[float, float]:
    """Print the film's error, unfiltered and filtered; returns the two in dB."""
    noisy, filtered = (shown_error(picture, reference) for picture in (film.mean, found.picture))
    before, after, means = (decibels(e) for e in (noisy, filtered, shown_error(nl_means(film), reference)))
    print(
        f"{film.count.mean():4.0f} samples: {before:.2f} dB, NL-means {means:.2f} dB, filtered {after:.2f} dB,"
        f" gain {after - before:.2f} dB: the quality of {noisy / filtered:.1f} x the samples"
    )
    return before, after


def shown(name: str, film: Film, found: FilteredFilm, reference: Film) -> RenderRow:
    """The film on the page, as it is now."""
    before, after = (decibels(shown_error(picture, reference)) for picture in (film.mean, found.picture))
    pictures = (
        (f"{film.count.mean():.0f} samples", film.mean.copy()),
        ("filtered", found.picture),
        (f"{reference.count.mean():.0f} samples", reference.mean),
    )
    return RenderRow(name, pictures, found.similar, (f"{before:.2f} dB as rendered, {after:.2f} dB filtered.",))


def adapt(scene: RayScene, camera: ThinLensCamera, reference: Film) -> None:
    """Print the error of as many samples, half of them placed where few pixels were similar."""
    film = Film.blank(camera.rows, camera.columns)
    more = partial(_cast_more, scene, camera, film)
    more(np.full(film.count.shape, SHOWN // 2))
    for _ in range(2):
        similar = filter_film(film, threads=THREADS).similar
        more(film.count.astype(np.int64) + film.dropped + allot(film, similar, SHOWN // 4 * film.count.size))
    found = filter_film(film, threads=THREADS)
    after = decibels(shown_error(found.picture, reference))
    print(f"{film.count.mean():4.0f} samples in the mean, half of them placed adaptively: filtered {after:.2f} dB")


def main() -> None:
    """Print environment, then every scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--columns", type=int, default=320)
    parser.add_argument("--reference", type=int, default=512)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    print(f"Python {platform.python_version()}, {platform.machine()}, {THREADS} cores, load {os.getloadavg()[0]:.1f}")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    rows = tuple(measure(name, options.columns, options.reference, options.out) for name in options.scenes)
    if options.out is not None:
        (options.out / "rays.html").write_bytes(ray_page("Renders of the simulated bench", rows))


if __name__ == "__main__":
    main()
