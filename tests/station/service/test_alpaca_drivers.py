"""The drivers of Alpaca's devices at the bench's own server: what every stage, camera, light and shutter promises."""

import socket
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from drivers.alpaca.link import AlpacaAddress, AlpacaLink, AlpacaProbe
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.alpaca.switch import AlpacaLight, AlpacaShutter, AlpacaSwitch
from drivers.errors import (
    BadConfiguration,
    DeviceError,
    EmergencyStopped,
    Held,
    LineLost,
    MoveFailed,
    NoAnswer,
    NoReading,
    NotHomed,
    Rejected,
)
from drivers.interfaces import ProbeReading
from station.bench.opening import make_bench

from .alpaca_clients import beside
from .serving import TOKEN

AXES = [AlpacaAxis("z_mm", 0, zero=300.0, home="Home"), AlpacaAxis("x_mm", 1, direction=-1, home="Home")]


@pytest.fixture
def stage(at):
    stage = AlpacaStage(at, AXES)
    assert "stage z_mm" in stage.connect().model
    yield stage
    stage.close()


@pytest.fixture
def homed(stage):
    stage.home()
    return stage


@pytest.fixture
def held_up(served, monkeypatch):
    """The bench's stage moves and does not arrive until it is let go or stopped."""
    moving, go_on, requested = threading.Event(), threading.Event(), []
    stage = served.bench.stage
    stop = stage.stop

    def move(**target):
        requested.append(target)
        moving.set()
        go_on.wait()
        raise MoveFailed("z_mm was stopped on its way", "move again")

    def halt():
        go_on.set()
        stop()

    monkeypatch.setattr(stage, "move_to", move)
    monkeypatch.setattr(stage, "stop", halt)
    yield SimpleNamespace(moving=moving, halted=go_on, requested=requested)
    go_on.set()


def test_a_pause_at_the_door_is_held_and_ended_by_resume(homed, served):
    twin, cable = served.bench.simulated.devices["stage"], served.bench.simulated.cables["stage"]
    cable.happen(lambda now_s: twin.door(True, now_s))
    with pytest.raises(Held, match="paused at the door"):
        homed.move_to(x_mm=-10.0)
    with pytest.raises(Held, match="paused at the door"):
        homed.resume()
    cable.happen(lambda now_s: twin.door(False, now_s))
    homed.resume()
    homed.move_to(x_mm=-10.0)
    assert homed.position()["x_mm"] == pytest.approx(-10.0, abs=2e-3)  # two steps


def test_it_goes_where_it_is_sent_and_the_bench_agrees(homed, served):
    there = served.bench.stage
    low, high = there.travel()["z_mm"].low, there.travel()["z_mm"].high
    assert homed.travel()["z_mm"].low == 300.0
    assert homed.travel()["z_mm"].high == pytest.approx(300.0 + high - low, abs=0.002)  # whole steps of 1 um
    assert homed.travel()["x_mm"].high == 0.0  # it counts the other way
    homed.move_to(z_mm=500.25, x_mm=-7.5)  # the server moves one at a time
    assert homed.position() == pytest.approx({"z_mm": 500.25, "x_mm": -7.5}, abs=0.002)
    assert there.position()["z_mm"] == pytest.approx(low + 200.25, abs=0.002)
    assert there.position()["x_mm"] == pytest.approx(there.travel()["x_mm"].low + 7.5, abs=0.002)
    assert not homed.moving()


def test_after_a_stop_the_other_axis_is_not_sent(homed, held_up, monkeypatch):
    # the server moves one at a time: the second axis, which it has refused, waits for the first one
    refused, finish = threading.Event(), homed._finish

    def wait(parts, epoch):
        refused.set()
        finish(parts, epoch)

    monkeypatch.setattr(homed, "_finish", wait)
    thread, outcome = beside(lambda: homed.move_to(z_mm=400.0, x_mm=-5.0))
    held_up.moving.wait()
    refused.wait()
    homed.stop()
    thread.join()
    assert isinstance(outcome[0], DeviceError)
    assert len(held_up.requested) == 1


