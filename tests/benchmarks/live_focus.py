"""Live focus: from a photograph of 24 megapixels in a watched folder to its number on the screen; and how near the
best focus of simulated sweeps comes to the true maximum of MTF50.

Usage: live_focus.py [latency | sweeps [N]], by default both. On a machine that other programs use too, times by the
clock are theirs as well; beside them stand the processor times of the thread that reads and measures.
"""

import asyncio
import functools
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
from textual.pilot import Pilot

from procedures import Chart, Plane
from procedures.pattern_psf.focus.sharpness import measure_sharpness
from procedures.pattern_psf.focus.sweep import best_focus
from simulators.camera.camera import Lens, SimulatedCamera, pixels_at, render_plane
from simulators.camera.sensor import Sensor
from simulators.world.scene import PlacedChart, Scene
from station.app.app import StationApp
from station.app.screens import focus as screen
from station.app.widgets import BigText
from station.guide.focus.live import LiveFocus, PhotographSource
from station.guide.workspace import StationLab

PHOTOGRAPHS = 8
SIZE = (120, 40)
PARTS = {"reading": (PhotographSource, "read"), "measuring": (LiveFocus, "see"), "its picture": (screen, "_glimpse")}
SWEEPS, PLACES, REACH_DIOPTRES = 20, 5, 0.025
F_NUMBERS = (2.8, 4.0)


def timed(owner: Any, name: str, took: list[float]) -> None:
    """Note the processor time of every call, of the thread that it is in."""
    function = getattr(owner, name)

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        begin = time.thread_time()
        try:
            return function(*arguments)
        finally:
            took.append(time.thread_time() - begin)

    setattr(owner, name, call)


def numbers_drawn() -> list[float]:
    """The moments at which a new number was painted, as they come."""
    drawn: list[float] = []
    show, line = BigText.show, BigText.render_line
    shown = [0]

    def count(self: BigText, text: str) -> None:
        shown[0] += 1
        show(self, text)

    def note(self: BigText, y: int) -> Any:
        if self.text and len(drawn) < shown[0]:
            drawn.append(time.perf_counter())
        return line(self, y)

    BigText.show, BigText.render_line = count, note  # type: ignore[method-assign]
    return drawn


async def until(holds: Callable[[], object], pilot: Pilot[int]) -> None:
    """Wait, looking now and then: every look takes some of the processor."""
    while not holds():
        await pilot.pause(0.05)


async def watch(app: StationApp, incoming: Path, photograph: Path) -> list[float]:
    """Seconds from the moment that a file lies there to its number being drawn, each in turn."""
    took, drawn = [], numbers_drawn()
    async with app.run_test(size=SIZE) as pilot:
        await until(lambda: app.bench is None and app.running("load") is None and app.running("open") is None, pilot)
        await pilot.press("f7")
        await until(lambda: app.screen.query("#whence, #typed"), pilot)
        await pilot.press("enter")
        app.screen.query_one("#typed").value = str(incoming)  # type: ignore[attr-defined]
        await pilot.press("enter")
        await until(lambda: app.running("focus"), pilot)
        for number in range(PHOTOGRAPHS):
            await pilot.pause(0.5)
            arriving = incoming / f"{number}.part"
            shutil.copy(photograph, arriving)
            begin = time.perf_counter()
            arriving.rename(incoming / f"{number}.dng")
            await until(lambda n=number: len(drawn) > n, pilot)
            took.append(drawn[number] - begin)
        assert app.screen.query_one(BigText).text[0] != "-", "the chart was not seen"
    return took


