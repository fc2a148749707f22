"""A session's report: its last result, recomputed from the photographs, with bench and journal. Where the plan has
written its own page with the result, that page is the report."""

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from procedures.field.field_file import read_field
from procedures.numbers import S_OVER_T
from procedures.outcome import Refused, Verdict
from procedures.pattern_psf.combine import CombinedPsf
from procedures.pattern_psf.drift import chart_series, slope_of
from procedures.psf_field import PsfField
from procedures.quality import OPERATOR
from procedures.raw import Exposure
from station.common.sanitise import printable, stated, unit_of
from station.guide.catalogue import entry_named, plan_named
from station.guide.session_result import SessionResult, compute
from station.procedure.schema import procedure_named, procedure_names
from station.reports.certificate_details import CertificateDetails
from station.reports.page import exposure_words
from station.reports.psf_page import psf_page
from station.reports.report import METHODS, DriftLine, Report, ReportLine, ReportShot, environment_lines
from station.reports.report_page import measurement_page
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.reader import read_record, read_result
from station.results.record_head import environment_of, temperature_during
from station.sessions.reader import SessionRecord, read_session, verify, verify_results
from station.sessions.state import SessionShot, SessionState, replay, terms_of_session

PAGE = "report.html"
COMMANDS = {"restoration": "restore", "camera": "field", "aperture-series": "pattern", "focus-series": "pattern"}
"""Procedures of plans with other names."""
FIELD = "field.h5"
REPORTED = "reported"
"""Event in the journal with the hash of the page."""
STATED = (
    "light", "sensor_kind", "chart", "chart_width_mm", "ruler_mm", "distance_mm", str(S_OVER_T), "near_mm", "ratio",
    "focal_length_mm", "pixel_pitch_um", "f_number", "exposure_s", "iso", "places", "views", "blur_by", "photographs",
    "max_w", "screw_count", "screw_radius_mm", "screw_pitch_mm", "s", "k", "solver", "print_blur", "exposure_ratio",
)  # fmt: skip
WORDS = {str(S_OVER_T): "s/t", "iso": "ISO", "f_number": "f-number"}


def session_page(folder: Path, result: SessionResult | None = None) -> str:
    """The page of a session's last result, stored or recomputed. Raises Refused without one; Damaged if a file has
    changed."""
    record = _with_result(folder)
    verify(folder, record.state)
    last = record.state.results[-1]
    if PAGE in last.files:
        verify_results(record)
        return (folder / last.folder / PAGE).read_text(encoding="utf-8")
    if (page := _kept_page(folder, record)) is not None:
        return page
    return _drawn(session_report(folder, result))


def _with_result(folder: Path) -> SessionRecord:
    """The session's record. Raises Refused without a result."""
    record = read_session(folder)
    if not record.state.results:
        raise Refused(f"{folder.name} has no result yet", "continue it: station session resume")
    return record


def overlaid_page(folder: Path, overlays: Sequence[Overlay]) -> str:
    """The report with the MTF of other results as overlays. Raises as `session_report`, and where units differ."""
    return _drawn(replace(session_report(folder), overlays=overlays))


def _drawn(report: Report) -> str:
    """The page of a report, as PSFs require it or with the curves and numbers of any other procedure."""
    return measurement_page(report) if entry_named(report.procedure).general else psf_page(report)


def session_report(folder: Path, result: SessionResult | None = None) -> Report:
    """Report of a session's last result. Raises Refused without a result or a page; Damaged if a photograph has
    changed."""
    record = _with_result(folder)
    plan, last = record.state.plan, record.state.results[-1]
    certified = plan in METHODS or entry_named(plan).general
    if not certified and last.verdict == Verdict.REFUSED:
        raise Refused(f"a refused result of {plan} has no page", "see the reason in result.json")
    verify(folder, record.state)
    if not certified and PAGE in last.files:
        return _of_measurement(record)
    drawn = max(i for i, line in enumerate(record.contents.lines) if line.event == "derived")
    state = replay(record.contents.lines[:drawn])
    return _report(record, state, result or compute(folder, state, plan_named(state.plan, folder)))


