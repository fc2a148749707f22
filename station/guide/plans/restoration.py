"""The guided plan of a restoration, with shapes of the blur from files of the session."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from procedures.plan import Facts, Outcomes, Plan
from procedures.raw import RawFrame
from procedures.restoration.photograph_blur import Shape
from procedures.restoration.plan import plan as restoration_plan
from station.calibration.restoration.inputs import files_in, read_blur_shape, with_files
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms
from station.sessions.given_files import is_given


def plan(folder: Path | None = None) -> Plan:
    """The plan, for the session in a folder if given."""

    def read_shape(name: str, plane: str | None, size: tuple[int, int] | None) -> Shape:
        """Shape from a file stored in the session, or from one that the operator has just named."""
        paths = (
            folder / file if folder is not None and is_given(file) else Path(file).expanduser()
            for file in files_in(name)
        )
        return read_blur_shape(with_files(name, [str(path) for path in paths]), plane, size)

    return restoration_plan(read_shape)


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """The restored picture."""
    return [PlaneResult.of_outcome(name, one, found=one.value) for name, one in outcomes.items()]


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """Write the files of `station restore` for a session."""
    from station.reports.restoration_files import write_plane  # it draws, a slow import

    (picture,) = planes
    return write_plane(folder, picture, frames, head)
