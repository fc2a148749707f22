"""From a photograph of 24 megapixels in a watched folder to its number on the screen of live focus, in seconds."""

from __future__ import annotations

import asyncio
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from textual.pilot import Pilot

from procedures.pattern import Chart
from simulators.camera.camera import SimulatedCamera, pixels_at
from simulators.world.scene import Scene
from station.app.app import StationApp
from station.app.widgets import BigText
from station.guide.workspace import StationLab

PHOTOGRAPHS = 6
SIZE = (120, 40)


async def until(holds: Callable[[], object], pilot: Pilot[int]) -> None:
    """Wait, looking often."""
    while not holds():
        await pilot.pause(0.005)


async def watch(app: StationApp, incoming: Path, photograph: Path) -> list[tuple[float, float]]:
    """Wall and processor seconds from the moment that a file lies there to its number being drawn, each in turn."""
    took = []
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
            begin = time.perf_counter(), time.process_time()
            arriving.rename(incoming / f"{number}.dng")
            source = app.screen.query_one("#source")
            await until(lambda n=number, part=source: f"Photograph {n + 1}," in str(part.render()), pilot)
            took.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
        assert app.screen.query_one(BigText).text[0] != "-", "the chart was not seen"
    return took


def main() -> None:
    """Print environment and seconds."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as name:
        folder, camera = Path(name), SimulatedCamera()
        (folder / "incoming").mkdir()
        placed = camera.place(Chart.from_seed(), pixels=pixels_at(1.3), at=(0.4, 0.6), roll_deg=2)
        camera.photograph(Scene((placed,)), np.random.default_rng(1), folder / "a.dng")
        app = StationApp(StationLab(sessions=folder / "sessions", config=None))
        took = asyncio.run(watch(app, folder / "incoming", folder / "a.dng"))
        size = (folder / "a.dng").stat().st_size / 1e6
        print(f"{camera.sensor.columns} x {camera.sensor.rows} photosites, {size:.0f} MB")
        for i, what in enumerate(("wall", "processor")):
            rest = [one[i] for one in took[1:]]
            print(
                f"{what}: the first {took[0][i]:.2f} s; the {len(rest)} after it {min(rest):.2f} to {max(rest):.2f} s"
            )


if __name__ == "__main__":
    main()
