import os

import pytest

from drivers.errors import EmergencyStopped, LineLost, MoveFailed, NoAnswer, Rejected
from drivers.shutter import NullParser, RtsShutter
from drivers.transport import SerialTransport
from station.bench.opening import make_bench, simulated_tables


def test_the_clocks_differ_by_drift_and_start_alone(box, bench):
    bench.clock.sleep(3600.0)
    times = box.fire(0.1)
    # the twin's clock gains 72 ms in an hour; each shot compares the clocks anew
    assert bench.body.openings[0].begin_s - bench.body.settings.lag_s == pytest.approx(times.closed_s, abs=1e-4)


def test_a_busy_box_is_reported(box, bench):
    def second():
        bench.clock.sleep(0.5)
        box.command("SHOT 0 100")

    first, refused = bench.clock.together(lambda: box.fire(2.0), second)
    assert first.released_s - first.closed_s == pytest.approx(2.0, abs=1e-3)
    assert isinstance(refused, Rejected)
    assert refused.code == "ERR 3"


def test_a_box_that_restarts_in_a_shot_opens_its_contacts_and_is_noticed(box, bench):
    fired, _ = bench.clock.together(
        lambda: box.fire(4.0),
        lambda: (bench.clock.sleep(1.0), bench.cables["shutter"].happen(bench.devices["shutter"].restart)),
    )
    assert isinstance(fired, NoAnswer | MoveFailed)
    assert bench.clock.now_s() < 10.0


def test_a_contact_that_was_closed_for_another_time_is_an_error(box, bench):
    faults = bench.cables["shutter"].faults
    faults.spoil = lambda data, at_s: data.replace(b"SHOT 0 500", b"SHOT 0 50")  # a byte is lost on the way
    with pytest.raises(MoveFailed, match="closed for 50 ms instead of 500 ms; check the cable"):
        box.fire(0.5)


def test_a_silent_host_lets_go_of_the_contact(box, bench):
    box.command("BULB 60000")
    bench.clock.sleep(20.0)
    assert box._contacts[1, "WATCHDOG"] - box._contacts[1, "SHUTTER"] == pytest.approx(5e6, rel=1e-3)


def test_a_flash_reports_the_true_exposure(box, bench):
    times = box.fire(0.2)
    assert times.flash_s - times.closed_s == pytest.approx(bench.body.settings.lag_s, abs=1e-4)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_a_port_without_modem_lines_cannot_be_an_rts_shutter():
    master, slave = os.openpty()
    shutter = RtsShutter(SerialTransport(os.ttyname(slave), NullParser, rts=False))
    with pytest.raises(LineLost, match="has no modem lines"):
        shutter.connect()
    assert not shutter.condition().usable
    os.close(master)
    os.close(slave)


def test_opening_the_port_of_an_rts_shutter_takes_no_photograph(bench, wired):
    shutter = wired(RtsShutter, NullParser, "rts", line={"rts": False})
    shutter.connect()
    assert not bench.body.openings
    shutter.fire(0.1)
    assert len(bench.body.openings) == 1


@pytest.mark.parametrize(
    "driver", [{"driver": "rts"}, {"driver": "relay", "on": "stage"}], ids=lambda table: table["driver"]
)
@pytest.mark.parametrize("stop_s", [0.3, 1.5])
def test_no_contact_closes_after_an_emergency_stop_which_is_the_error_of_the_shot(bench, tmp_path, driver, stop_s):
    stage = simulated_tables(bench.address, tmp_path)["stage"]
    line = {"port": bench.address("rts")} if driver["driver"] == "rts" else {}
    opened = make_bench({"stage": stage, "shutter": driver | line}, folder=tmp_path, clock=bench.clock)
    opened.connect()
    opened.stage.home()  # a locked controller switches no relay
    stop = lambda: (bench.clock.sleep(stop_s), opened.emergency_stop())  # noqa: E731
    fired, _ = bench.clock.together(lambda: opened.shutter.fire(1.0, focus_s=1.0), stop)
    opened.close()
    assert isinstance(fired, EmergencyStopped)
    assert not bench.body.openings or stop_s > 1.0
