"""Settings, measurement and page shared by procedures that estimate one PSF per plane."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from procedures.pattern_print.source import Source
from procedures.raw import RawFrame
from procedures.reading.exposure import Exposure, check_typed
from station.calibration.planes import Limit, diffraction_limit
from station.common.sanitise import printable
from station.procedure.base import ChartBits, ChartSeed, PlaneSettings, Procedure, chart_source, setting
from station.results.measurement import PSF, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, files_read
from station.results.terms import Terms
from station.results.units import Pixels, pixels_of

if TYPE_CHECKING:
    from station.reports.report import Report

INSIST = "add --trust-typed, or in a procedure file write trust_typed = true"


class OpticsReading(PlaneSettings, frozen=True, kw_only=True):
    """Planes of photographs, and the optics that they were taken with."""

    pixel_pitch_um: Annotated[float, setting("Of the sensor, for the diffraction limit.", least=0.1)] | None = None
    f_number: Annotated[float, setting("The aperture.  [default: as the camera noted it]", least=0.1)] | None = None
    wavelength_nm: Annotated[float, setting("[default: R 600, G 530, B 460, Y 550]", least=100)] | None = None
    trust_typed: Annotated[bool, setting("Take --f-number and --pixel-pitch-um against what the camera noted.")] = False

    @property
    def optics(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("pixel_pitch_um", "f_number", "wavelength_nm")}

    def read(self, path: Path) -> RawFrame:
        """The planes asked for. Raises ProcedureError, and where what was typed contradicts what the camera noted."""
        frame = super().read(path)
        if not self.trust_typed:
            check_typed(frame.exposure, self.optics, printable(path), INSIST)
        return frame

    def limit(self, exposure: Exposure, *, needed: bool = False) -> Limit:
        """The diffraction limit of each plane; it raises BadParameter where it is needed and not known."""
        return partial(diffraction_limit, exposure, needed=needed, **self.optics)

    def pixels(self, frame: RawFrame) -> Mapping[str, Pixels]:
        return pixels_of(frame, self.pixel_pitch_um)

    def plane_pixels(self, frame: RawFrame) -> Pixels:
        """The pixels of the planes, which are alike."""
        return next(iter(self.pixels(frame).values()))

    def given(self) -> dict[str, Any]:
        """The values stated, for the record."""
        values = {name: value for name, value in self.optics.items() if value is not None}
        if self.raw is not None:
            values["raw"] = str(self.layout)
        return values | ({"trust_typed": True} if self.trust_typed else {})


class PsfSettings(OpticsReading, frozen=True, kw_only=True):
    """Sampling and solver of a PSF, and the optics."""

    s: Annotated[int, setting("PSF samples per pixel of the plane.")] | Literal["auto"] = "auto"
    k: Annotated[int, setting("PSF samples along one side, odd.")] | Literal["auto"] = "auto"
    solver: Annotated[Literal["ls", "clip", "nnls"], setting("Least squares, cut at 0, or non-negative.")] = "ls"

    def sampling(self) -> dict[str, Any]:
        """Arguments s, k and solver of an estimate; None where chosen from the photograph."""
        return {"s": _number(self.s), "k": _number(self.k), "solver": self.solver}


class ChartPsfSettings(PsfSettings, frozen=True, kw_only=True):
    """Procedure for photographs of the noise chart."""

    bits: ChartBits = None
    seed: ChartSeed = None
    print_blur: Annotated[
        float | None,
        setting("Standard deviation of the print's blur in cells.  [default: by the printer's dots if they show]"),
    ] = None

    def sampling(self) -> dict[str, Any]:
        return {**super().sampling(), "print_blur": self.print_blur}

    @property
    def source(self) -> Source:
        """The chart. Raises ProcedureError."""
        return chart_source(self.bits, self.seed)

    def check(self) -> None:
        """Raise ProcedureError if the sampling is impossible, or the chart is unreadable."""
        from procedures.pattern_psf.estimate import PatternParameters

        super().check()
        PatternParameters(**self.sampling())
        _ = self.source


def _number(value: int | str) -> int | None:
    return value if isinstance(value, int) else None


@dataclass(frozen=True, eq=False)
class PsfPhotographs:
    """Photographs and settings of a PSF measurement."""

    frames: tuple[RawFrame, ...]
    asked: Mapping[str, Any]


P = TypeVar("P", bound=PsfSettings)


class PsfProcedure(Procedure[P]):
    """Base of procedures with one PSF per plane."""

    Settings: ClassVar[type[Any]] = PsfSettings
    schema = PSF
    has_mtf = True
    usual_page = False
    drawn_by = "psf_page:psf_page"

    def steps(self, paths: Sequence[Path]) -> int:
        return len(paths) + 1

    def measurement(
        self, frames: Sequence[RawFrame], results: Iterable[PlaneResult], asked: Mapping[str, Any], settings: P,
        terms: Terms,
    ) -> Measurement:  # fmt: skip
        """The results in the requested terms; `asked` are the parameters of the estimate."""
        from station.results.psf_files import psf_measurement

        pixels = settings.pixels(frames[0])
        planes = [terms.apply(result, pixels[result.name]) for result in results]
        given = {**asked, **settings.given()}
        parameters = {**given, **terms.parameters()}
        head = RecordHead(self.record_name, files_read(frames), parameters, terms.specified(planes))
        photographs = PsfPhotographs(tuple(frames), given)
        return replace(psf_measurement(planes, head), exposure=frames[0].exposure, terms=terms, result=photographs)

    def draws(self, measurement: Measurement) -> bool:
        """True: the page of a refused measurement states the reason."""
        return True

    def report(self, measurement: Measurement) -> Report:
        from station.reports.report import measurement_report  # here: it draws, which is slow to load

        whole: PsfPhotographs | None = measurement.result  # None where it was read from files
        return measurement_report(measurement, self.name, title=self.title, frames=whole.frames if whole else ())
