"""Milliseconds from a signal or a key to the stop bytes at the other ends of the wires.

    python -m tests.benchmarks.stops [--tries 200] [--only WAY[,WAY]] [--where WHERE[,WHERE]]

The simulated bench stands in this process behind pseudo-terminals. The program under test (`stops_program.py`: the
plain guide and the application, with their own signal handling, run, drivers and session) is another process that knows
them from a station.toml. A try: the program homes, moves, or waits for a photograph; at a random moment it gets a
signal, a key or a fault; the time at which the stop of each controller was read from its pseudo-terminal's master
counts. Then nothing may move, no order may come, and the journal must have the stop. A late try reports where its
time went (`stops_lateness.py`): "handled" is when the program knew, "wire" when its bytes were written, "read" when the
bench had them.

A program that was suspended sends nothing: its stop was on the wires before.

- `clogged`: the port of the head takes no bytes any more while the rail moves. Its stop must be there within the bound.
- `gone`: the terminal of the head is closed while the rail moves.
"""

import fcntl
import json
import os
import platform
import pty
import random
import select
import signal
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simulators.bench.bench import Setup, SimulatedBench
from simulators.devices.ports import PtyPort
from station.bench.opening import simulated_tables
from station.common.toml_text import toml_text
from tests.benchmarks import options
from tests.benchmarks.stops_lateness import Control, halves, keep_its_priority, spent, threads_ms

BOUND_MS = 20.0
SPEED = 20.0
"""How much faster than real the simulated bench homes and moves: a try ends before it has arrived."""
PATIENCE_S = 180.0
"""How long a program may take to begin, on a machine that has much else to do."""
BEGINNINGS = 3
"""Runs that are tried until one begins its move."""
SIGNALS = {name: getattr(signal, f"SIG{name}") for name in ("INT", "TERM", "HUP", "QUIT")}
KEYS = {"F12": b"\x1b[24~", "Ctrl-X": b"\x18", "Ctrl-C": b"\x03"}
PLAIN = (*SIGNALS, "exception")
APP = (*KEYS, "app INT", "app TERM", "app TSTP", "app exception")
WAYS = (*PLAIN, *APP)
PLACES = ("homing", "move", "exposure", "clogged", "gone")
MARKS = {"stage": b"\x18", "head": b"estop", "shutter": b"ABORT"}
ORDERS = (b"$J", b"$H", b"home", b"move", b"SHOT")
PROGRAM = Path(__file__).with_name("stops_program.py")


class WatchedPort(PtyPort):
    """A pseudo-terminal that keeps what was read at its master, with the time; `frozen` reads nothing."""

    def __init__(self, cable: object) -> None:
        self.heard: list[tuple[float, bytes]] = []
        self.frozen = threading.Event()
        super().__init__(cable)  # type: ignore[arg-type]

    def _read(self) -> None:
        if self.frozen.is_set():
            time.sleep(0.001)
        else:
            self.read_all()

    def read_all(self) -> None:
        """Take all that is there to the device."""
        with suppress(OSError):
            while data := os.read(self._master, 65536):
                self.heard.append((time.monotonic(), data))
                self._cable.write(data)

    def come_s(self, mark: bytes, since_s: float) -> float | None:
        """When these bytes were there first."""
        before = b""
        for at_s, data in list(self.heard):
            if at_s >= since_s:
                before += data
                if mark in before:
                    return at_s
        return None

    def orders_after(self, at_s: float) -> bytes:
        """What ordered a motion or a shot after that time."""
        later = b"".join(data for when_s, data in list(self.heard) if when_s > at_s)
        return later if any(order in later for order in ORDERS) else b""


@dataclass
class Count:
    """What came of the tries of one way in one place."""

    ms: list[float] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)

    @property
    def missing(self) -> list[str]:
        """What was wrong with stops apart from their lateness."""
        return [one for one in self.wrong if "within the bound" not in one]


