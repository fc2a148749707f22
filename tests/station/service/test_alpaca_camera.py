"""The ASCOM Initiative's own client photographs with the bench's camera."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
import requests
from alpaca import camera as alpaca_camera
from alpaca import exceptions

from procedures.raw import read_frame
from station.guide.workspace import StationLab
from station.service.alpaca.protocol import sensor_image

from ..guide import benches
from .alpaca_clients import once
from .serving import serving

NOT_IMPLEMENTED = exceptions.NotImplementedException


ABSENT_TO_READ = (
    "CCDTemperature", "CoolerOn", "CoolerPower", "ElectronsPerADU", "FastReadout", "FullWellCapacity", "Gain",
    "GainMax", "GainMin", "Gains", "HeatSinkTemperature", "Offset", "OffsetMax", "OffsetMin", "Offsets",
    "SetCCDTemperature", "SubExposureDuration",
)  # fmt: skip
ABSENT_TO_WRITE = ("CoolerOn", "FastReadout", "Gain", "Offset", "SetCCDTemperature", "SubExposureDuration")
BEFORE_A_FRAME = (
    "BayerOffsetX", "BayerOffsetY", "CameraXSize", "CameraYSize", "MaxADU", "NumX", "NumY", "PixelSizeX", "PixelSizeY",
    "SensorType",
)  # fmt: skip
KNOWN = {
    "BinX": 1, "BinY": 1, "MaxBinX": 1, "MaxBinY": 1, "CanAbortExposure": True, "CanAsymmetricBin": False,
    "CanFastReadout": False, "CanGetCoolerPower": False, "CanPulseGuide": False, "CanSetCCDTemperature": False,
    "CanStopExposure": False, "ExposureMin": 0.0, "ExposureMax": 3600.0, "ExposureResolution": 0.0,
    "HasShutter": False, "IsPulseGuiding": False, "ReadoutMode": 0, "ReadoutModes": ["RAW"], "SensorName": "",
    "StartX": 0, "StartY": 0, "ImageReady": False,
}  # fmt: skip


def connected(client):
    device = alpaca_camera.Camera(client.address, 0)
    device.Connected = True
    return device


def test_every_member_of_the_camera_before_a_photograph(camera):
    assert {name: getattr(camera, name) for name in KNOWN} == KNOWN
    assert camera.CameraState is alpaca_camera.CameraStates.cameraIdle
    for name in ABSENT_TO_READ:
        with pytest.raises(NOT_IMPLEMENTED):
            getattr(camera, name)
    for name in ABSENT_TO_WRITE:
        with pytest.raises(NOT_IMPLEMENTED):
            setattr(camera, name, 1)
    for name in BEFORE_A_FRAME:
        with pytest.raises(exceptions.ValueNotSetException, match="StartExposure"):
            getattr(camera, name)
    for name in ("LastExposureDuration", "LastExposureStartTime", "ImageArray", "PercentCompleted"):
        with pytest.raises(exceptions.InvalidOperationException, match="StartExposure"):
            getattr(camera, name)
    for call in (camera.StopExposure, lambda: camera.PulseGuide(alpaca_camera.GuideDirections.guideNorth, 1)):
        with pytest.raises(NOT_IMPLEMENTED):
            call()
    camera.BinX = camera.BinY = 1
    camera.ReadoutMode = 0
    for name in ("BinX", "BinY", "ReadoutMode"):
        with pytest.raises(exceptions.InvalidValueException):
            setattr(camera, name, 2)
    for seconds in (-1.0, 3601.0):
        with pytest.raises(exceptions.InvalidValueException, match="between 0 and 3600 s"):
            camera.StartExposure(seconds, True)
    camera.AbortExposure()
    assert camera.ImageArrayInfo is None


def test_a_photograph_is_the_sensors_numbers(camera, served):
    camera.StartExposure(0.02, True)  # as in the frames of this bench
    once(lambda: camera.ImageReady)
    (path,) = served.bench.simulated.folder.iterdir()
    truth = sensor_image(list(read_frame(path).planes.values()))
    assert (camera.CameraXSize, camera.CameraYSize) == (camera.NumX, camera.NumY) == (96, 64) == truth.shape[::-1]
    assert camera.MaxADU == 16383
    assert camera.SensorType is alpaca_camera.SensorType.RGGB
    assert (camera.BayerOffsetX, camera.BayerOffsetY) == (0, 0)
    assert camera.LastExposureDuration == pytest.approx(0.02)
    assert camera.LastExposureStartTime.startswith("20")
    with pytest.raises(exceptions.ValueNotSetException, match="do not give the pixel pitch"):
        _ = camera.PixelSizeX
    np.testing.assert_array_equal(np.array(camera.ImageArray), truth.T)
    info = camera.ImageArrayInfo
    assert (info.Rank, info.Dimension1, info.Dimension2) == (2, 96, 64)
    np.testing.assert_array_equal(np.array(camera.ImageArrayRaw).reshape(96, 64), truth.T)
    reply = requests.get(camera.base_url + "/imagearray", timeout=30).json()
    assert (reply["Type"], reply["Rank"], reply["Value"]) == (2, 2, truth.T.tolist())
    assert served.picture.number == 1
    camera.StartX, camera.StartY, camera.NumX, camera.NumY = 10, 4, 20, 30
    np.testing.assert_array_equal(np.array(camera.ImageArray), truth[4:34, 10:30].T)
    camera.NumX = 87
    with pytest.raises(exceptions.InvalidValueException, match=r"startx 10 and numx 87 must be within 0 \.\. 96"):
        camera.StartExposure(0.02, True)


def test_the_numbers_are_those_of_the_file(camera, served):
    camera.StartExposure(0.0, True)
    once(lambda: camera.ImageReady)
    written = np.random.default_rng(1).integers(600, 9000, (64, 96)).astype(np.uint16)  # as `frame_bytes` draws them
    assert benches.frame_bytes(1)
    np.testing.assert_array_equal(np.array(camera.ImageArray).T, written)


def test_a_frame_that_is_another_than_was_asked_for_is_an_error(camera):
    camera.StartExposure(0.5, True)
    with pytest.raises(exceptions.DriverException, match=r"taken at 0\.02 s instead of 0\.5 s; set the body, repeat"):
        once(lambda: camera.ImageReady)
    assert camera.CameraState is alpaca_camera.CameraStates.cameraError


def test_an_exposure_is_aborted_and_the_next_one_comes(camera, served, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()
    expose = served.bench.camera.expose

    def slow():
        begun.set()
        go_on.wait()
        return expose()

    monkeypatch.setattr(served.bench.camera, "expose", slow)
    camera.StartExposure(0.02, True)
    begun.wait()
    assert camera.CameraState is alpaca_camera.CameraStates.cameraExposing
    assert camera.PercentCompleted == 0
    with pytest.raises(exceptions.InvalidOperationException, match="in use by an exposure of"):
        camera.StartExposure(0.02, True)
    camera.AbortExposure()
    go_on.set()
    once(lambda: camera.CameraState is alpaca_camera.CameraStates.cameraIdle)
    assert not camera.ImageReady
    monkeypatch.undo()
    camera.StartExposure(0.02, True)
    once(lambda: camera.ImageReady)


def test_the_sensor_is_known_before_a_photograph(tmp_path):
    """From station.toml, from the simulated bench's camera, and from a file that is in the folder."""
    lab = StationLab(sessions=tmp_path / "sessions", config=None, simulate=True)
    with serving(tmp_path, lab=lab) as (client, served):
        device = connected(client)
        sensor = served.bench.simulated.view.camera.sensor
        assert (device.CameraXSize, device.CameraYSize) == (device.NumX, device.NumY) == (sensor.columns, sensor.rows)
        assert (device.SensorType, device.MaxADU) == (alpaca_camera.SensorType.RGGB, sensor.white)
        assert (device.BayerOffsetX, device.BayerOffsetY) == (0, 0)


