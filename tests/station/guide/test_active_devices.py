"""What the devices of a run report of themselves."""

from drivers.errors import EmergencyStopped
from station.guide.active_devices import ActiveDevices


def test_a_stage_that_is_reset_while_it_is_asked_has_no_position(bench):
    bench.connect()
    rig = ActiveDevices(bench)
    rig.home()
    assert "z_mm" in rig.snapshot().axes
    cable, position = bench.simulated.cables["stage"], bench.stage.position

    def asked():
        cable.happen(cable.device.restart)
        return position()

    bench.stage.position = asked
    snapshot = rig.snapshot()
    assert "z_mm" not in snapshot.axes
    assert "restarted" in snapshot.silent["stage"]


def test_a_lamp_is_switched_off_again_where_a_stop_ended_the_wait_for_its_reply(bench):
    bench.connect()
    bench.light.set_level(1.0)
    ask, failures = bench.light._ask, [EmergencyStopped("emergency stop", "set the level again")]

    def asked(*words):
        if failures:
            raise failures.pop()
        return ask(*words)

    bench.light._ask = asked
    ActiveDevices(bench).extinguish()
    assert bench.light.level() == 0.0
