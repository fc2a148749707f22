"""Disturbs batches with signals at random moments, resumes them, and holds their rows against an undisturbed batch's.

    python tests/benchmarks/batch_signals.py [--batches 200] [--seed 1] [--kinds pool,local]

Each batch is `station batch` over a few small photographs, in a group of processes of its own. At a random moment the
parent, one of its children or the whole group gets INT, TERM, KILL, HUP or STOP; INT comes twice, as from a person in a
hurry. A parent that was asked to end must be gone within 10 s, and the whole group with it; whatever was disturbed is
then run again, to its end, and must give the same rows.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PHOTOGRAPHS, ENDED_S, LONGEST_S = 8, 10.0, 600.0
SIGNALS = ("INT", "TERM", "KILL", "HUP", "STOP")
TARGETS = ("parent", "child", "group")
Row = tuple[str, str, str]


def write_photographs(folder: Path) -> None:
    """Small pictures of noise: each is refused, which is a row and a result like any other."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for n in range(PHOTOGRAPHS):
        levels = rng.integers(1000, 30_000, (300, 400)).astype(">u2")
        (folder / f"frame{n}.pgm").write_bytes(b"P5 400 300 65535\n" + levels.tobytes())


def start(folder: Path, out: Path, kind: str) -> subprocess.Popen[bytes]:
    """A batch in a group of its own."""
    words = [sys.executable, "-m", "station", "batch", folder / "in", "--procedure", folder / "p.toml", "--out", out]
    words += ["--jobs", "2"] + (["--cluster", "local"] if kind == "local" else [])
    log = (folder / "log").open("ab")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(words, env=environment, cwd=folder, stdout=log, stderr=log, start_new_session=True)


def rows(out: Path) -> list[Row]:
    """File, verdict and hash of every photograph."""
    found = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    return [(Path(row["files"][0]).name, row["verdict"], row["sha256"][0]) for row in found]


def children(process: int) -> list[int]:
    """All processes below one."""
    try:
        direct = [int(one) for one in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []
    return direct + [below for one in direct for below in children(one)]


def disturb(batch: subprocess.Popen[bytes], target: str, name: str, rng: random.Random) -> None:
    """Send the signal; INT once more after a moment."""
    number = signal.Signals[f"SIG{name}"]
    below = children(batch.pid)
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


def end_of(batch: subprocess.Popen[bytes], within_s: float) -> float | None:
    """Seconds until the whole group is gone; None where it is not."""
    begin = time.monotonic()
    while time.monotonic() - begin < within_s:
        if batch.poll() is not None and not is_left(batch.pid):
            return time.monotonic() - begin
        time.sleep(0.05)
    return None


def once(
    folder: Path, mark: str, kind: str, length_s: float, expected: list[tuple[str, str, str]]
) -> tuple[str, float]:
    """What went wrong with one disturbed batch, "" where nothing did; and how long its end took."""
    rng = random.Random(mark)
    out, target, name = folder / "out" / mark.replace("/", "-"), rng.choice(TARGETS), rng.choice(SIGNALS)
    batch = start(folder, out, kind)
    time.sleep(rng.uniform(0.3, length_s))
    disturb(batch, target, name, rng)
    if name == "STOP" and target != "child":  # whoever stops a parent lets it go on
        time.sleep(3.0)
        os.killpg(batch.pid, signal.SIGCONT)
    asked = name != "STOP" and target != "child"
    took = end_of(batch, ENDED_S if asked else LONGEST_S)
    try:
        if took is None:
            return f"{mark}: {name} to {target}: not ended", 0.0
    finally:
        if is_left(batch.pid):
            os.killpg(batch.pid, signal.SIGKILL)
        batch.wait()
    again = start(folder, out, kind)
    if again.wait(LONGEST_S) not in (0, 1) or rows(out) != expected:
        return f"{mark}: {name} to {target}: other rows after resuming", took
    return "", took if asked else 0.0


def main() -> None:
    """Disturb, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default="pool,local")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="signals-") as raw:
        folder = Path(raw)
        write_photographs(folder / "in")
        (folder / "p.toml").write_text("")
        wrong, done, longest = [], Counter[str](), 0.0
        for kind in given.kinds.split(","):
            begin = time.monotonic()
            if start(folder, folder / "out" / kind, kind).wait(LONGEST_S) not in (0, 1):
                raise SystemExit((folder / "log").read_text())
            length_s, expected = time.monotonic() - begin, rows(folder / "out" / kind)
            for n in range(given.batches // len(given.kinds.split(","))):
                problem, took = once(folder, f"{given.seed}/{kind}/{n}", kind, length_s, expected)
                done[kind] += 1
                longest = max(longest, took)
                wrong += [problem] if problem else []
                print(f"{kind} {n}: {problem or 'same rows'} ({took:.1f} s)", flush=True)
    print(f"{dict(done)} batches, longest end {longest:.1f} s, {len(wrong)} wrong")
    print("\n".join(wrong))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
