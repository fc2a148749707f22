"""What the procedures share that estimate one PSF for each plane: settings, measurement, page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from procedures.raw import RawFrame
from station.procedure.base import Procedure
from station.procedure.optics import OpticsReading
from station.procedure.settings import setting
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.psf_files import SCHEMA, psf_measurement
from station.results.record_head import RecordHead, files_read
from station.results.terms import Terms

if TYPE_CHECKING:
    from station.reports.pattern_report import Report


class PsfSettings(OpticsReading, frozen=True, kw_only=True):
    """How a PSF is sampled and solved for, and the optics."""

    s: Annotated[int, setting("PSF samples per pixel of the plane.")] | Literal["auto"] = "auto"
    k: Annotated[int, setting("PSF samples along one side, odd.")] | Literal["auto"] = "auto"
    solver: Annotated[
        Literal["ls", "clip", "nnls"], setting("Least squares, cut at 0, or non-negative.")
    ] = "ls"  # fmt: skip

    def sampling(self) -> dict[str, Any]:
        """s, k and the solver as estimates take them: None for what is chosen from the photograph."""
        return {"s": _number(self.s), "k": _number(self.k), "solver": self.solver}


def _number(value: int | str) -> int | None:
    return value if isinstance(value, int) else None


@dataclass(frozen=True, eq=False)
class PsfPhotographs:
    """The photographs of a PSF, and what was asked for."""

    frames: tuple[RawFrame, ...]
    asked: Mapping[str, Any]


P = TypeVar("P", bound=PsfSettings)


class PsfProcedure(Procedure[P]):
    """A procedure whose planes have one PSF each."""

    Settings: ClassVar[type[Any]] = PsfSettings
    schema = SCHEMA
    has_mtf = True
    usual_page = False

    def measurement(
        self, frames: Sequence[RawFrame], results: Iterable[PlaneResult], asked: Mapping[str, Any], settings: P,
        terms: Terms,
    ) -> Measurement:  # fmt: skip
        """The planes' results in the terms that were asked for; `asked` are the estimate's parameters."""
        pixels = settings.pixels(frames[0])
        planes = [terms.told(one, pixels[one.name]) for one in results]
        told = {**asked, **settings.given()}
        head = RecordHead(self.name, files_read(frames), {**told, **terms.parameters()}, terms.specified(planes))
        found = PsfPhotographs(tuple(frames), told)
        return replace(psf_measurement(planes, head), exposure=frames[0].exposure, terms=terms, found=found)

    def draws(self, found: Measurement) -> bool:
        """Always: of what was refused the page has the reason."""
        return True

    def report(self, found: Measurement) -> Report:
        """With the photographs and the marks in them."""
        from station.reports.pattern_report import report_of_files  # here: it draws, which is slow to load

        whole: PsfPhotographs = found.found
        return report_of_files(
            self.name, whole.frames, found.planes, whole.asked, found.terms.specification, found.overlays
        )

    def page(self, found: Measurement) -> bytes:
        """The PSF and its MTF with all that is needed to believe them."""
        from station.reports.pattern_report import calibration_page  # here: it draws, which is slow to load

        return calibration_page(self.report(found)).encode()