def certificate_files(
    folder: Path, result: SessionResult | None = None, details: CertificateDetails | None = None
) -> dict[str, bytes]:
    """Certificate of a session's last result: page, PDF and their hashes by name; details : else of certificate.toml.
    Raises as `session_report`."""
    from station.reports import certificate_print
    from station.reports.certificate import record_digest
    from station.reports.certificate_details import STATEMENT, statement_of

    report, last = session_report(folder, result), read_session(folder).state.results[-1]
    from station.guide.provenance import NAMES  # imported here: its dependencies are slow to import

    known = {}
    for key in STATED:
        if (value := report.parameters.get(key)) is not None:
            words, unit = unit_of(key)
            known[WORDS.get(key) or NAMES.get(key, words)] = (
                f"{value:.4g} {unit}".rstrip() if isinstance(value, float) else str(value)
            )
    report, record = replace(report, parameters=known), read_record(folder / last.folder)
    files = certificate_print.certificate_files(report, record, details or CertificateDetails.read())
    files.setdefault(STATEMENT, statement_of(files, {"record": record_digest(record)}))
    return files


def _kept_page(folder: Path, record: SessionRecord) -> str | None:
    """The page written with the last result; None where it is missing or has changed."""
    written = [line for line in record.contents.lines if line.event in ("derived", REPORTED)]
    try:
        text = (folder / PAGE).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    same = written[-1].event == REPORTED and written[-1].data["sha256"] == hashlib.sha256(text.encode()).hexdigest()
    return text if same else None


def _of_measurement(record: SessionRecord) -> Report:
    """Report of a result that a procedure's command would write too. Raises Refused without such a command."""
    state, last = record.state, record.state.results[-1]
    name = COMMANDS.get(state.plan, state.plan)
    if name not in procedure_names():
        raise Refused(f"the procedure {state.plan} has no certificate", "see report.html in the result's folder")
    folder = record.folder / last.folder
    beside = read_record(folder).get("field", {}).get("parts", {})  # refused ones have no folder
    parts = {one: read_result(folder / one) for one in beside if (folder / one).is_dir()}
    report = procedure_named(name).report(read_result(folder))
    planes = [replace(plane, name=f"{plane.name}, {one}") for one, part in parts.items() for plane in part.planes]
    refused = {one: part for one, part in beside.items() if one not in parts}
    planes += [PlaneResult(one, Verdict.REFUSED, part["reason"], part["remedy"]) for one, part in refused.items()]
    methods = [f"{one}: {procedure_named(one).method}" for one in parts]
    subject, made = f"{printable(state.camera)}, {printable(state.lens)}", last.at[:16].replace("T", " ") + " UTC"
    return replace(
        report, subject=subject, made=made, planes=[*report.planes, *planes],
        method="; ".join((report.method, *methods)),
        conditions=[*_conditions(state), *environment_lines(_environment(state))], devices=list(_devices(record)),
        fields=read_field(folder / FIELD) if (folder / FIELD).exists() else {},
        software=last.about["machine"]["software"], files=[f"{last.folder}/{name}" for name in last.files],
    )  # fmt: skip


def _report(record: SessionRecord, state: SessionState, result: SessionResult) -> Report:
    from procedures.field.conclusion import FieldResult  # imported here: slow to import
    from station.guide.provenance import NAMES, provenance_of
    from station.reports.field.field_files import with_medians

    last, entry = record.state.results[-1], entry_named(state.plan)
    sources = provenance_of(plan_named(state.plan), state.facts, result.frames).items()
    return Report(
        subject=f"{printable(state.camera)}, {printable(state.lens)}",
        procedure=state.plan,
        planes=[
            with_medians(one, one.estimate) if isinstance(one.estimate, FieldResult) else one
            for one in result.planes.values()
        ],
        frames=result.frames,
        shots=list(_shots(record.state, {frame.sha256: frame.exposure for frame in result.frames})),
        parameters={name: printable(value) for name, value in state.facts.items()},
        conditions=[
            *(ReportLine(NAMES[key], str(source)) for key, source in sources if source.source == OPERATOR),
            *_conditions(state),
            *environment_lines(_environment(state)),
        ],
        drift=drift_lines(state, result.planes),
        devices=list(_devices(record)),
        specification=terms_of_session(record.folder).specification.title,
        made=last.at[:16].replace("T", " ") + " UTC",
        software=last.about["machine"]["software"],
        files=[f"{last.folder}/{name}" for name in last.files],
        method=METHODS.get(state.plan) or (procedure_named(state.plan).method if entry.general else ""),
        fields={name: one for plane in result.planes.values() for name, one in _fields(plane.estimate)},
    )


