"""V4l2Camera at a twin that answers the kernel's requests; the twin, and the structures, against what others wrote."""

import ctypes
import io
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.dng import DngFolder, OpticsMetadata
from drivers.errors import BadConfiguration, EmergencyStopped, FrameMissing, LineLost, Rejected
from drivers.interfaces import CameraSettings, FrameFormat
from drivers.v4l2 import kernel
from drivers.v4l2.camera import FORMATS, V4l2Camera, V4l2Settings, four_characters
from procedures.raw import read_frame
from simulators.world.clock import VirtualClock
from station.bench.opening import inspect_raw, make_bench, read_config
from tests.drivers.conftest import comment_of
from tests.drivers.v4l2_twin import (
    EXPOSURE_MODE,
    EXPOSURE_TIME,
    GAIN,
    GAMMA,
    HANDLERS,
    SHARPNESS,
    WHITE_BALANCE,
    FakeCamera,
)


@pytest.fixture
def make(tmp_path):
    made = []

    def camera(fake=None, settings=None, optics=None):
        fake = fake or FakeCamera()
        fake.clock = clock = VirtualClock()
        frames = DngFolder(tmp_path, inspect_raw, optics, clock=clock)
        made.append(V4l2Camera(frames, "/dev/video7", settings, kernel=fake, clock=clock))
        return made[-1], fake

    yield camera
    for one in made:
        one.close()


def numbers_of(path):
    """The numbers of a file, of a mosaic or a grey picture."""
    from station.service.alpaca.protocol import sensor_image

    return sensor_image(list(read_frame(path).planes.values()))


def test_it_says_who_it_is_and_switches_the_automatic_settings_off(make):
    camera, fake = make()
    identity = camera.connect()
    assert (identity.model, identity.firmware, identity.address) == (
        "Fake Camera: Fake Camera", "uvcvideo 6.1.0", "/dev/video7",
    )  # fmt: skip
    values = {number: one.value for number, one in fake.controls.items()}
    assert [values[one] for one in (EXPOSURE_MODE, WHITE_BALANCE, SHARPNESS, GAMMA)] == [1, 0, 0, 100]
    assert camera.sensor() == FrameFormat(96, 64, "RGGB", 1023)
    camera.close()
    assert not camera.condition().usable
    with pytest.raises(LineLost, match="connect first"):
        camera.expose()


@pytest.mark.parametrize("name", ["GREY", "Y10 ", "Y16 ", "RGGB", "RG10", "pRAA", "pgCC"])
def test_the_file_holds_the_sensors_numbers_and_its_record(make, name):
    fake = FakeCamera(formats={"MJPG": ((640, 480),), name: ((52, 34),)})  # lines are padded to 32 bytes
    optics = OpticsMetadata(f_number=2.8, focal_length_mm=16.0, lens="Fixed 16", pixel_pitch_um=3.45, black=5.0)
    camera, _ = make(fake, V4l2Settings(gain=7), optics)
    camera.connect()
    camera.configure(CameraSettings(exposure_s=0.0123))
    taken = camera.expose()
    frame, form = read_frame(taken.path), FORMATS[name]
    assert set(frame.planes) == ({"Y"} if form.cfa is None else {"R", "G1", "G2", "B"})
    np.testing.assert_array_equal(numbers_of(taken.path), fake.numbers(0.0123, fake._taken))
    assert {(plane.black, plane.white) for plane in frame.planes.values()} == {(5.0, form.white)}
    assert frame.exposure.exposure_s == pytest.approx(0.0123)
    assert (frame.exposure.f_number, frame.exposure.lens) == (2.8, "Fixed 16")
    assert inspect_raw(taken.path).sensor == camera.sensor()
    notes = comment_of(taken.path)
    assert (notes["pixel_format"], notes["gain"], notes["frame"]) == (name.strip(), 7, 2)
    times = taken.shutter
    assert times.released_s - times.closed_s == pytest.approx(0.0123)
    assert taken.requested_s <= times.closed_s <= taken.received_s


def test_the_exposure_is_that_of_the_photograph_not_of_earlier_frames(make):
    camera, _ = make()
    camera.connect()
    light = []
    for exposure_s in (0.005, 0.02, 0.005):
        camera.configure(CameraSettings(exposure_s=exposure_s))
        light.append(float(numbers_of(camera.expose().path).mean()) - 1023 / 16)
    # proportional to the time, with the mean of 6144 pixels' noise of 5 and the rounding of half a number
    np.testing.assert_allclose(light, np.array([1, 4, 1]) * 1023 / 2 / 8, atol=1.0)


