"""The demonstration: photographs of the chart by a simulated camera; PSFs of its files are compared with the truth."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from procedures.numbers import Group, in_group
from procedures.outcome import Verdict
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
from station.demo.truth_comparison import TruthComparison, compare
from station.reports import otf_figures, psf_figures
from station.reports.page import exposure_words, render
from station.reports.psf_page import chart_figures, edge_rows
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import InputFile, RecordHead, verdict_entry
from station.results.result_files import RECORD, ResultFolder, write_record

SCHEMA = "station/demo/1"
CHART = "chart.pdf"
PAGE = "index.html"
SHOWN_PLANE = "G1"
PRINT_BLUR = 0.075
"""Standard deviation of the print's blur, in cells: that of a fine print."""
STEPS_PER_PHOTOGRAPH = 5
"""The photograph, then its four planes."""


@dataclass(frozen=True, eq=False)
class ComparedPlane:
    """A plane's result and its comparison with the truth, None if it was refused."""

    result: PlaneResult
    comparison: TruthComparison | None

    @property
    def name(self) -> str:
        return self.result.name


@dataclass(frozen=True, eq=False)
class DemoPhotograph:
    """One photograph read from its file, and its planes. path : of the DNG, relative to the demonstration's folder."""

    setup: Staging
    path: Path
    frame: RawFrame
    planes: tuple[ComparedPlane, ...]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """All photographs of a demonstration."""

    seed: int
    chart: Source
    parameters: PatternParameters
    shots: tuple[DemoPhotograph, ...]

    @property
    def planes(self) -> tuple[ComparedPlane, ...]:
        return tuple(plane for shot in self.shots for plane in shot.planes)

    @property
    def refused(self) -> tuple[ComparedPlane, ...]:
        return tuple(plane for plane in self.planes if plane.comparison is None)


@dataclass(frozen=True)
class Summary:
    """Agreement of all planes with the truth. `ratio_*` are errors of PSFs over the expected errors, `centre_px` is the
    largest error of a centre, `mtf50_within` the number of MTF50 within 2.5 standard uncertainties of the truth."""

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
    """Summary of a demonstration; NaN if every plane was refused."""
    verdicts = [plane.result.verdict for plane in demonstration.planes]
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


def steps(setups: tuple[Staging, ...] = SETUPS) -> int:
    """Number of progress steps: photographs with their planes, chart and page."""
    return STEPS_PER_PHOTOGRAPH * len(setups) + 2


def run_demo(
    out: Path, seed: int = 1, *, setups: tuple[Staging, ...] = SETUPS, progress: Progress = silent
) -> tuple[Demonstration, str]:
    """Print, photograph, read, estimate, compare, report; returns the demonstration and the record's text.

    out : receives chart, photographs, results, record and page, all at once at the end
    seed : seed of the camera's noise
    """
    start = time.perf_counter()
    chart, parameters = Source.from_seed().with_edges(), PatternParameters(print_blur=PRINT_BLUR)
    with ResultFolder(out) as folder:
        folder.write(CHART, encode(Path(CHART), chart, Size(WIDTH_MM)).data)
        progress(f"printed the chart, {chart.origin}")
        shots = tuple(
            _shoot(folder.staging, setup, chart, parameters, np.random.default_rng([seed, i]), progress)
            for i, setup in enumerate(setups)
        )
        demonstration = Demonstration(seed, chart, parameters, shots)
        folder.write(PAGE, demonstration_page(demonstration).encode())
        progress("wrote the page")
        text = write_record(folder, _record(demonstration, time.perf_counter() - start))
    return demonstration, text


def _shoot(
    root: Path, setup: Staging, chart: Source, parameters: PatternParameters, rng: np.random.Generator,
    progress: Progress,
) -> DemoPhotograph:  # fmt: skip
    """One photograph, from the scene to the result files of its planes."""
    start = time.perf_counter()
    path = Path("photographs", f"{setup.name}.dng")
    (root / path).parent.mkdir(exist_ok=True)
    truth = photograph(setup, chart.chart, rng, root / path)
    progress(f"{setup.title}: photographed")
    frame = read_frame(root / path)
    planes = tuple(compared_planes(frame, truth, chart, parameters, setup, progress))
    head = RecordHead(
        "pattern",
        (InputFile(path.as_posix(), frame.sha256),),
        {**parameters.to_record(), "chart": chart.origin, "pixel_pitch_um": PITCH_UM},
        duration_s=round(time.perf_counter() - start, 3),
    )
    with ResultFolder(root / "results" / setup.name) as folder:
        write_psf_result(folder, [plane.result for plane in planes], head)
    return DemoPhotograph(setup, path, frame, planes)


