"""The PSF of each plane from one photograph of the noise chart."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from procedures.pattern_psf.estimate import PatternParameters
from station.calibration.planes import calibrate
from station.calibration.sensor_models import NO_SENSOR, read_sensor
from station.common.progress import Progress, silent
from station.procedure.base import Inputs, setting
from station.procedure.psf import ChartPsfSettings, PsfProcedure
from station.results.measurement import Measurement
from station.results.terms import USUAL, Terms

GRADE = "grade"
"""Key of the parameter that says what a PSF rests on."""
SINGLE = "single photograph: linear response, no sharpening, sharp print and no stray light are assumed"


class PatternSettings(ChartPsfSettings, frozen=True, kw_only=True):
    """Physical model of the PSF, and the sensor."""

    physics: Annotated[
        bool | None, setting("Also explain the PSF by photosites, low-pass filter, diffraction and aberrations.")
    ] = False  # fmt: skip
    sensor: Annotated[
        Path | None,
        setting("Of station sensor: its response is undone, its noise weighs the samples.", metavar="RESULT.json"),
    ] = None
    origin: Annotated[
        Literal["marks", "centroid", "peak"],
        setting("Centre of widths, encircled energies and Strehl ratio: the chart's marks, or the PSF's own."),
    ] = "marks"


class Pattern(PsfProcedure[PatternSettings]):
    """One photograph of the noise chart."""

    name = "pattern"
    title = "PSF from the noise chart"
    help = "Estimate the PSF from IMAGE, a photograph of the noise chart."
    inputs = Inputs.PHOTOGRAPH
    Settings = PatternSettings

    def measure(
        self, paths: Sequence[Path], settings: PatternSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        source = settings.source
        frame = settings.read(paths[0])
        progress(f"read {paths[0]}")
        parameters = PatternParameters(
            **settings.sampling(), at=terms.frequencies(settings.plane_pixels(frame)), origin=settings.origin
        )
        known = read_sensor(settings.sensor, frame) if settings.sensor else NO_SENSOR
        limit = settings.limit(frame.exposure, needed=bool(settings.physics))
        results = calibrate(frame, source.chart, parameters, limit, physics=bool(settings.physics), sensor=known,
                            progress=progress)  # fmt: skip
        asked = {**parameters.to_record(), "physics": bool(settings.physics), **known.record(), "chart": source.origin,
                 "origin": settings.origin, GRADE: SINGLE}  # fmt: skip
        return self.measurement([frame], results, asked, settings, terms)
