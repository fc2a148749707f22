"""The reproducible result of a session, estimated from the photographs that count."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from procedures.outcome import BadInput, Cause, Outcome, Verdict, worst_of
from procedures.plan import Estimate, Known, Plan
from procedures.raw import ImuRecord, RawFrame, ShakerPath, ShakerResponse, measured_path, read_frame
from procedures.reading.arrays import checked_array, checked_number
from station.guide.catalogue import entry_named
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, environment_of
from station.results.result_files import ResultFolder
from station.sessions.journal import Damaged, same_bits
from station.sessions.layout import inside
from station.sessions.session import Session
from station.sessions.state import SessionShot, SessionState, terms_of_session


@dataclass(frozen=True, eq=False)
class SessionResult:
    """The result of a session by plane; `verdict` is the worst of the planes', with its causes."""

    frames: Sequence[RawFrame]
    planes: Mapping[str, PlaneResult]
    verdict: Verdict
    reason: str
    remedy: str
    other_causes: tuple[Cause, ...] = ()


Progress = Callable[[int, int], None]


def no_progress(done: int, total: int) -> None:
    """No-op progress callback."""


CACHE_BYTES = 500e6
"""Photographs kept in memory; planes of float32 take about four times the size of the file."""


class Frames(Sequence[RawFrame]):
    """Photographs of a session, read on access and kept, with IMU records and shaker paths; `progress` has their number
    and total. Raises Damaged for another hash."""

    def __init__(self, folder: Path, shots: Sequence[SessionShot], progress: Progress = no_progress) -> None:
        self._folder, self._shots, self.progress = folder, shots, progress
        self._paths = [inside(folder, shot.path) for shot in shots]
        largest = max((path.stat().st_size for path in self._paths), default=1)
        self._read = lru_cache(max(1, int(CACHE_BYTES / (4 * largest))))(read_frame)

    def __len__(self) -> int:
        return len(self._shots)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return Frames(self._folder, self._shots[index])
        shot, frame = self._shots[index], self._read(self._paths[index])
        self.progress(index, len(self))
        if frame.sha256 != shot.sha256:
            raise Damaged(f"{frame.path} has changed since it was taken", "restore it from a copy")
        return replace(frame, imu=imu_during(shot), shaker_path=shaker_path_during(shot))


def imu_during(shot: SessionShot) -> ImuRecord | None:
    """The IMU record of a photograph; None without one, or without the time at which the shutter opened."""
    motion, shutter = shot.snapshot.get("motion"), shot.exposure.get("shutter")
    if not motion or not shutter or shutter.get("flash_s") is None:
        return None
    times, acceleration, rotation = (
        checked_array(motion[name], f"`{name}` of a recorded motion")
        for name in ("host_s", "acceleration_m_s2", "rotation_rad_s")
    )
    opened_s = checked_number(shutter["flash_s"], "`flash_s` of a shutter")
    clock, box_s = motion.get("clock"), checked_number(shutter.get("within_s") or 0.0, "`within_s` of a shutter")
    if clock is None:
        return ImuRecord(times - opened_s, acceleration, rotation)
    own_s = checked_number(clock["within_s"], "`within_s` of a clock")
    # a unit on the box's own cable shares the error of its round trip, which cancels
    return ImuRecord(times - opened_s, acceleration, rotation, own_s if clock["by"] == "box" else own_s + box_s)


COLUMNS = {"x_mm": 0, "y_mm": 1, "z_mm": 2}
"""Column of a position by the shaker's axis: to the right, up, back."""


