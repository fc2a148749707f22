"""Micro-Manager's adapters through its real core, at its own demo devices."""

import threading
import time

import numpy as np
import pytest

from drivers.dng import DngFolder, OpticsMetadata
from drivers.errors import (
    BadConfiguration,
    EmergencyStopped,
    FrameWrong,
    LineLost,
    MoveFailed,
    NotHomed,
    Rejected,
)
from drivers.interfaces import CameraSettings
from drivers.micromanager.camera import Core, MicroManagerCamera, MicroManagerShutter
from drivers.micromanager.stage import MicroManagerAxis, MicroManagerStage
from procedures.raw import read_frame
from station.bench.opening import inspect_raw, make_bench, read_config

pytest.importorskip("pymmcore", reason="pymmcore is not installed (extra `micromanager`)")
ADAPTERS = pytest.importorskip("mm_test_adapters", reason="Micro-Manager's demo devices are not installed")

CONFIG = """\
Property,Core,Initialize,0
Device,Table,DemoCamera,DXYStage
Device,Focus,DemoCamera,DStage
Device,Cam,DemoCamera,DCam
Device,Door,DemoCamera,DShutter
Property,Core,Initialize,1
Property,Table,Velocity,0.1
Property,Cam,PixelType,16bit
Property,Cam,OnCameraCCDXSize,48
Property,Cam,OnCameraCCDYSize,32
"""
AXES = (
    MicroManagerAxis("x_mm", "Table", (-0.2, 0.2), "x"),
    MicroManagerAxis("y_mm", "Table", (-0.2, 0.2), "y", zero=0.1, direction=-1),
    MicroManagerAxis("z_mm", "Focus", (-0.1, 0.1), homes=False),
)
STEP_MM = 0.00001
"""The demo table's: 0.015 µm."""
PATIENCE_S = 60.0
"""Longer than anything here takes, on any machine."""


@pytest.fixture
def core(tmp_path):
    config = tmp_path / "demo.cfg"
    config.write_text(CONFIG)
    return Core(config, ADAPTERS.device_adapter_path())


@pytest.fixture
def truth(core):
    """The core itself, beside the drivers."""
    inside = core.join("truth")
    yield inside
    core.leave("truth")


@pytest.fixture
def stage(core):
    stage = MicroManagerStage(core, AXES, patience_s=PATIENCE_S)
    stage.connect()
    yield stage
    stage.close()


@pytest.fixture
def homed(stage):
    stage.home()
    return stage


@pytest.fixture
def slow(truth):
    """The table moves so slowly that no test waits until it has arrived."""
    truth.setProperty("Table", "Velocity", 0.001)


def test_it_says_who_it_is_and_does_not_move_before_homing(core):
    stage = MicroManagerStage(core, AXES)
    with pytest.raises(LineLost, match="connect first"):
        stage.move_to(z_mm=0.0)
    identity = stage.connect()
    assert "DemoCamera DXYStage; DemoCamera DStage" in identity.model
    assert identity.address == "Table, Focus in demo.cfg"
    with pytest.raises(NotHomed):
        stage.move_to(z_mm=0.05)
    assert not stage.condition().usable
    stage.close()
    stage.close()


def test_it_goes_where_it_is_sent_and_the_core_agrees(homed, truth):
    homed.move_to(x_mm=0.02, y_mm=0.13, z_mm=-0.04)
    assert homed.position() == pytest.approx({"x_mm": 0.02, "y_mm": 0.13, "z_mm": -0.04}, abs=STEP_MM)
    # y counts the other way from 0.1 mm on: 0.13 = 0.1 - um / 1000
    there = truth.getXPosition("Table"), truth.getYPosition("Table"), truth.getPosition("Focus")
    assert there == pytest.approx((20, -30, -40), abs=1000 * STEP_MM)
    homed.move_to(x_mm=0.01)
    assert homed.position() == pytest.approx({"x_mm": 0.01, "y_mm": 0.13, "z_mm": -0.04}, abs=2 * STEP_MM)


def test_what_cannot_home_reports_it(core):
    stage = MicroManagerStage(core, [MicroManagerAxis("z_mm", "Focus", (-0.1, 0.1))])
    stage.connect()
    with pytest.raises(Rejected, match=r"Unsupported device command.*homes = false"):
        stage.home()
    assert not stage.condition().usable
    stage.close()


def test_what_stands_outside_its_travel_is_not_trusted(core):
    stage = MicroManagerStage(core, [MicroManagerAxis("z_mm", "Focus", (1.0, 2.0), homes=False)])
    stage.connect()
    with pytest.raises(MoveFailed, match=r"is at 0.0000, outside its travel 1 .. 2"):
        stage.home()
    assert not stage.condition().usable
    stage.close()


