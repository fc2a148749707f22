"""The drivers of Alpaca's devices at the bench's own server: what every stage, camera, light and shutter promises."""

from __future__ import annotations

import socket
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.alpaca.camera import AlpacaCamera, AlpacaCameraSettings
from drivers.alpaca.link import HEADER, AlpacaLink, AlpacaServer, read_image
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.alpaca.switch import AlpacaLight, AlpacaShutter, AlpacaSwitch
from drivers.errors import (
    BadConfiguration,
    DeviceError,
    EmergencyStopped,
    FrameMissing,
    FrameWrong,
    LineLost,
    MoveFailed,
    NotHomed,
    OutsideTravel,
    Rejected,
)
from drivers.frame_files.dng_folder import DngFolder, Optics
from drivers.interfaces import CameraSettings
from procedures.raw import read_frame
from station.bench.opening import inspect_raw, make_bench
from station.service.alpaca.image import image_bytes, sensor_image

from .serving import TOKEN

AXES = [AlpacaAxis("z_mm", 0, zero=300.0, home="Home"), AlpacaAxis("x_mm", 1, direction=-1, home="Home")]


@pytest.fixture
def server(server, monkeypatch):
    """The server with its password in the environment."""
    monkeypatch.setenv("BENCH_TOKEN", TOKEN)
    return server


@pytest.fixture
def at(client):
    return AlpacaServer(f"127.0.0.1:{client.port}", "BENCH_TOKEN")


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


def beside(work):
    """Do this in a thread; what it raised stands in the list when it has ended."""
    outcome = []

    def run():
        try:
            outcome.append(work())
        except Exception as error:
            outcome.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, outcome


@pytest.fixture
def held_up(served, monkeypatch):
    """The bench's stage moves and does not arrive until it is let go or stopped."""
    moving, go_on, asked = threading.Event(), threading.Event(), []
    stage = served.bench.stage
    stop = stage.stop

    def move(**target):
        asked.append(target)
        moving.set()
        go_on.wait()
        raise MoveFailed("z_mm was stopped on its way", "move again")

    def halt():
        go_on.set()
        stop()

    monkeypatch.setattr(stage, "move_to", move)
    monkeypatch.setattr(stage, "stop", halt)
    yield SimpleNamespace(moving=moving, halted=go_on, asked=asked)
    go_on.set()


# --- stage ---------------------------------------------------------------------------------------------------------


def test_it_does_not_move_before_homing(stage):
    with pytest.raises(NotHomed):
        stage.move_to(z_mm=400.0)
    assert not stage.condition().usable


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
    for value in (299.9, 1e6, float("nan")):
        with pytest.raises(OutsideTravel, match="choose a target inside"):
            homed.move_to(z_mm=value)
    with pytest.raises(BadConfiguration, match="there is no axis nowhere_mm"):
        homed.move_to(nowhere_mm=1.0)


def test_stop_ends_a_move(homed, held_up):
    thread, outcome = beside(lambda: homed.move_to(z_mm=400.0))
    held_up.moving.wait()
    with pytest.raises(Rejected, match="already moving"):
        homed.move_to(z_mm=350.0)
    homed.stop()
    thread.join()
    assert isinstance(outcome[0], DeviceError)
    assert "stopped" in outcome[0].reason


def test_after_a_stop_the_other_axis_is_not_sent(homed, held_up):
    # the server moves one at a time: the second axis waits for the first one
    thread, outcome = beside(lambda: homed.move_to(z_mm=400.0, x_mm=-5.0))
    held_up.moving.wait()
    homed.stop()
    thread.join()
    assert isinstance(outcome[0], DeviceError)
    assert len(held_up.asked) == 1


def test_an_emergency_stop_ends_a_move_and_holds_until_homed(homed, held_up):
    thread, outcome = beside(lambda: homed.move_to(z_mm=400.0))
    held_up.moving.wait()
    homed.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)
    with pytest.raises(EmergencyStopped, match="then home"):
        homed.move_to(z_mm=400.0)
    homed.home()
    assert homed.condition().usable


def test_the_stop_passes_a_request_that_is_not_answered(homed, held_up):
    """The client's lock is everybody's: somebody hangs in it, as at a server that does not answer."""
    from alpaca.device import Device

    beside(lambda: homed.move_to(z_mm=400.0))
    held_up.moving.wait()
    with Device._ctid_lock:
        homed.emergency_stop()
        held_up.halted.wait()
    assert not homed.condition().usable


