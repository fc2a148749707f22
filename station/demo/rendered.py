"""The simulated bench, rendered: light traced through scenes in depth, filtered, photographed and shown. Films are
saved in `films` next to the results as they grow: an interrupted render continues where it stopped."""

import hashlib
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.dng import Shot
from procedures.numbers import DROPPED_SAMPLES
from procedures.outcome import BadParameter
from procedures.ray_histogram.comparison import decibels, shown_error
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from simulators.camera.optics import Optics
from simulators.camera.render import photograph_render
from simulators.camera.sensor import Sensor
from simulators.rays.ray_scenes import SCENES
from station.common.progress import Progress, silent
from station.common.versions import software
from station.demo.rendered_depth import (
    DepthPlan,
    RestoredDepth,
    depth_entry,
    depth_row,
    passes,
    render_film,
    restored_depth,
)
from station.demo.rendered_depth import steps as depth_steps
from station.drawing.pictures import display_png
from station.reports.ray_page import RenderRow, StripRow, ray_page
from station.results.result_files import ResultFolder, write_record

SCHEMA = "station/rendered/1"
PAGE = "rays.html"
REFERENCE_SEED = 1 << 32
"""Added to the seed of converged renders, so that their noise is independent."""


@dataclass(frozen=True)
class RenderPlan:
    """Settings of a rendering.

    columns : width of the 4 : 3 pictures; a multiple of 8, so that mosaics have whole tiles
    samples, converged : samples per pixel of the filtered film and of its reference
    restored : whether a scene in depth is photographed at two apertures and restored
    """

    columns: int = 320
    samples: int = 64
    converged: int = 512
    seed: int = 1
    scenes: tuple[str, ...] = tuple(SCENES)
    restored: bool = True

    def __post_init__(self) -> None:
        unknown = sorted(set(self.scenes) - set(SCENES))
        if unknown:
            raise BadParameter(f"no scene {unknown[0]!r}", f"choose from {', '.join(SCENES)}")
        if self.columns < 32 or self.columns % 8:
            raise BadParameter(f"pictures of {self.columns} columns", "choose a multiple of 8, 32 or more")
        if self.samples < 2 or self.converged < 2:
            raise BadParameter(f"{min(self.samples, self.converged)} samples per pixel", "choose at least 2")

    @property
    def rows(self) -> int:
        return 3 * self.columns // 4


@dataclass(frozen=True, eq=False)
class Rendered:
    """One scene: rendered, filtered, converged, and the SHA-256 of its photograph, `NAME.dng`."""

    name: str
    film: Film
    filtered: FilteredFilm
    reference: Film
    sha256: str

    @property
    def psnr_db(self) -> dict[str, float]:
        """PSNR with respect to the converged render, corrected for its noise."""
        pictures = (("rendered", self.film.mean), ("filtered", self.filtered.picture))
        return {name: decibels(shown_error(picture, self.reference)) for name, picture in pictures}


def rendered_demo(
    out: Path, plan: RenderPlan | None = None, *, threads: int = 1, progress: Progress = silent
) -> tuple[tuple[Rendered, ...], RestoredDepth | None, str]:
    """Render, filter, photograph, restore and show; returns the scenes, the restoration and the record's text.

    out : receives `films` as they grow, and pictures, photographs, page and record all at once at the end
    """
    start = time.perf_counter()
    plan = plan or RenderPlan()
    with ResultFolder(out) as folder:
        scenes = tuple(_render(folder, out / "films", name, plan, threads, progress) for name in plan.scenes)
        depth = None
        if plan.restored:
            pair = DepthPlan(plan.rows, plan.columns, plan.samples, plan.seed)
            depth = restored_depth(folder, out / "films", pair, threads=threads, progress=progress)
        rows: list[RenderRow | StripRow] = [_row(scene) for scene in scenes]
        rows += [depth_row(depth)] if depth else []
        folder.write(PAGE, ray_page("The simulated bench, rendered", tuple(rows)))
        record = {
            "schema": SCHEMA,
            "parameters": asdict(plan),
            "scenes": {scene.name: _entry(scene) for scene in scenes},
            "restored": depth and depth_entry(depth),
            "software": software(),
            "duration_s": round(time.perf_counter() - start, 3),
        }
        return scenes, depth, write_record(folder, record)


def _render(
    folder: ResultFolder, films: Path, name: str, plan: RenderPlan, threads: int, progress: Progress
) -> Rendered:
    scene, camera = SCENES[name](plan.rows, plan.columns)
    stem = f"{name}-{plan.columns}x{plan.rows}-seed{plan.seed}"
    film, reference = (
        render_film(scene, camera, samples, seed, films / f"{stem}-{samples}.npz", threads=threads, progress=progress)
        for samples, seed in ((plan.samples, plan.seed), (plan.converged, plan.seed + REFERENCE_SEED))
    )
    filtered = filter_film(film, threads=threads)
    folder.write(f"{name}.png", display_png(filtered.picture))
    path = folder.staging / f"{name}.dng"
    sensor = Sensor(rows=plan.rows, columns=plan.columns)
    rng = np.random.default_rng([plan.seed, *name.encode()])
    shot = Shot(f_number=5.6, focal_length_mm=camera.focal_mm, subject_distance_mm=camera.focus_mm, comment=name)
    photograph_render(filtered.picture, Optics.typical(), sensor, rng, path, shot=shot)
    progress(f"{name}: filtered and photographed")
    return Rendered(name, film, filtered, reference, hashlib.sha256(path.read_bytes()).hexdigest())


def _row(rendered: Rendered) -> RenderRow:
    samples, converged = (round(float(film.count.mean())) for film in (rendered.film, rendered.reference))
    pictures = (
        (f"{samples} samples", rendered.film.mean),
        ("filtered", rendered.filtered.picture),
        (f"{converged} samples", rendered.reference.mean),
    )
    gain = rendered.psnr_db["filtered"] - rendered.psnr_db["rendered"]
    fact = (
        f"PSNR {rendered.psnr_db['rendered']:.2f} dB as rendered, {rendered.psnr_db['filtered']:.2f} dB filtered:"
        f" the quality of {10 ** (gain / 10):.0f} times as many samples."
    )
    return RenderRow(rendered.name, pictures, rendered.filtered.similar, (fact,))


def _entry(rendered: Rendered) -> dict[str, Any]:
    return {
        "psnr_db": rendered.psnr_db,
        "similar_median": list(rendered.filtered.median_similar),
        DROPPED_SAMPLES: int(rendered.film.dropped.sum()),
        "photograph": {"path": f"{rendered.name}.dng", "sha256": rendered.sha256},
    }


def steps(plan: RenderPlan) -> int:
    """Number of progress steps without earlier films."""
    films = passes(plan.samples) + passes(plan.converged)
    return len(plan.scenes) * (films + 1) + (depth_steps(plan.samples) if plan.restored else 0)
