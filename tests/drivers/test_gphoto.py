"""GphotoCamera through the real libgphoto2, at its own "Directory Browse" camera: a folder that plays a body."""

import hashlib
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.errors import BadConfiguration, DeviceError, EmergencyStopped, FrameMissing, LineLost, Rejected
from drivers.frames import ExposureMetadata
from drivers.gphoto import BodyFile, GphotoCamera, read_choice
from drivers.interfaces import CameraSettings, ShutterTimes


class Writer:
    """A shutter whose body writes a file into the folder that libgphoto2 browses."""

    def __init__(self, folder, data=b"RAW data END"):
        self.folder, self.data, self.count = folder, data, 0

    def fire(self, pulse_s, focus_s=0.0):
        self.count += 1
        if self.data:
            (self.folder / f"DSC_{self.count:04d}.NEF").write_bytes(self.data + bytes([self.count]))
        (self.folder / f"DSC_{self.count:04d}.JPG").write_bytes(b"jpeg")
        return ShutterTimes(0.0, pulse_s)

    def emergency_stop(self):
        self.data = b""


@pytest.fixture
def body(tmp_path):
    pytest.importorskip("gphoto2", reason="gphoto2 is not installed (extra `tether`)")
    folder = tmp_path / "body"
    folder.mkdir()
    (folder / "DSC_0000.NEF").write_bytes(b"an old one")
    return folder


@pytest.fixture
def camera(body, tmp_path):
    saved = tmp_path / "saved"
    saved.mkdir()
    camera = GphotoCamera(
        saved,
        lambda path: ExposureMetadata(exposure_s=0.02),
        model="Directory Browse",
        port=f"disk:{body}",
        shutter=Writer(body),
        patience_s=0.5,
    )
    camera.connect()
    yield camera
    camera.close()


def test_it_lists_raw_files_only(camera, body):
    (body / "notes.txt").write_text("no photograph")
    assert camera.files() == [BodyFile("/", "DSC_0000.NEF")]


def test_a_name_that_is_taken_is_not_overwritten(camera):
    place = BodyFile("/", "DSC_0000.NEF")
    assert camera.fetch(place).name == "DSC_0000.NEF"
    assert camera.fetch(place).name == "DSC_0000-1.NEF"


def test_a_frame_that_never_comes_is_an_error(camera):
    camera.emergency_stop()
    with pytest.raises(FrameMissing, match="set the body to RAW"):
        camera.expose()


def test_a_stop_ends_the_wait_and_the_late_file_is_not_taken_for_the_next_one(camera, body):
    camera._patience_s, writer = 20.0, camera._shutter
    writer.data, data = b"", writer.data
    threading.Timer(0.05, camera.emergency_stop).start()
    begin_s = time.monotonic()
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert time.monotonic() - begin_s < 10.0  # half of its patience
    (body / "DSC_0001.NEF").write_bytes(b"the late one")
    writer.data = data
    assert camera.expose().path.name == "DSC_0002.NEF"


def test_a_stop_while_the_body_is_listed_leaves_the_contacts_open(camera, monkeypatch):
    monkeypatch.setattr(camera, "files", lambda: camera.emergency_stop() or [])
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert camera._shutter.count == 0


def test_what_does_not_decode_is_an_error(camera):
    def broken(path):
        raise ValueError("damaged")

    camera._inspect = broken
    with pytest.raises(FrameMissing, match="does not decode: damaged"):
        camera.expose()


def test_a_body_that_cannot_be_triggered_is_reported(camera):
    camera._shutter = None
    with pytest.raises(DeviceError):
        camera.expose()


def test_a_body_that_is_not_there_is_reported(tmp_path, body):
    camera = GphotoCamera(tmp_path, lambda path: ExposureMetadata(), model="Canon EOS 5D Mark IV", port="usb:")
    with pytest.raises(LineLost):
        camera.connect()
    with pytest.raises(LineLost, match="connect first"):
        camera.files()


def test_without_the_library_it_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "gphoto2", None)
    with pytest.raises(BadConfiguration, match=r"pip install 'calibration-station\[tether\]'"):
        GphotoCamera(tmp_path, lambda path: ExposureMetadata()).connect()


class Talkative:
    """A body that reports events as real ones do: JPEG and RAW in any order, then silence."""

    def __init__(self, gp, names):
        self.gp, self.names, self.fired = gp, list(names), False

    def trigger_capture(self):
        self.fired = True

    def wait_for_event(self, timeout_ms):
        if not self.names:
            return self.gp.GP_EVENT_TIMEOUT, None
        name = self.names.pop(0)
        if name == "complete":
            return self.gp.GP_EVENT_CAPTURE_COMPLETE, None
        return self.gp.GP_EVENT_FILE_ADDED, BodyFile("/store", name)


@pytest.mark.parametrize(
    "names", [["A.JPG", "A.CR3", "complete"], ["complete", "A.CR3", "A.JPG"], ["A.JPG", "complete", "A.CR3"]]
)
def test_the_raw_file_is_found_among_the_events(camera, names):
    # libgphoto2's folder camera reports no events: these are played
    camera._camera = Talkative(camera._gp, names)
    assert camera._triggered() == BodyFile("/store", "A.CR3")
    camera._camera = None


def test_a_body_set_to_jpeg_is_reported(camera):
    camera._camera = Talkative(camera._gp, ["A.JPG", "complete"])
    with pytest.raises(FrameMissing, match=r"files: A.JPG\); set the body to RAW"):
        camera._triggered()
    camera._camera = None