def after_the_first(stage, monkeypatch, name):
    """Stop the stage after this was done once; what it was done with comes into the list."""
    does, done = getattr(stage, name), []

    def wrapped(*given):
        does(*given)
        done.append(given[0])
        if len(done) == 1:
            stage.stop()

    monkeypatch.setattr(stage, name, wrapped)
    return done


def test_after_a_stop_no_further_device_is_sent_or_homed(homed, truth, monkeypatch):
    sent = after_the_first(homed, monkeypatch, "_send")
    with pytest.raises(MoveFailed, match="stopped before all axes"):
        homed.move_to(x_mm=0.15, z_mm=0.1)
    assert len(sent) == 1
    assert homed.position()["z_mm"] == 0.0
    monkeypatch.undo()
    ended = after_the_first(homed, monkeypatch, "_finish")
    with pytest.raises(MoveFailed, match="stopped before all axes"):
        homed.home()
    assert len(ended) == 1
    assert not homed.condition().usable


def test_a_device_that_refuses_its_order_stops_those_that_are_on_their_way(homed, truth, slow, monkeypatch):
    send = homed._send

    def one_refuses(label, *order):
        if label != "Table":
            raise Rejected("it does not take the order", "look at it")
        send(label, *order)

    monkeypatch.setattr(homed, "_send", one_refuses)
    with pytest.raises(Rejected):
        homed.move_to(x_mm=0.15, z_mm=0.1)
    assert not truth.deviceBusy("Table")
    assert homed.position()["x_mm"] < 0.14


def test_an_order_that_an_emergency_stop_overtook_is_taken_back(homed, truth):
    with pytest.raises(EmergencyStopped):
        homed._order(lambda core: (homed.emergency_stop(), core.setXYPosition("Table", 100, 0)), lambda: None)
    assert not truth.deviceBusy("Table")


def test_a_missing_device_is_named_with_those_that_are_there(core):
    stage = MicroManagerStage(core, [MicroManagerAxis("z_mm", "Table", (0.0, 1.0))])
    with pytest.raises(
        BadConfiguration, match=r"Table has another type; a single axis is required; name one .*: Focus"
    ):
        stage.connect()
    camera = MicroManagerCamera(core, "Camera 2", DngFolder(core.config.parent, inspect_raw))
    with pytest.raises(BadConfiguration, match=r"Camera 2 is not in it; a camera is required; name one .*: Cam"):
        camera.connect()


def test_a_configuration_that_does_not_load_is_reported_in_the_cores_words(tmp_path):
    stage = MicroManagerStage(Core(tmp_path / "no.cfg"), AXES)
    with pytest.raises(BadConfiguration, match=r"no.cfg does not exist"):
        stage.connect()
    (tmp_path / "no.cfg").write_text("Device,Z,NoSuchLibrary,DStage\n")
    with pytest.raises(LineLost, match=r"no.cfg: .*NoSuchLibrary.*adapters are searched for in .*Device API version"):
        stage.connect()


@pytest.fixture
def camera(core, tmp_path):
    (tmp_path / "in").mkdir()
    optics = OpticsMetadata(f_number=4.0, focal_length_mm=25.0, pixel_pitch_um=3.45, black=100.0)
    camera = MicroManagerCamera(core, "Cam", DngFolder(tmp_path / "in", inspect_raw, optics))
    camera.connect()
    yield camera
    camera.close()


def test_a_photograph_is_a_dng_of_the_pixels_that_the_core_read(camera, truth):
    camera.configure(CameraSettings(exposure_s=0.004))
    taken = camera.expose()
    frame = read_frame(taken.path)
    assert taken.sha256 == frame.sha256
    assert taken.settings == CameraSettings(0.004, None, 4.0)
    assert taken.requested_s <= taken.shutter.closed_s < taken.shutter.released_s <= taken.received_s
    plane, reported = frame.planes["Y"], frame.exposure
    # black 100, white 65535: single precision over 16 bits
    np.testing.assert_allclose(plane.samples * 65435 + 100, truth.getImage(), atol=0.01)
    assert (reported.exposure_s, reported.f_number, reported.focal_length_mm, reported.iso) == (0.004, 4.0, 25.0, None)
    assert reported.pixel_pitch_um == pytest.approx(3.45)


def test_photographs_are_numbered_on(camera):
    assert [camera.expose().path.name for _ in range(2)] == ["IMG_0001.DNG", "IMG_0002.DNG"]
    camera.connect()
    assert camera.expose().path.name == "IMG_0003.DNG"


def test_a_mosaic_is_read_as_one(core, camera, tmp_path):
    bayer = MicroManagerCamera(core, "Cam", DngFolder(tmp_path / "in", inspect_raw), cfa="GRBG")
    bayer.connect()
    assert set(read_frame(bayer.expose().path).planes) == {"R", "G1", "G2", "B"}
    bayer.close()


