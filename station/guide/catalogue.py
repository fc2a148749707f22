"""The guided procedures by name, with functions for their plans, results and files. The functions are imported at their
first call, so that the table itself is cheap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procedures.outcome import BadParameter
from procedures.plan import Facts, Outcomes, Plan
from station.results.record_head import RecordHead

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from station.results.measurement import Measurement
    from station.results.plane_result import PlaneResult
    from station.results.result_files import ResultFolder
    from station.results.terms import Terms

    Results = Callable[[Sequence[RawFrame], Outcomes, Terms, Facts], list[PlaneResult]]
    Write = Callable[[ResultFolder, Sequence[PlaneResult], Sequence[RawFrame], RecordHead], str]


def psf_results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """The planes of PSFs, with the exposure of the first photograph."""
    from station.calibration.planes import plane_result
    from station.results.units import pixels_of
    from station.sessions.state import in_terms

    first, pitch_um = frames[0], facts.get("pixel_pitch_um")
    pixels = pixels_of(first, float(pitch_um) if isinstance(pitch_um, int | float) else None)
    results = (plane_result(first.planes[name], outcome, first.exposure) for name, outcome in outcomes.items())
    return [in_terms(result, terms, pixels[result.name]) for result in results]


def _write_psf(
    folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.results.psf_files import write_psf_result

    return write_psf_result(folder, planes, head)


@dataclass(frozen=True)
class GuidedProcedure:
    """A guided procedure: title, plan, and conversion of its estimate into results and files.

    results : results of the planes from photographs, outcomes, terms (unit, specification) and facts; by default one
        PSF per plane
    write : writes and publishes the files of a result, from its folder, results, photographs and the record's head;
        gives the record's text
    in_session : whether the plan requires the session's folder, since it reads files stored there
    general : whether its results are those of the general plan, `station.guide.plans.general`
    """

    title: str
    plan: Callable[..., Plan]
    results: Results = psf_results
    write: Write = _write_psf
    in_session: bool = False
    general: bool = False


def _imported(module: str, name: str) -> Callable[..., Any]:
    """A function of a module that is imported at the first call."""
    return lambda *given: getattr(import_module(module), name)(*given)


def _guided(title: str, name: str, procedure: str = "", *, in_session: bool = False) -> GuidedProcedure:
    """A procedure with `plan` and `results` in a module of station.guide.plans, `measurement` or else `write` for its
    files."""
    plan, results, measurement, write = (
        _imported(f"station.guide.plans.{name}", one) for one in ("plan", "results", "measurement", "write")
    )
    write = partial(_write_measured, procedure, measurement) if procedure else write
    return GuidedProcedure(title, plan, results, write, in_session)


def _general(title: str, name: str) -> GuidedProcedure:
    entry = _guided(title, "general", name, in_session=True)
    return replace(entry, plan=partial(entry.plan, name), general=True)


def _write_measured(
    procedure: str, measurement: Callable[..., Measurement], folder: ResultFolder, planes: Sequence[PlaneResult],
    frames: Sequence[RawFrame], head: RecordHead,
) -> str:  # fmt: skip
    """Write the files of a procedure's command for a session; the record alone for a refused result."""
    from station.procedure.schema import procedure_named
    from station.results.measurement import write_measurement

    known, measured = procedure_named(procedure), measurement(planes, frames, head)
    if known.draws(measured):
        folder.write("report.html", known.page(measured))
    return write_measurement(folder, measured)


PLANS = {
    "pattern": GuidedProcedure("the PSF from a printed noise chart", _imported("procedures.pattern_psf.plan", "plan")),
    "two-photo": GuidedProcedure(
        "the PSF from two photographs of a textured wall", _imported("procedures.two_photo.plan", "plan")
    ),
    "field": _guided("the PSF over the whole frame", "field"),
    "geometry": _guided("intrinsics and distortion, from many chart poses", "geometry", "geometry"),
    "camera": _guided("the whole camera: PSF, geometry, vignetting, sensor", "camera"),
    "tilt": _guided("the sensor's tilt, corrected by its screws", "tilt", "tilt"),
    "sensor": _guided("gain, noise and non-uniformity of a sensor", "sensor", "sensor"),
    "restoration": _guided(
        "sharp image and depth map from blurred photographs", "restoration", "restore", in_session=True
    ),
    "edge": _general("MTF across slanted edges", "edge"),
    **{
        f"{setting}-series": replace(
            _guided(f"the PSF over {setting}, from one mounting", "series"),
            plan=_imported("station.guide.plans.series", f"{setting}_plan"),
        )
        for setting in ("aperture", "focus")
    },
    "witnessed": replace(
        _guided(
            "the PSF with witnesses: two exposures, two distances, a defocus", "witnessed", "witnessed", in_session=True
        ),
        general=True,
    ),
}
DEFAULT = "pattern"


def entries() -> dict[str, GuidedProcedure]:
    """All guided procedures by name, also those of installed packages that measure photographs."""
    from station.procedure.schema import added, procedure_named

    known = dict(PLANS)
    for name in added():
        with suppress(Exception):  # `station NAME` reports why the package cannot be loaded, or needs other inputs
            entry = _general(procedure_named(name).title, name)
            entry.plan()
            known.setdefault(name, entry)
    return known


def entry_named(name: str) -> GuidedProcedure:
    """The procedure by name. Raises BadParameter."""
    entry = PLANS.get(name) or entries().get(name)
    if entry is None:
        raise BadParameter(f"there is no plan {name!r}", f"choose one of {', '.join(entries())}")
    return entry


def plan_named(name: str, folder: Path | None = None) -> Plan:
    """The plan by name, for the session in a folder if given. Raises BadParameter."""
    entry = entry_named(name)
    return entry.plan(folder) if entry.in_session else entry.plan()
