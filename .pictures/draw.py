"""Draw the README's picture of the application: `python .pictures/draw.py`, in a checkout.

The guide goes through a calibration on the simulated bench in a terminal of 120 x 40, by the Enter key; the picture is
its last screen.
"""

from __future__ import annotations

import asyncio
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from station.app.app import StationApp
from station.app.screens.guide import GuideScreen
from station.demo.manual_pictures import self_contained
from station.guide.workspace import StationLab

SIZE = (120, 40)
PATIENCE_S = 900.0
PICTURE = Path(__file__).resolve().with_name("guide.svg")


async def last_screen(app: StationApp) -> str:
    """What the operator sees when all is done, as SVG."""
    end = time.monotonic() + PATIENCE_S
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("enter", "enter", "enter")
        while time.monotonic() < end:
            await pilot.pause(0.05)
            guide = next((one for one in app.screen_stack if isinstance(one, GuideScreen)), None)
            if guide is not None and guide.finished and app.running("run") is None:
                await pilot.pause(0.5)
                return app.export_screenshot(title="station")
            if guide is not None and guide.answers.open:
                if "uncertainty of MTF50" in guide.answers.question:  # a rough result is enough
                    await pilot.press("end", *["backspace"] * 8, *"0.05")
                await pilot.press("enter")
    raise TimeoutError(f"the guide did not come to its end in {PATIENCE_S:g} s; draw on a quieter machine")


def main() -> None:
    """Draw it."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the screen shows where the session lies
        lab = StationLab(sessions=Path("sessions"), config=None, simulate=True)
        lab.virtual_time = True
        try:
            PICTURE.write_text(self_contained(asyncio.run(last_screen(StationApp(lab)))), encoding="utf-8")
        finally:
            lab.close()


if __name__ == "__main__":
    main()