def latency() -> None:
    """Print seconds by the clock, and what the parts take of the processor."""
    parts: dict[str, list[float]] = {name: [] for name in PARTS}
    for name, (owner, function) in PARTS.items():
        timed(owner, function, parts[name])
    with tempfile.TemporaryDirectory() as name:
        folder, camera = Path(name), SimulatedCamera()
        (folder / "incoming").mkdir()
        placed = camera.place(Chart.from_seed(), pixels=pixels_at(1.3), at=(0.4, 0.6), roll_deg=2)
        camera.photograph(Scene((placed,)), np.random.default_rng(1), folder / "a.dng")
        app = StationApp(StationLab(sessions=folder / "sessions", config=None))
        took = asyncio.run(watch(app, folder / "incoming", folder / "a.dng"))
        size = (folder / "a.dng").stat().st_size / 1e6
    print(f"{camera.sensor.columns} x {camera.sensor.rows} photosites, {size:.0f} MB; load {os.getloadavg()[0]:.1f}")
    parts["together"] = [sum(one) for one in zip(*parts.values(), strict=True)]
    for what, seconds in {"file to number, by the clock": took, **parts}.items():
        first, *rest = seconds
        print(f"  {what:28} the first {first:.2f} s, the {len(rest)} after it {min(rest):.2f} to {max(rest):.2f} s")


def true_mtf50(camera: SimulatedCamera, placed: PlacedChart, dioptres: float) -> float:
    """Frequency at which the mean over directions of the true MTF is one half, cycles per pixel."""
    optics, angles = camera.optics_at(placed, 1000 / dioptres), np.pi * np.arange(16) / 16

    def above(f: float) -> float:
        return float(np.abs(optics.otf(f * np.cos(angles), f * np.sin(angles), "G")).mean()) - 0.5

    return float(scipy.optimize.brentq(above, 0.02, 1.2))


def sweep(f_number: float, rng: np.random.Generator) -> tuple[float, float]:
    """The true MTF50 at the best focus that a sweep finds, and the score that is stated for it, over the maximum."""
    lens = Lens(focal_length_mm=50.0, f_number=f_number)
    camera = SimulatedCamera(lens, Sensor(180, 260, cfa=None), pitch_um=8.0)
    chart = Chart.from_seed()
    placed = camera.place(chart, pixels=pixels_at(1.3))
    sharp, reach = 1000 / placed.pose.centre_mm[2], REACH_DIOPTRES * f_number / 4
    # nobody turns a ring by equal steps, nor begins at the same distance from the focus
    steps = np.linspace(-1, 1, PLACES) + rng.uniform(-0.1, 0.1, PLACES) + rng.uniform(-0.3, 0.3)
    places = sharp + reach * steps
    seen, near = [], None
    for place in places:
        shot = render_plane(Scene((placed,)), replace(camera, focus_mm=1000 / place), rng, exposure_s=0.002 * f_number)
        found = measure_sharpness(Plane("Y", shot.astype(np.float32), 1 / 16383), chart, near=near).result()
        near = found.sighting
        seen.append(found.mtf50)
    peak = best_focus(list(places), [one.value for one in seen], [one.uncertainty for one in seen])
    assert peak is not None, "the sweep has no top"
    most = true_mtf50(camera, placed, sharp)
    return true_mtf50(camera, placed, peak.place) / most, peak.score / most


def sweeps(count: int) -> None:
    """Print how far below the maximum the best focus found lies, and how far off the score stated."""
    for f_number in F_NUMBERS:
        found = np.array([sweep(f_number, np.random.default_rng([int(10 * f_number), i])) for i in range(count)])
        short, off = 1 - found[:, 0], found[:, 1] - 1
        print(
            f"f/{f_number:g}, {count} sweeps of {PLACES} photographs: the true MTF50 at the best focus found lies "
            f"{np.mean(short):.2%} below its maximum, at most {short.max():.2%}; the MTF50 stated is off by "
            f"{np.mean(off):+.2%}, at most {np.abs(off).max():.2%}"
        )


def main() -> None:
    """Print environment and figures."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores")
    what = sys.argv[1] if len(sys.argv) > 1 else ""
    if what != "sweeps":
        latency()
    if what != "latency":
        sweeps(int(sys.argv[2]) if len(sys.argv) > 2 else SWEEPS)


if __name__ == "__main__":
    main()