def test_a_stop_is_sent_again_where_it_was_not_answered(monkeypatch):
    sent = []

    def ask(self, method, member, form, timeout_s):
        sent.append((method, member))
        if len(sent) < 3:
            raise ConnectionResetError
        return "", b""

    monkeypatch.setattr(AlpacaLink, "_ask", ask)
    AlpacaLink(AlpacaServer("127.0.0.1:1"), "focuser", 0).shout("halt")
    assert sent == [("PUT", "halt")] * 3


def test_what_a_server_says_no_to_is_told(homed, served):
    with served.tenancy.held("a run"), pytest.raises(Rejected, match="taken by a run; wait until"):
        homed.move_to(z_mm=400.0)


def test_positions_are_believed_where_nothing_homes(at, homed):
    believing = AlpacaStage(at, [AlpacaAxis("z_mm", 0)])
    believing.connect()
    believing.home()
    assert believing.position()["z_mm"] == pytest.approx(homed.position()["z_mm"] - 300.0, abs=0.002)


# --- servers that are not as they should be ------------------------------------------------------------------------


def test_a_server_that_is_not_there_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        stage = AlpacaStage(AlpacaServer(f"127.0.0.1:{taken.getsockname()[1]}"), AXES)
        with pytest.raises(LineLost, match=r"focuser 0 at 127\.0\.0\.1:\d+ cannot be reached"):
            stage.connect()
    assert not stage.condition().usable
    with pytest.raises(LineLost, match="connect first"):
        stage.position()


@pytest.mark.parametrize(
    ("variable", "words"), [("", "wants a password"), ("NO_SUCH_TOKEN", "NO_SUCH_TOKEN in the environment is to hold")]
)
def test_a_password_that_is_missing_is_said(at, variable, words):
    with pytest.raises(BadConfiguration, match=words):
        AlpacaLink(AlpacaServer(at.address, variable), "focuser", 0).open()


def test_a_device_that_is_not_there_is_said(at):
    with pytest.raises(Rejected, match="there is no device focuser/7; there are camera/0"):
        AlpacaLink(at, "focuser", 7).open()


# --- camera --------------------------------------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path):
    folder = tmp_path / "saved"
    folder.mkdir()
    return DngFolder(folder, inspect_raw, Optics(f_number=5.6, pixel_pitch_um=3.45))


@pytest.fixture
def camera(at, saved):
    camera = AlpacaCamera(at, 0, saved, AlpacaCameraSettings(exposure_s=0.02, patience_s=20.0))
    camera.connect()
    yield camera
    camera.close()


def test_an_exposure_is_a_file_with_the_sensors_numbers_and_its_record(camera, served):
    exposure = camera.expose()
    (source,) = served.bench.simulated.folder.iterdir()
    theirs, ours = (sensor_image(list(read_frame(path).planes.values())) for path in (source, exposure.path))
    np.testing.assert_array_equal(ours.levels, theirs.levels)
    assert ours.red == theirs.red
    assert ours.white == theirs.white
    told = read_frame(exposure.path).exposure
    assert told.exposure_s == pytest.approx(0.02)
    assert told.f_number == 5.6
    assert exposure.requested_s < exposure.received_s


def test_an_exposure_that_fails_at_the_server_is_told(camera):
    camera.configure(CameraSettings(exposure_s=0.5))
    with pytest.raises(Rejected, match=r"taken at 0\.02 s instead of 0\.5 s; set the body, repeat"):
        camera.expose()


def test_an_exposure_whose_failure_the_server_does_not_tell_ends_soon(camera, monkeypatch):
    from alpaca.camera import Camera, CameraStates

    monkeypatch.setattr(Camera, "ImageReady", property(lambda self: False))
    monkeypatch.setattr(Camera, "CameraState", property(lambda self: CameraStates.cameraError))
    with pytest.raises(FrameMissing, match="says that its exposure failed"):
        camera.expose()


@pytest.fixture
def slow_camera(served, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()
    expose = served.bench.camera.expose

    def slow():
        begun.set()
        go_on.wait()
        return expose()

    monkeypatch.setattr(served.bench.camera, "expose", slow)
    yield begun
    go_on.set()


def test_an_emergency_stop_ends_an_exposure(camera, slow_camera):
    thread, outcome = beside(camera.expose)
    slow_camera.wait()
    camera.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)


