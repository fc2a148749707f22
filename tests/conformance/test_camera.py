"""What every camera promises."""

import hashlib
from dataclasses import replace
from itertools import islice
from types import SimpleNamespace

import pytest

from drivers.errors import FrameMissing, FrameWrong
from drivers.interfaces import CameraSettings
from station.bench.opening import inspect_raw
from station.guide.focus.live import PhotographSource


@pytest.fixture
def camera(camera_rig):
    camera_rig.device.connect()
    return camera_rig.device


def test_one_exposure_is_one_hashed_file(camera):
    exposure = camera.expose()
    data = exposure.path.read_bytes()
    assert exposure.sha256 == hashlib.sha256(data).hexdigest()
    assert exposure.size_bytes == len(data)


def test_it_says_when(camera, camera_rig):
    before_s = camera_rig.clock.now_s()
    exposure = camera.expose()
    assert before_s <= exposure.requested_s < exposure.received_s <= camera_rig.clock.now_s()
    if exposure.shutter is not None:
        assert exposure.requested_s <= exposure.shutter.closed_s + 0.005 < exposure.received_s


def test_ten_exposures_are_ten_different_files(camera):
    exposures = [camera.expose() for _ in range(10)]
    assert len({exposure.sha256 for exposure in exposures}) == 10
    assert len({exposure.path for exposure in exposures}) == 10


def test_it_is_a_source_of_live_focusing(camera):
    if camera.sensor() is None:
        pytest.skip("the folder's files of this rig are no photographs")
    bench = SimpleNamespace(camera=camera, stops=0, check_stops=lambda since: None)
    frames = list(islice(PhotographSource(lambda: False).tethered(bench), 3))
    assert len({frame.path for frame in frames}) == 3
    assert all(frame.plane.value.samples.size for frame in frames)


def test_the_sensor_is_that_of_the_frames(camera):
    first = camera.expose()
    sensor = camera.sensor()
    if sensor is None:
        pytest.skip("the folder's files of this rig are no photographs")
    assert inspect_raw(first.path).sensor in (sensor, replace(sensor, pixel_pitch_um=None))


def test_settings_are_kept_and_checked(camera):
    camera.configure(CameraSettings(exposure_s=0.02))
    assert camera.expose().settings.exposure_s == 0.02
    camera.configure(CameraSettings(exposure_s=0.5))
    # a server that looks for itself has no image to give
    with pytest.raises((FrameWrong, FrameMissing), match=r"0.02 s instead of 0.5 s; set the body|its exposure failed"):
        camera.expose()


def test_a_frame_that_never_comes_is_an_error_within_the_deadline(camera, camera_rig):
    if camera_rig.bench is None:
        pytest.skip("a real body is not made to lose frames")
    camera_rig.bench.body.settings.lose_frames = frozenset({1})
    before_s = camera_rig.clock.now_s()
    with pytest.raises(FrameMissing, match=r"no (complete )?RAW file"):
        camera.expose()
    assert camera_rig.clock.now_s() - before_s <= 22.0  # both wait for twenty seconds after the exposure
    assert camera.expose().path.name.startswith("IMG_0002")
