import gc
import hashlib
import os
import signal
import sys
import threading

import pytest

from drivers.errors import BadConfiguration, EmergencyStopped, NotConnected
from drivers.watchdog import in_background
from drivers.wire.connection import Transcript
from station.bench.motions import StopRecord, stops_on_wires
from station.bench.opening import inspect_raw, make_bench, read_config, simulated_bench, simulated_tables
from station.common.stop_signals import ENDING, TURN_S, closed_whole, guarded
from station.guide.active_devices import ActiveDevices


@pytest.fixture
def bench(tmp_path):
    bench = simulated_bench(tmp_path, virtual_time=True)
    yield bench
    bench.close()


def written(tmp_path, text):
    path = tmp_path / "station.toml"
    path.write_text(text)
    return path


def test_all_devices_of_the_simulated_bench_answer(bench):
    bench.connect()
    assert set(bench.identities) == set(bench.devices)


@pytest.mark.slow
def test_a_whole_measurement_through_interfaces_alone(bench):
    bench.connect()
    bench.stage.home()
    bench.head.home()
    bench.head.move_to(pan_deg=0.0, tilt_deg=0.0)
    bench.stage.move_to(z_mm=750.0, x_mm=150.0, y_mm=100.0)
    bench.light.set_level(1.0)
    bench.imu.start(100.0)
    assert bench.imu.read_block(1.0).lost == 0
    exposure = bench.camera.expose()
    assert inspect_raw(exposure.path).exposure_s == pytest.approx(0.02)
    # the laser's housing is 120 mm behind the principal plane; 0.6 mm of noise, the rail warm by less than a degree
    assert bench.devices["rangefinder"].measure().distance_mm == pytest.approx(800 + 750 + 120, abs=4.0)


def test_what_passes_on_each_wire_goes_into_a_file_until_it_is_reported_otherwise(bench, tmp_path):
    folder = tmp_path / "wire"
    folder.mkdir()
    bench.log_wires(folder)
    bench.connect()
    bench.light.set_level(1.0)
    bench.log_wires(None)
    size = (folder / "wire-light.txt").stat().st_size
    assert size > 0
    assert (folder / "wire-stage.txt").stat().st_size > 0
    bench.light.set_level(0.5)
    assert (folder / "wire-light.txt").stat().st_size == size


def test_every_loose_cable_is_named_at_once(bench, tmp_path):
    tables = simulated_tables(bench.simulated.address, tmp_path)
    tables["stage"]["port"] = "/dev/nowhere"
    tables["light"]["port"] = "usb:NOSUCH"
    broken = make_bench(tables, folder=tmp_path, clock=bench.clock)
    with pytest.raises(NotConnected, match="2 devices are not connected") as failed:
        broken.connect()
    assert set(failed.value.failures) == {"stage", "light"}
    assert "/dev/nowhere" in str(failed.value)
    assert broken.camera.condition().usable
    broken.close()


def test_a_device_may_be_named_before_the_one_it_needs(bench, tmp_path):
    tables = simulated_tables(bench.simulated.address, tmp_path)
    backwards = dict(reversed(tables.items()))
    assert list(make_bench(backwards, folder=tmp_path).devices).index("camera") > 0


def test_one_emergency_stop_reaches_all(bench):
    bench.connect()
    bench.stage.home()
    bench.head.home()
    bench.emergency_stop()
    bench.emergency_stop()
    for stage, goal in ((bench.stage, {"z_mm": 1.0}), (bench.head, {"pan_deg": 1.0})):
        with pytest.raises(EmergencyStopped):
            stage.move_to(**goal)


def test_relay_and_light_may_share_the_stages_controller(bench, tmp_path):
    tables = simulated_tables(bench.simulated.address, tmp_path)
    tables["shutter"] = {"driver": "relay", "on": "stage"}
    tables["light"] = {"driver": "grbl_light", "on": "stage", "pwm_hz": 1000.0}
    shared = make_bench(tables, folder=tmp_path, clock=bench.clock)
    shared.connect()
    shared.stage.home()
    shared.light.set_level(0.5)
    assert bench.simulated.world.lamp(1e9) == pytest.approx(0.5)
    assert shared.camera.expose().size_bytes > 0
    shared.close()


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(BadConfiguration, match="write one, or use --simulate"):
        read_config(tmp_path / "station.toml")


