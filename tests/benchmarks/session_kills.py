"""Kills simulated sessions at random moments and resumes them: nothing may be lost, and the result must be the same.

    python -m tests.benchmarks.session_kills [--kills 500] [--seed 1]

Each session is a run of a small plan on the simulated bench (homing, a look, two shots that count, the estimate) in a
process of its own, which is killed (SIGKILL) or gets a full disk until it may go to its end. Then its files are held
against those of a session that nothing disturbed.

- `time`: killed after a random time.
- `before`, `half`, `after`: killed at a random write, synchronisation or rename: before it, half way, after it.
- `frame`: killed when the camera has written half a frame.
- `full`: from a random operation on the disk takes half a write and no more; after some failures, there is room again.
- `limit`: no file may grow beyond a random size; the system refuses the rest of the write.
"""

import importlib
import json
import math
import os
import platform
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from procedures import ProcedureError, read_frame
from simulators.bench.body import Opening
from station.bench.opening import simulated_bench
from station.common.durable_files import Disk
from station.guide import catalogue, session_report
from station.guide.frontend import ProgressEvent
from station.guide.recompute import recompute
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.results.result_files import RECORD, SEAL
from station.sessions.reader import read_session, sessions_in, verify
from station.sessions.session import Session
from tests.benchmarks import options
from tests.station.sessions import short_plan
from tests.station.sessions.faulty_disk import FaultyDisk
from tests.station.sessions.short_plan import ENTRY, SHOTS, photographs, plan

catalogue.PLANS |= ENTRY
session_report.session_page = lambda folder, computed: "no part of this: it takes longer than all the rest"

KINDS = ("time", "before", "half", "after", "frame", "full", "limit")

READY: dict[str, Any] = {}
"""The estimate from one photograph, made once: an estimate in every process would take longer than all the rest."""


def estimate(frames: Any, facts: object, known: object) -> dict[str, Any]:
    """That estimate, moved a little by every sample of every photograph."""
    sums = [frame.planes["G1"].samples.sum(dtype=float) for frame in frames]
    found = READY["G1"]
    moved = found.value.psf.h + 1e-6 * math.fmod(math.fsum(sums), 1.0) + 1e-12 * sums[0]
    psf = replace(found.value.psf, h=moved)
    return {"G1": replace(found, value=replace(found.value, psf=psf))}


@dataclass(frozen=True)
class Fault:
    """What goes wrong in one process: `at` is a time in s, an operation, a frame, or a size in bytes."""

    kind: str = ""
    at: float = 0.0
    failures: int = 0


def die() -> None:
    """No process survives this."""
    os.kill(os.getpid(), signal.SIGKILL)


class KilledDisk(FaultyDisk):
    """The disk on which it happens: the process is killed, or there is room again after some failures."""

    def __init__(self, fault: Fault) -> None:
        here = fault.kind in ("before", "half", "after", "full")
        super().__init__(int(fault.at) if here else -1, fault.kind)
        self._failures = fault.failures

    def cut(self) -> None:
        die()

    def _perform(self, action: Any, partly: Any = lambda: None) -> Any:
        self.full = self.full and self.count + 1 < self.at + self._failures
        return super()._perform(action, partly)


