"""Settings, measurement and page shared by procedures that estimate one PSF per plane."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from procedures.pattern_print.source import Source
from procedures.raw import RawFrame
from station.procedure.base import ChartBits, ChartSeed, Procedure, chart_source
from station.procedure.optics import OpticsReading
from station.procedure.settings import setting
from station.results.measurement import PSF, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, files_read
from station.results.terms import Terms

if TYPE_CHECKING:
    from station.reports.report import Report


class PsfSettings(OpticsReading, frozen=True, kw_only=True):
    """Sampling and solver of a PSF, and the optics."""

    s: Annotated[int, setting("PSF samples per pixel of the plane.")] | Literal["auto"] = "auto"
    k: Annotated[int, setting("PSF samples along one side, odd.")] | Literal["auto"] = "auto"
    solver: Annotated[
        Literal["ls", "clip", "nnls"], setting("Least squares, cut at 0, or non-negative.")
    ] = "ls"  # fmt: skip

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
        """Arguments of an estimate with the chart."""
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
        """Reading each photograph, and the estimate."""
        return len(paths) + 1

    def measurement(
        self, frames: Sequence[RawFrame], results: Iterable[PlaneResult], asked: Mapping[str, Any], settings: P,
        terms: Terms,
    ) -> Measurement:  # fmt: skip
        """The results in the requested terms; `asked` are the parameters of the estimate."""
        from station.results.psf_files import psf_measurement

        pixels = settings.pixels(frames[0])
        planes = [terms.apply(one, pixels[one.name]) for one in results]
        given = {**asked, **settings.given()}
        parameters = {**given, **terms.parameters()}
        head = RecordHead(self.record_name, files_read(frames), parameters, terms.specified(planes))
        photographs = PsfPhotographs(tuple(frames), given)
        return replace(psf_measurement(planes, head), exposure=frames[0].exposure, terms=terms, result=photographs)

    def draws(self, measurement: Measurement) -> bool:
        """True: the page of a refused measurement states the reason."""
        return True

    def report(self, measurement: Measurement) -> Report:
        """Contents of the page, with photographs and detected marks."""
        from station.reports.report import measurement_report  # here: it draws, which is slow to load

        whole: PsfPhotographs = measurement.result
        return measurement_report(measurement, self.name, title=self.title, frames=whole.frames)
