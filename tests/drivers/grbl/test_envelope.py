"""Travel, rates and places as the controller is set to them."""

import numpy as np
import pytest

from drivers.errors import Alarm, BadConfiguration, OutsideTravel, Rejected
from drivers.interfaces import Travel
from drivers.light import GrblLight
from drivers.protocols.grbl import Controls, GrblAxis, envelope
from simulators.devices.grbl import GrblController
from simulators.devices.grbl_motion import Outputs
from simulators.devices.serial_device import Cable, plug


def rebuilt(bench, **options):
    """The bench's stage behind another controller."""
    axes = {"X": bench.world.axes["z_mm"], "Y": bench.world.axes["x_mm"], "Z": bench.world.axes["y_mm"]}
    outputs = Outputs(spindle=bench.world.set_lamp)
    cable = Cable(GrblController(axes, outputs=outputs, **options), bench.clock)
    bench.devices["stage"], bench.cables["stage"] = cable.device, cable
    plug(f"{bench.name}/stage", cable)
    return cable.device


def goes_everywhere(stage, bench):
    """Homes, goes to both ends of each axis, and the world agrees to a hundredth of a millimetre."""
    stage.connect()
    stage.home()
    for end in ("low", "high"):
        goal = {name: getattr(travel, end) for name, travel in stage.travel().items()}
        stage.move_to(**goal)
        assert stage.position() == pytest.approx(goal, abs=0.01)
        there = {name: bench.world.axes[name].position(bench.clock.now_s()) for name in goal}
        assert there == pytest.approx(goal, abs=0.01)


def test_a_long_move_on_a_slow_controller_has_the_time_it_needs(make, twin, bench):
    # GRBL's own $110 and $120, under the 3000 mm/min that are asked for
    for i in range(3):
        twin.settings[110 + i], twin.settings[120 + i] = 500.0, 10.0
    stage = make()
    stage.connect()
    stage.home()
    begin_s = bench.clock.now_s()
    stage.move_to(z_mm=100.0)
    # from 1499 mm at 500 mm/min, and the two ramps at 10 mm/s^2
    assert bench.clock.now_s() - begin_s == pytest.approx(1399 / 500 * 60 + 500 / 60 / 10, abs=1.0)


def test_pace_is_the_fastest_that_every_axis_allows(homed, rng):
    axes = homed.envelopes
    for scale in (0.5, 3.0, 300.0):
        for z, x in scale * rng.standard_normal((10, 2)):
            length = np.hypot(z, x)
            shares = {"z_mm": abs(z) / length, "x_mm": abs(x) / length}
            feed, duration_s = homed.pace({"z_mm": z, "x_mm": x})
            rates = [feed * share / min(axes[n].axis.feed_per_min, axes[n].rate_per_min) for n, share in shares.items()]
            assert max(rates) == pytest.approx(1)
            a = min(axes[name].acceleration_per_s2 / share for name, share in shares.items())
            v = min(feed / 60, np.sqrt(length * a))  # of a trapezoid, or of a triangle
            assert duration_s == pytest.approx(2 * v / a + (length - v**2 / a) / v)


def test_half_a_step_is_no_move(homed):
    resolution = homed.envelopes["z_mm"].resolution
    assert homed.pace({"z_mm": 0.49 * resolution, "x_mm": 0.0}) == (0.0, 0.0)
    feed, duration_s = homed.pace({"z_mm": -0.51 * resolution, "x_mm": 0.0})
    assert (feed, duration_s > 0) == (3000.0, True)


def test_with_hard_limits_the_travel_keeps_off_the_switches(make, twin, bench):
    twin.settings[21] = 1
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.travel()["z_mm"] == Travel(1.0, 1499.0)
    with pytest.raises(OutsideTravel):
        stage.move_to(z_mm=1500.0)
    stage.link.command("$J=G53 G90 X0 F3000", 5.0)
    with pytest.raises(Alarm, match="hard limit"):  # what would have happened
        stage.link.pause(5.0)
    stage.home()
    stage.move_to(z_mm=100.0)


@pytest.mark.parametrize("bits", [1, 3, 5, 9, 17])
def test_every_way_grblhal_has_to_switch_homing_on(make, bench, bits):
    rebuilt(bench, variant="grblHAL", settings={22: bits, 27: 0})
    goes_everywhere(make(), bench)


