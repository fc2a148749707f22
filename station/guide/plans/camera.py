"""The guided plan of the whole camera: its photographs sorted by what they are for, and all results put together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.facts import facts_as
from procedures.field.conclusion import FieldResult
from procedures.field.estimate import NO_SENSORS
from procedures.geometry.estimate import Geometry
from procedures.geometry.facts import VIEW
from procedures.geometry.plan import seen_views
from procedures.outcome import BadInput, Outcome, Refused, Verdict, with_doubt, worst_of
from procedures.plan import Facts, Known, Outcomes, Plan
from procedures.raw import RawFrame
from procedures.sensor.estimate import SensorResult, sensor_model
from procedures.sensor.facts import LIT, mark_of
from procedures.sensor.photon_transfer import gain_and_noise
from procedures.sensor_model import SensorModel
from procedures.vignetting.joint import joint_formula
from procedures.whole_camera import plan as guide
from procedures.whole_camera.facts import FLAT, PANEL_TURNED, TURNED, WholeCameraFacts
from procedures.whole_camera.from_field import whole_camera
from procedures.whole_camera.from_others import sensor_parts, vignetting_parts
from procedures.whole_camera.joint import Part
from station.calibration.sensor import SensorFiles
from station.calibration.sensor_files import sensor_measurement
from station.calibration.vignetting import Flats, flats_of, vignetting_measurement
from station.guide.plans import field, sensor
from station.results.measurement import write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import PartBeside, RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms

GEOMETRY, VIGNETTING, SENSOR = "geometry", "vignetting", "sensor"
"""What a session answers beside the planes' PSFs; its folders are called so too."""
USED = "the PSFs were estimated with its noise and response"
NOT_USED = "the PSFs were estimated without it"


def plan() -> Plan:
    """The plan."""
    return guide.plan(estimate)


class Picked(Sequence[RawFrame]):
    """Some of the frames, each read when it is asked for."""

    def __init__(self, frames: Sequence[RawFrame], which: Sequence[int]) -> None:
        self._frames, self._which = frames, which

    def __len__(self) -> int:
        return len(self._which)

    def __getitem__(self, index: Any) -> Any:
        which = self._which[index]
        return Picked(self._frames, which) if isinstance(index, slice) else self._frames[which]


def picked(frames: Sequence[RawFrame], wanted: Callable[[str], bool]) -> Picked:
    """The frames whose mark is wanted."""
    return Picked(frames, [i for i, frame in enumerate(frames) if wanted(mark_of(frame.sha256))])


# --- estimate ----------------------------------------------------------------------------------------------------


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """By plane the whole camera, with the verdict on the plane's PSF; a refusal where no place gives one.

    The sensor is first: the PSFs of all places rest on what it was found to do.
    """
    told = facts_as(WholeCameraFacts, facts)
    beside = {*told.lit, *told.flats, *told.turned}
    places = picked(frames, lambda mark: mark not in beside)
    flats = upright_or_turned(told, facts)
    of_sensor, of_lens, turned = (picked(frames, marks.__contains__) for marks in (told.lit, flats, told.turned))
    parts: dict[str, Outcome[Any]] = {}
    used: dict[str, str] = {}
    models: Mapping[str, SensorModel] = NO_SENSORS
    if of_sensor and places:
        by_plane = sensor.estimate(of_sensor, facts, {})
        parts[SENSOR], models, used[SENSOR] = sensor_used(by_plane, places[0].exposure.iso)
    try:
        found = field.field_of(places, told, models)
    except Refused as refusal:
        return field.refused(frames, refusal)
    if of_lens:
        parts[VIGNETTING] = vignetting_of(of_lens, found)
    views, reasons = seen_views(turned, told)
    camera = whole_camera(found, told.cell_mm, joint_parts(parts), views)
    if turned:
        lost = "; ".join(reasons)
        parts[GEOMETRY] = replace(camera.geometry, reason="; ".join(filter(None, (camera.geometry.reason, lost))))
    return field.by_plane(field.session_field(found, camera, parts, used))


