"""The PSF of each plane over the whole frame, from photographs of charts at many places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from procedures.field.photosite import ASSUMED, Photosite
from procedures.outcome import BadParameter, Miss
from procedures.pattern import BLOCK, BLOCKS
from procedures.reading.exposure import Exposure
from station.calibration.field_photographs import check_noted, focus_positions
from station.common.progress import Progress, silent
from station.procedure.base import Inputs, beside, setting
from station.procedure.psf import INSIST, ChartPsfSettings, PsfProcedure
from station.results.measurement import Measurement
from station.results.overlay import Overlay, read_height_overlays
from station.results.record_head import InputFile, RecordHead
from station.results.terms import USUAL, Terms
from station.results.units import Pixels

if TYPE_CHECKING:
    from station.reports.report import Report

ASSUMED_WORD = "assumed"


class FieldSettings(ChartPsfSettings, frozen=True, kw_only=True):
    """The chart, the sampling, and other results on the same camera."""

    plane: Annotated[str, setting("R, G1, G2, B, Y or all.")] = "all"
    s: Annotated[int, setting("PSF samples per pixel of the plane.")] | Literal["auto"] = 4
    focus: Annotated[Path | None, setting("A CSV table: photograph's name, focus position in mm (a bracket).")] = None
    vignetting: Annotated[
        Path | None, setting("A result of station vignetting, to be kept with the field.", metavar="RESULT")
    ] = None
    without_photosite: Annotated[str | None, setting(
        "Report sagittal and meridional MTF also divided by that of square photosites of this fill factor.",
        metavar="FILL[,ERROR]|assumed")] = None  # fmt: skip
    sensor: Annotated[Path | None, setting(
        "Of station sensor: its response is undone, its noise weighs the samples; gain and noise are reported with "
        "the camera.",
        metavar="RESULT.json")] = None  # fmt: skip
    width_mm: Annotated[
        float, setting("Width of the printed chart's ten blocks: the scale of the geometry's distances.", least=1)
    ] = 300.0

    @property
    def photosite(self) -> Photosite | None:
        """The photosite to divide by. Raises BadParameter."""
        if self.without_photosite is None:
            return None
        if self.without_photosite == ASSUMED_WORD:
            return ASSUMED
        try:
            fill, *rest = (float(word) for word in self.without_photosite.split(","))
            (uncertainty,) = rest or (0.0,)
        except ValueError:
            remedy = f"give {ASSUMED_WORD}, a fill factor as 0.9, or one with its standard uncertainty as 0.9,0.02"
            raise BadParameter(f"{self.without_photosite!r} is no fill factor", remedy) from None
        return Photosite(fill, uncertainty)

    def check(self) -> None:
        """Raise ProcedureError as its base does, or if the fill factor is invalid."""
        super().check()
        _ = self.photosite

    def given(self) -> dict[str, Any]:
        files = {name: str(path) for name in ("vignetting", "sensor") if (path := getattr(self, name)) is not None}
        photosite = self.photosite
        if photosite is None:
            return super().given() | files
        return super().given() | files | {
            "photosite_fill": photosite.fill,
            "photosite_fill_uncertainty": photosite.uncertainty,
            "photosite_fill_origin": ASSUMED_WORD if photosite.assumed else "given",
        }  # fmt: skip


class Field(PsfProcedure[FieldSettings]):
    """Photographs of charts at many places of the frame."""

    name = "field"
    title = "PSF over the frame"
    help = """Estimate the PSF over the frame from FOLDER: photographs of one or several charts each, or a session.

    All planes are estimated unless --plane names one. What else the charts yield (geometry, lateral colour) is written
    with the PSF's numbers, and with those of --vignetting and --sensor, as one file with one covariance, camera.h5."""
    inputs = Inputs.PHOTOGRAPHS
    argument = "FOLDER..."
    Settings = FieldSettings
    usual_page = True
    drawn_by = "field.field_page:field_page"

    def measure(
        self, paths: Sequence[Path], settings: FieldSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        from procedures.field.conclusion import conclude
        from procedures.field.measuring import measure
        from procedures.pattern_psf.estimate import PatternParameters
        from procedures.whole_camera.from_field import whole_camera
        from station.calibration.field import field_pixels, field_results, other_parts
        from station.calibration.sensor_models import read_models
        from station.calibration.vignetting import read_vignetting
        from station.reports.field.field_files import FieldParts, field_measurement  # here: it draws, slow to load

        parameters, source, photosite = PatternParameters(**settings.sampling()), settings.source, settings.photosite
        if not settings.trust_typed:
            check_noted(paths, settings.optics, INSIST)
        positions = focus_positions(beside(settings.focus, paths[0].parent), paths) if settings.focus else None
        vignetting, sensor = settings.vignetting, settings.sensor
        lights = {name: one.light for name, one in read_vignetting(vignetting).items()} if vignetting else {}
        others, sensors = other_parts(vignetting, sensor), read_models(sensor, paths) if sensor else {}
        names = None if settings.plane_name == "all" else str(settings.plane_name).split(",")
        measured = measure(paths, names, source.chart, parameters, progress, settings.layout, sensors=sensors)
        limit = settings.limit(measured.exposures[0].exposure if measured.exposures else Exposure())
        pixels = field_pixels(measured, settings.pixel_pitch_um)
        at = terms.frequencies(next(iter(pixels.values()), Pixels()))
        result = conclude(measured, positions, limit, at=at, photosite=photosite)
        planes = field_results(result, terms, pixels, limit)
        camera = whole_camera(result, settings.width_mm / (BLOCK * BLOCKS), others)
        given = {**parameters.to_record(), "chart": source.origin, **settings.given(), **terms.parameters()}
        inputs = tuple(InputFile(str(path), sha256) for path, sha256 in measured.frames)
        head = RecordHead(self.name, inputs, given, terms.specified(planes))
        whole = field_measurement(FieldParts(result, camera, lights), planes, head)
        return replace(whole, terms=terms)

    def missed(self, measurement: Measurement) -> list[Miss]:
        measured = measurement.result.result.measured
        return [miss for miss in measured.misses if miss.source in measured.failed]

    def lines(self, measurement: Measurement) -> list[str]:
        measured = measurement.result.result.measured
        return [str(miss) for miss in measured.misses if miss.source not in measured.failed]

    def read_overlays(self, paths: Sequence[Path], terms: Terms) -> Sequence[Overlay]:
        """Fields whose MTF over image height is drawn over this one's. Raises BadParameter."""
        return read_height_overlays(paths, terms.unit)

    def report(self, measurement: Measurement) -> Report:
        """Contents of the certificate: the frame's centre, and the medians over the frame unless read from files."""
        if measurement.result is None:
            return super().report(measurement)
        from station.reports.field.field_files import with_medians  # here: it draws, which is slow to load
        from station.reports.report import measurement_report

        result = measurement.result.result
        report = measurement_report(measurement, self.name, title=self.title, frames=result.measured.exposures)
        fields = {name: one.interpolation.field for name, one in measurement.result.fitted.items()}
        return replace(report, planes=[with_medians(plane, result) for plane in measurement.planes], fields=fields)