def test_an_axis_that_is_not_where_it_was_sent_is_halted_before_that_is_reported(homed, held_up, monkeypatch):
    # as if it said too early that it stands
    monkeypatch.setattr(homed, "_finish", lambda parts, epoch: held_up.moving.wait())
    with pytest.raises(MoveFailed, match="z_mm stopped"):
        homed.move_to(z_mm=400.0)
    assert held_up.halted.is_set()


def test_homing_that_is_not_answered_is_halted(homed, held_up, monkeypatch):
    late = NoAnswer("focuser 0 did not answer in time", "look at its server")
    monkeypatch.setattr(homed, "_order", Mock(side_effect=late))
    with pytest.raises(NoAnswer):
        homed.home()
    assert held_up.halted.is_set()


def test_the_stop_passes_a_request_that_is_not_answered(homed, held_up, monkeypatch):
    ask, asked = AlpacaLink._ask, threading.Event()

    def hang(link, method, member, *rest):
        if member == "ismoving":
            asked.set()
            held_up.halted.wait()
        return ask(link, method, member, *rest)

    monkeypatch.setattr(AlpacaLink, "_ask", hang)
    thread, outcome = beside(lambda: homed.move_to(z_mm=400.0))
    asked.wait()
    homed.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)


def test_a_move_whose_end_cannot_be_asked_is_halted_and_the_stage_must_be_connected_again(homed, held_up, monkeypatch):
    ask = AlpacaLink._ask

    def lose(link, method, member, *rest):
        if member == "ismoving":
            held_up.moving.wait()
            raise ConnectionResetError
        return ask(link, method, member, *rest)

    monkeypatch.setattr(AlpacaLink, "_ask", lose)
    with pytest.raises(LineLost, match="cannot be reached"):
        homed.move_to(z_mm=400.0)
    assert held_up.halted.is_set()
    assert homed.condition().word == "not connected"
    monkeypatch.setattr(AlpacaLink, "_ask", ask)
    homed.connect()
    with pytest.raises(NotHomed):
        homed.move_to(z_mm=400.0)


def test_what_a_server_says_no_to_is_reported(homed, served):
    with served.tenancy.held("a run"), pytest.raises(Rejected, match="in use by a run; wait until"):
        homed.move_to(z_mm=400.0)


def test_positions_are_trusted_where_nothing_homes(at, homed):
    believing = AlpacaStage(at, [AlpacaAxis("z_mm", 0)])
    believing.connect()
    believing.home()
    assert believing.position()["z_mm"] == pytest.approx(homed.position()["z_mm"] - 300.0, abs=0.002)


def test_a_server_that_is_not_there_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        stage = AlpacaStage(AlpacaAddress(f"127.0.0.1:{taken.getsockname()[1]}"), AXES)
        with pytest.raises(LineLost, match=r"focuser 0 at 127\.0\.0\.1:\d+ cannot be reached"):
            stage.connect()
    assert not stage.condition().usable
    with pytest.raises(LineLost, match="connect first"):
        stage.position()


@pytest.mark.parametrize(
    ("variable", "words"),
    [("", "requires a password"), ("NO_SUCH_TOKEN", "NO_SUCH_TOKEN in the environment must hold")],
)
def test_a_password_that_is_missing_is_reported(at, variable, words):
    with pytest.raises(BadConfiguration, match=words):
        AlpacaLink(AlpacaAddress(at.address, variable), "focuser", 0).open()


def test_a_device_that_is_not_there_is_reported(at):
    with pytest.raises(Rejected, match="there is no device focuser/7; there are camera/0"):
        AlpacaLink(at, "focuser", 7).open()


