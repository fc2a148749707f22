"""Disturbs batches with signals at random moments, resumes them, and holds their rows against an undisturbed batch's.

    python -m tests.benchmarks.batch_signals [--batches 200] [--seed 1]

Each batch is `station batch` over a few small photographs, in a group of processes of its own: mostly a fork with the
program loaded, at times an interpreter that begins from nothing. At a random moment the parent, one of its children or
the whole group gets INT, TERM, KILL, HUP or STOP; INT comes twice, as from a person in a hurry. A parent that was asked
to end must be gone within 10 s, and the whole group with it: longer only where more processes want the machine than it
has cores, and as many times. A batch is disturbed one to three times, is then run to its end, and must give the same
rows.
"""

import importlib
import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

import numpy as np

from tests.benchmarks import ROOT, options
from tests.benchmarks.batch import children, is_worker

PHOTOGRAPHS, JOBS, ENDED_S, LONGEST_S = 6, 2, 10.0, 600.0
FROM_NOTHING = 0.2
"""Of the disturbed batches begin with the interpreter's start."""
SIGNALS = ("INT", "TERM", "KILL", "HUP", "STOP")
TARGETS = ("parent", "child", "group")
Row = tuple[str, str, str]


def write_photographs(folder: Path) -> None:
    """Small pictures of noise: each is refused, which is a row and a result like any other."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for n in range(PHOTOGRAPHS):
        levels = rng.integers(1000, 30_000, (150, 200)).astype(">u2")
        (folder / f"frame{n}.pgm").write_bytes(b"P5 200 150 65535\n" + levels.tobytes())


class Started:
    """A batch in a group of processes of its own; `from_nothing`, with the interpreter's start."""

    def __init__(self, folder: Path, out: Path, *, from_nothing: bool = False) -> None:
        words = ["batch", folder / "in", "--procedure", folder / "p.toml", "--out", out, "--jobs", str(JOBS)]
        self._code: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            os.setsid()
            os.chdir(folder)
            log = os.open(folder / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            os.dup2(log, 1)
            os.dup2(log, 2)
            _run(list(map(str, words)), from_nothing=from_nothing)

    def poll(self) -> int | None:
        """The exit code, less than 0 for a signal; None while it runs."""
        if self._code is None:
            process, status = os.waitpid(self.pid, os.WNOHANG)
            self._code = os.waitstatus_to_exitcode(status) if process else None
        return self._code

    def wait(self, within_s: float = LONGEST_S) -> int | None:
        """The exit code; None where it has not ended."""
        end = time.monotonic() + within_s
        while self.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        return self._code


def _run(words: list[str], *, from_nothing: bool) -> NoReturn:
    """The program in this process, which it ends."""
    if from_nothing:
        os.environ["PYTHONPATH"] = str(ROOT)
        os.execv(sys.executable, [sys.executable, "-m", "station", *words])
    from station.__main__ import main as station

    code = 70
    try:
        station(words, prog_name="station")
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def load() -> None:
    """What every batch would load."""
    for name in ("station.cli.batch", "station.batch.run", "station.batch.item",
                 "station.calibration.planes", "station.calibration.folder_photographs"):  # fmt: skip
        importlib.import_module(name)


def rows(out: Path) -> list[Row]:
    """File, verdict and hash of every photograph."""
    found = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    return [(Path(row["files"][0]).name, row["verdict"], row["sha256"][0]) for row in found]


def disturb(batch: Started, target: str, name: str, rng: random.Random) -> None:
    """Send the signal, to the parent where no worker has begun; INT once more after a moment."""
    number = signal.Signals[f"SIG{name}"]
    below = [one for one in children(batch.pid) if is_worker(one)]
    for again in range(2 if name == "INT" else 1):
        if again:
            time.sleep(0.3)
        try:
            if target == "group":
                os.killpg(batch.pid, number)
            else:
                os.kill(rng.choice(below) if target == "child" and below else batch.pid, number)
        except ProcessLookupError:
            return


def is_left(group: int) -> bool:
    """Whether a process of the group is there."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def end_of(batch: Started, within_s: float) -> float | None:
    """Seconds until the whole group is gone; None where it is not. A machine that is shared gives it longer."""
    begin = time.monotonic()
    while time.monotonic() - begin < within_s * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)):
        if batch.poll() is not None and not is_left(batch.pid):
            return time.monotonic() - begin
        time.sleep(0.05)
    return None


def disturbed(folder: Path, out: Path, length_s: float, rng: random.Random) -> tuple[str, float]:
    """What was done to one run, "" first where it ended as it must, and how long its end took."""
    target, name = rng.choice(TARGETS), rng.choice(SIGNALS)
    batch = Started(folder, out, from_nothing=rng.random() < FROM_NOTHING)
    time.sleep(rng.uniform(0.1, length_s))
    disturb(batch, target, name, rng)
    if name == "STOP":  # whoever stops a parent lets it go on, also where it was stopped in place of a worker
        time.sleep(3.0)
        with suppress(ProcessLookupError):
            (os.killpg if target == "group" else os.kill)(batch.pid, signal.SIGCONT)
    asked = name != "STOP" and target != "child"
    took = end_of(batch, ENDED_S if asked else LONGEST_S)
    if took is None:
        with suppress(ProcessLookupError):
            os.killpg(batch.pid, signal.SIGKILL)
    batch.wait()
    return ("" if took is not None else f"{name} to {target}: not ended"), (took or 0.0) if asked else 0.0


def once(folder: Path, mark: str, length_s: float, expected: list[Row]) -> tuple[int, list[str], float]:
    """How often one batch was disturbed, what went wrong, and how long the longest end took."""
    rng, out = random.Random(mark), folder / "out" / mark.replace("/", "-")
    found = [disturbed(folder, out, length_s, rng) for _ in range(rng.randint(1, 3))]
    wrong = [f"{mark}: {problem}" for problem, _ in found if problem]
    code = Started(folder, out).wait()
    if code not in (0, 1) or rows(out) != expected:
        wrong.append(f"{mark}: other rows after resuming, exit code {code}")
    return len(found), wrong, max(took for _, took in found)


def main() -> None:
    """Disturb, resume, compare."""
    given = options(__doc__, batches=200, seed=1)
    load()
    with tempfile.TemporaryDirectory(prefix="signals-") as raw:
        folder = Path(raw)
        write_photographs(folder / "in")
        (folder / "p.toml").write_text("")
        wrong, done, longest, begin = [], 0, 0.0, time.monotonic()
        if Started(folder, folder / "out" / "plain").wait() not in (0, 1):
            raise SystemExit((folder / "log").read_text())
        length_s, expected, n = time.monotonic() - begin, rows(folder / "out" / "plain"), 0
        while done < given.batches:
            many, problems, took = once(folder, f"{given.seed}/{n}", length_s, expected)
            n, longest, wrong = n + 1, max(longest, took), wrong + problems
            done += many
            print(f"{done}: {problems or 'same rows'} ({took:.1f} s, load {os.getloadavg()[0]:.1f})", flush=True)
    print(f"{done} batches disturbed, longest end {longest:.1f} s, {len(wrong)} wrong")
    print("\n".join(wrong))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