def test_an_image_that_never_comes_is_an_error_within_the_deadline(at, saved, slow_camera):
    camera = AlpacaCamera(at, 0, saved, AlpacaCameraSettings(exposure_s=0.02, patience_s=0.2))
    camera.connect()
    begin_s = time.monotonic()
    with pytest.raises(FrameMissing, match=r"no image 0\.2 s after its exposure"):
        camera.expose()
    assert time.monotonic() - begin_s >= 0.2


@pytest.mark.parametrize("kind", ["<i2", "<i4", "u1", "<u2", "<u4"])
def test_images_come_in_every_type_of_whole_numbers(kind):
    truth = np.arange(6).reshape(2, 3).astype(kind)
    number = {"<i2": 1, "<i4": 2, "u1": 6, "<u2": 8, "<u4": 9}[kind]
    data = HEADER.pack(1, 0, 0, 0, HEADER.size, 2, number, 2, 3, 2, 0) + truth.T.tobytes()
    np.testing.assert_array_equal(read_image("application/imagebytes", data), truth)


def test_an_image_in_json_is_read_too():
    truth = np.array([[1, 2, 3], [4, 5, 70000]])
    data = b'{"ErrorNumber": 0, "Type": 2, "Rank": 2, "Value": [[1, 4], [2, 5], [3, 70000]]}'
    np.testing.assert_array_equal(read_image("application/json", data), truth)


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        ("application/json", b'{"ErrorNumber": 1035, "ErrorMessage": "no image"}'),
        ("application/json", b'{"ErrorNumber": 0, "Value": [[[1]]]}'),
        ("application/json", b"{}"),
        ("application/imagebytes", b"short"),
        ("application/imagebytes", HEADER.pack(1, 1035, 0, 0, 44, 0, 0, 0, 0, 0, 0) + b"no image"),
        ("application/imagebytes", HEADER.pack(1, 0, 0, 0, 44, 2, 3, 2, 1, 1, 0) + bytes(8)),
        ("application/imagebytes", image_bytes(np.zeros((4, 4), np.uint16), 0, 0)[:-2]),
    ],
)
def test_what_is_no_image_is_refused(client, at, monkeypatch, kind, data):
    link = AlpacaLink(at, "camera", 0)
    monkeypatch.setattr(link, "_ask", lambda *_: (kind, data))
    with pytest.raises(Rejected, match="sent no image"):
        link.image(1.0)


def test_numbers_that_no_file_holds_are_refused(camera, monkeypatch):
    monkeypatch.setattr(AlpacaLink, "image", lambda self, timeout_s: np.array([[0, 70000]]))
    with pytest.raises(FrameWrong, match="sent 2 x 1 numbers from 0 to 70000"):
        camera.expose()


# --- light and shutter ---------------------------------------------------------------------------------------------


def test_a_light_on_a_switch(at, served):
    light = AlpacaLight(AlpacaSwitch(at, 0, 0))
    assert "light" in light.connect().model
    for level in (0.25, 1.0, 0.0):
        light.set_level(level)
        assert light.level() == served.bench.light.level() == level
    with pytest.raises(BadConfiguration, match=r"outside 0 \.\. 1"):
        light.set_level(1.5)
    light.emergency_stop()
    assert light.condition().usable


def test_a_shutter_on_a_switch(at, served):
    shutter = AlpacaShutter(AlpacaSwitch(at, 0, 2))  # the half-press: a contact that stays as it is set
    shutter.connect()
    told = []
    contact = served.bench.shutter
    press, contact.focus = contact.focus, lambda pressed: (told.append(pressed), press(pressed))
    times = shutter.fire(0.05)
    assert told == [True, False]
    assert times.released_s - times.closed_s >= 0.05
    thread, outcome = beside(lambda: shutter.fire(60.0))
    while told.count(True) < 2:
        threading.Event().wait(0.005)
    shutter.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)
    assert told[-1] is False
    with pytest.raises(Rejected, match="no focus contact"):
        shutter.focus(True)


@pytest.mark.parametrize(("switch", "words"), [(4, "distance at .* is read only"), (5, "has 5 switches, and number 5")])
def test_a_switch_that_cannot_be_one_is_refused(at, switch, words):
    with pytest.raises(BadConfiguration, match=words):
        AlpacaLight(AlpacaSwitch(at, 0, switch)).connect()


# --- station.toml --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_bench_of_another_bench(client, tmp_path, server):
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
        assert server[1].bench.light.level() == 0.5
        assert TOKEN not in str(tables)
    finally:
        bench.close()
