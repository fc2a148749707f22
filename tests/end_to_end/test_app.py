"""The operator's application on the simulated bench: keys from the first screen to the result, in virtual time."""

import asyncio
import json
import os
import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

from simulators.camera.sensor import Sensor
from station.app.app import StationApp
from station.app.screens.guide import GuideScreen
from station.app.screens.parts import MIN_READ_S
from station.guide.catalogue import plan_named
from station.guide.frontend import CONSENTS
from station.guide.workspace import StationLab
from station.results.reader import find_results
from tests.station.app.driving import WRITE, Driver

pytestmark = pytest.mark.slow

PATIENCE_S = 240.0
"""Real seconds for the whole of it on a slow machine."""
SPECIFICATION = "title = 'a simulated lens'\nlimits = { mtf50 = { min = 0.1 } }\n"
SCREENS = Path(__file__).parent / "screens" / "first-calibration-80.txt"
"""The text above the images at the first occurrence of each question, numbers masked."""


def make_lab(folder: Path) -> StationLab:
    """The bench in virtual time; its images are rendered more coarsely than its optics require, with the same verdicts.

    Its sensor is without a mosaic: a fourth of the work, and what four planes bring is in `test_guide`.
    """
    wanted = folder / "specification.toml"
    wanted.write_text(SPECIFICATION)
    lab = StationLab(sessions=folder / "sessions", config=None, simulate=True, specification=wanted)
    lab.virtual_time = True
    bench = lab.open().bench
    assert bench is not None
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=5, sensor=Sensor(240, 320, cfa=None), pitch_um=11.88)
    return lab


async def answer(app: StationApp, pilot: Pilot[int], guide: GuideScreen) -> None:
    """Actions of an operator who reads the screen: Enter; a rough result suffices."""
    if "uncertainty of MTF50" in guide.answers.question:
        await pilot.press("end", *["backspace"] * 8, *"0.05")
    if guide.answers._ask is not None and guide.answers._ask.key in CONSENTS:
        await pilot.pause(1.25 * MIN_READ_S)  # a key that is held down does not consent
    await pilot.press("enter")


def upper_part(screen: str) -> str:
    """Step, instruction and question, down to the lower edge of the box."""
    lines = screen.splitlines()
    edge = next((i for i, line in enumerate(lines) if "┗" in line), 0)
    return re.sub(r"\d", "0", "\n".join(lines[1 : edge + 1]))


async def look(driver: Driver, question: str, seen: dict[str, str]) -> None:
    """The screen at a question of the plan: compared with the stored one when asked for the first time."""
    questions = [ask.question for ask in plan_named("pattern").asks().values()]
    if question not in questions or question in seen:
        return
    kept = {} if os.environ.get(WRITE) else read_screens()
    if question in kept:
        await driver.until(lambda: upper_part(driver.text) == kept[question])
    else:
        await driver.pilot.pause(0.2)
    seen[question] = upper_part(driver.text)


def read_screens() -> dict[str, str]:
    """The kept screens by their questions."""
    parts = SCREENS.read_text(encoding="utf-8").removesuffix("\n").split("\n\n")
    return dict(part.split("\n", 1) for part in parts)


async def from_start_to_result(app: StationApp, seen: dict[str, str]) -> GuideScreen:
    end = time.monotonic() + PATIENCE_S
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("enter")
        guide, driver = None, Driver(app, pilot)
        while time.monotonic() < end:
            await pilot.pause(0.1)
            guide = next((one for one in app.screen_stack if isinstance(one, GuideScreen)), None)
            if guide is not None and guide.finished and app.running("run") is None:
                break
            if guide is not None and guide.answers.open:
                await look(driver, guide.answers.question, seen)
                if guide.answers.question.startswith("Accept it"):
                    await driver.until("Lens: meets the specification")
                await answer(app, pilot, guide)
        assert guide is not None
        return guide


def test_keys_lead_from_the_first_screen_to_an_accepted_result_and_its_certificate(tmp_path):
    lab, seen = make_lab(tmp_path), {}
    try:
        guide = asyncio.run(from_start_to_result(StationApp(lab), seen))
    finally:
        lab.close()
    assert guide.finished
    if os.environ.get(WRITE):
        SCREENS.write_text("\n\n".join(f"{name}\n{one}" for name, one in seen.items()) + "\n", encoding="utf-8")
    assert list(seen) == list(read_screens())
    (folder,) = find_results(lab.sessions)
    record = json.loads((folder / "result.json").read_text())
    assert {plane["verdict"] for plane in record["planes"].values()} == {"pass"}
    (kept,) = lab.kept()
    assert kept.ended == "finished"
    assert (kept.folder / "report.html").is_file()
    certificate = (kept.folder / "certificate.html").read_text()
    assert "a simulated lens" in certificate
    assert "meets" in certificate
    assert (kept.folder / "certificate.pdf").read_bytes().startswith(b"%PDF")
