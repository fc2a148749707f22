"""The guided plan of a restoration, with shapes of the blur from files of the session."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from procedures.plan import Facts, Outcomes, Plan, facts_as
from procedures.raw import RawFrame
from procedures.restoration.facts import RestorationFacts
from procedures.restoration.ground_truth import stacked
from procedures.restoration.joint.result import Restoration
from procedures.restoration.known_blur import planes_of, rig_poses, split_ground_truth
from procedures.restoration.photograph_blur import Shape
from procedures.restoration.plan import plan as restoration_plan
from station.calibration.restoration.inputs import files_in, imu_table, poses_table, read_blur_shape, with_files
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.terms import Terms
from station.sessions.layout import is_given


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
    """The restored picture, its depth and diagnostics."""
    from station.reports.restoration_files import restored_plane  # it draws, a slow import

    return [restored_plane(name, outcome) for name, outcome in outcomes.items()]


def measurement(planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> Measurement:
    """That of `station restore`, with the records of motion."""
    from station.reports.restoration_files import Restored, restoration_measurement  # it draws, a slow import

    (picture,) = planes
    shown = {name: value for name, value in head.parameters.items() if name != "first_view"}
    head = replace(head, parameters=shown)
    restoration: Restoration | None = picture.estimate
    outcome = picture.outcome(restoration)
    if restoration is None:
        return restoration_measurement(picture.name, Restored(outcome, ()), head)
    facts = facts_as(RestorationFacts, head.parameters)
    blurred, _ = split_ground_truth(frames, facts)
    records: dict[str, bytes] = {}
    for n, frame in enumerate(blurred, start=1):
        if frame.imu is not None:
            records[f"imu_{n}.csv"] = imu_table(frame.imu)
        poses, exposure_s = rig_poses(frame), frame.exposure.exposure_s
        if frame.shaker_path is not None and poses is not None and exposure_s is not None:
            records[f"poses_{n}.csv"] = poses_table(poses, exposure_s)
    timeless = replace(restoration, history=tuple(replace(r, seconds=0.0) for r in restoration.history))
    photographs = [stacked(planes_of(frame, facts)) for frame in blurred]
    whole = Restored(replace(outcome, value=timeless), photographs)  # makes the files reproducible
    measured = restoration_measurement(picture.name, whole, head)
    return replace(measured, files={**records, **measured.files})