def shaker_path_during(shot: SessionShot) -> ShakerPath | None:
    """The shaker's path during a photograph, measured by its inertial unit, else by its response; None if it also
    turned."""
    shake, shutter = shot.snapshot.get("shake"), shot.exposure.get("shutter") or {}
    if not shake or not set(shake["offsets"]) <= set(COLUMNS):
        return None
    count = len(next(iter(shake["offsets"].values())))
    position_m = np.zeros((count, 3))
    for axis, offsets in shake["offsets"].items():
        position_m[:, COLUMNS[axis]] = checked_array(offsets, f"`{axis}` of a shaker's path", (count,)) / 1000
    flash_s = shutter.get("flash_s")
    since_s = None if flash_s is None else float(flash_s) - float(shake["began_s"])
    given = {COLUMNS[axis]: one for axis, one in (shake.get("response") or {}).items()}
    response = tuple(
        ShakerResponse(given[i]["gain"], given[i]["frequency_hz"], given[i]["damping"]) if i in given
        else ShakerResponse() for i in range(3)
    )  # fmt: skip
    within_s = max((float(one["within_s"]) for one in given.values()), default=0.0)
    uncertainty = max((float(one.get("gain_uncertainty", 0.0)) for one in given.values()), default=0.0)
    path = ShakerPath(position_m, float(shake["interval_s"]), since_s, response, within_s, uncertainty)
    if ((shot.snapshot.get("motion") or {}).get("clock") or {}).get("by") == "box":  # on the clock of the shaker
        with suppress(BadInput):
            return measured_path(path, imu) if (imu := imu_during(shot)) is not None else path
    return path


def derive(
    session: Session, plan: Plan, step: str, progress: Progress = no_progress, known: Known | None = None
) -> tuple[Path, SessionResult]:
    """Compute, write and store the session's result; gives its folder, too. Raises ProcedureError."""
    start_s, state = session.clock.now_s(), session.state
    result = compute(session.folder, state, plan, session.result_folder(), progress, known=known)
    duration_s = session.clock.now_s() - start_s
    numbers = [shot.number for shot in state.counting()]
    causes = {"reason": result.reason, "remedy": result.remedy, "duration_s": duration_s}
    kept = session.keep_result(step=step, shots=numbers, verdict=str(result.verdict), **causes)
    return session.folder / kept.folder, result


def compute(
    folder: Path,
    state: SessionState,
    plan: Plan,
    into: Path | None = None,
    progress: Progress = no_progress,
    *,
    sealed: bool = True,
    known: Known | None = None,
) -> SessionResult:
    """The result of a session in this state, in a folder, bitwise the same at every call; progress as `Frames`, `known`
    estimates of the shots. Raises ProcedureError."""
    shots, entry = state.counting(), entry_named(plan.name)
    frames = Frames(folder, shots, progress)
    with same_bits():
        outcomes = estimate_of(plan).estimate(frames, state.facts, {} if known is None else known)
        frames.progress = no_progress  # results read single photographs again
        terms = terms_of_session(folder)
        results = entry.results(frames, outcomes, terms, state.facts)
        if into is not None:
            with ResultFolder(into, sealed=sealed, force=True) as place:
                entry.write(place, results, frames, _head(plan, state, frames, terms.specified(results)))
    no_shots: Outcome[Any] = Outcome(None, Verdict.REFUSED, "no shot counts", "take the shots again")
    worst = worst_of({result.name: result for result in results}) if results else no_shots
    causes = worst.reason, worst.remedy, worst.other_causes
    return SessionResult(frames, {result.name: result for result in results}, worst.verdict, *causes)


def _head(
    plan: Plan, state: SessionState, frames: Sequence[RawFrame], specification: Mapping[str, Any] | None
) -> RecordHead:
    """Head of the record; date and duration are in the journal."""
    from station.guide.provenance import provenance_of  # imported here: its dependencies are slow to import

    files = tuple(InputFile(shot.path, shot.sha256) for shot in state.counting())
    provenance = {key: one.record() for key, one in provenance_of(plan, state.facts, frames).items()}
    return RecordHead(
        plan.name,
        files,
        {**state.facts, **({"provenance": provenance} if provenance else {})},
        specification,
        environment=environment_of(shot.snapshot for shot in state.counting()),
    )


def estimate_of(plan: Plan) -> Estimate:
    """The plan's estimate. Raises KeyError where it has none."""
    for request in (request for step in plan.steps for request in step.requests):
        if isinstance(request, Estimate):
            return request
    raise KeyError(f"the plan {plan.name} estimates nothing")
