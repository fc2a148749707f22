"""The demonstration: photographs of the chart by a simulated camera; PSFs of its files are compared with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from procedures.pattern_print.formats import encode
from procedures.pattern_print.sheet import Size
from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters
from procedures.raw import RawFrame, read_frame
from simulators.bench.demonstration import PITCH_UM, SETUPS, WIDTH_MM, Staging, photograph
from simulators.camera.camera import Photograph
from station.calibration.planes import calibrate, diffraction_limit
from station.common.progress import Progress, silent
from station.common.versions import software
from station.demo.demonstration import ComparedPlane, Demonstration, DemoPhotograph, summary
from station.demo.truth_comparison import compare
from station.results.psf_files import write_psf_result
from station.results.record_head import InputFile, RecordHead, verdict_entry
from station.results.result_files import RECORD, ResultFolder, write_record

SCHEMA = "station/demo/1"
CHART = "chart.pdf"
PAGE = "index.html"
STEPS_PER_PHOTOGRAPH = 5
"""The photograph, then its four planes."""


def steps(setups: tuple[Staging, ...] = SETUPS) -> int:
    """Number of progress steps: photographs with their planes, chart and page."""
    return STEPS_PER_PHOTOGRAPH * len(setups) + 2


def run_demo(
    out: Path, seed: int = 1, *, setups: tuple[Staging, ...] = SETUPS, progress: Progress = silent
) -> tuple[Demonstration, str]:
    """Print, photograph, read, estimate, compare, report; returns the demonstration and the record's text.

    Parameters
    ----------
    out : Path
        Receives chart, photographs, results, record and page, all at once at the end.
    seed : int
        Seed of the camera's noise.
    """
    start = time.perf_counter()
    chart, parameters = Source.from_seed().with_edges(), PatternParameters()
    with ResultFolder(out) as folder:
        folder.write(CHART, encode(Path(CHART), chart, Size(WIDTH_MM)).data)
        progress(f"printed the chart, {chart.origin}")
        shots = tuple(
            _shoot(folder.staging, setup, chart, parameters, np.random.default_rng([seed, i]), progress)
            for i, setup in enumerate(setups)
        )
        demonstration = Demonstration(seed, chart, parameters, shots)
        from station.demo.demo_page import demonstration_page  # here: importing the drawing library is slow

        folder.write(PAGE, demonstration_page(demonstration, summary(demonstration)).encode())
        progress("wrote the page")
        text = write_record(folder, _record(demonstration, time.perf_counter() - start))
    return demonstration, text


def _shoot(
    root: Path,
    setup: Staging,
    chart: Source,
    parameters: PatternParameters,
    rng: np.random.Generator,
    progress: Progress,
) -> DemoPhotograph:
    """One photograph, from the scene to the result files of its planes."""
    start = time.perf_counter()
    path = Path("photographs", f"{setup.name}.dng")
    (root / path).parent.mkdir(exist_ok=True)
    truth = photograph(setup, chart.chart, rng, root / path)
    progress(f"{setup.title}: photographed")
    frame = read_frame(root / path)
    planes = tuple(_check(frame, truth, chart, parameters, setup, progress))
    head = RecordHead(
        "pattern",
        (InputFile(path.as_posix(), frame.sha256),),
        {**parameters.to_record(), "chart": chart.origin, "pixel_pitch_um": PITCH_UM},
        duration_s=round(time.perf_counter() - start, 3),
    )
    with ResultFolder(root / "results" / setup.name) as folder:
        write_psf_result(folder, [plane.result for plane in planes], head)
    return DemoPhotograph(setup, path, frame, planes)


def _check(
    frame: RawFrame,
    truth: Photograph,
    chart: Source,
    parameters: PatternParameters,
    setup: Staging,
    progress: Progress,
) -> Iterator[ComparedPlane]:
    """Every plane estimated from the file and compared with the true PSF."""
    limit = partial(diffraction_limit, frame.exposure, pixel_pitch_um=PITCH_UM)
    for one in calibrate(frame, chart.chart, parameters, limit):
        progress(f"{setup.title}: {one.name} {one.verdict}")
        if one.found is None:
            yield ComparedPlane(one, None)
        else:
            psf = one.found.psf
            true = truth.true_psf(one.name, psf.s, psf.k)
            yield ComparedPlane(one, compare(one.found, true.h, true.floor, partial(truth.true_otf, one.name)))


def _record(demonstration: Demonstration, duration_s: float) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "procedure": "demo",
        "parameters": {
            "seed": demonstration.seed,
            **demonstration.parameters.to_record(),
            "chart": demonstration.chart.origin,
        },
        "summary": asdict(summary(demonstration)),
        "photographs": [_shot_entry(shot) for shot in demonstration.shots],
        "software": software(),
        "duration_s": round(duration_s, 3),
    }


def _shot_entry(shot: DemoPhotograph) -> dict[str, Any]:
    return {
        "name": shot.setup.name,
        "title": shot.setup.title,
        "input": {"path": shot.path.as_posix(), "sha256": shot.frame.sha256},
        "result": f"results/{shot.setup.name}/{RECORD}",
        "planes": {plane.name: _plane_entry(plane) for plane in shot.planes},
    }


def _plane_entry(plane: ComparedPlane) -> dict[str, Any]:
    record, against = plane.result, plane.comparison
    entry = verdict_entry(record)
    if against is not None:
        entry |= {"error": against.error, "expected_error": against.expected, "centre_px": list(against.centre_px)}
        for name, mtf50 in against.mtf50.items():
            entry[f"mtf50_{name}"] = {**asdict(mtf50.measured), "true": mtf50.true, "sigmas": mtf50.sigmas}
    return entry