def _fields(estimate: object) -> Iterator[tuple[str, PsfField]]:
    """The PSF over the frame by plane, of an estimate of a field."""
    from procedures.field.conclusion import FieldResult

    if isinstance(estimate, FieldResult):
        yield from ((name, plane.value.interpolation.field) for name, plane in estimate.planes.items() if plane.value)


def _shots(state: SessionState, exposures: Mapping[str, Exposure]) -> Iterator[ReportShot]:
    """The photographs of the result, then those that do not count, with the reason."""
    for shot in sorted(state.shots, key=lambda shot: not shot.counts):
        exposure = exposures.get(shot.sha256) if shot.counts else None
        words = exposure_words(exposure) if exposure else ""
        taken = printable(exposure.captured_at or "") if exposure else ""
        note = "" if shot.counts else printable(f"{shot.purpose}: does not count, {shot.reason or 'it was not judged'}")
        yield ReportShot(shot.path, shot.sha256, words, taken, note)


def _conditions(state: SessionState) -> Iterator[ReportLine]:
    """Range of every reported device value over the shots that count."""
    values_of: dict[str, list[float]] = {}
    for shot in state.counting():
        for name, value in {**shot.snapshot.get("axes", {}), **shot.snapshot}.items():
            if isinstance(value, int | float):
                values_of.setdefault(name, []).append(float(value))
    for name, values in sorted(values_of.items()):
        low, high = f"{min(values):.5g}", f"{max(values):.5g}"
        words, unit = unit_of(printable(name))
        yield ReportLine(words, f"{low if low == high else f'{low} to {high}'} {unit}".rstrip())


def _environment(state: SessionState) -> dict[str, Any] | None:
    return environment_of(shot.snapshot for shot in state.counting())


def _devices(record: SessionRecord) -> Iterator[ReportLine]:
    identities: Mapping[str, Any] = {}
    for line in record.contents.lines:
        if line.event == "devices":
            identities = line.data["devices"]
    for name, identity in identities.items():
        words = [str(identity.get(key) or "") for key in ("model", "firmware", "serial", "address")]
        yield ReportLine(printable(name), printable(", ".join(word for word in words if word)))


PLANES = ("G1", "Y")
SAME_PLACE = 3
"""Decimals of the axes' positions that are equal at one position."""
SMALLEST_CHANGE_K = 0.2
"""Change of the temperature below which no slope per kelvin is given: probes resolve about a tenth of it."""
HOUR_S = 3600.0


def drift_lines(state: SessionState, planes: Mapping[str, PlaneResult]) -> list[DriftLine]:
    """The drift of each number of the chart's photographs; none for other procedures, or with few photographs."""
    plane = next((planes[name] for name in PLANES if name in planes), None)
    if plane is None or not isinstance(plane.estimate, CombinedPsf):
        return []
    counting, combined = state.counting(), plane.estimate
    photographs = [(counting[place], shot) for place, shot in zip(combined.places, combined.shots, strict=True)]
    place = Counter(_place(shot) for shot, _ in photographs).most_common(1)[0][0]
    photographs = [photograph for photograph in photographs if _place(photograph[0]) == place]
    shots = [shot for shot, _ in photographs]
    series = chart_series([estimate for _, estimate in photographs], plane.pitch or 1)
    times = np.array([float(shot.exposure.get("requested_s", np.nan)) for shot in shots]) / HOUR_S
    hours = times if np.all(np.diff(times) > 0) else None
    readings = [temperature_during(shot.snapshot) for shot in shots]
    kelvins = None if None in readings else np.array(readings, np.float64)
    if kelvins is not None and np.ptp(kelvins) < SMALLEST_CHANGE_K:
        kelvins = None
    lines = []
    for name, one in series.items():
        slopes = [None if x is None else slope_of(x, one) for x in (hours, kelvins)]
        if any(slopes):
            per_hour, per_kelvin = (
                "—" if slope is None else f"{stated(slope.value, slope.uncertainty)} {one.unit}/{per}"
                for slope, per in zip(slopes, "hK", strict=True)
            )
            lines.append(DriftLine(name, per_hour, per_kelvin))
    return lines


def _place(shot: SessionShot) -> tuple[tuple[str, float], ...]:
    axes = shot.snapshot.get("axes", {})
    return tuple(sorted((str(name), round(float(value), SAME_PLACE)) for name, value in axes.items()))
