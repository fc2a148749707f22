"""A lens over aperture, focus and ISO, from photographs of the noise chart from one mounting."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from procedures.numbers import WAVEFRONT_RMS
from station.calibration.series import PAGE, TABLE, best_apertures, points_of, series_table, several
from station.common.progress import Progress, silent
from station.procedure.base import BatchSummary, Inputs, setting
from station.procedure.builtin.pattern import Pattern, PatternSettings
from station.results.measurement import Measurement
from station.results.terms import USUAL, Terms


class SeriesSettings(PatternSettings, frozen=True, kw_only=True):
    """The settings of each photograph."""

    physics: Annotated[bool | None, setting(
        "Also explain each PSF by photosites, low-pass filter, diffraction and aberrations, for the wavefront's "
        "error.  [default: where the pixel pitch is given]")] = None  # fmt: skip


class Series(Pattern):
    """Photographs of one chart, each by itself; those of the same settings are averaged."""

    name = "series"
    title = "lens over aperture, focus and ISO"
    record_name = "pattern"
    help = """Follow MTF50, Strehl ratio and wavefront over aperture, focus and ISO in FOLDER, photographs of the chart.

    The settings come from the cameras' records; photographs of the same settings are averaged. Writes series.csv and
    series.html in addition to the files of `station batch`: it is a batch with `procedure = "series"`, and an
    interrupted one continues."""
    inputs = Inputs.SERIES
    Settings = SeriesSettings

    def measure(
        self, paths: Sequence[Path], settings: PatternSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        if settings.physics is None:
            settings = msgspec.structs.replace(settings, physics=settings.pixel_pitch_um is not None)
        return super().measure(paths, settings, terms, progress)

    def summary(self, rows: Sequence[Any]) -> BatchSummary:
        """Table and page of the series, the best apertures, and what does not belong together."""
        from station.reports.batches.series_page import series_page  # here: it draws, which is slow to load

        points = points_of(rows)
        lines = [aperture.words for aperture in best_apertures(points)]
        page = series_page(points, lines).encode()
        if points and not any(point.number == WAVEFRONT_RMS for point in points):
            lines.append("no wavefront error: it needs --pixel-pitch-um, as the Strehl ratio does, and --physics")
        files = {TABLE: series_table(points), PAGE: page}
        return BatchSummary(files, lines, several(rows))
