"""The guided plan of the whole camera: its photographs sorted by purpose, and the combined results."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.clipping import SensorModel
from procedures.field.conclusion import FieldResult
from procedures.field.estimate import NO_SENSORS
from procedures.geometry.estimate import Geometry
from procedures.geometry.facts import VIEW
from procedures.geometry.plan import chart_views
from procedures.outcome import BadInput, Outcome, Refused, Verdict, mark_doubtful, worst_of
from procedures.plan import Facts, Known, Outcomes, Plan, facts_as
from procedures.raw import RawFrame
from procedures.sensor.estimate import sensor_model
from procedures.sensor.photon_transfer import gain_and_noise
from procedures.sensor.plan import LIT, mark_of
from procedures.vignetting.estimate import joint_formula
from procedures.whole_camera import plan as guide
from procedures.whole_camera.from_field import CameraPart, sensor_parts, vignetting_parts, whole_camera
from procedures.whole_camera.plan import FLAT, PANEL_TURNED, TURNED, WholeCameraFacts
from station.calibration.sensor import SensorFiles
from station.calibration.sensor_files import sensor_measurement
from station.calibration.vignetting import Flats, flats_of, vignetting_measurement
from station.guide.plans import field, geometry, sensor
from station.procedure.schema import procedure_named
from station.results.measurement import Measurement, write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import PartBeside, RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms

GEOMETRY, VIGNETTING, SENSOR = "geometry", "vignetting", "sensor"
"""Results of a session in addition to the planes' PSFs, and the names of their folders."""
USED = "the PSFs were estimated with its noise and response"
NOT_USED = "the PSFs were estimated without it"


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


class FrameSubset(Sequence[RawFrame]):
    """A subset of the frames, each read on access."""

    def __init__(self, frames: Sequence[RawFrame], indices: Sequence[int]) -> None:
        self._frames, self._indices = frames, indices

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, index: Any) -> Any:
        indices = self._indices[index]
        return FrameSubset(self._frames, indices) if isinstance(index, slice) else self._frames[indices]


def subset(frames: Sequence[RawFrame], wanted: Callable[[str], bool]) -> FrameSubset:
    """The frames with a wanted mark."""
    return FrameSubset(frames, [i for i, frame in enumerate(frames) if wanted(mark_of(frame.sha256))])


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """The whole camera for every plane, with the verdict on the plane's PSF; a refusal where no place gives one. The
    sensor comes first: the PSFs of all places use its noise and response."""
    known_facts = facts_as(WholeCameraFacts, facts)
    others = {*known_facts.lit, *known_facts.flats, *known_facts.turned}
    places = subset(frames, lambda mark: mark not in others)
    flats = {  # taken with the panel upright, or turned as confirmed
        mark
        for mark, quarters in known_facts.flats.items()
        if not quarters or facts.get(f"{PANEL_TURNED}{quarters:.0f}")
    }
    sensor_frames, flat_frames, turned = (
        subset(frames, marks.__contains__) for marks in (known_facts.lit, flats, known_facts.turned)
    )
    parts: dict[str, Outcome[Any]] = {}
    used: dict[str, str] = {}
    models: Mapping[str, SensorModel] = NO_SENSORS
    if sensor_frames and places:
        by_plane = sensor.estimate(sensor_frames, facts, {})
        parts[SENSOR], models, used[SENSOR] = sensor_used(by_plane, places[0].exposure.iso)
    try:
        whole = field.field_of(places, known_facts, models)
    except Refused as refusal:
        return field.refused(frames, refusal)
    if flat_frames:
        parts[VIGNETTING] = vignetting_of(flat_frames, whole)
    views, reasons = chart_views(turned, known_facts)
    camera = whole_camera(whole, known_facts.cell_mm, joint_parts(parts), views)
    if turned:
        parts[GEOMETRY] = replace(camera.geometry, reason="; ".join(filter(None, (camera.geometry.reason, *reasons))))
    return field.by_plane(field.session_field(whole, camera, parts, used))


SensorUsed = tuple[Outcome[SensorFiles], Mapping[str, SensorModel], str]


def sensor_used(outcomes: Mapping[str, Outcome[SensorFiles]], iso: float | None) -> SensorUsed:
    """The sensor, the models used for the PSFs by plane, and a text about them; `iso` is that of the charts.

    Its verdict is the worst of its planes', and doubtful where the charts were taken at another sensitivity. The PSFs
    of a plane use noise and response where these are not doubtful.
    """
    whole = next((outcome.value for outcome in outcomes.values() if outcome.value is not None), None)
    answer = worst_of(outcomes).of_value(whole)
    if whole is not None and None not in (iso, whole.iso) and iso != whole.iso:
        reason = f"the sensor was measured at ISO {whole.iso:g}, the charts were taken at ISO {iso:g}"
        remedy = "take both at one sensitivity, since gain and noise depend on it"
        return mark_doubtful(answer, reason, remedy), NO_SENSORS, f"{NOT_USED}: {reason}"
    if whole is None:
        return answer, NO_SENSORS, f"{NOT_USED}: it was refused"
    planes = {plane.name: plane for plane in whole.planes}
    reasons = {
        name: caveat for name, plane in planes.items()
        if (caveat := plane.outcome.reason if plane.outcome.value is None else plane.outcome.value.caveat)
    }  # fmt: skip
    models = {name: sensor_model(one.outcome.result(), one.step) for name, one in planes.items() if name not in reasons}
    uses = [f"{', '.join(models)}: {USED}"] if models else []
    uses += [f"{name}: {NOT_USED}: {reason}" for name, reason in reasons.items()]
    return answer, models, "; ".join(uses)


