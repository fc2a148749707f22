"""Processor time of finding the chart in large frames on one core, against the mean of every 2 x 2 pixels; memory.

python -m tests.benchmarks.detection
"""

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable

import cv2
import numpy as np

from procedures.pattern import X_CORNERS, Chart
from procedures.pattern_psf.chart_finding.detection import find_charts
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene, Wall
from tests.simulators.clutter import random_clutter

RUNS = 5
BOUND_S = 0.5
FRAMES = {"6 MP, a plane of 24": (2000, 3000), "24 MP": (4000, 6000), "60 MP": (6336, 9504)}
PITCH_UM, WALL_MM = 4.0, 6000.0
MEMORY = """
import resource, sys, numpy as np
from procedures.pattern_psf.chart_finding.detection import find_charts
image = np.random.default_rng(1).random((6336, 9504), dtype="f4")
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
find_charts(image)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024, image.nbytes / 2**20)
"""


def best_of(work: Callable[[], object], runs: int = RUNS) -> float:
    """Shortest processor time, seconds."""
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def cluttered(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A chart of 80 pixels among clutter with noise of 1 %; and where its x-corners are."""
    camera = SimulatedCamera(sensor=Sensor(rows, columns, None), pitch_um=PITCH_UM)
    rng = np.random.default_rng(6)
    width, height = (n * PITCH_UM / 1000 * WALL_MM / 50 for n in (columns, rows))
    wall = Wall(WALL_MM, 0.5, random_clutter(rng, width, height, polygons=60, lines=60, words=60))
    placed = camera.place(Chart.from_seed(), pixels=80, at=(0.7, 0.3), roll_deg=33, yaw_deg=12)
    shot = camera.photograph(Scene((placed,), wall), rng)
    plane = shot.plane("Y") + 0.008 * rng.standard_normal((rows, columns))
    return plane.astype(np.float32), shot.true_points("Y", X_CORNERS)


def textured(image: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The same chart where all the rest is a texture of strong contrast: the slowest of frames."""
    rng = np.random.default_rng(7)
    texture = cv2.GaussianBlur(rng.random(image.shape, dtype=np.float32), (0, 0), 1.0) * 2.0
    (x0, y0), (x1, y1) = np.round(corners.min(axis=0) - 20).astype(int), np.round(corners.max(axis=0) + 20).astype(int)
    texture[y0:y1, x0:x1] = image[y0:y1, x0:x1]
    return texture


def report(name: str, image: np.ndarray, corners: np.ndarray) -> None:
    """Print one frame's time, how many means of 2 x 2 pixels that is, and whether the chart was found."""
    seconds, mean = best_of(lambda: find_charts(image)), best_of(lambda: cv2.resize(image, None, fx=0.5, fy=0.5))
    found = find_charts(image)
    error = np.abs(found[0].corners - corners).max() if len(found) == 1 else float("nan")
    bound = f"bound {BOUND_S:.2f} s" if image.size <= 24e6 else ""
    print(f"{name:34s} {seconds:6.3f} s {seconds / mean:6.0f} x mean   largest error {error:.2f} px   {bound}")


def main() -> None:
    """Print environment, best times and peak memory beyond the frame itself."""
    cv2.setNumThreads(1)
    print(f"Python {platform.python_version()}, OpenCV {cv2.__version__}, {os.cpu_count()} cores, best of {RUNS}")
    # first: a child's peak begins with its parent's size
    extra, frame = map(float, subprocess.check_output([sys.executable, "-c", MEMORY], text=True).split())
    print(f"60 MP: {extra:.0f} MiB beyond the frame's own {frame:.0f} MiB")
    for name, (rows, columns) in FRAMES.items():
        image, corners = cluttered(rows, columns)
        report(f"{name}, clutter", image, corners)
        report(f"{name}, texture everywhere", textured(image, corners), corners)


if __name__ == "__main__":
    main()
