"""The guided plan of a field, with the estimate from its photographs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

from procedures.field import plan as guide
from procedures.field.conclusion import FieldResult, conclude
from procedures.field.estimate import NO_SENSORS, Sensors
from procedures.field.measuring import measure_frames
from procedures.field.plan import FieldFacts
from procedures.outcome import BadParameter, Outcome, Refused, Verdict
from procedures.plan import Facts, Known, Outcomes, Plan, facts_as
from procedures.raw import RawFrame
from procedures.vignetting.surface import LightSurface
from procedures.whole_camera.from_field import WholeCamera, whole_camera
from station.calibration.field import centre_result, field_pixels, field_results
from station.calibration.planes import diffraction_limit
from station.procedure.schema import procedure_named
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import PartBeside, RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms


@dataclass(frozen=True, eq=False)
class SessionField(FieldResult):
    """A field with the other results of its session.

    `parts` : outcomes of the other procedures on the same mounting, by name
    `used` : what the PSFs use of each, or why they do not
    """

    camera: WholeCamera | None = None
    parts: Mapping[str, Outcome[Any]] = field(default_factory=dict)
    used: Mapping[str, str] = field(default_factory=dict)


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The whole field for every plane, with the plane's verdict; a refusal where the photographs give none."""
    known_facts = facts_as(FieldFacts, facts)
    try:
        whole = field_of(frames, known_facts)
    except Refused as refusal:
        return refused(frames, refusal)
    return by_plane(session_field(whole, whole_camera(whole, known_facts.cell_mm)))


def field_of(frames: Sequence[RawFrame], facts: FieldFacts, sensors: Sensors = NO_SENSORS) -> FieldResult:
    """The field from its photographs and sensor models. Raises Refused where none gives a PSF."""
    measured = measure_frames(frames, facts.chart, facts.parameters, sensors)
    exposure = measured.exposures[0].exposure if measured.exposures else None
    limit = (
        partial(diffraction_limit, exposure, pixel_pitch_um=facts.pixel_pitch_um, f_number=facts.typed_f_number)
        if exposure
        else (lambda plane: None)
    )
    return conclude(measured, limit=limit)


def refused(frames: Sequence[RawFrame], refusal: Refused) -> Outcomes:
    """The refusal for every plane."""
    names = frames[0].planes if frames else ()
    return {name: Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy) for name in names}


def session_field(
    whole: FieldResult,
    camera: WholeCamera,
    parts: Mapping[str, Outcome[Any]] | None = None,
    used: Mapping[str, str] | None = None,
) -> SessionField:
    """The field with the other results of its session."""
    values = {one.name: getattr(whole, one.name) for one in fields(FieldResult)}
    return SessionField(**values, camera=camera, parts=parts or {}, used=used or {})


def by_plane(whole: SessionField) -> Outcomes:
    """The whole field for every plane, with the plane's verdict."""
    return {name: plane.of_value(None if plane.value is None else whole) for name, plane in whole.planes.items()}


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """Every plane's result at the frame's centre, compared with the specification at every place that it names.
    `estimate` of each is the whole field."""
    whole = next((outcome.value for outcome in outcomes.values() if outcome.value is not None), None)
    if whole is None:
        return [PlaneResult.of_outcome(name, outcome) for name, outcome in outcomes.items()]
    pixels = field_pixels(whole.measured, facts_as(FieldFacts, facts).pixel_pitch_um)
    terms = terms.with_known_unit(next(iter(pixels.values())))
    try:
        planes = field_results(whole, terms, pixels, lambda plane: None)
    except BadParameter as error:
        centres = (centre_result(name, one) for name, one in whole.planes.items())
        planes = [terms.undecided(centre, error.reason) for centre in centres]
    return [one if one.estimate is None else replace(one, estimate=whole) for one in planes]


def write(
    folder: ResultFolder,
    planes: Sequence[PlaneResult],
    frames: Sequence[RawFrame],
    head: RecordHead,
    lights: Mapping[str, LightSurface] | None = None,
    beside: Mapping[str, PartBeside] | None = None,
) -> str:
    """Write the files of `station psf field` for a session, or the record of a refusal.

    lights : vignetting by plane; beside : results of other parts of the session
    """
    # imported here: it draws, a slow import
    from station.reports.field.field_files import FieldParts, field_measurement

    whole: SessionField | None = next((plane.estimate for plane in planes if plane.estimate is not None), None)
    if whole is None:
        return write_psf_result(folder, planes, head)
    measurement = field_measurement(FieldParts(whole, whole.camera, lights or {}, beside or {}), planes, head)
    folder.write("report.html", procedure_named("field").page(measurement))
    return write_measurement(folder, measurement)