def vignetting_of(frames: Sequence[RawFrame], whole: FieldResult) -> Outcome[Flats]:
    """The vignetting with the worst of its planes' verdicts; doubtful where the aperture differs from the charts'."""
    try:
        flats = flats_of(frames)
    except BadInput as error:
        return Outcome(None, Verdict.REFUSED, error.reason, error.remedy)
    answer = worst_of(flats.planes).of_value(flats)
    f_number, charts = frames[0].exposure.f_number, whole.measured.exposures[0].exposure.f_number
    if None in (f_number, charts) or f_number == charts:
        return answer
    return mark_doubtful(answer, f"the flats were taken at f/{f_number:g}, the charts at f/{charts:g}",
                      "take both at one aperture, since vignetting depends on it")  # fmt: skip


def joint_parts(parts: Mapping[str, Outcome[Any]]) -> list[CameraPart]:
    """Numbers of vignetting and sensor in the joint covariance."""
    flats: Flats | None = parts[VIGNETTING].value if VIGNETTING in parts else None
    files: SensorFiles | None = parts[SENSOR].value if SENSOR in parts else None
    numbers = [] if flats is None else vignetting_parts(joint_formula(_values(flats.planes)))
    if files is None:
        return numbers
    sensors = _values({plane.name: plane.outcome for plane in files.planes})
    return numbers + sensor_parts({name: gain_and_noise(one.transfer) for name, one in sensors.items()})


def _values(outcomes: Mapping[str, Outcome[Any]]) -> dict[str, Any]:
    return {name: outcome.value for name, outcome in outcomes.items() if outcome.value is not None}


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """Every plane's PSF at the frame's centre, and the verdict on each other part; a refused part is doubtful."""
    planes = field.results(frames, outcomes, terms, facts)
    whole = _whole(planes)
    for name, one in whole.parts.items() if whole else ():
        verdict = Verdict.DOUBTFUL if one.verdict is Verdict.REFUSED else one.verdict
        planes.append(replace(PlaneResult.of_outcome(name, one), verdict=verdict))
    return planes


def _whole(planes: Sequence[PlaneResult]) -> field.SessionField | None:
    return next((plane.estimate for plane in planes if plane.estimate is not None), None)


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The files of a field, with camera and page; the result of each other part is in a folder of its own."""
    whole = _whole(planes)
    parts = whole.parts if whole else {}
    head = replace(
        head, parameters={key: value for key, value in head.parameters.items() if not key.startswith(SHOT_FACTS)}
    )
    beside = dict(_written(folder, whole, frames, head)) if whole else {}
    flats: Flats | None = parts[VIGNETTING].value if VIGNETTING in parts else None
    lights = {} if flats is None else {name: one.surface.light for name, one in _values(flats.planes).items()}
    psfs = [plane for plane in planes if plane.name not in parts]
    return field.write(folder, psfs, frames, head, lights, beside)


SHOT_FACTS = (LIT, FLAT, TURNED, VIEW)
"""Prefixes of the facts of single photographs, which are in the journal."""


def _written(
    folder: ResultFolder, whole: field.SessionField, frames: Sequence[RawFrame], head: RecordHead
) -> Iterator[tuple[str, PartBeside]]:
    """Write each part's result into its folder, and give its entry of the page."""
    for name, part in whole.parts.items():
        page = ""
        if part.value is not None:
            page = "numbers.csv" if name == VIGNETTING else "report.html"
            with ResultFolder(folder.staging / name, sealed=folder.sealed) as inside:
                measured = _measured(part, whole.reference, frames, replace(head, procedure=name))
                if name != VIGNETTING:
                    inside.write(page, procedure_named(name).page(measured))
                write_measurement(inside, measured)
            page = f"{name}/{page}"
        yield name, PartBeside(part.verdict, part.reason, part.remedy, page, whole.used.get(name, ""))


def _measured(outcome: Outcome[Any], plane: str, frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    value: SensorFiles | Flats | Geometry = outcome.result()
    if isinstance(value, SensorFiles):
        return sensor_measurement(value, _of_inputs(head, {file.sha256 for file in value.files}))
    if isinstance(value, Flats):
        inputs = _of_inputs(head, {sha256 for _, sha256 in value.inputs}).input
        return vignetting_measurement(replace(value, inputs=tuple((Path(file.path), file.sha256) for file in inputs)))
    sources = {view.view.source for view in value.views}
    views = FrameSubset(frames, [i for i, frame in enumerate(frames) if frame.path.name in sources])
    result = PlaneResult.of_outcome(plane, outcome, estimate=value, numbers=value.numbers())
    return geometry.measurement([result], views, _of_inputs(head, {frame.sha256 for frame in views}))


def _of_inputs(head: RecordHead, hashes: set[str]) -> RecordHead:
    return replace(head, input=tuple(one for one in head.input if one.sha256 in hashes))
