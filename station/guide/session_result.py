"""The result of a session: estimated from the photographs that count, written whole. The same way every time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from procedures.outcome import Cause, Outcome, Verdict, worst_of
from procedures.plan import Estimate, Known, Plan
from procedures.raw import Carried, Felt, RawFrame, read_frame
from procedures.reading.arrays import checked_array, checked_number
from station.guide.catalogue import entry_named
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead
from station.results.result_files import ResultFolder
from station.sessions.compute_environment import same_bits
from station.sessions.journal import Damaged
from station.sessions.layout import inside
from station.sessions.session import Session
from station.sessions.session_terms import terms_of_session
from station.sessions.state import SessionShot, SessionState


@dataclass(frozen=True, eq=False)
class SessionResult:
    """What a session's photographs gave, by plane.

    The verdict on the whole is the worst of its planes', with the causes of the planes that have it.
    """

    frames: Sequence[RawFrame]
    planes: Mapping[str, PlaneResult]
    verdict: Verdict
    reason: str
    remedy: str
    other_causes: tuple[Cause, ...] = ()


Counted = Callable[[int, int], None]


def uncounted(done: int, total: int) -> None:
    """Nobody counts."""


MEMORY = 500e6
"""Bytes of photographs kept in memory; planes of float32 take some four times the file's bytes."""


class Frames(Sequence[RawFrame]):
    """Photographs that are read when they are asked for; as many stay in memory as have room there.

    Raises Damaged where one that is read has another hash than it is told to have.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        felt: Sequence[Felt | None] = (),
        hashes: Sequence[str] = (),
        carried: Sequence[Carried | None] = (),
    ) -> None:
        self._paths, self._felt, self._hashes = paths, felt or (None,) * len(paths), hashes
        self._carried = carried or (None,) * len(paths)
        largest = max((path.stat().st_size for path in paths), default=1)
        self._read = lru_cache(max(1, int(MEMORY / (4 * largest))))(read_frame)

    def __len__(self) -> int:
        return len(self._paths)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return Frames(self._paths[index], self._felt[index], self._hashes[index], self._carried[index])
        frame, felt = self._read(self._paths[index]), self._felt[index]
        if self._hashes and frame.sha256 != self._hashes[index]:
            raise Damaged(f"{frame.path} is not what was taken any more", "bring it back from a copy")
        carried = self._carried[index]
        return frame if felt is carried is None else replace(frame, felt=felt, carried=carried)


def felt_during(shot: SessionShot) -> Felt | None:
    """The motion recorded with a photograph; None where it was not, or not when the shutter opened."""
    motion, shutter = shot.snapshot.get("motion"), shot.exposure.get("shutter")
    if not motion or not shutter or shutter.get("flash_s") is None:
        return None
    times, acceleration, rotation = (
        checked_array(motion[name], f"`{name}` of a recorded motion")
        for name in ("host_s", "acceleration_m_s2", "rotation_rad_s")
    )
    return Felt(times - checked_number(shutter["flash_s"], "`flash_s` of a shutter"), acceleration, rotation)


COLUMNS = {"x_mm": 0, "y_mm": 1, "z_mm": 2}
"""Of a position, by a shaker's axis: to the right, up, back."""


def carried_during(shot: SessionShot) -> Carried | None:
    """The path that a shaker was told for a photograph; None where there was none, or it turned the camera, too."""
    told, shutter = shot.snapshot.get("shake"), shot.exposure.get("shutter") or {}
    if not told or not set(told["offsets"]) <= set(COLUMNS):
        return None
    count = len(next(iter(told["offsets"].values())))
    position_m = np.zeros((count, 3))
    for axis, way in told["offsets"].items():
        position_m[:, COLUMNS[axis]] = checked_array(way, f"`{axis}` of a shaker's path", (count,)) / 1000
    flash_s = shutter.get("flash_s")
    since_s = None if flash_s is None else float(flash_s) - float(told["began_s"])
    return Carried(position_m, float(told["interval_s"]), since_s)


