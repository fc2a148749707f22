"""What the devices of a run report of themselves."""

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