def test_the_deepest_format_and_the_largest_size_are_taken_unless_others_are_named(make):
    sizes = ((32, 16), (64, 48))
    fake = FakeCamera(formats={"YUYV": sizes, "GREY": sizes, "Y10 ": sizes, "RG10": sizes, "pRAA": sizes})
    camera, _ = make(fake)
    camera.connect()
    assert camera.sensor() == FrameFormat(64, 48, "RGGB", 1023)
    camera, _ = make(fake, V4l2Settings("Y10", columns=32, rows=16))
    camera.connect()
    assert camera.sensor() == FrameFormat(32, 16, None, 1023)


def test_what_the_camera_has_not_is_refused_by_name(make):
    with pytest.raises(BadConfiguration, match="no grey or raw format: it offers YUYV, MJPG"):
        make(FakeCamera(formats={"YUYV": ((8, 8),), "MJPG": ((8, 8),)}))[0].connect()
    with pytest.raises(BadConfiguration, match=r"no grey or raw format Y16: it offers RG10"):
        make(settings=V4l2Settings("Y16"))[0].connect()
    with pytest.raises(BadConfiguration, match="gives 48 x 32 RG10 instead of 50 x 30 RG10"):
        make(settings=V4l2Settings(columns=50, rows=30))[0].connect()
    with pytest.raises(Rejected, match=r"no gain of 101: it offers 0 \.\. 100"):
        make(settings=V4l2Settings(gain=101))[0].connect()
    camera, fake = make()
    camera.connect()
    with pytest.raises(Rejected, match=r"cannot expose 5 s: it offers 0.0001 \.\. 1"):
        camera.configure(CameraSettings(exposure_s=5.0))
    with pytest.raises(Rejected, match=r"exposes 0.0001 s instead of 0.00014 s"):
        camera.configure(CameraSettings(exposure_s=1.4e-4))
    with pytest.raises(Rejected, match="a gain and no ISO"):
        camera.configure(CameraSettings(iso=100))
    del fake.controls[EXPOSURE_TIME], fake.controls[GAIN]
    camera.connect()
    with pytest.raises(Rejected, match="no exposure time to be set"):
        camera.configure(CameraSettings(exposure_s=0.01))
    camera._wanted = V4l2Settings(gain=1)
    with pytest.raises(BadConfiguration, match="no gain to be set"):
        camera.connect()


def test_a_lost_a_damaged_and_a_short_frame_are_errors_and_the_next_one_comes(make):
    camera, fake = make(settings=V4l2Settings(patience_s=0.5))
    camera.connect()
    fake.stalled = True
    before_s = fake.clock.now_s()
    with pytest.raises(FrameMissing, match="no frame came from /dev/video7 within"):
        camera.expose()
    assert fake.clock.now_s() - before_s < 1.0
    fake.stalled = False
    for fault, said in (("damage", "is damaged"), ("short", "is incomplete: 64 x 96 pixels of RG10 take")):
        setattr(fake, fault, frozenset({fake._taken + 3}))
        with pytest.raises(FrameMissing, match=said):
            camera.expose()
        camera.expose()


def test_a_camera_that_is_gone_or_in_use_is_reported(make, tmp_path):
    camera, fake = make()
    camera.connect()
    fake.gone = True
    with pytest.raises(LineLost, match=r"/dev/video7: No such device; check its cable"):
        camera.expose()
    with pytest.raises(LineLost, match="No such device"):
        camera.connect()
    fake.gone, fake.busy = False, True
    with pytest.raises(LineLost, match="is in use by another program"):
        camera.connect()
    missing = V4l2Camera(DngFolder(tmp_path, inspect_raw), str(tmp_path / "video99"))
    with pytest.raises(LineLost, match="No such file or directory"):
        missing.connect()


def test_an_emergency_stop_ends_the_wait(make):
    camera, fake = make(settings=V4l2Settings(patience_s=60.0))
    camera.connect()
    fake.stalled = True
    sleep = fake.clock.sleep

    def stop_then_sleep(duration_s):
        camera.emergency_stop()
        sleep(duration_s)

    fake.clock.sleep = stop_then_sleep
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert fake.clock.now_s() < 1.0
    fake.clock.sleep, fake.stalled = sleep, False
    camera.expose()


def test_one_photograph_is_taken_at_a_time(make):
    camera, fake = make()
    camera.connect()
    waiting, go_on = threading.Event(), threading.Event()

    def ready(file, timeout_s):
        waiting.set()
        go_on.wait()
        return FakeCamera.ready(fake, file, timeout_s)

    fake.ready = ready
    thread = threading.Thread(target=camera.expose)
    thread.start()
    waiting.wait()
    with pytest.raises(Rejected, match="is already exposing"):
        camera.expose()
    go_on.set()
    thread.join()