SensorUsed = tuple[Outcome[SensorFiles], Mapping[str, SensorModel], str]


def sensor_used(outcomes: Mapping[str, Outcome[SensorFiles]], iso: float | None) -> SensorUsed:
    """The sensor, what the PSFs take from it by plane, and words about that; `iso` is the charts'.

    It has the worst of its planes' verdicts, and is doubted where the charts were taken at another sensitivity. A
    plane's PSFs take noise and response where these are not doubted.
    """
    whole = next((one.value for one in outcomes.values() if one.value is not None), None)
    answer = worst_of(outcomes).of_value(whole)
    if whole is not None and None not in (iso, whole.iso) and iso != whole.iso:
        reason = f"the sensor was measured at ISO {whole.iso:g}, the charts were taken at ISO {iso:g}"
        remedy = "take both at one sensitivity: gain and noise are not the charts' otherwise"
        return with_doubt(answer, reason, remedy), NO_SENSORS, f"{NOT_USED}: {reason}"
    if whole is None:
        return answer, NO_SENSORS, f"{NOT_USED}: it was refused"
    found = {one.name: one for one in whole.planes}
    why_not = {name: doubt for name, one in found.items() if (doubt := _why_not(one.outcome))}
    models = {name: sensor_model(one.outcome.result(), one.step) for name, one in found.items() if name not in why_not}
    told = [f"{', '.join(models)}: {USED}"] if models else []
    told += [f"{name}: {NOT_USED}: {why}" for name, why in why_not.items()]
    return answer, models, "; ".join(told)


def _why_not(one: Outcome[SensorResult]) -> str:
    """Why a plane's PSFs take nothing from its sensor; "" where they do."""
    return one.reason if one.value is None else one.value.doubt


def upright_or_turned(told: WholeCameraFacts, facts: Facts) -> set[str]:
    """The marks of the flats whose panel was turned as they were to be."""
    return {mark for mark, quarters in told.flats.items() if not quarters or facts.get(f"{PANEL_TURNED}{quarters:.0f}")}


def vignetting_of(frames: Sequence[RawFrame], found: FieldResult) -> Outcome[Flats]:
    """The lens's vignetting with the worst of its planes' verdicts; doubted where the aperture was another."""
    try:
        flats = flats_of(frames)
    except BadInput as error:
        return Outcome(None, Verdict.REFUSED, error.reason, error.remedy)
    answer = worst_of(flats.planes).of_value(flats)
    own, charts = frames[0].exposure.f_number, found.measured.exposures[0].exposure.f_number
    if None in (own, charts) or own == charts:
        return answer
    return with_doubt(answer, f"the flats were taken at f/{own:g}, the charts at f/{charts:g}",
                      "take both at one aperture: vignetting is another at each")  # fmt: skip


def joint_parts(parts: Mapping[str, Outcome[Any]]) -> list[Part]:
    """The numbers of vignetting and sensor that go into the one covariance."""
    flats: Flats | None = parts[VIGNETTING].value if VIGNETTING in parts else None
    files: SensorFiles | None = parts[SENSOR].value if SENSOR in parts else None
    found = [] if flats is None else vignetting_parts(joint_formula(_values(flats.planes)))
    if files is None:
        return found
    sensors = _values({one.name: one.outcome for one in files.planes})
    return found + sensor_parts({name: gain_and_noise(one.transfer) for name, one in sensors.items()})


def _values(outcomes: Mapping[str, Outcome[Any]]) -> dict[str, Any]:
    return {name: one.value for name, one in outcomes.items() if one.value is not None}


# --- results and files -------------------------------------------------------------------------------------------


def results(outcomes: Mapping[str, Outcome[FieldResult]], terms: Terms, facts: Facts) -> list[PlaneResult]:
    """Every plane's PSF at the frame's centre, and the verdict on each other part; one that gave nothing is a doubt."""
    planes = field.results(outcomes, terms, facts)
    return [*planes, *(_part_result(name, one) for name, one in parts_of(planes).items())]


