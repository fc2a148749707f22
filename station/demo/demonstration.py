"""The results of a demonstration: photographs, planes compared with the truth, and their summary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procedures.outcome import Verdict
from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters
from procedures.raw import RawFrame
from simulators.bench.demonstration import Staging
from station.demo.truth_comparison import TruthComparison
from station.results.plane_result import PlaneResult


@dataclass(frozen=True, eq=False)
class ComparedPlane:
    """A plane's result and its comparison with the truth, None if it was refused."""

    result: PlaneResult
    comparison: TruthComparison | None

    @property
    def name(self) -> str:
        """Name of the plane."""
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
        """Planes of all photographs."""
        return tuple(plane for shot in self.shots for plane in shot.planes)

    @property
    def refused(self) -> tuple[ComparedPlane, ...]:
        """Planes without a PSF."""
        return tuple(plane for plane in self.planes if plane.comparison is None)


@dataclass(frozen=True)
class Summary:
    """Agreement of all planes with the truth.

    `ratio_*` are errors of PSFs over the expected errors, `centre_px` is the largest error of a centre, `mtf50_within`
    the number of MTF50 within 2.5 standard uncertainties of the truth.
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
