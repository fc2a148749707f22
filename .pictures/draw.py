"""Draw the README's picture of the application: `python .pictures/draw.py`, in a checkout.

The guide goes through a calibration on the simulated bench in a terminal of 120 x 40, by the Enter key; the picture is
the screen as it stands when the step named below asks its last question or ends.
"""

from __future__ import annotations

import asyncio
import re
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from station.app.app import StationApp
from station.app.screens.guide import GuideScreen
from station.guide.workspace import StationLab

SIZE = (120, 40)
PATIENCE_S = 500.0
STEP = sys.argv[1] if len(sys.argv) > 1 else "verdict"
PICTURE = Path(__file__).with_name("guide.svg")


async def walk(app: StationApp) -> str:
    """The last screen before the step is left, as SVG."""
    end, drawn, asked = time.monotonic() + PATIENCE_S, "", ""
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("enter", "enter", "enter")
        while time.monotonic() < end:
            await pilot.pause(0.05)
            guide = next((one for one in app.screen_stack if isinstance(one, GuideScreen)), None)
            if guide is None:
                continue
            if guide.finished and app.running("run") is None:
                break
            if guide.answers.open:
                await pilot.pause(0.3)
                asked = guide.answers.question
                print(asked, flush=True)
                if STEP.lower() in asked.lower():
                    drawn = app.export_screenshot(title="station")
                    break
                if "uncertainty of MTF50" in asked:
                    await pilot.press("end", *["backspace"] * 8, *"0.05")
                await pilot.press("enter")
        return drawn or app.export_screenshot(title="station")


def self_contained(svg: str) -> str:
    """The picture without fonts from the network: any fixed-width font will do, the letters' places are in the file."""
    svg = re.sub(r"@font-face \{.*?\}", "", svg, flags=re.DOTALL)
    return re.sub(r"font-family: [^;]+;", "font-family: ui-monospace, 'DejaVu Sans Mono', monospace;", svg)


def main() -> None:
    """Draw it."""
    with tempfile.TemporaryDirectory() as folder:
        lab = StationLab(sessions=Path(folder), config=None, simulate=True)
        lab.virtual_time = True
        try:
            PICTURE.write_text(self_contained(asyncio.run(walk(StationApp(lab)))), encoding="utf-8")
        finally:
            lab.close()


if __name__ == "__main__":
    main()