class Told(Sequence[RawFrame]):
    """Frames that tell when an estimate turns to the next one: how far it is, without the estimate's doing."""

    def __init__(self, frames: Sequence[RawFrame], progress: Counted) -> None:
        self._frames, self._progress = frames, progress

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, int) and 0 <= index < len(self):
            self._progress(index, len(self))
        return self._frames[index]


def derive(
    session: Session, plan: Plan, step: str, progress: Counted = uncounted, known: Known | None = None
) -> tuple[Path, SessionResult]:
    """Draw the result from the session's counting photographs, write it and keep it; its folder. Raises ProcedureError.

    `known` is what was estimated already, when the shots were judged.
    """
    start_s, state = session.clock.now_s(), session.state
    found = compute(session.folder, state, plan, session.result_folder(), progress, known=known)
    duration_s = session.clock.now_s() - start_s
    numbers = [shot.number for shot in state.counting()]
    told = {"reason": found.reason, "remedy": found.remedy, "duration_s": duration_s}
    kept = session.keep_result(step=step, shots=numbers, verdict=str(found.verdict), **told)
    return session.folder / kept.folder, found


def compute(
    folder: Path,
    state: SessionState,
    plan: Plan,
    into: Path | None = None,
    progress: Counted = uncounted,
    *,
    sealed: bool = True,
    known: Known | None = None,
) -> SessionResult:
    """The result of a session in this state, written into a folder; the same files, bit for bit, at every call.

    `progress` hears of every photograph that an estimate begins with, and of how many there are; `sealed` is of the
    result's folder; `known` holds estimates of the same photographs that need not be made again.

    Raises
    ------
    ProcedureError
        If a photograph cannot be read, or the result not be written.
    """
    shots, entry = state.counting(), entry_named(plan.name)
    paths, felt = [inside(folder, shot.path) for shot in shots], [felt_during(shot) for shot in shots]
    carried = [carried_during(shot) for shot in shots]
    frames = Frames(paths, felt, [shot.sha256 for shot in shots], carried)
    with same_bits():
        outcomes = estimate_of(plan).estimate(Told(frames, progress), state.facts, {} if known is None else known)
        terms = terms_of_session(folder)
        results = entry.results(frames, outcomes, terms, state.facts)
        if into is not None:
            with ResultFolder(into, sealed=sealed, force=True) as place:
                entry.write(place, results, frames, _head(plan, state, frames, terms.specified(results)))
    worst = verdict_of_planes(results)
    causes = worst.reason, worst.remedy, worst.other_causes
    return SessionResult(frames, {one.name: one for one in results}, worst.verdict, *causes)


def _head(
    plan: Plan, state: SessionState, frames: Sequence[RawFrame], specification: Mapping[str, Any] | None
) -> RecordHead:
    """How a record begins; when it was drawn and how long that took is in the journal."""
    from station.guide.whose_word import words_of  # here: what it stands on is slow to import

    files = tuple(InputFile(shot.path, shot.sha256) for shot in state.counting())
    words = {key: asdict(word) for key, word in words_of(plan, state.facts, frames).items()}
    return RecordHead(plan.name, files, {**state.facts, **({"whose_word": words} if words else {})}, specification)


def verdict_of_planes(planes: Sequence[PlaneResult]) -> Outcome[Any]:
    """The worst verdict, with the causes of the planes that have it."""
    if not planes:
        return Outcome(None, Verdict.REFUSED, "no shot counts", "take the shots again")
    return worst_of({one.name: one for one in planes})


def estimate_of(plan: Plan) -> Estimate:
    """The plan's estimate. Raises KeyError where it has none."""
    for request in requests_of(plan):
        if isinstance(request, Estimate):
            return request
    raise KeyError(f"the plan {plan.name} estimates nothing")


def requests_of(plan: Plan) -> Sequence[object]:
    """All requests in their order."""
    return [request for step in plan.steps for request in step.requests]
