from collections.abc import Mapping, Sequence
from dataclasses import replace

from procedures.raw import RawFrame
from station.reports.report import Report, measurement_report
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.psf_files import psf_measurement
from station.results.record_head import RecordHead, files_read
from station.results.terms import USUAL, Terms


def report_of(
    procedure: str, frame: RawFrame, planes: Sequence[PlaneResult], parameters: Mapping[str, object],
    terms: Terms = USUAL, overlays: Sequence[Overlay] = (),
) -> Report:  # fmt: skip
    """The report of the planes of one photograph."""
    measured = psf_measurement(planes, RecordHead(procedure, files_read([frame]), parameters))
    measured = replace(measured, exposure=frame.exposure, terms=terms, overlays=overlays)
    return measurement_report(measured, procedure, frames=[frame])
