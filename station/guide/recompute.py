"""Recompute a session's results from its photographs and journal, and compare them byte by byte."""

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput, BadParameter
from station.common.durable_files import holds, sha256_of, temporary_folder
from station.guide.catalogue import plan_named
from station.guide.session_result import compute
from station.results.reader import changes, read_result
from station.results.result_files import RECORD, is_sealed
from station.sessions.journal import KERNELS, machine
from station.sessions.reader import read_session, verify
from station.sessions.state import DerivedResult, SessionState, replay


@dataclass(frozen=True)
class MovedNumber:
    """A number of a plane that has changed; `sigmas` is the change in units of the recorded standard uncertainty."""

    plane: str
    number: str
    then: float
    now: float
    sigmas: float


@dataclass(frozen=True)
class RecomputedResult:
    """Comparison of a result with its recomputation.

    result : folder of the result, relative to the session
    same, different, missing, added : names of files, by comparison with the hashes in the journal
    altered : files that are no longer as the journal has them
    keys : entries in which the records differ
    kernels : processor family whose linear algebra kernels reproduced the files, where those of this processor did not
    machine : differences of the computing environment: (what, then, now)
    version : version of this program that computed the result; "" where the journal does not state it
    numbers : count of numbers with an uncertainty in both results
    moved : those that differ, the largest change first
    verdicts : planes with a different verdict: (plane, then, now)
    """

    result: str
    same: tuple[str, ...]
    different: tuple[str, ...]
    missing: tuple[str, ...]
    added: tuple[str, ...]
    altered: tuple[str, ...] = ()
    keys: tuple[str, ...] = ()
    machine: tuple[tuple[str, str, str], ...] = ()
    kernels: str = ""
    version: str = ""
    numbers: int = 0
    moved: tuple[MovedNumber, ...] = ()
    verdicts: tuple[tuple[str, str, str], ...] = ()

    @property
    def identical(self) -> bool:
        """Whether every file is bitwise the same."""
        return not (self.different or self.missing or self.added or self.altered)


def recompute(folder: Path, numbers: tuple[int, ...] = ()) -> Iterator[RecomputedResult]:
    """Recompute every result of a session, or those of these numbers.

    Each is computed from the state of the journal at that time, into a temporary folder, and compared with the hashes
    in the journal, so that files altered afterwards are reported as well. A result of another processor family is
    recomputed with the kernels of that family where this processor supports them. Raises BadParameter if there is no
    such result; Damaged if a photograph has changed.
    """
    record = read_session(folder)
    results = record.state.results
    wanted = numbers or tuple(range(1, len(results) + 1))
    for number in wanted:
        if not 1 <= number <= len(results):
            raise BadParameter(f"{folder.name} has {len(results)} results; got number {number}", "choose one of them")
    verify(folder, record.state)
    lines = record.contents.lines
    drawn = [i for i, line in enumerate(lines) if line.event == "derived"]
    for number in wanted:
        comparison = _recomputed(folder, results[number - 1], replay(lines[: drawn[number - 1]]))
        then = kernels_of(results[number - 1].about.get("machine", {}))
        if not comparison.identical and then and then != kernels_of(machine()) and KERNELS not in os.environ:
            comparison = _with_kernels(folder, number, then) or comparison
        yield comparison


def kernels_of(computer: Mapping[str, Any]) -> str:
    """The processor family whose kernels OpenBLAS used; "" where it is not unique."""
    libraries = str(computer.get("blas", "")).split(", ")
    families = {words[2] for library in libraries if (words := library.split())[:1] == ["openblas"] and len(words) == 3}
    return families.pop() if len(families) == 1 else ""


def _with_kernels(folder: Path, number: int, kernels: str) -> RecomputedResult | None:
    """The comparison by a process with OpenBLAS kernels of that family; None unless the files are the same."""
    words = [sys.executable, "-m", "station", "session", "recompute", str(folder.absolute())]
    environment = {**os.environ, KERNELS: kernels}
    done = subprocess.run(
        [*words, "--result", str(number), "--json"], env=environment, capture_output=True, check=False
    )
    if done.returncode != 0:
        return None
    (entry,) = json.loads(done.stdout)["results"]
    del entry["identical"]
    return RecomputedResult(**{**{name: _tuples(value) for name, value in entry.items()}, "kernels": kernels})


def _tuples(value: Any) -> Any:
    return tuple(_tuples(part) for part in value) if isinstance(value, list) else value


def _recomputed(folder: Path, result: DerivedResult, state: SessionState) -> RecomputedResult:
    with temporary_folder() as raw:
        fresh = Path(raw, "result")
        compute(folder, state, plan_named(state.plan, folder), fresh, sealed=is_sealed(folder / result.folder))
        hashes = {path.relative_to(fresh).as_posix(): sha256_of(path) for path in fresh.rglob("*") if path.is_file()}
        keys = _differing(folder / result.folder / RECORD, fresh / RECORD)
        shared, moved, verdicts = _planes_compared(folder / result.folder, fresh)
    environment = result.about.get("machine", {})
    altered = [name for name, digest in result.files.items() if not holds(folder / result.folder / name, digest)]
    same = [name for name, digest in hashes.items() if result.files.get(name) == digest]
    before, now = _flat(environment), _flat(machine())
    return RecomputedResult(
        result.folder,
        tuple(sorted(name for name in same if name not in altered)),
        tuple(sorted(name for name in hashes if name in result.files and name not in same)),
        tuple(sorted(name for name in result.files if name not in hashes)),
        tuple(sorted(name for name in hashes if name not in result.files)),
        tuple(sorted(altered)),
        keys,
        tuple((k, str(before.get(k)), str(now.get(k))) for k in sorted(before) if before[k] != now.get(k)),
        version=str(environment.get("software", {}).get("version") or ""),
        numbers=shared,
        moved=moved,
        verdicts=verdicts,
    )


def _planes_compared(old: Path, new: Path) -> tuple[int, tuple[MovedNumber, ...], tuple[tuple[str, str, str], ...]]:
    """Count of shared numbers, the numbers that differ, and the planes with different verdicts."""
    try:
        before, now = read_result(old).by_name, read_result(new).by_name
    except BadInput:  # the hashes report what is wrong with the older result
        return 0, (), ()
    both = [(before[name], now[name]) for name in before if name in now]
    shared = [
        (one.name, change.name, change.one, change.other) for one, other in both for change in changes(one, other)
    ]
    moved = [  # both are of the same photographs, so that the change is relative to a single uncertainty
        MovedNumber(plane, name, then.value, now.value,
                    (now.value - then.value) / then.uncertainty if then.uncertainty > 0 else math.inf)
        for plane, name, then, now in shared if then.value != now.value
    ]  # fmt: skip
    moved.sort(key=lambda one: -abs(one.sigmas))
    verdicts = tuple((a.name, str(a.verdict), str(b.verdict)) for a, b in both if a.verdict is not b.verdict)
    return len(shared), tuple(moved), verdicts


def _differing(old: Path, new: Path) -> tuple[str, ...]:
    try:
        before, now = (_flat(json.loads(path.read_bytes())) for path in (old, new))
    except (OSError, ValueError, RecursionError):
        return ()
    return tuple(sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name)))


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    if isinstance(value, Mapping):
        return {k: v for key, part in value.items() for k, v in _flat(part, f"{name}.{key}" if name else key).items()}
    return {name: value}
