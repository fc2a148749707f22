"""The four planes of a 24-megapixel RAW file with one chart: reading alone; the whole command, s and k chosen, and its
peak memory."""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from procedures.pattern import Chart
from procedures.raw import read_frame
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

RUNS = 3
BOUND_S, BOUND_GIB = 2.5, 1.0
COMMAND = [sys.executable, "-m", "station", "psf", "pattern"]


def photograph(path: Path) -> None:
    """A simulated 14-bit RGGB photograph of 6000 x 4000 pixels; the noise region is 100 pixels wide in each plane."""
    camera = SimulatedCamera(sensor=Sensor(rows=4000, columns=6000))
    scene = Scene((camera.place(Chart.from_seed(), pixels=100, at=(0.45, 0.55), roll_deg=7),))
    camera.photograph(scene, np.random.default_rng(24), path)


def best_of(work: Callable[[], object]) -> float:
    """Shortest wall time of some runs, seconds."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def best_of_command(words: list[str]) -> tuple[float, float]:
    """Shortest wall time and least processor time of some runs of a command, seconds."""
    processor = []

    def run() -> None:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True, stderr=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)

    return best_of(run), min(processor)


def peak_gib(words: list[str]) -> float:
    """Greatest resident memory of a command, GiB (Linux).

    Asked of a small process between: a child's figure starts at the size of the process it is forked from.
    """
    between = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stderr=subprocess.DEVNULL);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", between, *words], check=True, capture_output=True, text=True)
    return int(done.stdout) / 2**20


def main() -> None:
    """Print environment, times and memory."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, best of {RUNS}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.dng"
        photograph(path)
        copying = best_of(path.read_bytes)
        reading = best_of(lambda: read_frame(path))
        words = [*COMMAND, str(path), "--plane", "all", "--out", str(Path(folder) / "out")]
        paged = [*words, "--report"]
        whole, processor = best_of_command(words)
        with_page, _ = best_of_command(paged)
        print(f"{path.stat().st_size / 1e6:.0f} MB from disk cache  {copying:6.3f} s")
        print(f"read_frame, four planes  {reading:6.3f} s   {reading / copying:5.1f} x the bytes alone")
        print(f"the whole command        {whole:6.3f} s   {whole / BOUND_S:5.2f} x the bound of {BOUND_S} s")
        print(f"its processor time       {processor:6.3f} s")
        print(f"with its report          {with_page:6.3f} s")
        print(f"its peak memory          {peak_gib(words):6.3f} GiB, bound {BOUND_GIB} GiB")


if __name__ == "__main__":
    main()
