"""How quick the application is: from its start to the first screen, from a key to its paint while an estimate runs.

python tests/benchmarks/app_latency.py [folder of shared data]

Everything is measured from outside, through a pseudo-terminal of 80 x 24. The estimate is the one of the published
photograph, over and over, in the thread of a run. The event loop's stalls are measured inside, by a task that wants to
wake up every 2 ms. On a machine that other programs use too, times by the clock are theirs as well; beside a stall
stands the processor time of the loop's own thread in it, which is what the application itself did.
"""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import platform
import pty
import select
import struct
import subprocess
import sys
import tempfile
import termios
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "station" / "app")]

STARTS, KEYS = 10, 60
START_BOUND_S, KEY_BOUND_S, STALL_BOUND_S = 1.0, 0.1, 0.05
EVERY_S = 0.002
SETTLE_S = 3.0
F2, F3, F12 = b"\x1bOQ", b"\x1bOR", b"\x1b[24~"


class Terminal:
    """A program before a pseudo-terminal."""

    def __init__(self, words: list[str]) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        environ = {**os.environ, "TERM": "xterm-256color", "PYTHONPATH": str(ROOT)}
        self.began = time.perf_counter()
        self.process = subprocess.Popen(words, stdin=slave, stdout=slave, stderr=slave, env=environ, close_fds=True)
        os.close(slave)
        self.seen = b""

    def wait_for(self, text: str, timeout_s: float = 60.0) -> float:
        """The moment at which the text has been painted since the last call."""
        wanted, end = text.encode(), time.perf_counter() + timeout_s
        while wanted not in self.seen:
            if time.perf_counter() > end or not select.select([self.master], [], [], 1.0)[0]:
                if time.perf_counter() > end:
                    raise TimeoutError(f"{text!r} was not painted")
                continue
            self.seen += os.read(self.master, 65536)
        moment = time.perf_counter()
        self.drain()
        return moment

    def drain(self, quiet_s: float = 0.05) -> None:
        """Read on until nothing has come for a while; forget it."""
        while select.select([self.master], [], [], quiet_s)[0]:
            if not os.read(self.master, 65536):
                break
        self.seen = b""

    def press(self, key: bytes, text: str) -> float:
        """Seconds from the key to the text."""
        self.seen = b""
        start = time.perf_counter()
        os.write(self.master, key)
        return self.wait_for(text) - start

    def end(self) -> None:
        """The measurement is done."""
        self.process.kill()
        self.process.wait()
        os.close(self.master)


def starts() -> None:
    """From the start of the process to the first screen."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(STARTS):
            terminal = Terminal([sys.executable, "-m", "station", "--simulate", "--sessions", folder])
            times.append(terminal.wait_for("press Enter to go from line to line") - terminal.began)
            terminal.end()
    report("start to first screen", times, START_BOUND_S)


def keys(photographs: Path, busy: bool) -> None:
    """From a key to the screen it leads to, while an estimate runs or nothing does."""
    what = "while an estimate runs" if busy else "at rest"
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "stalls.json"
        words = [sys.executable, __file__, "--child", str(photographs), str(told), "busy" if busy else "rest"]
        terminal = Terminal(words)
        terminal.wait_for("press Enter to go")
        time.sleep(1.0)
        for _ in range(3):
            os.write(terminal.master, b"\r")
            time.sleep(0.2)
        terminal.wait_for("estimat" if busy else "resting")
        time.sleep(SETTLE_S)
        terminal.drain()
        terminal.press(F3, "Manual moves")
        terminal.press(F2, "Nothing to do now")
        times = []
        for _ in range(KEYS // 2):
            times += [terminal.press(F3, "Manual moves"), terminal.press(F2, "Nothing to do now")]
        os.write(terminal.master, F12)
        while not told.exists():
            terminal.drain()
        terminal.end()
        report(f"key to paint, {what}", times, KEY_BOUND_S)
        stalls = json.loads(told.read_text())
        report(f"event loop stalls, {what}", [late for late, _ in stalls], STALL_BOUND_S)
        report("  of them the loop's own work", [min(late, busy_s) for late, busy_s in stalls], STALL_BOUND_S)


def report(what: str, times: list[float], bound_s: float) -> None:
    """Best, median and worst in milliseconds."""
    ordered = sorted(times)
    shares = {"best": 0.0, "median": 0.5, "99 %": 0.99, "worst": 1.0}
    told = {name: ordered[min(int(share * len(ordered)), len(ordered) - 1)] for name, share in shares.items()}
    words = "  ".join(f"{name} {1e3 * value:6.1f}" for name, value in told.items())
    print(f"{what:42s} {words} ms of {len(times):5d}; median {told['median'] / bound_s:.2f} of the bound")


# --- the program that is measured --------------------------------------------------------------------------------


def child(photographs: Path, told: Path, busy: bool) -> None:
    """The application with a run that estimates without end."""
    from fakes import PLAN, FakeLab, FakeRun

    from station.app.app import StationApp, share_the_lock
    from station.guide.frontend import ProgressEvent, RunEnded, StepBegan

    def script(run: FakeRun) -> RunEnded:
        from procedures.pattern import Chart
        from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
        from procedures.raw import read_frame

        plane = read_frame(photographs / "img_example.pgm").planes["Y"]
        chart = Chart.from_image(read_frame(photographs / "pattern_noise.pgm").planes["Y"].samples)
        estimate_psf(plane, chart, PatternParameters())
        run.operator.notify(StepBegan(PLAN.step("shots")))
        n = 0
        while not run.asked.is_set() and not run.halted.is_set():
            n += 1
            run.operator.notify(ProgressEvent("estimating" if busy else "resting", n % 10, 10))
            if busy:
                estimate_psf(plane, chart, PatternParameters())
            else:
                time.sleep(0.5)
        return RunEnded("stopped")

    class Watched(StationApp):
        """Notes by how much a task of its loop wakes up late."""

        def on_mount(self) -> None:
            self._late: list[tuple[float, float]] = []
            self._task = asyncio.get_running_loop().create_task(self._watch())
            super().on_mount()

        async def _watch(self) -> None:
            while self.running("run") is None:
                await asyncio.sleep(0.05)
            await asyncio.sleep(SETTLE_S)
            while True:
                start, busy_s = time.perf_counter(), time.thread_time()
                await asyncio.sleep(EVERY_S)
                late = time.perf_counter() - start - EVERY_S
                self._late.append((late, time.thread_time() - busy_s))

        def stop_everything(self) -> None:
            told.write_text(json.dumps(self._late))  # the key that ends the measurement

    share_the_lock()
    Watched(FakeLab(told.parent, script)).run()


def main() -> None:
    """Print environment and times."""
    if "--child" in sys.argv:
        photographs, told, how = sys.argv[2:]
        child(Path(photographs), Path(told), how == "busy")
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT.parent / "shared" / "data")
    machine = f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"Python {platform.python_version()}, {machine}")
    starts()
    for busy in (False, True):
        keys(folder / "pattern_photo", busy)


if __name__ == "__main__":
    main()
