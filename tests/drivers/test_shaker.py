"""The shaker at its twin: the world's camera follows the commanded path, by the same clock as the shot."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import BadConfiguration, LineLost, MoveFailed, NoAnswer, OutsideTravel, Rejected
from drivers.interfaces import ShakePath
from drivers.shaker import ShakerAxis, StrigShaker

AXES = (ShakerAxis("x_mm", 0, 2.0), ShakerAxis("y_mm", 1, 2.0))
STEP_MM = 2.0 / 2047
ANGLES = 2 * np.pi * np.arange(40) / 40
CIRCLE = ShakePath(0.005, {"x_mm": tuple(1.5 * np.cos(ANGLES)), "y_mm": tuple(0.75 * np.sin(ANGLES))})


@pytest.fixture
def shaker(box, bench):
    shaker = StrigShaker(box, AXES, clock=bench.clock)
    shaker.connect()
    return shaker


def carried(bench, t_s):
    """Where the world has the camera, about where it rests."""
    sway = bench.world.sway(np.atleast_1d(t_s))
    return np.column_stack([sway["x_mm"][0], sway["y_mm"][0]])


@pytest.fixture
def quiet(bench):
    """Nothing but the shaker moves the camera."""
    bench.world.room = replace(bench.world.room, modes=())
    return bench


def test_the_camera_goes_around_the_path_until_it_rests(shaker, quiet):
    reported = shaker.start(CIRCLE)
    began_s = shaker.began_s()
    quiet.clock.sleep(0.5)
    # the points of two rounds, in whole steps: reported path and motion in the world are equal
    at_s = began_s + 0.2 + 0.005 * np.arange(40)
    truth = np.column_stack([reported.offsets["x_mm"], reported.offsets["y_mm"]])
    # of the comparison of clocks some microseconds stay: at 10 Hz and 1.5 mm a tenth of a micrometre each
    np.testing.assert_allclose(carried(quiet, at_s), truth, atol=0.002)
    for name in reported.offsets:
        np.testing.assert_allclose(reported.offsets[name], CIRCLE.offsets[name], atol=STEP_MM / 2 + 1e-12)
    shaker.stop()
    np.testing.assert_array_equal(carried(quiet, quiet.clock.now_s()), [[0.0, 0.0]])


def test_path_and_shot_are_reported_by_one_clock(shaker, box, quiet):
    quiet.body.settings.exposure_s = 0.2
    reported = shaker.start(CIRCLE)
    quiet.clock.sleep(1.0)
    times = box.fire(0.1)
    since = times.flash_s - shaker.began_s()
    opened_s = quiet.body.openings[0].begin_s
    # where in the round the shutter opened, to 0.1 ms: 20 mm a round of 0.2 s would be 10 um
    x_mm = np.interp(since % 0.2, 0.005 * np.arange(41), [*reported.offsets["x_mm"], reported.offsets["x_mm"][0]])
    assert carried(quiet, opened_s)[0, 0] == pytest.approx(x_mm, abs=0.02)
    shaker.stop()


def test_an_axis_that_is_not_driven_rests_and_a_turned_one_goes_the_other_way(box, quiet):
    shaker = StrigShaker(box, [ShakerAxis("x_mm", 0, 2.0, direction=-1)], clock=quiet.clock)
    shaker.connect()
    reported = shaker.start(ShakePath(0.05, {"x_mm": (0.5, 1.0, 0.5, 0.0)}))
    assert reported.offsets["x_mm"] == pytest.approx((0.5, 1.0, 0.5, 0.0), abs=STEP_MM)
    np.testing.assert_allclose(carried(quiet, shaker.began_s() + 0.05), [[-1.0, 0.0]], atol=0.003)


def test_the_imu_feels_it(shaker, quiet):
    shaker.start(CIRCLE)
    t_s = shaker.began_s() + np.linspace(0.2, 0.4, 50)
    force, _ = quiet.world.ideal_imu(t_s)
    # a circle of 5 Hz: amplitude times the square of its angular frequency
    assert np.ptp(force[:, 0]) / 2 == pytest.approx(0.0015 * (10 * np.pi) ** 2, rel=0.05)


@pytest.mark.parametrize("ended", ["emergency_stop", "abort", "close"])
def test_a_stop_lets_it_rest_at_once_and_is_reported(shaker, box, quiet, ended):
    shaker.start(CIRCLE)
    quiet.clock.sleep(0.33)
    getattr(shaker if ended == "emergency_stop" else box, ended)()
    quiet.clock.sleep(0.05)
    np.testing.assert_array_equal(carried(quiet, quiet.clock.now_s()), [[0.0, 0.0]])
    if ended == "close":
        return
    with pytest.raises(MoveFailed, match="stopped too early"):
        shaker.began_s()
    shaker.start(CIRCLE)
    shaker.stop()


@pytest.mark.parametrize("order", ["start", "stop"])
def test_it_rests_after_an_order_whose_reply_is_lost(shaker, bench, quiet, order):
    if order == "stop":
        shaker.start(CIRCLE)
    faults = bench.cables["shutter"].faults
    faults.spoil_reply = lambda data, at_s: b"" if b"EVT SHAKE" in data or b"EVT REST" in data else data
    with pytest.raises(NoAnswer):
        shaker.start(CIRCLE) if order == "start" else shaker.stop()
    quiet.clock.sleep(0.05)
    np.testing.assert_array_equal(carried(quiet, quiet.clock.now_s()), [[0.0, 0.0]])


@pytest.mark.parametrize(
    ("path", "error", "reported"),
    [
        (ShakePath(0.01, {"x_mm": (0.0, 2.1)}), OutsideTravel, "x_mm goes 2 from rest, not 2.1"),
        (ShakePath(0.01, {"x_mm": (0.0, float("nan"))}), OutsideTravel, "x_mm goes 2 from rest"),
        (ShakePath(0.01, {"z_mm": (0.0, 1.0)}), BadConfiguration, "axes are x_mm, y_mm"),
        (ShakePath(0.01, {"x_mm": (0.0, 1.0), "y_mm": (0.0,)}), BadConfiguration, "1 and 2 points"),
        (ShakePath(0.01, {"x_mm": (0.0,) * 129}), BadConfiguration, "129 points"),
        (ShakePath(0.0005, {"x_mm": (0.0, 1.0)}), BadConfiguration, "give an interval from 0.001 to 1 s"),
    ],
)
def test_what_cannot_be_played_is_refused_before_it_is_reported(shaker, quiet, path, error, reported):
    with pytest.raises(error, match=reported):
        shaker.start(path)
    np.testing.assert_array_equal(carried(quiet, quiet.clock.now_s()), [[0.0, 0.0]])


def test_a_box_without_one_reports_it(box, bench):
    bench.devices["shutter"].actuators = None
    shaker = StrigShaker(box, AXES, clock=bench.clock)
    with pytest.raises(Rejected, match="no shaker; wire a shaker to the box"):
        shaker.connect()
    box.version = 1
    with pytest.raises(BadConfiguration, match="speaks STRIG/1, which has no shaker"):
        shaker.connect()
    box.close()
    with pytest.raises(LineLost, match="connect the shutter first"):
        shaker.connect()
    assert not shaker.condition().usable