def test_a_file_in_the_folder_shows_the_sensor(camera, served):
    (served.bench.simulated.folder / "before.DNG").write_bytes(benches.frame_bytes(7))
    assert (camera.CameraXSize, camera.CameraYSize, camera.MaxADU) == (96, 64, 16383)
    assert camera.SensorType is alpaca_camera.SensorType.RGGB


def test_the_exposure_after_an_aborted_one_waits_for_its_file_only(camera, served):
    clock, body = served.bench.clock, served.bench.simulated.body
    body.settings.readout_s = 3.0  # an exposure lasts long enough to be aborted
    fired, fire = threading.Event(), served.bench.shutter.fire

    def fire_and_tell(*given):
        times = fire(*given)
        fired.set()
        return times

    served.bench.camera._shutter.fire = fire_and_tell
    sleep = clock.sleep
    aborted = threading.Event()

    def wait_for_abort(seconds):
        if fired.is_set():
            aborted.wait()
        sleep(seconds)

    served.bench.camera.clock = SimpleNamespace(now_s=clock.now_s, sleep=wait_for_abort)
    camera.StartExposure(0.02, True)
    fired.wait()
    camera.AbortExposure()
    aborted.set()
    once(lambda: camera.CameraState is alpaca_camera.CameraStates.cameraIdle)
    began_s = clock.now_s()
    camera.StartExposure(0.02, True)
    once(lambda: camera.ImageReady)
    # twice the time of readout, with the rest of each file; the limit for a file is twenty seconds
    assert clock.now_s() - began_s < 2 * (3.0 + 1.0)
    written = np.random.default_rng(2).integers(600, 9000, (64, 96)).astype(np.uint16)
    np.testing.assert_array_equal(np.array(camera.ImageArray).T, written)  # the second frame, not the aborted one


def test_an_abort_that_comes_before_the_driver_has_begun_is_not_lost(camera, served, monkeypatch):
    entered, go_on = threading.Event(), threading.Event()
    configure = served.bench.camera.configure

    def slow(settings):
        entered.set()
        go_on.wait()
        configure(settings)

    monkeypatch.setattr(served.bench.camera, "configure", slow)
    camera.StartExposure(0.02, True)
    entered.wait()
    camera.AbortExposure()  # the driver forgets earlier stops when it begins to expose
    go_on.set()
    once(lambda: camera.CameraState is alpaca_camera.CameraStates.cameraIdle)
    assert not camera.ImageReady
