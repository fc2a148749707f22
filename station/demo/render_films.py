"""Films of rendered scenes, saved as they grow: an interrupted render continues from its file."""

from pathlib import Path

import numpy as np

from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import read_film, write_film
from simulators.rays.path_tracer import RayScene, ThinLensCamera, cast
from station.common.progress import Progress, silent

PASS = 32
"""Samples per pixel after which a film is saved."""


def render_film(
    scene: RayScene,
    camera: ThinLensCamera,
    samples: int,
    seed: int,
    path: Path,
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> Film:
    """The film of a scene with `samples` samples per pixel, continuing the film in `path`.

    That file must have the same scene, camera and seed: name it after them.
    """
    film = read_film(path) if path.exists() else Film.blank(camera.rows, camera.columns)
    taken = film.count.astype(np.int64) + film.dropped
    for wanted in (*range(int(taken.min()) + PASS, samples, PASS), samples):
        if (taken >= wanted).all():
            continue
        cast(scene, camera, wanted, film.add, seed=seed, taken=taken, threads=threads)
        taken = film.count.astype(np.int64) + film.dropped
        path.parent.mkdir(parents=True, exist_ok=True)
        write_film(film, path)
        progress(f"{path.stem}: {wanted} of {samples} samples per pixel")
    return film


def passes(samples: int) -> int:
    """Number of progress steps of `render_film` without an earlier film."""
    return -(-samples // PASS)
