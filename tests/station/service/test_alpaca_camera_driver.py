"""The driver of Alpaca's cameras at the bench's own server, and at servers that are not as they should be."""

import threading
import time

import exifread
import numpy as np
import pytest

from drivers.alpaca.camera import FAILED, AlpacaCamera, AlpacaCameraSettings
from drivers.alpaca.link import HEADER, AlpacaLink, read_image
from drivers.dng import DngFolder, OpticsMetadata
from drivers.errors import EmergencyStopped, FrameMissing, FrameWrong, Rejected
from drivers.interfaces import CameraSettings, FrameFormat
from procedures.raw import read_frame
from station.bench.opening import frame_format, inspect_raw
from station.service.alpaca.protocol import image_bytes, sensor_image

from .alpaca_clients import beside


@pytest.fixture
def saved(tmp_path):
    folder = tmp_path / "saved"
    folder.mkdir()
    return DngFolder(folder, inspect_raw, OpticsMetadata(f_number=5.6, pixel_pitch_um=3.45))


@pytest.fixture
def camera(at, saved):
    camera = AlpacaCamera(at, 0, saved, AlpacaCameraSettings(exposure_s=0.02, patience_s=20.0))
    camera.connect()
    yield camera
    camera.close()


def test_an_exposure_is_a_file_with_the_sensors_numbers_and_its_record(camera, served):
    assert camera.sensor() is None  # neither a photograph nor station.toml has shown it to the server
    before_s = camera.clock.now_s()
    exposure = camera.expose()
    assert camera.sensor() == FrameFormat(96, 64, "RGGB", 16383, 3.45)
    (source,) = served.bench.simulated.folder.iterdir()
    theirs, ours = (list(read_frame(path).planes.values()) for path in (source, exposure.path))
    np.testing.assert_array_equal(sensor_image(ours), sensor_image(theirs))
    assert frame_format(ours) == frame_format(theirs)
    reply = read_frame(exposure.path).exposure
    assert reply.exposure_s == pytest.approx(0.02)
    assert reply.f_number == 5.6
    assert before_s <= exposure.requested_s < exposure.received_s


def test_gain_and_offset_are_set_and_read_back(at, saved, monkeypatch):
    numbers, call = {}, AlpacaLink._call

    def answer(link, method, member, values):
        if member not in ("gain", "offset"):
            return call(link, method, member, values)
        numbers.update(values)
        return numbers.get(member.title())

    monkeypatch.setattr(AlpacaLink, "_call", answer)
    camera = AlpacaCamera(at, 0, saved, AlpacaCameraSettings(exposure_s=0.02, gain=12, offset=50))
    camera.connect()
    assert numbers == {"Gain": 12, "Offset": 50}
    with camera.expose().path.open("rb") as file:
        comment = exifread.process_file(file)["EXIF UserComment"]
    assert '{"gain": 12, "offset": 50}' in str(comment)
    monkeypatch.setattr(AlpacaLink, "number_of", lambda *_: 11.0)
    with pytest.raises(Rejected, match="has Gain 11 after 12 was set"):
        camera.connect()
    monkeypatch.undo()


def test_a_gain_that_the_camera_has_not_is_refused(at, saved):
    with pytest.raises(Rejected, match="gain is not implemented"):
        AlpacaCamera(at, 0, saved, AlpacaCameraSettings(gain=1)).connect()


def test_an_exposure_that_fails_at_the_server_is_reported(camera):
    camera.configure(CameraSettings(exposure_s=0.5))
    with pytest.raises(FrameMissing, match=r"taken at 0\.02 s instead of 0\.5 s; set the body, repeat"):
        camera.expose()


def test_an_exposure_whose_failure_the_server_does_not_report_ends_soon(camera, monkeypatch):
    monkeypatch.setattr(AlpacaLink, "get", lambda self, member: {"imageready": False, "camerastate": FAILED}[member])
    with pytest.raises(FrameMissing, match="reports that its exposure failed"):
        camera.expose()


@pytest.fixture
def slow_camera(served, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()
    expose = served.bench.camera.expose

    def slow():
        begun.set()
        go_on.wait()
        return expose()

    slow.go_on = go_on.set
    monkeypatch.setattr(served.bench.camera, "expose", slow)
    yield begun
    go_on.set()


def test_an_emergency_stop_ends_an_exposure(camera, slow_camera):
    thread, outcome = beside(camera.expose)
    slow_camera.wait()
    camera.emergency_stop()
    thread.join()
    assert isinstance(outcome[0], EmergencyStopped)


def test_an_exposure_that_another_client_aborted_ends_at_once(camera, client, slow_camera, served):
    thread, outcome = beside(camera.expose)
    slow_camera.wait()
    begin_s = time.monotonic()
    client.request("PUT", "/api/v1/camera/0/abortexposure", b"ClientID=2")
    served.bench.camera.expose.go_on()
    thread.join()
    assert isinstance(outcome[0], FrameMissing)
    assert "was aborted at its server; expose again" in str(outcome[0])
    assert time.monotonic() - begin_s < 10.0  # half of its patience


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
        ("application/json", b"[]"),
        ("application/imagebytes", b"short"),
        ("application/imagebytes", HEADER.pack(1, 1035, 0, 0, 44, 0, 0, 0, 0, 0, 0) + b"no image"),
        ("application/imagebytes", HEADER.pack(1, 0, 0, 0, 44, 2, 3, 2, 1, 1, 0) + bytes(8)),
        ("application/imagebytes", image_bytes(np.zeros((4, 4), np.uint16), 0, 0)[:-2]),
    ],
)
def test_what_is_no_image_is_refused(client, at, monkeypatch, kind, data):
    link = AlpacaLink(at, "camera", 0)
    monkeypatch.setattr(link, "_ask", lambda *_: (200, kind, data))
    with pytest.raises(Rejected, match="sent no image"):
        link.image(1.0)


def test_numbers_that_no_file_holds_are_refused(camera, monkeypatch):
    monkeypatch.setattr(AlpacaLink, "image", lambda self, timeout_s: np.array([[0, 70000]]))
    with pytest.raises(FrameWrong, match="sent 2 x 1 numbers from 0 to 70000"):
        camera.expose()
