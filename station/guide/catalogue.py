"""The guided procedures by name: their plans, their planes' results and the files of these.

Each is imported by the function that needs it, so that a table of all of them costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from procedures.outcome import BadParameter
from procedures.plan import Facts, Outcomes, Plan
from station.results.record_head import RecordHead

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from procedures.restoration.photograph_blur import Shape
    from station.results.plane_result import PlaneResult
    from station.results.result_files import ResultFolder
    from station.results.terms import Terms

    Results = Callable[[Sequence[RawFrame], Outcomes, Terms, Facts], list[PlaneResult]]
    Write = Callable[[ResultFolder, Sequence[PlaneResult], Sequence[RawFrame], RecordHead], str]


def _psf_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    from station.calibration.planes import plane_result
    from station.results.units import pixels_of
    from station.sessions.session_terms import in_terms

    first, pitch_um = frames[0], facts.get("pixel_pitch_um")
    pixels = pixels_of(first, float(pitch_um) if isinstance(pitch_um, int | float) else None)
    results = (plane_result(first.planes[name], one, first.exposure) for name, one in outcomes.items())
    return [in_terms(one, terms, pixels[one.name]) for one in results]


def _write_psf(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.results.result_files import write_psf_result

    return write_psf_result(folder, planes, head)


@dataclass(frozen=True)
class GuidedProcedure:
    """A guided procedure: what it is in a few words, its plan, and how its estimate becomes results and files.

    Attributes
    ----------
    results : callable
        The planes' results, of photographs, what was found in them, the terms that they are told in and the session's
        facts; by default those of a PSF a plane.
    write : callable
        Writes and publishes a folder's files, of it, results, photographs and the record's head; returns the
        record's text.
    in_session : callable, optional
        The plan of a session in a folder, where it reads files that the session keeps.
    """

    title: str
    plan: Callable[[], Plan]
    results: Results = _psf_results
    write: Write = _write_psf
    in_session: Callable[[Path], Plan] | None = None


def _pattern() -> Plan:
    from procedures.pattern_psf.plan import plan

    return plan()


def _two_photo() -> Plan:
    from procedures.two_photo.plan import plan

    return plan()


def _field() -> Plan:
    from station.guide.plans.field import plan

    return plan()


def _field_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    from station.guide.plans.field import results

    return results(outcomes, terms, facts)


def _write_field(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.guide.plans.field import write

    return write(folder, planes, head)


def _restoration(folder: Path | None = None) -> Plan:
    from procedures.restoration.plan import plan
    from station.calibration.restoration.inputs import files_in, read_blur_shape, with_files
    from station.sessions.given_files import is_given

    def read_shape(name: str, plane: str | None, size: tuple[int, int] | None) -> Shape:
        """Of a file that the session keeps, or of one that is just being told of."""
        known = (
            folder / one if folder is not None and is_given(one) else Path(one).expanduser() for one in files_in(name)
        )
        return read_blur_shape(with_files(name, [str(path) for path in known]), plane, size)

    return plan(read_shape)


def _restoration_results(
    frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts
) -> list[PlaneResult]:
    from station.results.plane_result import PlaneResult

    return [PlaneResult.of_outcome(name, one, found=one.value) for name, one in outcomes.items()]


def _write_restoration(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.reports.restoration_files import write_plane

    (picture,) = planes
    return write_plane(folder, picture, frames, head)


def _geometry() -> Plan:
    from procedures.geometry.plan import plan

    return plan()


def _found_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    from station.results.plane_result import PlaneResult

    return [
        PlaneResult.of_outcome(name, one, found=one.value, numbers={} if one.value is None else one.value.numbers())
        for name, one in outcomes.items()
    ]


def _write_geometry(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.reports.geometry_files import write_plane

    (plane,) = planes
    return write_plane(folder, plane, frames, head)


def _sensor() -> Plan:
    from station.guide.plans.sensor import plan

    return plan()


def _sensor_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    from station.guide.plans.sensor import results

    return results(outcomes)


def _write_sensor(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.guide.plans.sensor import write

    return write(folder, planes, head)


def _camera() -> Plan:
    from station.guide.plans.camera import plan

    return plan()


def _camera_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    from station.guide.plans.camera import results

    return results(outcomes, terms, facts)


def _write_camera(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.guide.plans.camera import write

    return write(folder, planes, frames, head)


def _tilt() -> Plan:
    from station.guide.plans.tilt import plan

    return plan()


def _write_tilt(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.guide.plans.tilt import write

    return write(folder, planes, frames, head)


PLANS = {
    "pattern": GuidedProcedure("the PSF from a printed noise chart", _pattern),
    "two-photo": GuidedProcedure("the PSF from two photographs of a textured wall", _two_photo),
    "field": GuidedProcedure("the PSF over the whole frame, place by place", _field, _field_results, _write_field),
    "geometry": GuidedProcedure(
        "intrinsics and distortion, from many chart poses", _geometry, _found_results, _write_geometry
    ),
    "camera": GuidedProcedure("all of a camera: PSF, geometry, light, sensor", _camera, _camera_results, _write_camera),
    "tilt": GuidedProcedure("the sensor squared to the lens by its screws", _tilt, _found_results, _write_tilt),
    "sensor": GuidedProcedure("gain, noise and non-uniformity of a sensor", _sensor, _sensor_results, _write_sensor),
    "restoration": GuidedProcedure(
        "picture and depth from blurred photographs",
        _restoration,
        _restoration_results,
        _write_restoration,
        _restoration,
    ),
}
DEFAULT = "pattern"


def entry_named(name: str) -> GuidedProcedure:
    """The procedure of that name. Raises BadParameter."""
    if name not in PLANS:
        raise BadParameter(f"there is no plan {name!r}", f"choose one of {', '.join(PLANS)}")
    return PLANS[name]


def plan_named(name: str, folder: Path | None = None) -> Plan:
    """The plan of that name, imported now; of the session in a folder. Raises BadParameter."""
    entry = entry_named(name)
    return entry.plan() if folder is None or entry.in_session is None else entry.in_session(folder)