def _in_its_terminal() -> None:
    """The new process' terminal is its own, and it minds when that hangs up, also where this program does not."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    for number in SIGNALS.values():
        signal.signal(number, signal.SIG_DFL)


class Program:
    """The program under test, in a terminal of its own."""

    def __init__(self, where: str, front: str, folder: Path) -> None:
        control, self._control = os.pipe()
        self._status, status = os.pipe()
        self._terminal, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        words = [sys.executable, PROGRAM, where, front, folder / "station.toml", folder / "sessions", control, status]
        root = PROGRAM.parents[2]
        self.process = subprocess.Popen(
            list(map(str, words)), stdin=slave, stdout=slave, stderr=slave, pass_fds=(control, status), cwd=root,
            start_new_session=True, env={**os.environ, "PYTHONPATH": str(root), "TERM": "xterm-256color"},
            preexec_fn=_in_its_terminal,
        )  # fmt: skip
        keep_its_priority(self.process.pid)
        for descriptor in (control, status, slave):
            os.close(descriptor)
        self.said = b""
        threading.Thread(target=self._drain, daemon=True).start()

    def _drain(self) -> None:
        with suppress(OSError):
            while data := os.read(self._terminal, 65536):
                self.said = (self.said + data)[-4000:]

    def go(self, word: bytes = b"g") -> None:
        os.write(self._control, word)

    def wait_for(self, word: bytes) -> bool:
        """Wait for a byte of its status; False if the run has ended before. Raises TimeoutError."""
        while True:
            if not select.select([self._status], [], [], PATIENCE_S)[0]:
                raise TimeoutError(f"waited in vain for {word!r}: {self.said!r}")
            if (heard := os.read(self._status, 1)) in (word, b"e", b""):
                assert heard, self.said
                return heard == word

    def end_by(self, way: str) -> float:
        """Send the signal or press the key; when."""
        name = way.removeprefix("app ")
        now_s = time.monotonic()
        if name in KEYS:
            os.write(self._terminal, KEYS[name])
        else:
            self.process.send_signal(getattr(signal, f"SIG{name}", signal.SIGUSR1))
        return now_s

    def go_on_from_suspension(self) -> bool:
        """Continue it; whether it was suspended."""
        end_s = time.monotonic() + PATIENCE_S
        while not (suspended := self._state() == "T") and time.monotonic() < end_s:
            time.sleep(0.001)
        self.process.send_signal(signal.SIGCONT)
        return suspended

    def _state(self) -> str:
        return Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[0]

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        for descriptor in (self._control, self._status, self._terminal):
            os.close(descriptor)


class Tries:
    """One bench and one program, for the tries of one way in one place."""

    def __init__(self, way: str, place: str, folder: Path, chance: random.Random) -> None:
        self.way, self.place, self.folder, self.chance = way, place, folder, chance
        (folder / "incoming").mkdir(exist_ok=True)
        self.bench = SimulatedBench(folder / "incoming", Setup(develop=lambda opening: b"", speed=SPEED))
        self.ports = {name: WatchedPort(self.bench.cables[name]) for name in MARKS}
        self.front = "app" if way in APP else "plain"
        where = "move" if place in ("clogged", "gone") else place
        self.program: Program | None = None
        self.control = Control(folder)
        self._where = where

    def _write_config(self) -> None:
        tables = simulated_tables(lambda name: self.ports[name].address if name in self.ports else "", self.folder)
        used = {name: tables[name] for name in (*MARKS, "camera")}
        used["camera"]["folder"] = str(self.folder / "incoming")
        (self.folder / "station.toml").write_text(toml_text({"devices": used}))

    def one(self, count: Count) -> None:
        """A try."""
        self._write_config()
        for port in self.ports.values():
            port.heard.clear()
        if self.program is None:
            self.program = Program(self._where, self.front, self.folder)
        self._begin(self.program)
        time.sleep(self.chance.uniform(0.005, 0.1))
        wrong, pids = len(count.wrong), (self.program.process.pid, os.getpid())
        before = [threads_ms(pid) for pid in pids]
        sent_s = self.program.end_by(self.way)
        time.sleep(BOUND_MS / 1000)
        if self.place == "clogged":  # what is there now has come in time
            self.ports["head"].read_all()
            if self.ports["head"].come_s(MARKS["head"], sent_s) is None:
                count.wrong.append("the clogged head had no stop within the bound")
            self.ports["head"].frozen.clear()
        stops = self._stops(sent_s)
        times = [spent(one, threads_ms(pid)) for one, pid in zip(before, pids, strict=True)]
        self._look(count, sent_s, stops)
        if self.way == "app TSTP" and not self.program.go_on_from_suspension():
            count.wrong.append("it was not suspended")
        if self.way in ("app INT", "app TERM"):
            self.program.close()  # it leaves for good
            self.program = None
        else:
            self.program.wait_for(b"e")
        halted = self._look_at_journal(count)
        if count.ms[-1] > BOUND_MS or len(count.wrong) > wrong:
            controls = self.control.late_ms(sent_s, max(stops.values(), default=sent_s + 1))
            count.late.append(
                f"{count.ms[-1]:.1f} ms: {halves(sent_s, stops, halted) if halted else 'no journal'}; program"
                f" {times[0]}, bench {times[1]}, control late {controls[0]:.1f} {controls[-1]:.1f}"
            )
        if self.place == "gone":
            self.ports["head"] = WatchedPort(self.bench.cables["head"])

    def _begin(self, program: Program) -> None:
        """Begin a run; again where it ends before its move, as a starved machine misses the homing's deadlines."""
        for _ in range(BEGINNINGS):
            program.go()
            if self._where != "move" or program.wait_for(b"m"):
                return self._until_there(program)
        raise TimeoutError(f"{BEGINNINGS} runs ended before they moved: {program.said!r}")

    def _until_there(self, program: Program) -> None:
        if self._where == "move":
            if self.place == "clogged":
                self.ports["head"].frozen.set()
            if self.place == "gone":
                self.ports["head"].close()
            program.go(b"c" if self.place == "clogged" else b"g")
        stage = self.bench.devices["stage"]
        there: dict[str, Callable[[], object]] = {
            "homing": lambda: stage.state == "Home",  # type: ignore[attr-defined]
            "move": lambda: stage.state == "Jog",  # type: ignore[attr-defined]
            "exposure": lambda: self.ports["shutter"].come_s(b"SHOT", 0.0),
        }
        end_s = time.monotonic() + PATIENCE_S
        while not there[self._where]():
            if time.monotonic() > end_s:
                raise TimeoutError(f"no {self._where}: {program.said!r}")
            time.sleep(0.001)

    def _stops(self, sent_s: float) -> dict[str, float]:
        """When the stop of each controller came; waits for those that are late."""
        names = [name for name in MARKS if not (self.place == "gone" and name == "head")]
        found: dict[str, float] = {}
        end_s = time.monotonic() + PATIENCE_S
        while len(found) < len(names) and time.monotonic() < end_s:
            come = {name: self.ports[name].come_s(MARKS[name], sent_s) for name in names}
            found = {name: at_s for name, at_s in come.items() if at_s is not None}
            time.sleep(0.001)
        return found

    def _look(self, count: Count, sent_s: float, stops: dict[str, float]) -> None:
        """Were all stops there in time, and did nothing move and nobody order anything after them?"""
        late = {name: 1000 * (at_s - sent_s) for name, at_s in stops.items()}
        if self.place == "clogged":  # nobody read there before the bound was over
            late.pop("head", None)
        missing = set(MARKS) - set(stops) - ({"head"} if self.place == "gone" else set())
        if missing:
            count.wrong.append(f"no stop came to {', '.join(sorted(missing))}")
        count.ms.append(max(late.values(), default=float("inf")))
        time.sleep(0.05)
        now_s = self.bench.clock.now_s()
        moving = [name for name, axis in self.bench.world.axes.items() if axis.moves(now_s)]
        if moving and not (self.place == "gone" and set(moving) <= {"pan_deg", "tilt_deg"}):
            count.wrong.append(f"{', '.join(moving)} moved on")
        for name, at_s in stops.items():
            if after := self.ports[name].orders_after(at_s):
                count.wrong.append(f"{name} got {after[:60]!r} after its stop")

    def _look_at_journal(self, count: Count) -> dict[str, Any] | None:
        """The newest session shows when each wire had its stop; one whose program was killed by us has no last line."""
        if self.program is None:
            return None
        newest = max((self.folder / "sessions").glob("*/journal.jsonl"), key=lambda path: path.stat().st_mtime_ns)
        entries = [json.loads(line) for line in newest.read_text().splitlines()]
        halted = [entry for entry in entries if entry["event"] == "halted"]
        if not halted or halted[0]["on_the_wire_s"].get("stage") is None:
            count.wrong.append(f"the journal has no stop of the stage: {[entry['event'] for entry in entries][-4:]}")
        return halted[0] if halted else None

    def close(self) -> None:
        self.control.close()
        if self.program is not None:
            self.program.close()
        for port in self.ports.values():
            with suppress(OSError):
                port.close()
        self.bench.close()


