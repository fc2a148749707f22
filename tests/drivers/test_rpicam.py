"""RpicamCamera at a program that behaves as `rpicam-still`."""

import json
import sys
import threading
import time

import numpy as np
import pytest

from drivers.dng import DngFolder
from drivers.errors import BadConfiguration, EmergencyStopped, FrameMissing, FrameWrong, LineLost, Rejected
from drivers.interfaces import CameraSettings, FrameFormat
from drivers.rpicam import RpicamCamera, RpicamSettings
from procedures.raw import read_frame
from station.bench.opening import inspect_raw, make_bench, read_config

from .rpicam_twin import install_twin

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the twin is a shell script")


@pytest.fixture
def make(tmp_path, monkeypatch):
    program, folder = install_twin(tmp_path), tmp_path / "frames"
    folder.mkdir()

    def camera(number=0, settings=None, **faults):
        monkeypatch.setenv("RPICAM_TWIN", json.dumps(faults))
        return RpicamCamera(DngFolder(folder, inspect_raw), number, settings, program=str(program))

    return camera


def test_it_says_who_it_is_and_its_deepest_mode(make):
    camera = make()
    identity = camera.connect()
    assert (identity.model, identity.serial) == ("Raspberry Pi imx477", "/base/soc/i2c/imx477@1a")
    assert identity.firmware == "v1.5.0 3d9ac10d5a3b 14-05-2024"
    assert camera.sensor() == FrameFormat(96, 64, "RGGB", 4095)
    camera.close()
    with pytest.raises(LineLost, match="connect first"):
        camera.expose()
    grey = make(1)
    grey.connect()
    assert grey.sensor() == FrameFormat(64, 48, None, 1023)


def test_the_file_is_the_programs_own_with_its_record(make, tmp_path):
    camera = make()
    camera.connect()
    camera.configure(CameraSettings(exposure_s=0.02, iso=200))
    taken = [camera.expose() for _ in range(2)]
    assert [one.path.name for one in taken] == ["IMG_0001.DNG", "IMG_0002.DNG"]
    assert taken[0].sha256 != taken[1].sha256
    frame = read_frame(taken[0].path)
    assert {(plane.black, plane.white) for plane in frame.planes.values()} == {(256.0, 4095.0)}
    assert (frame.exposure.exposure_s, frame.exposure.iso) == (pytest.approx(0.02), 200)
    assert taken[0].settings == CameraSettings(0.02, 200)
    assert inspect_raw(taken[0].path).sensor == camera.sensor()
    # the twin's light is as the exposure times the gain, in the mean over a ramp from 0.1 to 0.9
    mean = np.mean([plane.samples.mean() for plane in frame.planes.values()])
    assert mean == pytest.approx(0.5 * 0.02 * 2 / 0.04 * 4095 / (4095 - 256), abs=0.01)
    assert [path.name for path in (tmp_path / "frames").iterdir() if path.name.startswith(".")] == []


def test_another_mode_is_taken_by_its_bits(make):
    camera = make(settings=RpicamSettings(bits=10))
    camera.connect()
    assert inspect_raw(camera.expose().path).sensor == FrameFormat(64, 48, "RGGB", 1023)
    with pytest.raises(BadConfiguration, match="no raw mode of 14 bits: it offers 10, 12"):
        make(settings=RpicamSettings(bits=14)).connect()


def test_what_is_missing_is_reported(make, tmp_path):
    with pytest.raises(BadConfiguration, match=r"no program no-such-program; install it: apt install rpicam-apps"):
        RpicamCamera(DngFolder(tmp_path, inspect_raw), program="no-such-program").connect()
    with pytest.raises(LineLost, match=r"there is no camera 1: .* lists 0 \(imx477\); check its ribbon cable"):
        make(1, cameras=1).connect()
    with pytest.raises(LineLost, match=r"there is no camera 0: .* lists none"):
        make(cameras=0).connect()
    camera = make()
    camera.connect()
    with pytest.raises(Rejected, match="no ISO below 100; got 50"):
        camera.configure(CameraSettings(iso=50))


def test_a_photograph_that_fails_is_an_error_and_the_next_one_comes(make, monkeypatch):
    camera = make()
    camera.connect()
    for faults, error, words in (
        ({"fails": "failed to acquire camera imx477"}, LineLost, "failed: failed to acquire camera imx477; close oth"),
        ({"no_raw": True}, FrameMissing, "wrote no DNG; update rpicam-apps"),
    ):
        monkeypatch.setenv("RPICAM_TWIN", json.dumps(faults))
        with pytest.raises(error, match=words):
            camera.expose()
    monkeypatch.setenv("RPICAM_TWIN", "{}")
    camera.configure(CameraSettings(exposure_s=1e-5))  # shorter than the sensor can
    with pytest.raises(FrameWrong, match=r"taken at 2.9e-05 s instead of 1e-05 s"):
        camera.expose()
    camera.configure(CameraSettings(exposure_s=0.01))
    assert camera.expose().path.is_file()


def test_a_program_that_hangs_is_ended(make):
    camera = make(settings=RpicamSettings(patience_s=0.3), delay_s=60.0)
    camera.connect()
    with pytest.raises(FrameMissing, match=r"took no photograph within 0.33 s"):
        camera.expose()


def test_an_emergency_stop_ends_the_program(make):
    camera = make(delay_s=60.0)
    camera.connect()
    threading.Timer(0.05, camera.emergency_stop).start()
    begin_s = time.monotonic()
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert time.monotonic() - begin_s < 10.0  # half of its patience


def test_it_stands_in_station_toml(tmp_path):
    (tmp_path / "in").mkdir()
    lines = ('driver = "rpicam"', f'program = "{install_twin(tmp_path)}"', 'folder = "in"', "camera = 1", "gain = 2")
    (tmp_path / "station.toml").write_text("\n".join(("[devices.camera]", *lines, "pixel_pitch_um = 3.45")))
    bench = make_bench(read_config(tmp_path / "station.toml"), folder=tmp_path)
    bench.connect()
    assert bench.camera.expose().settings == CameraSettings(0.01, 200)
    assert bench.camera.sensor() == FrameFormat(64, 48, None, 1023, 3.45)
    bench.close()