class Log:
    """What a process did and received, outside the session; whole lines survive it."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def write(self, *words: object) -> None:
        os.write(self._file, (json.dumps(words) + "\n").encode())

    def heard(self, event: object) -> None:
        """What is reported to the operator."""
        if isinstance(event, ProgressEvent):
            self.write("heard", event.say)


class WatchedSession(Session):
    """A session that logs which photographs it has reported as kept."""

    log: Log

    def adopt(self, *args: Any, **kwargs: Any) -> Any:
        shot = super().adopt(*args, **kwargs)
        self.log.write("kept", shot.number, shot.sha256)
        return shot


def session_in(root: Path, clock: Any, disk: Disk) -> Session:
    """The session in the folder, opened or begun."""
    for folder in sessions_in(root / "sessions"):
        return WatchedSession.open(folder, clock, disk=disk)
    about = {"plan": "short", "camera": "Box", "lens": "24 mm", "config": {}}
    return WatchedSession.create(root / "sessions", **about, clock=clock, seed=1, disk=disk)


def develop(session: Session, frames: dict[str, bytes], fault: Fault, folder: Path, log: Log) -> Any:
    """What the camera sees depends on what is photographed, not on how often."""

    def developed(opening: Opening) -> bytes:
        awaited = session.state.awaited
        assert awaited is not None
        good = [s for s in session.state.shots if s.purpose == awaited.purpose and s.counts is not False]
        name = "look" if awaited.purpose == "look" else f"shot {len(good)}"
        log.write("exposed", name)
        if fault.kind == "frame" and opening.number == fault.at:
            (folder / f"IMG_{9000 + opening.number}.DNG").write_bytes(frames[name][: len(frames[name]) // 2])
            die()
        return frames[name]

    return developed


def work(root: Path, frames: dict[str, bytes], fault: Fault) -> None:
    """Begin or resume, and run to the end unless something happens."""
    log = WatchedSession.log = Log(root / "log.jsonl")
    if fault.kind == "limit":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(fault.at), resource.RLIM_INFINITY))
    incoming = root / "incoming"
    incoming.mkdir(exist_ok=True)
    bench = simulated_bench(incoming, seed=1, virtual_time=True)
    disk = KilledDisk(fault)
    with session_in(root, bench.clock, disk) as session:
        bench.simulated.body.develop = develop(session, frames, fault, incoming, log)
        ended = Run(plan(), bench, session, ScriptedOperator(listen=log.heard, patience=4)).go()
    log.write("ended", ended.how, disk.count, [] if fault.kind else list(sys.modules))


def run(root: Path, frames: dict[str, bytes], fault: Fault) -> tuple[bool, float]:
    """One process in this folder: whether it came to its end by itself, and how long it took.

    A full disk must end in a sentence, not in an error that nobody foresaw.
    """
    root.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            with open(root / "stderr.txt", "a") as errors:
                os.dup2(errors.fileno(), 2)
                work(root, frames, fault)
            code = 0
        except ProcedureError as error:
            traceback.print_exception(error)
            code = 0
        except BaseException as error:
            traceback.print_exception(error)
        finally:
            sys.stderr.flush()
            os._exit(code)
    if fault.kind == "time":
        time.sleep(fault.at)
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if fault.kind == "full" and status != 0:
        raise SystemExit(f"a full disk ended a session without a sentence: see {root / 'stderr.txt'}")
    whole = status == 0 and any(line[:2] == ["ended", "finished"] for line in logged(root))
    return whole, time.perf_counter() - start


def logged(root: Path) -> list[list[Any]]:
    """What the processes logged."""
    path = root / "log.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def results(folder: Path) -> dict[str, bytes]:
    """Every file under derived/; in the record, photographs go by hashes, and its own hash and the room are dropped.

    A trial that had to be repeated is one more file, and those after it have the next numbers.
    """
    found = {str(p.relative_to(folder)): p.read_bytes() for p in (folder / "derived").rglob("*") if p.is_file()}
    for name in found:
        if name.endswith(RECORD):
            record = json.loads(found[name])
            for entry in (SEAL, "environment"):  # the room is another one while a trial is repeated
                record.pop(entry, None)
            text = json.dumps(record)
            for one in record["input"]:
                text = text.replace(one["path"], one["sha256"])
            found[name] = text.encode()
    return found


def complaints(root: Path, reference: Path) -> list[str]:
    """All that is not as it must be in a session that came to its end."""
    (folder,) = sessions_in(root / "sessions")
    (whole,) = sessions_in(reference / "sessions")
    found, state, log = [], read_session(folder).state, logged(root)
    verify(folder, state)
    kept = {shot.number: shot.sha256 for shot in state.shots}
    for _, number, digest in (line for line in log if line[0] == "kept"):
        if kept.get(number) != digest:
            found.append(f"shot {number} was kept and is lost")
    if results(folder) != results(whole):
        found.append("the result differs")
    exposed = sum(line[0] == "exposed" for line in log)
    said = {line[1] for line in log if line[0] == "heard"}
    noticed = [line for line in read_session(folder).contents.lines if line.event == "noticed"]
    again = [line for line in noticed if "it will be taken again" in line.data["say"]]
    if exposed > len(state.shots) + len(again):
        found.append(f"{exposed} exposures, {len(state.shots)} shots, and only {len(again)} said to be repeated")
    if any(line.data["say"] not in said for line in again):
        found.append("a repetition was noted and never reported")
    if sum(shot.purpose == "look" for shot in state.shots) > 1 and not any("begins again" in one for one in said):
        found.append("the look was repeated in silence")
    counting = [shot.sha256 for shot in state.counting()]
    if len(set(counting)) != SHOTS or len(counting) != SHOTS:
        found.append(f"{len(counting)} shots count, {len(set(counting))} of them different")
    return found


def chosen(rng: random.Random, duration_s: float, operations: int, size: int) -> Fault:
    """A fault at random."""
    kind = rng.choice(KINDS)
    at = {
        "time": rng.uniform(0, 1.1 * duration_s),
        "frame": rng.randint(1, SHOTS + 1),
        "limit": rng.choice((rng.randint(0, 30_000), rng.randint(0, size))),
    }.get(kind, rng.randint(1, operations))
    return Fault(kind, at, rng.randint(1, 30))


def main() -> int:
    """Kill, resume, compare; the exit code is 0 where nothing was lost and nothing differs."""
    given = options(__doc__, kills=500, seed=1)
    start, rng = time.perf_counter(), random.Random(given.seed)
    frames = photographs()
    warm = Path(tempfile.mkdtemp(prefix="kills-"))
    (warm / "frame.dng").write_bytes(frames["look"])
    READY.update(short_plan.estimate([read_frame(warm / "frame.dng")], {}, {}))  # and compiled, and loaded
    short_plan.estimate = estimate
    reference = warm / "reference"
    finished, duration_s = run(reference, frames, Fault())
    if not finished:
        print((reference / "stderr.txt").read_text(), logged(reference))
        return 1
    operations, loaded = logged(reference)[-1][2:]
    for name in loaded:  # once, and not in every process
        if name not in sys.modules:
            with suppress(ImportError):
                importlib.import_module(name)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"undisturbed: {duration_s:.2f} s, {operations} operations on the disk", flush=True)
    faults: Counter[str] = Counter()
    sessions, wrong, weathered = 0, 0, 0
    while sum(faults.values()) < given.kills:
        root = warm / f"{sessions:04d}"
        sessions += 1
        for _ in range(rng.randint(1, 4)):
            fault = chosen(rng, duration_s, operations, 1.2 * len(frames["look"]))
            whole, _ = run(root, frames, fault)
            if whole:
                weathered += fault.kind in ("full", "limit")
                break
            faults[fault.kind] += 1
        if not whole:
            whole, _ = run(root, frames, Fault())
        found = complaints(root, reference) if whole else ["it did not come to its end: see stderr.txt"]
        if found:
            wrong += 1
            print(f"{root}: {'; '.join(found)}", flush=True)
        else:
            shutil.rmtree(root)
    (folder,) = sessions_in(reference / "sessions")
    same = all(one.identical for one in recompute(folder))
    stated = ", ".join(f"{kind} {faults[kind]}" for kind in KINDS)
    print(
        f"{sum(faults.values())} interruptions ({stated}) in {sessions} sessions, {time.perf_counter() - start:.0f} s"
    )
    print(f"{weathered} more ran with a limit, or until the disk had room again, to their end")
    print(f"{wrong} sessions with something lost, repeated in silence, or different; recomputed: {same}")
    if not wrong:
        shutil.rmtree(warm)
    return 0 if not wrong and same else 1


if __name__ == "__main__":
    sys.exit(main())