def test_a_device_that_is_not_configured_is_named(tmp_path):
    tables = read_config(written(tmp_path, '[devices.imu]\ndriver = "wit"\nport = "/dev/x"'))
    with pytest.raises(BadConfiguration, match=r"no device has the name stage; add \[devices.stage\]"):
        _ = make_bench(tables, folder=tmp_path).stage


def test_every_byte_is_logged_where_one_asks_for_it(bench, tmp_path):
    tables = {"imu": simulated_tables(bench.simulated.address, tmp_path)["imu"]}
    logged = make_bench(tables, folder=tmp_path, clock=bench.clock, wire_log=tmp_path)
    logged.connect()
    logged.close()
    lines = (tmp_path / "wire-imu.txt").read_text().splitlines()
    assert lines[0].split(maxsplit=2)[1:] == [">", repr(b"\xff\xaa'.\x00")]  # the question for its version
    assert any(" < " in line for line in lines)


def test_every_interrupt_stops_and_the_first_asks_what_runs_to_end():
    reported, stopped = [], threading.Event()
    with guarded(stopped.set, lambda: reported.append("ask")):
        os.kill(os.getpid(), signal.SIGINT)
        assert stopped.wait(10.0)
        assert reported == ["ask"]
        stopped.clear()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert stopped.wait(10.0)
    assert reported == ["ask"]


@pytest.mark.parametrize("number", [number for number in ENDING if number != signal.SIGINT])
def test_every_other_end_stops_and_ends_with_the_device_code(number):
    reported = []
    with pytest.raises(SystemExit) as ended, guarded(lambda: reported.append("stop"), lambda: None):
        os.kill(os.getpid(), number)
    assert "stop" in reported
    assert ended.value.code == 3


def test_closing_is_not_cut_short_by_a_second_signal():
    reported = []

    def close():
        os.kill(os.getpid(), signal.SIGTERM)
        reported.append("closed")

    with pytest.raises(SystemExit), closed_whole(close), guarded(lambda: None, lambda: None):
        os.kill(os.getpid(), signal.SIGTERM)
    assert reported == ["closed"]


def test_an_end_that_is_heard_where_errors_are_ignored_ends_all_the_same(monkeypatch):
    class Finalized:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGTERM)

    ignored = []
    monkeypatch.setattr(sys, "unraisablehook", lambda error: ignored.append(error.exc_type))
    with pytest.raises(SystemExit), guarded(lambda: None, lambda: None):
        Finalized()
    assert ignored == [SystemExit]


@pytest.mark.skipif(not hasattr(signal, "SIGTSTP"), reason="programs are not suspended here")
def test_what_is_suspended_stops_first(monkeypatch):
    reported = []
    monkeypatch.setattr(signal, "raise_signal", lambda number: reported.append(signal.getsignal(number)))
    before = signal.getsignal(signal.SIGTSTP)
    with guarded(lambda: reported.append("stop"), lambda: None):
        os.kill(os.getpid(), signal.SIGTSTP)
        assert reported[0] == "stop"
        assert signal.SIG_DFL in reported  # suspended by the system's own handler, after the stop
        os.kill(os.getpid(), signal.SIGTSTP)  # and again after it goes on
        assert reported.count(signal.SIG_DFL) == 2
    assert signal.getsignal(signal.SIGTSTP) == before


def test_a_stop_waits_for_no_search_for_garbage_among_all_that_is_loaded():
    # a search holds Python's lock: 29 ms of processor time for the 58 thousand objects of a guide
    loaded = [[] for _ in range(20_000)]
    gc.collect()
    with guarded(lambda: None, lambda: None):
        assert len(gc.get_objects()) < len(loaded)


@pytest.mark.slow
def test_a_stop_waits_for_no_computation_of_the_main_thread():
    # one long call in which the main thread takes no step of Python's, and so runs no handler of its own
    reported = []

    def compute():
        threading.Timer(0.05, lambda: os.kill(os.getpid(), signal.SIGTERM)).start()
        try:
            hashlib.pbkdf2_hmac("sha256", b"", b"", 1_000_000)
        finally:
            reported.append("computed")

    with pytest.raises(SystemExit), guarded(lambda: reported.append("stop"), lambda: None):
        compute()
    assert reported[:2] == ["stop", "computed"]


