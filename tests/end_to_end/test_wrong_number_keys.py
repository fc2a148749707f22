"""A wrong focal length typed into the application on the simulated bench: the screen names it."""

import pytest

from station.app.app import StationApp
from station.app.screens import parts
from station.sessions.session import Session
from tests.end_to_end.test_app import make_lab
from tests.end_to_end.test_camera_guide import as_left
from tests.station.app.driving import Driver, drive

pytestmark = pytest.mark.slow
DONE = ("print", "mount")
NAMED = "the focal length was given as 50 mm, but the camera recorded 24 mm"
REMEDY = "Correct the numbers, or confirm them."
SIZES = ("focal_length_mm", "pixel_pitch_um")


def hung_and_lit(lab) -> None:
    """A session in which the chart hangs and is lit: the sizes of lens and sensor are asked for next."""
    bench = lab.open().bench
    session = Session.create(lab.sessions, plan="pattern", camera="C", lens="L", config={}, clock=bench.clock, seed=3)
    session.learn({key: value for key, value in as_left(bench).items() if key not in SIZES})
    for name in DONE:
        session.begin_step(name)
        session.finish_step(name)
    session.close()


async def type_another(driver: Driver) -> None:
    await driver.until("Or continue a session")
    await driver.press("tab", "enter")
    await driver.until("clear: press Enter to light it")
    await driver.press("enter")
    await driver.until("clear: press Enter to move")
    await driver.press("enter")
    await driver.until("What is the lens's focal length?")
    await driver.press(*"50", "enter")
    await driver.until("What is the sensor's pixel pitch?")
    await driver.press(*"5.94", "enter")
    await driver.until(NAMED)
    assert "Distance now" in driver.words  # it is still the step in which it was typed
    assert REMEDY in driver.words


def test_a_wrong_focal_length_is_named_on_the_screen_within_two_steps(tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "MIN_READ_S", 0.0)
    lab = make_lab(tmp_path)
    hung_and_lit(lab)
    try:
        drive(StationApp(lab), type_another)
    finally:
        lab.close()
