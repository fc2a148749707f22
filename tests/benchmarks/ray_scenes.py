"""The project's own renders, filtered: gain over the same samples unfiltered, and its slope as samples grow.

python tests/benchmarks/ray_scenes.py [--columns 320] [--reference 512] [--out FOLDER] [scene ...]; with a folder it
keeps the films there and writes a page that shows noisy, filtered and converged side by side.

Errors are against a render with another seed, less what that render's own noise adds to them.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procedures.ray_histogram.comparison import decibels, shown_error
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import write_film
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from simulators.ray_scenes import SCENES
from simulators.rays import cast
from station.ray_page import RenderRow, ray_page

SAMPLES = (16, 64, 256)
SHOWN = 64
THREADS = os.cpu_count() or 1


def measure(name: str, columns: int, converged: int, out: Path | None) -> RenderRow:
    """Render, filter and print one scene."""
    scene, camera = SCENES[name](3 * columns // 4, columns)
    reference, film = (Film.blank(camera.rows, camera.columns) for _ in range(2))
    start = time.perf_counter()
    cast(scene, camera, converged, reference.add, seed=2, threads=THREADS)
    seconds = time.perf_counter() - start
    paths = converged * camera.rows * camera.columns
    print(
        f"\n{name}: {camera.columns} x {camera.rows}, reference {seconds:.0f} s, {paths / seconds / 1e6:.2f} M paths/s"
    )
    rows: dict[int, tuple[float, float]] = {}
    shown: tuple[npt.NDArray[np.floating], FilteredFilm] | None = None
    for n in SAMPLES:
        cast(scene, camera, n, film.add, seed=1, taken=film.count.astype(np.int64) + film.dropped, threads=THREADS)
        found = filter_film(film, threads=THREADS)
        noisy, filtered = shown_error(film.mean, reference), shown_error(found.picture, reference)
        rows[n] = decibels(noisy), decibels(filtered)
        print(
            f"{n:4d} samples: {rows[n][0]:.2f} dB, filtered {rows[n][1]:.2f} dB, gain {rows[n][1] - rows[n][0]:.2f} dB:"
            f" the quality of {noisy / filtered:.1f} x the samples"
        )
        if n == SHOWN:
            shown = film.mean.copy(), found
            if out is not None:
                write_film(film, out / f"{name}.npz")
    doublings = np.log2(SAMPLES[-1] / SAMPLES[0])
    slopes = [(rows[SAMPLES[-1]][i] - rows[SAMPLES[0]][i]) / doublings for i in (0, 1)]
    print(f"slope per doubling: {slopes[0]:.2f} dB unfiltered, {slopes[1]:.2f} dB filtered")
    assert shown is not None
    picture, found = shown
    pictures = ((f"{SHOWN} samples", picture), ("filtered", found.picture), (f"{converged} samples", reference.mean))
    fact = f"{SHOWN} samples: {rows[SHOWN][0]:.2f} dB as rendered, {rows[SHOWN][1]:.2f} dB filtered."
    return RenderRow(name, pictures, found.similar, (fact,))


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
