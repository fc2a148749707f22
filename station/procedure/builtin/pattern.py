"""The PSF of each plane from one photograph of the noise chart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters
from station.calibration.planes import calibrate
from station.calibration.sensor_models import NO_SENSOR, read_sensor
from station.common.progress import Progress, silent
from station.procedure.base import ChartBits, ChartSeed, Inputs, chart_source
from station.procedure.psf import PsfProcedure, PsfSettings
from station.procedure.settings import setting
from station.results.measurement import Measurement
from station.results.terms import USUAL, Terms


class PatternSettings(PsfSettings, frozen=True, kw_only=True):
    """The chart, the sampling, and what is known and asked for besides."""

    bits: ChartBits = None
    seed: ChartSeed = None
    physics: Annotated[
        bool, setting("Also explain the PSF by photosites, low-pass filter, diffraction and aberrations.")
    ] = False  # fmt: skip
    sensor: (
        Annotated[
            Path,
            setting("Of station sensor: its response is undone, its noise weighs the samples.", metavar="RESULT.json"),
        ]
        | None
    ) = None  # fmt: skip

    def check(self) -> Source:
        """The chart. Raises ProcedureError where settings cannot be meant."""
        PatternParameters(**self.sampling())
        return chart_source(self.bits, self.seed)


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
        """The PSF of every plane."""
        source = settings.check()
        frame = settings.read(paths[0])
        progress(f"read {paths[0]}")
        parameters = PatternParameters(**settings.sampling(), at=terms.frequencies(settings.plane_pixels(frame)))
        known = read_sensor(settings.sensor, frame) if settings.sensor else NO_SENSOR
        limit = settings.limit(frame.exposure, needed=settings.physics)
        found = calibrate(frame, source.chart, parameters, limit, physics=settings.physics, sensor=known)
        asked = {**parameters.to_record(), "physics": settings.physics, **known.record(), "chart": source.origin}
        return self.measurement([frame], found, asked, settings, terms)


PROCEDURE = Pattern()
