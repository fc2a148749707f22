"""Wall time of simulated photographs, against the Fourier transform of their fine picture, and peak memory.

python -m tests.benchmarks.simulated_camera
"""

from __future__ import annotations

import os
import platform
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import fft

from procedures.pattern import Chart
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.simulators.random_scenes import Trials, random_camera, random_scene

RUNS = 5
CHART = Chart.from_seed()


def best_of(work: Callable[[], object], runs: int = RUNS) -> float:
    """Shortest wall time, seconds."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def grey(pixels: int) -> tuple[str, Callable[[], object], int]:
    """A grey plane filled by a chart."""
    side = int(1.6 * pixels)
    camera = SimulatedCamera(sensor=Sensor(side, side, None), pitch_um=7.52)
    scene = Scene((camera.place(CHART, pixels=pixels, yaw_deg=10, roll_deg=20),))
    return f"grey, chart of {pixels} px", lambda: camera.photograph(scene, np.random.default_rng(1)), 8 * side


def bayer(folder: Path, charts: int, bits: int) -> tuple[str, Callable[[], object], int]:
    """A RAW file of 24 megapixels."""
    camera = SimulatedCamera()
    places = [((i % 3 + 0.5) / 3, (i // 3 + 0.5) / 3) for i in range(charts)]
    scene = Scene(tuple(camera.place(CHART, pixels=101, at=at, roll_deg=20) for at in places))
    name = f"24 megapixels, {charts} charts of 101 px, {bits} bits"
    return name, lambda: camera.photograph(scene, np.random.default_rng(1), folder / "a.dng", bits=bits), 4 * 330


def trial(seed: int) -> object:
    """One random photograph as the trials of detection take it."""
    rng, trials = np.random.default_rng(seed), Trials()
    camera = random_camera(rng, trials)
    return camera.photograph(random_scene(rng, camera, CHART, trials), rng)


def main() -> None:
    """Print environment, best times, and their ratio to one real transform of the size of the fine picture."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, best of {RUNS}")
    with tempfile.TemporaryDirectory() as folder:
        jobs = [grey(130), grey(300), *(bayer(Path(folder), n, bits) for n, bits in ((1, 16), (1, 14), (9, 16)))]
        for name, work, side in jobs:
            picture = np.zeros((fft.next_fast_len(side),) * 2)
            seconds, transform = best_of(work), best_of(lambda p=picture: fft.rfft2(p, workers=2))
            print(f"{name:45s} {1000 * seconds:7.0f} ms {seconds / transform:7.1f} x transform")
    start = time.perf_counter()
    for seed in range(20):
        trial(seed)
    print(f"{'random 640 x 480, 60 to 300 px, mean of 20':45s} {50 * (time.perf_counter() - start):7.0f} ms")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