def compared_planes(
    frame: RawFrame, truth: Photograph, chart: Source, parameters: PatternParameters, setup: Staging, progress: Progress
) -> Iterator[ComparedPlane]:
    """Every plane estimated from the file and compared with the true PSF."""
    limit = partial(diffraction_limit, frame.exposure, pixel_pitch_um=PITCH_UM)
    for one in calibrate(frame, chart.chart, parameters, limit):
        progress(f"{setup.title}: {one.name} {one.verdict}")
        if one.estimate is None:
            yield ComparedPlane(one, None)
        else:
            psf = one.estimate.psf
            true = truth.true_psf(one.name, psf.s, psf.k)
            yield ComparedPlane(one, compare(one.estimate, true.h, true.floor, partial(truth.true_otf, one.name)))


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
        "photographs": [
            {
                "name": shot.setup.name,
                "title": shot.setup.title,
                "input": {"path": shot.path.as_posix(), "sha256": shot.frame.sha256},
                "result": f"results/{shot.setup.name}/{RECORD}",
                "planes": {plane.name: _plane_entry(plane) for plane in shot.planes},
            }
            for shot in demonstration.shots
        ],
        "software": software(),
        "duration_s": round(duration_s, 3),
    }


def _plane_entry(plane: ComparedPlane) -> dict[str, Any]:
    record, against = plane.result, plane.comparison
    entry = verdict_entry(record)
    if against is not None:
        entry |= {"error": against.error, "expected_error": against.expected, "centre_px": list(against.centre_px)}
        for name, mtf50 in against.mtf50.items():
            entry[f"mtf50_{name}"] = {**asdict(mtf50.measured), "true": mtf50.true, "sigmas": mtf50.sigmas}
    return entry


def demonstration_page(demonstration: Demonstration) -> str:
    """The demonstration's report."""
    return render(
        "demo.html",
        demonstration=demonstration,
        summary=summary(demonstration),
        size=Size(WIDTH_MM),
        compared=[
            psf_figures.ratios_figure(_compared(demonstration, lambda one: [one.ratio]), "ratios"),
            psf_figures.sigmas_figure(
                _compared(demonstration, lambda one: [against.sigmas for against in one.mtf50.values()]), "sigmas"
            ),
            psf_figures.places_figure(_places(demonstration), "places"),
        ],
        titles=in_group(Group.HEADLINE),
        edge_rows=edge_rows,
        pictures={shot.setup.name: _pictures(shot, f"p{i}") for i, shot in enumerate(demonstration.shots, 1)},
        exposure=exposure_words,
        software=software(),
    )


def _compared(demonstration: Demonstration, numbers: Callable[[TruthComparison], Sequence[float]]) -> psf_figures.Rows:
    return [
        (shot.setup.title, {one.name: numbers(one.comparison) for one in shot.planes if one.comparison is not None})
        for shot in demonstration.shots
    ]


def _places(demonstration: Demonstration) -> list[Any]:
    outlines = []
    for shot in demonstration.shots:
        for plane in shot.planes[:1]:
            if plane.result.estimate is not None:
                rows, columns = shot.frame.planes[plane.name].samples.shape
                outlines.append(psf_figures.chart_outline(plane.result.estimate) / (columns, rows))
    return outlines


def _pictures(shot: DemoPhotograph, name: str) -> Mapping[str, Any]:
    """Figures of one photograph: of its shown plane, and of every plane."""
    pictures: dict[str, Any] = {"planes": {}}
    for plane in shot.planes:
        estimate, against = plane.result.estimate, plane.comparison
        if estimate is None or against is None:
            continue
        here = f"{name}-{plane.name}"
        pictures["planes"][plane.name] = {
            "psf": psf_figures.psf_figure(estimate.psf, against.aligned, f"{here}-psf"),
            "mtf": otf_figures.mtf_figure(estimate.quality, against.otf, f"{here}-mtf", estimate.diffraction),
        }
        if plane.name == SHOWN_PLANE:
            pictures["chart"] = chart_figures(shot.frame.planes[plane.name], estimate, here)
    return pictures
