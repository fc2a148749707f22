"""Films of the station's own renders, kept in files as they grow: a render that was interrupted goes on from there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import read_film, write_film
from simulators.rays.path_tracer import Scene, ThinLensCamera, cast
from station.common.progress import Progress, silent

PASS = 32
"""Samples per pixel between two savings of a film."""


def render_film(
    scene: Scene,
    camera: ThinLensCamera,
    samples: int,
    seed: int,
    path: Path,
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> Film:
    """The film of a scene with so many samples per pixel; what `path` holds already is not rendered again.

    The file must be of the same scene, camera and seed: name it after them.
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
    """How many steps `render_film` tells when nothing was rendered before."""
    return -(-samples // PASS)
