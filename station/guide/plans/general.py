"""The guided plan of any procedure that measures photographs: settings as questions, photographs, measurement."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from procedures.drawings import steps as drawings
from procedures.outcome import BadInput, BadParameter, Refused, Verdict
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Fact,
    Facts,
    Go,
    Known,
    Outcomes,
    Plan,
    SetLight,
    Step,
    Tour,
    TourStop,
)
from procedures.raw import RawFrame
from station.common.models import ModelField, TableSource, fields_of, read_model, read_value
from station.common.sanitise import unit_of
from station.guide.dialogue import FILE_SEPARATOR
from station.procedure.base import Inputs, Procedure
from station.procedure.schema import procedure_named
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.terms import Terms
from station.sessions.state import terms_of_session

COUNTS = {Inputs.PHOTOGRAPH: 1, Inputs.PAIR: 2, Inputs.PHOTOGRAPHS: None}
"""Number of photographs by kind of input; None where the operator chooses it."""
SETTING = "setting_"
"""Prefix of the facts that are settings: a setting `f_number` is not the fact `f_number` of a photograph."""
COUNT = "photographs"
NO, YES = "no", "yes"
NOT_ASKED = ("raw",)
"""Settings that the camera of a bench determines."""


def plan(name: str, folder: Path | None = None) -> Plan:
    """The plan of a procedure, for the session in a folder if given. Raises BadParameter if there is no such procedure,
    or its inputs are not one or several photographs."""
    procedure = procedure_named(name)
    if procedure.inputs not in COUNTS:
        raise BadParameter(
            f"the inputs of {name} must be photographs; they are: {procedure.inputs}", f"use station {name}"
        )
    count = COUNTS[procedure.inputs]
    how_many = Ask(COUNT, "How many photographs shall be measured together?", "number", "", 2.0, low=1.0, high=100.0)
    return Plan(
        name,
        procedure.title,
        (
            Step(
                "settings", "Settings", "Choose the settings of the procedure. Enter keeps the default.",
                (*([] if count else [how_many]), *(_question(one) for one in _asked(procedure))),
            ),
            Step(
                "photographs", "Photographs", "Prepare subject and camera, then take the photographs.",
                (
                    SetLight(lambda facts: 1.0),
                    Ask("scene", "Place the subject in front of the camera, and light it evenly."),
                    Ask("camera_set", "Set the camera: RAW, manual exposure, nothing that matters clipped."),
                    Ask("focused", "Focus on the subject, then switch autofocus off."),
                    Tour(partial(_stops, procedure, count)),
                ),
                drawings.SHOTS,
            ),
            Step("estimate", "Estimate", "Measure the photographs.", (Estimate(partial(estimate, procedure, folder)),)),
            Step("verdict", "Verdict", "Accept the result, or take the photographs again.", (Decide("settings"),)),
        ),
        subject=procedure.subject,
    )  # fmt: skip


def _stops(procedure: Procedure[Any], count: int | None, facts: Facts) -> list[TourStop]:
    """The photographs; before each the operator changes what the procedure requires."""
    total = count or int(float(facts[COUNT]))

    def stop(number: int) -> TourStop:
        say = f"Prepare photograph {number} of {total}." if total > 1 else ""
        return TourStop(f"photograph {number}", Go(lambda facts: {}, lambda facts: say), check)

    def check(frame: RawFrame, facts: Facts) -> Advice:
        return procedure.check_photograph(frame, _given(_asked(procedure), facts))

    return [stop(number) for number in range(1, total + 1)]


def _asked(procedure: Procedure[Any]) -> list[ModelField]:
    return [one for one in fields_of(procedure.Settings) if one.name not in NOT_ASKED]


def _question(field: ModelField) -> Ask:
    """A setting as a question with its default; an empty answer leaves an optional setting out."""
    words, unit = unit_of(field.name)
    question = f"{words[:1].upper()}{words[1:]}{unit and f', {unit}'}: {field.description}"
    ask = Ask(SETTING + field.name, question, "text", check=partial(_check, field))
    if field.kind is bool:
        return replace(ask, kind="choice", choices=(NO, YES), default=YES if field.default else NO)
    if field.choices and field.default is not None and not field.several:
        return replace(ask, kind="choice", choices=field.choices, default=str(field.default))
    if field.kind in (int, float) and isinstance(field.default, int | float):
        return replace(ask, kind="number", default=float(field.default), low=field.least, high=field.most)
    if field.required:
        return ask
    parts = () if field.default is None else field.default if field.several else (field.default,)
    default = f"{FILE_SEPARATOR} ".join(map(str, parts))
    return replace(ask, default=default, names_file=lambda part: field.kind is Path and bool(part))


def _check(field: ModelField, answer: Fact, facts: Facts) -> None:
    """Raises BadParameter if an answer is not a value of the setting."""
    for value in _given([field], {SETTING + field.name: answer}).values():
        read_value(field, value, TableSource(), (field.name,))


def _given(fields: Sequence[ModelField], facts: Facts) -> dict[str, Any]:
    answers = ((field, facts.get(SETTING + field.name, "")) for field in fields)
    return {one.name: _value(one, answer) for one, answer in answers if answer != ""}


def _value(field: ModelField, answer: Fact) -> Any:
    if field.kind is bool:
        return answer in (True, YES)
    if field.several:
        return [_single(field.kind, part.strip()) for part in str(answer).split(FILE_SEPARATOR)]
    return _single(field.kind, answer)


def _single(kind: type, answer: Fact) -> Any:
    """A number where one is required and given; other text is left to the check of the model."""
    if kind not in (int, float):
        return str(answer)
    try:
        number = float(answer)
    except ValueError:
        return answer
    return int(number) if kind is int and number.is_integer() else number


def estimate(
    procedure: Procedure[Any], folder: Path | None, frames: Sequence[RawFrame], facts: Facts, known: Known
) -> Outcomes:
    """The measurement of the original photographs, as the value of every plane's outcome."""
    if folder is None or not frames:
        raise BadInput("a session with photographs is required; there is none", "take the photographs")
    read = list(frames)  # reading verifies the hashes
    given = _given(_asked(procedure), facts)
    try:
        settings = read_model(procedure.Settings, given, TableSource()).placed(folder)
        settings.check()
        measured = procedure.measure([one.path for one in read], settings, terms_of_session(folder))
        if not measured.planes:
            raise Refused(f"{procedure.name} found no plane in the photographs", "take them again")
    except (BadInput, BadParameter, Refused) as error:
        names = list(read[0].planes)
        several = procedure.results_key == Procedure.results_key
        planes = (
            PlaneResult(name, Verdict.REFUSED, error.reason, error.remedy) for name in (names if several else names[:1])
        )
        measured = Measurement(
            procedure.schema, RecordHead(procedure.record_name), tuple(planes), results_key=procedure.results_key
        )
    files = {one.name: given[one.name] for one in _asked(procedure) if one.kind is Path and one.name in given}
    parameters = {**measured.head.parameters, **files}
    measured = replace(measured, head=replace(measured.head, parameters=parameters))
    return {plane.name: plane.outcome(measured) for plane in measured.planes}


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """Every plane of the measurement; `estimate` of each is the whole measurement."""
    return [replace(outcome.result().by_name[name], estimate=outcome.value) for name, outcome in outcomes.items()]


def measurement(planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    """That of the procedure's command."""
    measured: Measurement = planes[0].estimate
    own = replace(measured.head, input=head.input, environment=head.environment, duration_s=None)
    return replace(measured, head=own)