def test_grblhal_moves_after_a_line_that_was_wrong(make, bench):
    rebuilt(bench, variant="grblHAL")
    stage = make()
    stage.connect()
    stage.home()
    with pytest.raises(Rejected, match="unsupported"):
        stage.link.command("G5 X1")
    stage.move_to(z_mm=100.0)  # it would refuse this with the same error


def test_a_machine_space_from_zero_upwards(make, bench):
    # built to make its homing place the origin, homing to the low end
    rebuilt(bench, options="Z", settings={23: 7, 27: 0})
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.link.report().machine[0] == pytest.approx(1500.0)


def test_a_space_that_homing_contradicts_is_refused_and_can_be_configured(make, bench):
    twin = rebuilt(bench, settings={23: 7, 27: 0})
    twin.motion.forced_origin = True  # and does not report it
    stage = make([GrblAxis("z_mm", "X", 3000.0, travel=1500.0, space=(-1500.0, -1.0))])
    stage.connect()
    with pytest.raises(BadConfiguration, match=r"z_mm stands at machine position 0 after homing.*set `space`"):
        stage.home()
    assert not stage.condition().usable
    stage.close()
    goes_everywhere(make([GrblAxis("z_mm", "X", 3000.0, space=(0.0, 1500.0))]), bench)


def test_fluidnc_reports_its_ends_in_its_configuration(make, bench):
    twin = rebuilt(bench, variant="FluidNC", options="Z", settings={23: 7, 27: 0, 1: 25})
    twin.job = "SD:12.50,/jobs/a part.nc"
    stage = make()
    goes_everywhere(stage, bench)
    assert stage.envelopes["z_mm"].low == 0.0
    assert "let go 25 ms" in stage.condition().caveat.reason


def test_a_lamp_that_a_reset_has_switched_off_reports_it(make, bench):
    rebuilt(bench)
    stage = make()
    stage.connect()
    stage.home()
    light = GrblLight(stage.link, clock=bench.clock, owns_link=False)
    light.connect()
    light.set_level(0.5)
    assert light.level() == 0.5
    stage.emergency_stop()
    bench.clock.sleep(1.0)
    assert light.level() == 0.0
    assert "a reset of the controller ended its 50 %" in light.condition().word
    assert light.condition().remedy == "set the level again"
    stage.home()
    light.set_level(0.5)
    assert light.level() == 0.5
    assert light.condition().usable


@pytest.mark.parametrize(
    ("settings", "needed_s"),
    [
        # Y goes as slowly as X, with which it homes; a switch is searched for in 1.5 travels
        ({110: 100.0}, 1.5 * 1000 / 100 * 60),
        # on grblHAL Z does, too; three slow searches, each of ten pull-offs
        ({44: 7.0, 110: 100.0, 24: 10.0, 27: 2.0, 43: 3.0}, 1.5 * 1000 / 100 * 60 + 3 * 10 * 2 / 10 * 60),
        # GRBL's slow search of five pull-offs, for Z and for X with Y
        ({24: 1.0}, 2 * 5 * 1 / 1 * 60),
    ],
)
def test_homing_has_the_time_that_the_firmware_takes_until_it_gives_up_itself(settings, needed_s):
    quick = {**{110 + i: 3000.0 for i in range(3)}, 24: 300.0, 25: 3000.0, 27: 1.0}
    limit_s = Controls(quick | settings).homing_limit_s({0: 10.0, 1: 1000.0, 2: 40.0})
    assert needed_s < limit_s < 4 * needed_s


