"""What every shaker promises."""

import math

import pytest

from drivers.errors import BadConfiguration, MoveFailed, OutsideTravel
from drivers.interfaces import ShakePath

STEP = 2.0 / 2047


@pytest.fixture
def shaker(shaker_rig):
    shaker_rig.device.connect()
    return shaker_rig.device


def around(shaker, part=0.5, number=20):
    """A circle of this part of the strokes, 0.1 s around."""
    (first, a), (second, b) = shaker.strokes().items()
    angles = [2 * math.pi * i / number for i in range(number)]
    path = {first: tuple(part * a * math.cos(t) for t in angles), second: tuple(part * b * math.sin(t) for t in angles)}
    return ShakePath(0.1 / number, path)


def rests(rig):
    """Whether the camera is where it rests, as far as that is known."""
    return rig.carried is None or rig.carried() == (0.0, 0.0)


def test_it_says_what_it_is_and_how_far_it_goes(shaker_rig):
    assert shaker_rig.device.connect().model
    assert all(stroke > 0 for stroke in shaker_rig.device.strokes().values())
    assert rests(shaker_rig)


def test_it_plays_the_path_as_it_says_until_it_is_stopped(shaker, shaker_rig):
    path = around(shaker)
    reported = shaker.start(path)
    assert reported.interval_s == pytest.approx(path.interval_s, abs=1e-6)
    for name, values in path.offsets.items():
        assert reported.offsets[name] == pytest.approx(values, abs=STEP)
    clock, began_s = shaker_rig.clock, shaker.began_s()
    assert abs(began_s - clock.now_s()) < 0.5
    for _ in range(5):
        clock.sleep(0.0173)
        if shaker_rig.carried is not None:
            points = list(zip(*reported.offsets.values(), strict=True))
            at = (clock.now_s() - began_s) / reported.interval_s
            # at a point or half way between two, as smoothly as the channels go; and clocks are compared to a point
            near = [points[(math.floor(at) + i) % len(points)] for i in (-1, 0, 1)]
            assert min(math.dist(shaker_rig.carried(), point) for point in near) < 0.16
    shaker.stop()
    clock.sleep(0.05)
    assert rests(shaker_rig)


def test_it_ends_with_its_round(shaker, shaker_rig):
    shaker.start(around(shaker))
    began_s = shaker.began_s()
    shaker_rig.clock.sleep(0.13)
    shaker.stop()
    rounds = (shaker_rig.clock.now_s() - began_s) / 0.1
    assert rounds >= 2 - 0.01


def test_another_path_takes_the_place_of_the_first(shaker, shaker_rig):
    shaker.start(around(shaker))
    second = around(shaker, 0.25, 40)
    reported = shaker.start(second)
    for name, values in second.offsets.items():
        assert reported.offsets[name] == pytest.approx(values, abs=STEP)
    shaker.stop()


def test_it_is_stopped_twice_and_without_having_begun(shaker, shaker_rig):
    shaker.stop()
    shaker.start(around(shaker))
    shaker.stop()
    shaker.stop()
    assert rests(shaker_rig)


@pytest.mark.parametrize("beyond", [0.01, 50.0, float("inf"), float("nan")])
def test_it_refuses_to_go_beyond_its_stroke(shaker, shaker_rig, beyond):
    name, stroke = next(iter(shaker.strokes().items()))
    for sign in (1, -1):
        with pytest.raises(OutsideTravel, match=r"from rest"):
            shaker.start(ShakePath(0.01, {name: (0.0, sign * (stroke + beyond))}))
    assert rests(shaker_rig)


def test_it_refuses_an_axis_it_has_not(shaker):
    with pytest.raises(BadConfiguration, match=r"nowhere_mm was requested; axes are"):
        shaker.start(ShakePath(0.01, {"nowhere_mm": (0.0, 0.1)}))


def test_an_emergency_stop_lets_it_rest_at_once_and_is_reported(shaker, shaker_rig):
    shaker.start(around(shaker))
    shaker_rig.clock.sleep(0.03)
    shaker.emergency_stop()
    shaker.emergency_stop()
    shaker_rig.clock.sleep(0.05)
    assert rests(shaker_rig)
    with pytest.raises(MoveFailed, match="stopped too early"):
        shaker.began_s()
    shaker.start(around(shaker))
    shaker.stop()