def test_the_gain_is_set_and_read_back(core, camera, truth, tmp_path):
    frames = DngFolder(tmp_path / "in", inspect_raw)
    MicroManagerCamera(core, "Cam", frames, gain=3).connect()
    assert float(truth.getProperty("Cam", "Gain")) == 3
    with pytest.raises(Rejected, match="write a gain that its property Gain takes"):
        MicroManagerCamera(core, "Cam", frames, gain=30).connect()


def test_eight_bits_are_scaled_to_eight_bits(camera, truth):
    truth.setProperty("Cam", "PixelType", "8bit")
    assert read_frame(camera.expose().path).planes["Y"].white == 255


def test_developed_colours_are_refused(camera, truth):
    truth.setProperty("Cam", "PixelType", "32bitRGB")
    with pytest.raises(FrameWrong, match="4 colours in 4 bytes a pixel"):
        camera.expose()


def test_what_the_camera_cannot_set_is_an_error(camera):
    with pytest.raises(Rejected, match="has a gain and no ISO"):
        camera.configure(CameraSettings(iso=200))
    with pytest.raises(Rejected, match="choose a time that the camera offers"):
        camera.configure(CameraSettings(exposure_s=1e-7))


def test_a_frame_that_an_emergency_stop_overtook_is_kept_and_reported(camera, truth, tmp_path):
    camera.configure(CameraSettings(exposure_s=0.2))
    timer = threading.Timer(0.05, camera.emergency_stop)
    timer.start()
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert read_frame(tmp_path / "in" / "IMG_0001.DNG").exposure.exposure_s == 0.2


@pytest.mark.parametrize("ended", ["abort", "emergency_stop"])
def test_a_shutter_that_is_stopped_before_it_opens_stays_shut(core, truth, monkeypatch, ended):
    shutter, opened = MicroManagerShutter(core, "Door"), []
    shutter.connect()
    monkeypatch.setattr(shutter.clock, "sleep", lambda duration_s: getattr(shutter, ended)())  # while it focuses
    set_open = shutter._set
    monkeypatch.setattr(shutter, "_set", lambda core, on: (opened.append(on), set_open(core, on)))
    with pytest.raises(MoveFailed, match="cut short"):
        shutter.fire(5.0, focus_s=1.0)
    assert not any(opened)
    shutter.close()


def test_a_shutter_is_open_as_long_as_asked_and_closed_by_a_stop(core, truth):
    shutter = MicroManagerShutter(core, "Door")
    with pytest.raises(LineLost):
        shutter.fire(0.1)
    truth.setShutterOpen("Door", True)
    shutter.connect()
    assert not truth.getShutterOpen("Door")
    times = shutter.fire(0.05)
    assert times.released_s - times.closed_s >= 0.05
    ended = []

    def shoot():
        try:
            shutter.fire(30.0)
        except MoveFailed as error:
            ended.append(error)

    shot = threading.Thread(target=shoot)
    shot.start()
    while not truth.getShutterOpen("Door"):
        time.sleep(0.005)
    shutter.emergency_stop()
    assert not truth.getShutterOpen("Door")
    shot.join(PATIENCE_S)
    assert "cut short" in ended[0].reason
    with pytest.raises(Rejected, match="no focus contact"):
        shutter.focus(True)
    shutter.close()


def test_the_devices_of_a_station_toml_share_the_configuration(tmp_path):
    (tmp_path / "demo.cfg").write_text(CONFIG)
    (tmp_path / "in").mkdir()
    common = f'config = "demo.cfg"\nadapters = "{ADAPTERS.device_adapter_path()}"\n'
    (tmp_path / "station.toml").write_text(f"""
[devices.stage]
driver = "micromanager_stage"
{common}axes = [
    {{ name = "x_mm", device = "Table", part = "x", travel = [-0.2, 0.2] }},
    {{ name = "z_mm", device = "Focus", travel = [-0.1, 0.1], homes = false }},
]
[devices.camera]
driver = "micromanager_camera"
{common}device = "Cam"
folder = "in"
f_number = 4.0
[devices.shutter]
driver = "micromanager_shutter"
{common}device = "Door"
""")
    bench = make_bench(read_config(tmp_path / "station.toml"), folder=tmp_path)
    bench.connect()
    bench.stage.home()
    bench.stage.move_to(z_mm=0.02)
    bench.devices["shutter"].close()  # the others keep the configuration
    assert bench.stage.position()["z_mm"] == pytest.approx(0.02)
    assert bench.camera.expose().path.parent == tmp_path / "in"
    bench.emergency_stop()
    assert not bench.stage.condition().usable
    bench.close()
    with pytest.raises(LineLost):
        bench.stage.position()