@pytest.mark.parametrize(
    ("settings", "lengths", "limit_s"),
    [
        # 1.5 travels to find the switch and 1 back, at 10 mm/s: 25 s; twelve pull-offs of 1 mm at 1 mm/s
        ({25: 600.0, 24: 60.0, 27: 1.0, 110: 6000.0}, {0: 100.0}, 2 * 25 + 12 + 10),
        ({}, {0: 100.0}, 60 * (5 * 100 / 500 + 12 / 25) + 10),  # GRBL's own settings
        ({110: 100.0}, {0: 100.0, 1: 50.0, 2: 10.0}, 60 * (5 * 100 / 100 + 5 * 10 / 500 + 2 * 12 / 25) + 10),
        # Z, then X with Y, then each of the others; on grblHAL as $44 to $49 say
        ({}, {i: 100.0 * (i + 1) for i in range(6)}, 60 * (5 * (300 + 200 + 400 + 500 + 600) / 500 + 5 * 12 / 25) + 10),
        ({44: 1.0, 50: 2.0}, {0: 100.0, 1: 50.0}, 60 * (5 * 100 / 500 + 12 / 25) + 10),
        ({27: 2.0, 43: 3.0, 45: 1.0}, {0: 100.0, 1: 50.0}, 60 * (5 * 100 / 500 + 3 * 12 * 2 / 25) + 10),
    ],
)
def test_homing_has_twice_the_way_there_and_back_and_ten_seconds(settings, lengths, limit_s):
    assert Controls(settings).homing_limit_s(lengths) == pytest.approx(limit_s)


def test_homing_has_the_time_of_an_axis_whose_travel_is_configured(make, twin):
    for number in (130, 131, 132):
        del twin.settings[number]
    stage = make([GrblAxis("z_mm", "X", 3000.0, travel=1500.0, space=(200.0, 1700.0))])
    stage.connect()
    assert stage._homing_limit_s() == stage.link.controls.homing_limit_s({0: 1500.0})


HARD, DOWN, ORIGIN = {21: 1.0, 27: 1.5}, {23: 4.0}, {22: 9.0}
"""Hard limits with a pull-off; the third axis homes to its low end; homing sets the origin."""


@pytest.mark.parametrize(
    ("controls", "ends", "travel"),
    [
        (Controls({}), (-300.0, 0.0), (0.0, 300.0)),
        (Controls({21: 1.0}), (-300.0, 0.0), (0.0, 300.0)),
        (Controls({132: 80.0}), (-80.0, 0.0), (0.0, 80.0)),
        (Controls({27: 1.5, **DOWN}), (-300.0, 0.0), (0.0, 300.0)),
        (Controls(HARD), (-300.0, 0.0), (1.5, 298.5)),
        (Controls(HARD | ORIGIN), (-300.0, 0.0), (3.0, 300.0)),
        (Controls(HARD | ORIGIN | DOWN), (0.0, 300.0), (0.0, 297.0)),
        (Controls(HARD | DOWN, "VZ"), (0.0, 300.0), (0.0, 297.0)),
        (Controls(HARD | ORIGIN | {23: 3.0}), (-300.0, 0.0), (3.0, 300.0)),
        (Controls(HARD | ORIGIN | DOWN, spaces={2: (20.0, -60.0)}), (-60.0, 20.0), (1.5, 78.5)),
        (Controls(HARD | ORIGIN | DOWN, spaces={0: (20.0, -60.0)}), (0.0, 300.0), (0.0, 297.0)),
    ],
)
def test_ends_and_travel_of_an_axis_follow_from_the_settings(controls, ends, travel):
    for direction in (1, -1):
        axis = GrblAxis("y_mm", "Z", 900.0, travel=300.0, direction=direction)
        found = envelope(axis, 2, controls)
        assert (found.low, found.high) == ends
        length = ends[1] - ends[0]
        seen = travel if direction > 0 else (length - travel[1], length - travel[0])
        assert found.travel == Travel(*seen)
        assert str(found.to_user(found.zero)) == "0.0"  # not -0.0
        assert found.to_machine(found.to_user(ends[0] + 7.0)) == ends[0] + 7.0
        assert found.homed_inside(ends[0] - 0.003) == found.homed_inside(ends[1] + 0.003) is True
        assert found.homed_inside(ends[0] - 0.005) == found.homed_inside(ends[1] + 0.005) is False


def test_rates_of_an_axis_are_the_controllers_or_else_its_own():
    def rates(settings):
        one = envelope(GrblAxis("y_mm", "Z", 900.0, travel=300.0), 2, Controls(settings))
        return one.rate_per_min, one.acceleration_per_s2, one.resolution

    assert rates({}) == (900.0, 10.0, 1 / 250)
    assert rates({112: 500.0, 122: 40.0, 102: 800.0}) == (500.0, 40.0, 1 / 800)
    assert rates({102: 4000.0})[2] == 0.001  # the digits of a report