def test_it_stands_in_station_toml(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    text = '[devices.camera]\ndriver = "v4l2"\nfolder = "in"\npixel_format = "Y10"\ngain = 3\nblack = 60\n'
    (tmp_path / "station.toml").write_text(text)
    monkeypatch.setattr(kernel, "Kernel", lambda: FakeCamera(formats={"Y10 ": ((64, 48),)}, period_s=1e-3))
    bench = make_bench(read_config(tmp_path / "station.toml"), folder=tmp_path)
    bench.connect()
    frame = read_frame(bench.camera.expose().path)
    assert (frame.planes["Y"].black, frame.planes["Y"].white) == (60, 1023)
    bench.close()
    (tmp_path / "station.toml").write_text(f"{text}columns = 32\n")
    with pytest.raises(BadConfiguration, match="has only one of columns and rows; write both, or none"):
        read_config(tmp_path / "station.toml")


STRUCTURES = {
    "v4l2_capability": (kernel.Capability, {"version": "version", "device_caps": "device_caps"}),
    "v4l2_fmtdesc": (kernel.FormatDescription, {"description": "description", "pixelformat": "pixel_format"}),
    "v4l2_frmsizeenum": (kernel.FrameSize, {"pixel_format": "pixel_format", "discrete": "size"}),
    "v4l2_format": (kernel.Format, {"fmt": "union"}),
    "v4l2_pix_format": (kernel.PixelLayout, {"bytesperline": "line_bytes", "sizeimage": "bytes"}),
    "v4l2_requestbuffers": (kernel.BufferRequest, {"memory": "memory"}),
    "v4l2_buffer": (
        kernel.VideoBuffer,
        {
            "bytesused": "used", "timestamp": "time", "timecode": "time_code", "sequence": "sequence",
            "memory": "memory", "m": "place", "length": "length",
        },
    ),
    "v4l2_queryctrl": (kernel.ControlRange, {"minimum": "low", "default_value": "default", "flags": "flags"}),
    "v4l2_control": (kernel.ControlValue, {"value": "value"}),
}  # fmt: skip
REQUESTS = {
    "QUERYCAP": kernel.QUERYCAP, "ENUM_FMT": kernel.ENUM_FMT, "S_FMT": kernel.S_FMT, "REQBUFS": kernel.REQBUFS,
    "QUERYBUF": kernel.QUERYBUF, "QBUF": kernel.QBUF, "DQBUF": kernel.DQBUF, "STREAMON": kernel.STREAMON,
    "STREAMOFF": kernel.STREAMOFF, "G_CTRL": kernel.G_CTRL, "S_CTRL": kernel.S_CTRL, "QUERYCTRL": kernel.QUERYCTRL,
    "ENUM_FRAMESIZES": kernel.ENUM_FRAMESIZES,
}  # fmt: skip
CONTROLS = {
    "AUTO_WHITE_BALANCE": kernel.AUTO_WHITE_BALANCE, "GAMMA": kernel.GAMMA, "AUTOGAIN": kernel.AUTOGAIN,
    "GAIN": kernel.GAIN, "SHARPNESS": kernel.SHARPNESS, "BACKLIGHT_COMPENSATION": kernel.BACKLIGHT,
    "EXPOSURE_AUTO": kernel.EXPOSURE_MODE, "EXPOSURE_ABSOLUTE": kernel.EXPOSURE_TIME,
    "EXPOSURE_AUTO_PRIORITY": kernel.EXPOSURE_PRIORITY, "ANALOGUE_GAIN": kernel.ANALOGUE_GAIN,
}  # fmt: skip
FOURCC = {
    "RGGB": "SRGGB8", "BA81": "SBGGR8", "GRBG": "SGRBG8", "GBRG": "SGBRG8", "RG10": "SRGGB10", "BG12": "SBGGR12",
    "BA10": "SGRBG10", "BA12": "SGRBG12", "GR14": "SGRBG14", "GB16": "SGBRG16", "BYR2": "SBGGR16", "pRAA": "SRGGB10P",
    "pBCC": "SBGGR12P", "pgEE": "SGRBG14P", "pGAA": "SGBRG10P", "GREY": "GREY", "Y10 ": "Y10", "Y16 ": "Y16",
    "Y10P": "Y10P",
}  # fmt: skip


def test_structures_and_numbers_are_those_of_the_kernels_header(tmp_path):
    if shutil.which("gcc") is None or not Path("/usr/include/linux/videodev2.h").is_file():
        pytest.skip("gcc, or the kernel's headers, are not installed")
    ours, lines = {}, []
    for name, (structure, fields) in STRUCTURES.items():
        lines.append(f'printf("{name} %zu\\n", sizeof(struct {name}));')
        ours[name] = ctypes.sizeof(structure)
        for theirs, own in fields.items():
            lines.append(f'printf("{name}.{theirs} %zu\\n", offsetof(struct {name}, {theirs}));')
            ours[f"{name}.{theirs}"] = getattr(structure, own).offset
    for prefix, table in (("VIDIOC_", REQUESTS), ("V4L2_CID_", CONTROLS)):
        for name, number in table.items():
            lines.append(f'printf("{name} %lu\\n", (unsigned long){prefix}{name});')
            ours[name] = number
    for characters, name in FOURCC.items():
        lines.append(f'printf("fourcc-{name} %lu\\n", (unsigned long)V4L2_PIX_FMT_{name});')
        ours[f"fourcc-{name}"] = int.from_bytes(characters.encode(), "little")
    source = tmp_path / "header.c"
    head = "#include <stddef.h>\n#include <stdio.h>\n#include <linux/videodev2.h>\n"
    source.write_text(head + "int main(void) {\n" + "\n".join(lines) + "\nreturn 0;\n}\n")
    subprocess.run(["gcc", str(source), "-o", str(tmp_path / "header")], check=True)
    said = subprocess.run([str(tmp_path / "header")], capture_output=True, text=True, check=True).stdout
    theirs = {line.split()[0]: int(line.split()[1]) for line in said.splitlines()}
    assert ours == theirs
    assert set(REQUESTS.values()) <= set(HANDLERS)


def test_the_names_of_formats_are_their_numbers():
    for name in FORMATS:
        assert four_characters(int.from_bytes(name.encode(), "little")) == name


class DeviceFile(io.RawIOBase):
    """What the other client has of an open device."""

    mode, name = "rb+", "/dev/video7"

    def __init__(self, number):
        self.number = number

    def fileno(self):
        return self.number


def test_a_client_that_others_wrote_photographs_with_the_twin(monkeypatch):
    video = pytest.importorskip("linuxpy.video.device", reason="linuxpy is not installed (pip install linuxpy)")
    fake = FakeCamera(formats={"YUYV": ((64, 48),), "GREY": ((32, 16), (64, 48))})

    def call(file, request, argument):
        number = file if isinstance(file, int) else file.fileno()
        if (request := int(request) & 0xFFFFFFFF) == kernel.DQBUF:  # it waits in this call
            assert fake.ready(number, 1.0)
        fake.call(number, request, argument)

    monkeypatch.setattr("linuxpy.ioctl.fcntl.ioctl", call)
    monkeypatch.setattr(video, "mmap", SimpleNamespace(mmap=fake.memory))
    calls = SimpleNamespace(
        open=lambda *_, **__: DeviceFile(fake.open("")), select=SimpleNamespace(select=None),
        os=SimpleNamespace(get_blocking=lambda number: True),
    )  # fmt: skip
    device = video.Device("/dev/video7", io=calls)
    with device:
        assert device.info.card == fake.card
        assert {one.pixel_format.name for one in device.info.formats} == {"YUYV", "GREY"}
        sizes = {
            (one.info.width, one.info.height) for one in device.info.frame_sizes() if one.pixel_format.name == "GREY"
        }
        assert sizes == {(32, 16), (64, 48)}
        capture = video.VideoCapture(device)
        capture.set_format(64, 48, "GREY")
        with capture as stream:
            for number, frame in zip((1, 2, 3), stream, strict=False):
                levels = np.frombuffer(bytes(frame.data), np.uint8).reshape(48, 64)
                np.testing.assert_array_equal(levels, fake.numbers(0.0156, number))
                assert frame.frame_nb == number - 1


@pytest.mark.skipif(sys.platform != "linux", reason="V4L2 is Linux'")
def test_a_kernels_test_driver_is_photographed(tmp_path):
    """`vivid`, or a camera with v4l2loopback, where the machine has one."""
    devices = [path for path in Path("/sys/class/video4linux").glob("video*") if "vivid" in (path / "name").read_text()]
    if not devices:
        pytest.skip("there is no vivid device: modprobe vivid")
    camera = V4l2Camera(DngFolder(tmp_path, inspect_raw), f"/dev/{sorted(devices)[0].name}", V4l2Settings("Y16"))
    camera.connect()
    taken = camera.expose()
    assert inspect_raw(taken.path).sensor == camera.sensor()
    camera.close()