@pytest.mark.parametrize(
    ("text", "value"), [("1/250", 0.004), ("0.5s", 0.5), ("f/5.6", 5.6), ("400", 400.0), ("Auto", None), ("1/0", None)]
)
def test_choices_are_read(text, value):
    assert read_choice(text) == pytest.approx(value)


class Widget:
    """One setting of a body, which accepts a value, or not."""

    def __init__(self, choices, value, *, takes=True, fixed=False):
        self.choices, self.value, self.takes, self.fixed = choices, value, takes, fixed

    def get_choices(self):
        return self.choices

    def get_value(self):
        return self.value

    def set_value(self, value):
        self.value = value if self.takes else self.value

    def get_readonly(self):
        return self.fixed


class Settable:
    """A body with these settings and no others."""

    def __init__(self, gp, widgets):
        self.gp, self.widgets, self.sent = gp, widgets, 0

    def get_config(self):
        return self

    def set_config(self, config):
        self.sent += 1

    def get_child_by_name(self, name):
        if name not in self.widgets:
            raise self.gp.GPhoto2Error(-2)
        return self.widgets[name]

    def exit(self):
        pass


@pytest.fixture
def settable(camera, monkeypatch):
    def body(**widgets):
        monkeypatch.setattr("drivers.gphoto.TAKES_S", 0.0)
        camera._camera = Settable(camera._gp, {name.replace("_", "-"): one for name, one in widgets.items()})
        return camera._camera

    return body


APERTURES = ["f/2.8", "f/4", "f/5.6", "f/8"]


@pytest.mark.parametrize("name", ["aperture", "f_number"])
def test_the_aperture_has_a_name_by_make(camera, settable, name):
    body = settable(**{name: Widget(APERTURES, "f/4")})
    camera.configure(CameraSettings(f_number=5.6))
    assert next(iter(body.widgets.values())).value == "f/5.6"
    camera.configure(CameraSettings(f_number=5.6))
    assert body.sent == 1  # what stands already is not sent again


@pytest.mark.parametrize("how", [{"takes": False}, {"fixed": True}])
def test_a_setting_that_did_not_take_is_an_error(camera, settable, how):
    settable(shutterspeed=Widget(["1/50", "1/100", "Bulb"], "1/100", **how))
    with pytest.raises(Rejected, match=r"did not accept shutterspeed = 1/50: it is set to 1/100; turn its dial to M"):
        camera.configure(CameraSettings(exposure_s=0.02))


def test_what_a_body_does_not_offer_is_an_error(camera, settable):
    settable(aperture=Widget(APERTURES, "f/4"))
    with pytest.raises(
        Rejected, match=r"no aperture of 1.4: it offers f/2.8 .. f/8, f/2.8 the nearest; choose a value"
    ):
        camera.configure(CameraSettings(f_number=1.4))


PTP_BODY = """
import json, sys
from pathlib import Path
import drivers.gphoto as gphoto
from drivers.errors import DeviceError
from drivers.frames import ExposureMetadata
from drivers.interfaces import CameraSettings
saved = Path(sys.argv[1])
camera = gphoto.GphotoCamera(saved, lambda path: ExposureMetadata(exposure_s=0.02), patience_s=5.0)
reported = {"model": camera.connect().model}
camera.configure(CameraSettings(exposure_s=0.02, f_number=5.6))
config = camera._do(camera._camera.get_config)
reported["set"] = [config.get_child_by_name(name).get_value() for name in ("shutterspeed", "f-number")]
try:
    camera.expose()
except DeviceError as error:
    reported["jpeg"] = error.reason
gphoto.is_raw = lambda path: path.suffix == ".JPG"  # this body knows nothing else
exposures = [camera.expose() for _ in range(2)]
reported["frames"] = [(one.path.name, one.size_bytes, one.sha256) for one in exposures]
camera.close()
print(json.dumps(reported))
"""


def test_libgphoto2s_own_ptp_body_is_set_triggered_and_fetched(tmp_path):
    # in a process of its own: which bodies libgphoto2 has is settled when it is loaded
    gphoto2 = pytest.importorskip("gphoto2", reason="gphoto2 is not installed (extra `tether`)")
    if not (Path(gphoto2.__file__).parent / "libgphoto2" / "vusb").is_dir():
        pytest.skip("this libgphoto2 came without its virtual PTP body")
    store, saved = tmp_path / "store", tmp_path / "saved"
    store.mkdir()
    saved.mkdir()
    picture = cv2.imencode(".jpg", np.zeros((40, 60, 3), np.uint8))[1].tobytes()
    (store / "seed.jpg").write_bytes(picture)  # what it gives as every photograph
    env = {**os.environ, "VCAMERADIR": str(store)}
    command = [sys.executable, "-c", PTP_BODY, str(saved)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env, timeout=60.0)
    assert done.returncode == 0, done.stderr
    reported = json.loads(done.stdout)
    assert reported["model"] == "Nikon DSC D750"
    assert reported["set"] == ["0.0200s", "f/5.6"]
    assert "no RAW file came" in reported["jpeg"]
    assert ".JPG" in reported["jpeg"]
    assert len({name for name, _, _ in reported["frames"]}) == 2
    assert all(rest == [len(picture), hashlib.sha256(picture).hexdigest()] for _, *rest in reported["frames"])
