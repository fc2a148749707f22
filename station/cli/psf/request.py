"""What `psf pattern` and `psf two-photo` do alike: what was asked besides how to estimate, and how it is answered."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from station.cli.psf.planes import OPTICS, finish, read_overlays, read_planes, tell_each, told_layout, told_trust
from station.cli.psf.terms import terms_of
from station.cli.terminal.force import forced
from station.common.log import log
from station.results.record_head import RecordHead, files_read

if TYPE_CHECKING:
    from procedures.pattern_psf.estimate import PatternParameters
    from procedures.raw import RawFrame
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.two_photo.estimate import TwoPhotoParameters
    from station.calibration.planes import Limit
    from station.results.overlay import Overlay
    from station.results.plane_result import PlaneResult
    from station.results.result_files import ResultFolder
    from station.results.terms import Terms
    from station.results.units import Pixels

    Told = Mapping[str, object]
    """What a record says was asked."""
    Parameters = TypeVar("Parameters", PatternParameters, TwoPhotoParameters)


@dataclass(frozen=True)
class Request:
    """What a command was asked; `optics` are what was typed, `trusted` whether against what the camera noted."""

    procedure: str
    plane: str | None
    layout: DumpLayout | None
    out: Path
    report: bool
    certificate: bool
    as_json: bool
    trusted: bool
    optics: Mapping[str, Any]
    terms: Terms
    overlays: Sequence[Overlay]
    start: float = field(default_factory=time.perf_counter)

    @classmethod
    def taken_from(cls, options: dict[str, Any], procedure: str) -> Request:
        """Take it out of the options: what stays is the estimate's own. Raises BadParameter."""
        plain = {name: options.pop(name) for name in ("plane", "layout", "out", "report", "certificate", "as_json")}
        trusted, terms = options.pop("trust_typed"), terms_of(options)
        optics = {name: options.pop(name) for name in OPTICS}
        overlays = read_overlays(options.pop("overlays"))
        return cls(procedure, **plain, trusted=trusted, optics=optics, terms=terms, overlays=overlays)

    def folder(self) -> ResultFolder:
        """Where the result goes, which takes its place when it is whole."""
        from station.results.result_files import ResultFolder

        return ResultFolder(self.out, force=forced())

    def read(self, image: Path) -> RawFrame:
        """The planes asked for, of one photograph. Raises BadParameter where what was typed contradicts it."""
        return read_planes(image, self.plane, self.layout, typed=None if self.trusted else self.optics)

    def limit_of(self, frame: RawFrame, *, needed: bool = False) -> Limit:
        """The diffraction limit of each plane; it raises BadParameter where it is needed and not known."""
        from station.calibration.planes import diffraction_limit

        return partial(diffraction_limit, frame.exposure, needed=needed, **self.optics)

    def at_frequencies(self, parameters: Parameters, frame: RawFrame) -> Parameters:
        """Parameters that tell the MTF at the frequencies asked for, too."""
        return replace(parameters, at=self.terms.frequencies(next(iter(self._pixels(frame).values()))))

    def answer(
        self,
        folder: ResultFolder,
        frames: Sequence[RawFrame],
        results: Iterable[PlaneResult],
        given: Told,
    ) -> None:
        """Tell each plane as it comes, write all of it; leaves with the code that the planes deserve."""
        pixels = self._pixels(frames[0])
        planes = tell_each(self.terms.told(one, pixels[one.name]) for one in results)
        typed = {name: value for name, value in self.optics.items() if value is not None}
        told = {**given, **typed, **told_layout(self.layout), **told_trust(self.trusted)}
        if self.report or self.certificate or self.overlays:
            self._draw(folder, frames, planes, told)
        finish(planes, self._write(folder, frames, planes, told), as_json=self.as_json)

    def _draw(
        self, folder: ResultFolder, frames: Sequence[RawFrame], planes: Sequence[PlaneResult], told: Told
    ) -> None:
        from station.reports.pattern_report import PAGE, calibration_page, report_of_files  # it draws: slow to import

        report = report_of_files(self.procedure, frames, planes, told, self.terms.specification, self.overlays)
        if self.report or self.overlays:
            folder.write(PAGE, calibration_page(report).encode())
        if self.certificate:
            from station.reports.certificate_print import write_certificate

            write_certificate(folder, report)

    def _write(
        self, folder: ResultFolder, frames: Sequence[RawFrame], planes: Sequence[PlaneResult], told: Told
    ) -> str:
        """Write files and record; the record's text."""
        from station.results.result_files import write_psf_result

        took_s = round(time.perf_counter() - self.start, 3)
        told, held = {**told, **self.terms.parameters()}, self.terms.specified(planes)
        text = write_psf_result(
            folder, planes, RecordHead(self.procedure, files_read(frames), told, held, duration_s=took_s)
        )
        record = str(folder.path / "result.json")
        log("written", f"wrote {record}", path=record)
        return text

    def _pixels(self, frame: RawFrame) -> Mapping[str, Pixels]:
        from station.results.units import pixels_of

        return pixels_of(frame, self.optics["pixel_pitch_um"])