@contextmanager
def tries(way: str, place: str, chance: random.Random) -> Iterator[Tries]:
    """A bench and a program for these tries, given back afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        found = Tries(way, place, Path(folder), chance)
        try:
            yield found
        finally:
            found.close()


def measured(way: str, place: str, number: int, chance: random.Random) -> Count:
    """So many tries."""
    count = Count()
    with tries(way, place, chance) as one:
        for _ in range(number):
            one.one(count)
    return count


def main() -> int:
    """Print environment, figures and bars; 1 where one was missed."""
    chosen = options(__doc__, tries=200, only=",".join(WAYS), where=",".join(PLACES), seed=1, shared_machine=False)
    machine = f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} cores"
    print(f"{machine}, load {os.getloadavg()[0]:.1f}")
    chance, missed = random.Random(chosen.seed), 0
    for way in chosen.only.split(","):
        for place in chosen.where.split(","):
            if (way, place) == ("Ctrl-C", "exposure"):  # it ends the run after this exposure
                continue
            count = measured(way, place, chosen.tries, chance)
            times = sorted(count.ms)
            over = sum(one > BOUND_MS for one in times)
            missed += len(count.missing) if chosen.shared_machine else over + len(count.wrong)
            wrong = "; ".join(f"{n} x {stated}" for stated, n in sorted(Counter(count.wrong).items()))
            print(
                f"{way:13} {place:9} {len(times):4} tries: median {times[len(times) // 2]:6.2f} ms, longest "
                f"{times[-1]:7.2f} ms, {over} over {BOUND_MS:.0f} ms {wrong}",
                flush=True,
            )
            for line in count.late:
                print(f"    {line}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
