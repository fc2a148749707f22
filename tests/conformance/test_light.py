"""What every light promises."""

import pytest

from drivers.errors import BadConfiguration


@pytest.fixture
def light(light_rig):
    light_rig.device.connect()
    return light_rig.device


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
def test_the_world_is_as_bright_as_it_says(light, light_rig, level):
    light.set_level(level)
    assert light.level() == level
    if light_rig.bench is not None:
        # a warm lamp; DMX has 255 steps
        assert light_rig.bench.world.lamp(light_rig.clock.now_s() + 1e5) == pytest.approx(level, abs=0.5 / 255)


@pytest.mark.parametrize("level", [-0.1, 1.1, float("nan")])
def test_an_impossible_level_is_refused(light, level):
    light.set_level(0.5)
    with pytest.raises(BadConfiguration, match=r"must be in 0 \.\. 1"):
        light.set_level(level)
    assert light.level() == 0.5
