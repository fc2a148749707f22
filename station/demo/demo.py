"""The demonstration: a simulated camera photographs the chart, and what is found in its files is held to the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from procedures.outcome import Verdict
from procedures.pattern_print.formats import encode
from procedures.pattern_print.sheet import Size
from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf
from procedures.raw import RawFrame, read_frame
from simulators.bench.demonstration import PITCH_UM, SETUPS, Setup, photograph
from simulators.camera.camera import Photograph
from station.calibration.plane_records import Calibrated, calibrate, diffraction_limit
from station.common.progress import Progress, silent
from station.demo.truth_comparison import Comparison, compare
from station.results.result_files import RECORD, ResultFolder, json_text, software, write_psf_result

SCHEMA = "station/demo/1"
CHART = "chart.pdf"
PAGE = "index.html"
STEPS_PER_PHOTOGRAPH = 5
"""The photograph, then its four planes."""


@dataclass(frozen=True, eq=False)
class Checked:
    """One plane: what was found, and how near the truth it is, None where it was refused."""

    calibrated: Calibrated[PatternPsf]
    comparison: Comparison | None

    @property
    def name(self) -> str:
        """The plane's."""
        return self.calibrated.record.name


@dataclass(frozen=True, eq=False)
class Shot:
    """One photograph as it was read back from its file, and its planes.

    Attributes
    ----------
    path : Path
        Of the DNG, from the demonstration's folder.
    """

    setup: Setup
    path: Path
    frame: RawFrame
    planes: tuple[Checked, ...]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Everything a demonstration found."""

    seed: int
    chart: Source
    parameters: PatternParameters
    shots: tuple[Shot, ...]

    @property
    def planes(self) -> tuple[Checked, ...]:
        """The planes of all photographs."""
        return tuple(plane for shot in self.shots for plane in shot.planes)

    @property
    def refused(self) -> tuple[Checked, ...]:
        """The planes without a PSF."""
        return tuple(plane for plane in self.planes if plane.comparison is None)


@dataclass(frozen=True)
class Summary:
    """How well all planes together agree with the truth.

    Attributes
    ----------
    ratio_mean, ratio_least, ratio_most : float
        Of the PSFs' errors over what was expected.
    centre_px : float
        Largest distance of a centre from where it should be.
    mtf50_n, mtf50_within : int
        How many MTF50 there are, and how many lie within 2.5 standard uncertainties of the truth.
    """

    planes: int
    passed: int
    doubtful: int
    refused: int
    ratio_mean: float
    ratio_least: float
    ratio_most: float
    centre_px: float
    mtf50_n: int
    mtf50_within: int


def summary(demonstration: Demonstration) -> Summary:
    """The demonstration in ten numbers; NaN where every plane was refused."""
    verdicts = [plane.calibrated.record.verdict for plane in demonstration.planes]
    compared = [plane.comparison for plane in demonstration.planes if plane.comparison is not None]
    ratios = [one.ratio for one in compared] or [math.nan]
    sigmas = [against.sigmas for one in compared for against in one.mtf50.values()]
    return Summary(
        planes=len(verdicts),
        passed=verdicts.count(Verdict.PASS),
        doubtful=verdicts.count(Verdict.DOUBTFUL),
        refused=verdicts.count(Verdict.REFUSED),
        ratio_mean=float(np.mean(ratios)),
        ratio_least=min(ratios),
        ratio_most=max(ratios),
        centre_px=max((one.centre_error_px for one in compared), default=math.nan),
        mtf50_n=len(sigmas),
        mtf50_within=sum(abs(sigma) <= 2.5 for sigma in sigmas),
    )


def steps(setups: tuple[Setup, ...] = SETUPS) -> int:
    """How many steps of progress a demonstration reports: also the chart and the page."""
    return STEPS_PER_PHOTOGRAPH * len(setups) + 2


def run_demo(
    out: Path, seed: int = 1, *, setups: tuple[Setup, ...] = SETUPS, progress: Progress = silent
) -> tuple[Demonstration, str]:
    """Print, photograph, read, estimate, compare, report; returns what was found, and the record's text.

    Parameters
    ----------
    out : Path
        Receives chart, photographs, results, record and page, all at once when everything is done.
    seed : int
        Of the camera's noise.
    """
    start = time.perf_counter()
    chart, parameters = Source.from_seed().with_edges(), PatternParameters()
    with ResultFolder(out) as folder:
        folder.write(CHART, encode(Path(CHART), chart, Size(300.0)).data)
        progress(f"printed the chart, {chart.origin}")
        shots = tuple(
            _shoot(folder.staging, setup, chart, parameters, np.random.default_rng([seed, i]), progress)
            for i, setup in enumerate(setups)
        )
        found = Demonstration(seed, chart, parameters, shots)
        folder.write(PAGE, _page(found).encode())
        progress("wrote the page")
        text = json_text(_record(found, time.perf_counter() - start))
        folder.write(RECORD, text.encode())
        folder.publish()
    return found, text


def _page(found: Demonstration) -> str:
    from station.demo.demo_page import demonstration_page  # here: it draws, and that import is slow

    return demonstration_page(found, summary(found))


def _shoot(
    root: Path,
    setup: Setup,
    chart: Source,
    parameters: PatternParameters,
    rng: np.random.Generator,
    progress: Progress,
) -> Shot:
    """One photograph, from the light to the files of its planes."""
    start = time.perf_counter()
    path = Path("photographs", f"{setup.name}.dng")
    (root / path).parent.mkdir(exist_ok=True)
    truth = photograph(setup, chart.chart, rng, root / path)
    progress(f"{setup.title}: photographed")
    frame = read_frame(root / path)
    planes = tuple(_check(frame, truth, chart, parameters, setup, progress))
    about = {
        "procedure": "pattern",
        "input": [{"path": path.as_posix(), "sha256": frame.sha256}],
        "parameters": {**parameters.told(), "chart": chart.origin, "pixel_pitch_um": PITCH_UM},
        "duration_s": round(time.perf_counter() - start, 3),
    }
    with ResultFolder(root / "results" / setup.name) as folder:
        write_psf_result(folder, [plane.calibrated.record for plane in planes], about)
    return Shot(setup, path, frame, planes)


def _check(
    frame: RawFrame,
    truth: Photograph,
    chart: Source,
    parameters: PatternParameters,
    setup: Setup,
    progress: Progress,
) -> Iterator[Checked]:
    """Every plane estimated from the file, and compared with the PSF that made it."""
    limit = partial(diffraction_limit, frame.exposure, pixel_pitch_um=PITCH_UM)
    for one in calibrate(frame, chart.chart, parameters, limit):
        progress(f"{setup.title}: {one.record.name} {one.record.verdict}")
        if one.found is None:
            yield Checked(one, None)
        else:
            psf = one.found.psf
            true = truth.true_psf(one.record.name, psf.s, psf.k)
            yield Checked(one, compare(one.found, true.h, true.floor, partial(truth.true_otf, one.record.name)))


def _record(found: Demonstration, duration_s: float) -> dict[str, Any]:
    """The record of the whole demonstration."""
    return {
        "schema": SCHEMA,
        "procedure": "demo",
        "parameters": {"seed": found.seed, **found.parameters.told(), "chart": found.chart.origin},
        "summary": asdict(summary(found)),
        "photographs": [_shot_entry(shot) for shot in found.shots],
        "software": software(),
        "duration_s": round(duration_s, 3),
    }


def _shot_entry(shot: Shot) -> dict[str, Any]:
    return {
        "name": shot.setup.name,
        "title": shot.setup.title,
        "input": {"path": shot.path.as_posix(), "sha256": shot.frame.sha256},
        "result": f"results/{shot.setup.name}/{RECORD}",
        "planes": {plane.name: _plane_entry(plane) for plane in shot.planes},
    }


def _plane_entry(plane: Checked) -> dict[str, Any]:
    record, against = plane.calibrated.record, plane.comparison
    entry: dict[str, Any] = {"verdict": str(record.verdict), "reason": record.reason, "remedy": record.remedy}
    if against is not None:
        entry |= {"error": against.error, "expected_error": against.expected, "centre_px": list(against.centre_px)}
        for name, mtf50 in against.mtf50.items():
            entry[f"mtf50_{name}"] = {**asdict(mtf50.measured), "true": mtf50.true, "sigmas": mtf50.sigmas}
    return entry