def test_a_light_on_a_switch(at, served):
    light = AlpacaLight(AlpacaSwitch(at, 0, 0))
    assert "light" in light.connect().model
    for level in (0.25, 1.0, 0.0):
        light.set_level(level)
        assert light.level() == served.bench.light.level() == level
    with pytest.raises(BadConfiguration, match=r"must be in 0 \.\. 1"):
        light.set_level(1.5)
    light.emergency_stop()
    assert light.condition().usable


def test_a_shutter_on_a_switch(at, served):
    shutter = AlpacaShutter(AlpacaSwitch(at, 0, 2))  # the half-press: a contact that stays as it is set
    shutter.connect()
    reply = []
    contact = served.bench.shutter
    press, contact.focus = contact.focus, lambda pressed: (reply.append(pressed), press(pressed))
    times = shutter.fire(0.05)
    assert reply == [True, False]
    assert times.released_s - times.closed_s >= 0.05
    thread, outcome = beside(lambda: shutter.fire(60.0))
    while reply.count(True) < 2:
        threading.Event().wait(0.005)
    shutter.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)
    assert reply[-1] is False
    with pytest.raises(Rejected, match="no focus contact"):
        shutter.focus(True)


def test_a_contact_whose_closing_was_not_acknowledged_is_opened(at, served, monkeypatch):
    shutter, pressed = AlpacaShutter(AlpacaSwitch(at, 0, 2)), []
    shutter.connect()
    press, ask = served.bench.shutter.focus, AlpacaLink._ask
    served.bench.shutter.focus = lambda down: (pressed.append(down), press(down))

    def lose(link, method, member, values, timeout_s):
        reply = ask(link, method, member, values, timeout_s)
        if "State=True" in values:
            raise ConnectionResetError
        return reply

    monkeypatch.setattr(AlpacaLink, "_ask", lose)
    with pytest.raises(LineLost, match="cannot be reached"):
        shutter.fire(0.05)
    assert pressed == [True, False]
    assert not shutter.condition().usable


@pytest.mark.parametrize(("switch", "words"), [(4, "distance at .* is read only"), (5, "has 5 switches; number 5")])
def test_a_switch_that_cannot_be_one_is_refused(at, switch, words):
    with pytest.raises(BadConfiguration, match=words):
        AlpacaLight(AlpacaSwitch(at, 0, switch)).connect()


@pytest.mark.slow
def test_a_bench_of_another_bench(client, served, tmp_path, at):
    address = {"server": f"127.0.0.1:{client.port}", "password_variable": "BENCH_TOKEN"}
    (tmp_path / "here").mkdir()
    tables = {
        "stage": {"driver": "alpaca_stage", **address, "axes": [{"name": "z_mm", "focuser": 0, "home": "Home"}]},
        "shutter": {"driver": "alpaca_shutter", **address, "switch": 1},
        "camera": {"driver": "alpaca_camera", **address, "folder": "here", "exposure_s": 0.02, "lens": "L"},
        "light": {"driver": "alpaca_light", **address, "switch": 0, "warm_up_s": 1.0},
    }
    bench = make_bench(tables, folder=tmp_path)
    try:
        bench.connect()
        bench.stage.home()
        bench.stage.move_to(z_mm=10.0)
        bench.light.set_level(0.5)
        assert bench.camera.expose().path.parent == tmp_path / "here"
        assert bench.shutter.fire(0.01)
        assert served.bench.light.level() == 0.5
        assert TOKEN not in str(tables)
    finally:
        bench.close()


def test_a_probe_reads_what_its_server_measures(at, served):
    probe = AlpacaProbe(at, 0, {"temperature": 0.3})
    assert probe.connect().model == "Alpaca room"
    readings = probe.read()
    assert readings["temperature"] == ProbeReading(served.bench.devices["room"].read()["temperature"].value, "°C", 0.3)
    assert readings["humidity"] == ProbeReading(45.2, "%")
    served.bench.simulated.devices["room"].unplugged = True
    with pytest.raises(NoReading, match="check sensor and range"):
        probe.read()
    probe.close()
    with pytest.raises(LineLost, match="connect first"):
        probe.read()
