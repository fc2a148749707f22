"""The PSF of each plane from a photograph of the noise chart with three witnesses."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from procedures.outcome import BadInput, BadParameter, Outcome
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.witness import Photographs, WitnessedPsf, witnessed_psf
from procedures.raw import RawFrame
from station.calibration.planes import plane_result
from station.common.progress import Progress, silent
from station.procedure.base import Inputs, setting
from station.procedure.builtin.pattern import GRADE, PatternSettings
from station.procedure.psf import PsfProcedure
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.result_files import number_record
from station.results.terms import USUAL, Terms

ROLES = ("SHORT", "LONG", "NEAR", "DEFOCUSED")


class WitnessedSettings(PatternSettings, frozen=True, kw_only=True):
    """The settings of one photograph, and the ratio of the exposures."""

    exposure_ratio: Annotated[
        float | None, setting("Exposure of LONG over that of SHORT.  [default: as the camera recorded]")
    ] = None


class Witnessed(PsfProcedure[WitnessedSettings]):
    """Two exposures, a second distance, a slight defocus."""

    name = "witnessed"
    title = "PSF with witnesses"
    help = """Estimate the PSF from SHORT LONG NEAR DEFOCUSED, four photographs of the noise chart.

    SHORT and LONG differ in the exposure time alone, LONG by twice; NEAR is from two thirds of the distance; DEFOCUSED
    is LONG with the focus slightly off. The PSF is that of LONG. The others show what a single photograph has to
    assume: a linear response, no sharpening, a sharp print, no stray light."""
    inputs = Inputs.PHOTOGRAPHS
    Settings = WitnessedSettings
    argument = " ".join(ROLES)

    def measure(
        self, paths: Sequence[Path], settings: WitnessedSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        if len(paths) != len(ROLES):
            raise BadParameter(
                f"a witnessed PSF needs {len(ROLES)} photographs; got {len(paths)}", f"give {' '.join(ROLES)}"
            )
        frames = []
        for path in paths:
            frames.append(settings.read(path))
            progress(f"read {path}")
        long = frames[1]
        ratio = settings.exposure_ratio or _recorded_ratio(frames[0], long)
        parameters = PatternParameters(
            **settings.sampling(), at=terms.frequencies(settings.plane_pixels(long)), origin=settings.origin
        )
        limit, chart = settings.limit(long.exposure), settings.source.chart
        results = []
        for name in long.planes:
            if any(name not in frame.planes for frame in frames):
                raise BadInput(f"every photograph needs the plane {name}", "give four photographs of one camera")
            short, main, near, defocused = (frame.planes[name] for frame in frames)
            four = Photographs(short, main, near, defocused, ratio)
            outcome = witnessed_psf(four, chart, parameters, limit(main))
            results.append(_result(four, outcome))
        asked = {**parameters.to_record(), "chart": settings.source.origin, "origin": settings.origin,
                 "exposure_ratio": ratio, GRADE: "witnessed"}  # fmt: skip
        return self.measurement(frames, results, asked, settings, terms)


def _result(four: Photographs, outcome: Outcome[WitnessedPsf]) -> PlaneResult:
    witnessed = outcome.value
    psf = Outcome(witnessed and witnessed.psf, outcome.verdict, outcome.reason, outcome.remedy, outcome.other_causes)
    result = plane_result(four.long, psf)
    if witnessed is None:
        return result
    details = {name: number_record(number) for name, number in witnessed.numbers.items()}
    return replace(result, numbers={**result.numbers, **witnessed.numbers}, details=details)


def _recorded_ratio(short: RawFrame, long: RawFrame) -> float:
    """Ratio of the exposure times. Raises BadParameter where the camera did not record them."""
    first, second = (one.exposure.exposure_s if one.exposure else None for one in (short, long))
    if not first or not second:
        raise BadParameter(
            "the ratio of the exposures must be known; the camera recorded no exposure time", "give --exposure-ratio"
        )
    return second / first
