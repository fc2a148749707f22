"""Where the milliseconds of a late stop went: the program, its wait for a processor, or the bench that read it.

    python stops_lateness.py FILE

As a program: the control, which does nothing but sleep and notes in FILE when it was woken late. Two of them run beside
the tries, so that a stop which came late with them was the scheduler's.
"""

import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

NAP_S = 0.001
NOTED_S = 0.001


class Control:
    """Two sleepers, each bound to a processor of its own; how late they were woken in a span of time."""

    def __init__(self, folder: Path) -> None:
        cores = sorted(os.sched_getaffinity(0))[:2]
        self._files = [folder / f"control{core}" for core in cores]
        words = [[sys.executable, __file__, str(file)] for file in self._files]
        self._sleepers = [subprocess.Popen(one) for one in words]
        for sleeper, core in zip(self._sleepers, cores, strict=True):
            os.sched_setaffinity(sleeper.pid, {core})

    def late_ms(self, begin_s: float, end_s: float) -> list[float]:
        """(sleepers) greatest lateness of each between these times of the monotonic clock, milliseconds."""
        return [max((late for due, late in _notes(file) if begin_s - late / 1000 < due < end_s), default=0.0)
                for file in self._files]  # fmt: skip

    def close(self) -> None:
        for sleeper in self._sleepers:
            sleeper.kill()
            sleeper.wait()


def _notes(file: Path) -> list[tuple[float, float]]:
    lines = file.read_text().splitlines() if file.exists() else []
    return [(float(due), float(late)) for due, late in (line.split() for line in lines)]


def keep_its_priority(pid: int) -> None:
    """Give a program in a session of its own the niceness of this one, where Linux schedules sessions as groups.

    Under `nice` the session of this one may count as usual; the program's is then not to have less. A process whose
    session is in no group (as the first session of a machine) reads an empty file: there is nothing to give then.
    """
    with suppress(OSError, IndexError):
        own = int(Path("/proc/self/autogroup").read_text().split()[-1])
        Path(f"/proc/{pid}/autogroup").write_text(str(min(own, os.nice(0))))


def threads_ms(pid: int) -> dict[str, tuple[float, float]]:
    """What each thread of a process has run so far, and waited for a processor, milliseconds."""
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            ran, waited, _ = map(int, (task / "schedstat").read_text().split())
            found[task.name] = (ran / 1e6, waited / 1e6)
        except (OSError, ValueError):  # the thread has ended, or this kernel does not count
            continue
    return found


def spent(before: dict[str, tuple[float, float]], after: dict[str, tuple[float, float]]) -> str:
    """What all threads ran between two counts, and the longest that one waited; those that ended are not seen."""
    spans = [
        (ran - before.get(t, (0.0, 0.0))[0], late - before.get(t, (0.0, 0.0))[1]) for t, (ran, late) in after.items()
    ]
    return f"ran {sum(ran for ran, _ in spans):.1f}, waited {max((late for _, late in spans), default=0.0):.1f}"


def halves(sent_s: float, read_s: dict[str, float], halted: dict[str, Any]) -> str:
    """Signal to its handling, handling to the wire and wire to the reader, by the program's own journal."""
    parts = [f"handled after {1000 * (halted['asked_s'] - sent_s):.1f} ms"]
    for name, at_s in read_s.items():
        if (wire_s := halted["on_the_wire_s"].get(name)) is not None:
            parts.append(f"{name}: wire +{1000 * (wire_s - halted['asked_s']):.1f}, read +{1000 * (at_s - wire_s):.1f}")
    return ", ".join(parts)


def main() -> None:
    """Sleep, and note when it was longer than asked for."""
    with Path(sys.argv[1]).open("w", buffering=1) as file:
        while True:
            due_s = time.monotonic() + NAP_S
            time.sleep(NAP_S)
            if (late_s := time.monotonic() - due_s) > NOTED_S:
                file.write(f"{due_s} {1000 * late_s:.2f}\n")


if __name__ == "__main__":
    main()
