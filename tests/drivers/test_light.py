import pytest

from drivers.errors import NoAnswer
from drivers.light import DmxLight, DmxParser, LampProperties
from drivers.transport import SerialTransport


@pytest.mark.parametrize(("pwm_hz", "exposure_s"), [(0.0, 0.001), (1000.0, 0.1), (1000.0, 0.2)])
def test_long_exposures_and_steady_lamps_have_no_flicker(pwm_hz, exposure_s):
    assert LampProperties(pwm_hz=pwm_hz).flicker(exposure_s) is None


def test_short_exposures_under_a_modulated_lamp_can_differ_by_one_period():
    caveat = LampProperties(pwm_hz=1000.0).flicker(0.02)
    assert caveat.reason == (
        "an exposure must last 100 periods of the lamp's modulation, 0.1 s; at 0.02 s its light can change by 5 %"
    )


def test_a_lamp_is_steady_after_its_warm_up(wired, bench):
    light = wired(DmxLight, DmxParser, "light", (1, 2), panel=LampProperties(warm_up_s=60.0))
    light.connect()
    light.set_level(0.5)
    assert not light.steady()
    assert "warming up" in light.condition().word
    bench.clock.sleep(60.0)
    assert light.steady()
    light.set_level(0.5)  # nothing changes, nothing warms up
    assert light.steady()


def test_an_echo_is_no_reply():
    light = DmxLight(SerialTransport("loop://", DmxParser))
    with pytest.raises(NoAnswer):
        light.connect()


def test_only_its_own_channels_are_lit(wired, bench):
    light = wired(DmxLight, DmxParser, "light", (3, 5))
    light.connect()
    light.set_level(1.0)
    slots = bench.devices["light"].slots
    assert [i + 1 for i, value in enumerate(slots) if value] == [3, 5]


def test_a_lamp_whose_reply_is_lost_counts_as_lit(wired, bench):
    light = wired(DmxLight, DmxParser, "light")
    light.connect()
    bench.cables["light"].faults.spoil_reply = lambda data, at_s: b""
    with pytest.raises(NoAnswer):
        light.set_level(1.0)
    assert light.level() == 1.0
    assert bench.world.lamp(1e9) == 1.0