def parts_of(planes: Sequence[PlaneResult]) -> Mapping[str, Outcome[Any]]:
    """The parts of the session that was found."""
    found = next((one.found for one in planes if one.found is not None), None)
    return {} if found is None else found.parts


def _part_result(name: str, one: Outcome[Any]) -> PlaneResult:
    verdict = Verdict.DOUBTFUL if one.verdict is Verdict.REFUSED else one.verdict
    return replace(PlaneResult.of_outcome(name, one), verdict=verdict)


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The files of a field, with camera and page for all; each other part's own result is in a folder beside them."""
    from station.reports.field.field_files import write_planes  # it draws: that import is slow

    parts = parts_of(planes)
    found = next((one.found for one in planes if one.found is not None), None)
    head = replace(head, parameters={key: one for key, one in head.parameters.items() if not key.startswith(OF_SHOTS)})
    beside = dict(_written(folder, found, frames, head)) if found is not None else {}
    flats: Flats | None = parts[VIGNETTING].value if VIGNETTING in parts else None
    lights = {} if flats is None else {name: one.surface.light for name, one in _values(flats.planes).items()}
    own = [one for one in planes if one.name not in parts]
    return write_planes(folder, own, head, found and found.camera, lights=lights, beside=beside)


OF_SHOTS = (LIT, FLAT, TURNED, VIEW)
"""How the names of facts of single photographs begin: the journal has them."""


def _written(
    folder: ResultFolder, found: field.SessionField, frames: Sequence[RawFrame], head: RecordHead
) -> Iterator[tuple[str, PartBeside]]:
    """Each part's result in a folder of its own: what the page tells of it."""
    writers = {SENSOR: _write_sensor, VIGNETTING: _write_vignetting, GEOMETRY: _write_geometry}
    for name, one in found.parts.items():
        look = ""
        if one.value is not None:
            with ResultFolder(folder.staging / name, sealed=folder.sealed) as inside:
                look = f"{name}/{writers[name](inside, one, found.reference, frames, replace(head, procedure=name))}"
        yield name, PartBeside(one.verdict, one.reason, one.remedy, look, found.used.get(name, ""))


def _write_sensor(
    folder: ResultFolder, one: Outcome[Any], plane: str, frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.reports.sensor_page import sensor_page  # it draws: that import is slow

    files: SensorFiles = one.result()
    folder.write("report.html", sensor_page(files))
    write_measurement(folder, sensor_measurement(files, _of_inputs(head, {one.sha256 for one in files.files})))
    return "report.html"


def _write_vignetting(
    folder: ResultFolder, one: Outcome[Any], plane: str, frames: Sequence[RawFrame], head: RecordHead
) -> str:
    flats: Flats = one.result()
    inputs = _of_inputs(head, {sha256 for _, sha256 in flats.inputs}).input
    flats = replace(flats, inputs=tuple((Path(told.path), told.sha256) for told in inputs))
    write_measurement(folder, vignetting_measurement(flats))
    return "numbers.csv"


def _write_geometry(
    folder: ResultFolder, one: Outcome[Any], plane: str, frames: Sequence[RawFrame], head: RecordHead
) -> str:
    from station.reports.geometry_files import write_plane  # it draws: that import is slow

    geometry: Geometry = one.result()
    sources = {view.view.source for view in geometry.views}
    seen = Picked(frames, [i for i, frame in enumerate(frames) if frame.path.name in sources])
    told = PlaneResult.of_outcome(plane, one, found=geometry, numbers=geometry.numbers())
    write_plane(folder, told, seen, _of_inputs(head, {frame.sha256 for frame in seen}))
    return "report.html"


def _of_inputs(head: RecordHead, hashes: set[str]) -> RecordHead:
    """The head with these photographs alone."""
    return replace(head, input=tuple(one for one in head.input if one.sha256 in hashes))
