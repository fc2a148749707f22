"""The operator's application on the simulated bench: keys from the first screen to the result, in virtual time."""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

from station.app.app import StationApp
from station.app.screens.guide import GuideScreen
from station.guide.workspace import StationLab
from station.results.reader import find_results

pytestmark = pytest.mark.slow

PATIENCE_S = 240.0
"""Real seconds for the whole of it on a slow machine."""


def make_lab(folder: Path) -> StationLab:
    """The bench in virtual time; its pictures are drawn more coarsely than its optics ask, which no verdict notices."""
    lab = StationLab(sessions=folder / "sessions", config=None, simulate=True)
    lab.virtual_time = True
    bench = lab.open().bench
    assert bench is not None
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=4)
    return lab


async def answer(app: StationApp, pilot: Pilot[int], guide: GuideScreen) -> None:
    """What an operator does who reads the screen: Enter; but a rough result is enough."""
    if "uncertainty of MTF50" in guide.answers.question:
        await pilot.press("end", *["backspace"] * 8, *"0.05")
    await pilot.press("enter")


async def from_start_to_result(app: StationApp) -> GuideScreen:
    end = time.monotonic() + PATIENCE_S
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("enter")
        guide = None
        while time.monotonic() < end:
            await pilot.pause(0.1)
            guide = next((one for one in app.screen_stack if isinstance(one, GuideScreen)), None)
            if guide is not None and guide.finished and app.running("run") is None:
                break
            if guide is not None and guide.answers.open:
                await answer(app, pilot, guide)
        assert guide is not None
        return guide


def test_keys_lead_from_the_first_screen_to_an_accepted_result(tmp_path):
    lab = make_lab(tmp_path)
    try:
        guide = asyncio.run(from_start_to_result(StationApp(lab)))
    finally:
        lab.close()
    assert guide.finished
    (folder,) = find_results(lab.sessions)
    record = json.loads((folder / "result.json").read_text())
    assert {plane["verdict"] for plane in record["planes"].values()} == {"pass"}
    (kept,) = lab.kept()
    assert kept.ended == "finished"
    assert (kept.folder / "report.html").is_file()