def test_guarding_shortens_the_turns_and_leaves_everything_as_it_was():
    def state():
        wakeup = signal.set_wakeup_fd(-1)
        signal.set_wakeup_fd(wakeup)
        return [*map(signal.getsignal, ENDING), sys.getswitchinterval(), wakeup]

    before, threads = state(), set(threading.enumerate())
    with guarded(lambda: None, lambda: None):
        assert sys.getswitchinterval() == pytest.approx(TURN_S)
        assert not set(state()) & set(before)
    assert state() == before
    assert set(threading.enumerate()) == threads


def test_an_exception_that_ends_the_program_stops():
    reported = []
    with pytest.raises(ZeroDivisionError), guarded(lambda: reported.append("stop"), lambda: None):
        raise ZeroDivisionError
    assert reported == ["stop"]


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up here")
def test_a_program_that_was_reported_not_to_mind_its_terminal_does_not():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with guarded(lambda: pytest.fail("stopped"), lambda: None):
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_no_device_waits_for_another_and_each_stop_has_its_time(bench):
    bench.connect()
    bench.stage.home()
    held = threading.Event()
    bench.devices["light"].emergency_stop = lambda: held.wait(30.0)
    bench.emergency_stop()
    held.set()
    (stop,) = bench.stops_since(0)
    assert {"stage", "head", "shutter"} <= set(stop.wires)
    assert all(at_s is not None and at_s >= stop.asked_s for at_s in stop.wires.values())
    after_ms = {name: pytest.approx(1000 * (at_s - stop.asked_s), abs=0.001) for name, at_s in stop.wires.items()}
    assert stop.record() == {"asked_s": stop.asked_s, "on_the_wire_s": stop.wires, "after_ms": after_ms}


def test_no_thread_of_a_device_or_a_stop_holds_the_program_at_its_end(bench, monkeypatch):
    start, started = threading.Thread.start, []
    monkeypatch.setattr(threading.Thread, "start", lambda thread: (started.append(thread), start(thread)))
    with guarded(bench.emergency_stop, lambda: None):
        bench.connect()
        in_background(bench.emergency_stop)
    assert {"signals", "stop", "heartbeat"} <= {thread.name for thread in started}
    assert [thread.name for thread in started if not thread.daemon] == []


def test_a_wire_that_took_no_stop_is_named(bench):
    bench.connect()
    bench.stage.link._transport._port.close()
    bench.emergency_stop()
    (stop,) = bench.stops_since(0)
    assert stop.wires["stage"] is None
    assert stop.wires["head"] is not None


def test_a_stop_has_the_times_at_which_its_own_bytes_went_out():
    wires = {name: Transcript() for name in ("stage", "head", "light")}
    entries = {"stage": [(1.0, "!"), (2.0, ">"), (3.5, "x"), (4.0, "!"), (5.0, "!")], "head": [(3.0, "x"), (3.1, "<")]}
    for name, passed in entries.items():
        for time_s, way in passed:
            wires[name].record(time_s, way, b"!")
    stops = [StopRecord(1.0), StopRecord(3.0)]
    stops[0].done.set()
    late = (1.5, "!", b"!")
    threading.Timer(0.05, lambda: (wires["light"].record(*late), stops[1].done.set())).start()  # it is still under way
    first, second = stops_on_wires(stops, wires)
    assert (first.asked_s, first.wires) == (1.0, {"stage": 1.0, "head": None, "light": 1.5})
    assert (second.asked_s, second.wires) == (3.0, {"stage": 4.0, "head": None})
    assert second.record()["after_ms"] == {"stage": 1000.0, "head": None}


def test_nothing_homes_after_a_stop_that_came_before(bench):
    bench.connect()
    rig = ActiveDevices(bench)
    bench.emergency_stop()
    with pytest.raises(EmergencyStopped, match="everything was stopped"):
        rig.home()
    assert not bench.simulated.world.axes["z_mm"].moves(bench.clock.now_s())
    ActiveDevices(bench).home()


def test_an_interrupt_stops_a_move_that_the_main_thread_waits_for(tmp_path):
    # the lock that the main thread waits with must not keep the handler from stopping
    bench = simulated_bench(tmp_path)
    bench.stage.connect()
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGTERM))
    timer.start()
    with pytest.raises(SystemExit), guarded(bench.emergency_stop, lambda: None):
        bench.stage.home()
    timer.join()
    assert not bench.simulated.world.axes["z_mm"].moves(bench.clock.now_s())
    bench.close()
