"""GenicamCamera through the real Aravis, at its fake GigE Vision camera: another process, over the loopback network."""

import threading

import numpy as np
import pytest

from ..aravis_fake import IGNORED, fake_camera, require_aravis
from .conftest import comment_of

require_aravis(module=True)

from drivers.dng import DngFolder, OpticsMetadata  # noqa: E402
from drivers.errors import BadConfiguration, EmergencyStopped, FrameMissing, LineLost, Rejected  # noqa: E402
from drivers.genicam.camera import GenicamCamera, GenicamSettings  # noqa: E402
from drivers.interfaces import CameraSettings  # noqa: E402
from procedures.raw import read_frame  # noqa: E402
from station.bench.opening import inspect_raw, make_bench, read_config  # noqa: E402

pytestmark = pytest.mark.filterwarnings(IGNORED)


@pytest.fixture(scope="module")
def fake():
    with fake_camera() as address:
        yield address


@pytest.fixture
def make(fake, tmp_path):
    made = []

    def camera(settings=None, optics=None, name=fake):
        made.append(GenicamCamera(DngFolder(tmp_path, inspect_raw, optics), name, settings))
        return made[-1]

    yield camera
    for one in made:
        one.close()


def small(camera, columns=64, rows=48):
    """Of a frame of 2048 x 2048 pixels what these tests need."""
    camera.connect()
    camera._stop()
    camera._camera.set_region(0, 0, columns, rows)
    return camera


def test_it_says_who_it_is_and_connects_again(make):
    camera = make()
    for _ in range(2):
        identity = camera.connect()
        assert (identity.model, identity.serial, identity.address) == ("Aravis Fake", "GV01", "127.0.0.1")
        assert identity.firmware
        assert camera.condition().usable
    camera.close()
    assert not camera.condition().usable
    with pytest.raises(LineLost, match="connect first"):
        camera.expose()


@pytest.mark.slow  # Aravis asks the whole network for a second
def test_a_camera_that_is_not_there_reports_it(make):
    with pytest.raises(LineLost, match="check power, cable and address"):
        make(name="No-Such-Camera").connect()


@pytest.mark.parametrize(
    ("name", "planes", "white"),
    [("Mono8", {"Y"}, 255), ("Mono16", {"Y"}, 65535), ("BayerRG8", {"R", "G1", "G2", "B"}, 255)],
)
def test_a_frame_is_a_dng_with_its_exposure_record(make, name, planes, white):
    optics = OpticsMetadata(f_number=2.8, focal_length_mm=16.0, lens="Fixed 16", pixel_pitch_um=3.45)
    camera = small(make(GenicamSettings(name, gain_db=1.0), optics))
    camera.configure(CameraSettings(exposure_s=0.0125))
    taken = camera.expose()
    frame = read_frame(taken.path)
    assert set(frame.planes) == planes
    assert {plane.white for plane in frame.planes.values()} == {white}
    reported = frame.exposure
    assert (reported.exposure_s, reported.f_number, reported.focal_length_mm, reported.lens) == (
        0.0125, 2.8, 16.0, "Fixed 16",
    )  # fmt: skip
    assert (reported.camera, reported.iso) == ("Aravis Fake", None)
    assert taken.settings == CameraSettings(0.0125, None, 2.8)
    assert taken.sha256 == frame.sha256
    comment = comment_of(taken.path)
    assert (comment["pixel_format"], comment["gain_db"]) == (name, 1.0)


def test_the_pixels_are_those_that_were_sent(make):
    camera = small(make(GenicamSettings("Mono8", gain_db=0.0)))
    camera.configure(CameraSettings(exposure_s=0.01))
    numbers = read_frame(camera.expose().path).planes["Y"].samples * 255
    # its ramp moves from frame to frame, and is the same along diagonals
    np.testing.assert_allclose(numbers[1:, :-1], numbers[:-1, 1:], atol=1e-3)
    steps = np.diff(numbers[0])
    assert set(np.round(steps).astype(int)) <= {1, -254, -255}
    assert numbers.max() > numbers.min() + 60


def test_the_deepest_format_is_taken_by_itself(make):
    camera = small(make())
    assert comment_of(camera.expose().path)["pixel_format"] == "Mono16"


@pytest.mark.slow  # a hundred frames over the network
def test_a_hundred_frames_none_lost_each_with_its_record(make):
    camera = small(make(GenicamSettings("BayerRG8", gain_db=2.0)), columns=32, rows=24)
    times = [0.001 + 0.0001 * number for number in range(100)]
    frames = []
    for exposure_s in times:
        camera.configure(CameraSettings(exposure_s=exposure_s))
        frames.append(camera.expose())
    assert len({taken.path for taken in frames}) == 100
    comments = [comment_of(taken.path) for taken in frames]
    numbers = np.array([comment["frame"] for comment in comments])
    # GigE Vision counts frames from 1 to 65535 and begins again
    assert set(np.diff(numbers) % 65535) == {1}
    assert {comment["gain_db"] for comment in comments} == {2.0}
    # the camera counts microseconds, the file millionths: half of one each
    reported = [inspect_raw(taken.path).exposure_s for taken in frames]
    np.testing.assert_allclose(reported, times, atol=1.5e-6)
    statistics = camera._stream.get_statistics()
    assert statistics.n_missing_packets == 0


def test_what_the_camera_has_not_is_refused_by_name(make):
    with pytest.raises(BadConfiguration, match=r"no pixel format Mono12p .*name one of its own: BayerBG8, .*Mono16"):
        make(GenicamSettings("Mono12p")).connect()
    with pytest.raises(Rejected, match=r"no gain of 90 dB: it offers 0 .. 10"):
        make(GenicamSettings(gain_db=90.0)).connect()
    with pytest.raises(Rejected, match=r"is set to 0 dB instead of 0.5 dB"):  # its gain is a whole number
        make(GenicamSettings(gain_db=0.5)).connect()
    camera = small(make())
    with pytest.raises(Rejected, match=r"cannot expose 100 s: it offers 1e-05 .. 10"):
        camera.configure(CameraSettings(exposure_s=100.0))
    with pytest.raises(Rejected, match="a gain and no ISO"):
        camera.configure(CameraSettings(iso=100))


def test_a_frame_that_never_comes_is_an_error_and_the_next_one_comes(make):
    camera = small(make(GenicamSettings(patience_s=0.1)))
    camera.expose()
    camera._camera.set_trigger_source("Line0")  # nobody pulls that line
    with pytest.raises(FrameMissing, match=r"no frame came from 127.0.0.1 within"):
        camera.expose()
    camera._camera.set_trigger_source("Software")
    camera.expose()


def test_an_emergency_stop_ends_the_wait(make):
    camera = small(make(GenicamSettings(patience_s=60.0)))
    camera.expose()
    camera._camera.set_trigger_source("Line0")
    threading.Timer(0.1, camera.emergency_stop).start()
    with pytest.raises(EmergencyStopped):
        camera.expose()
    camera.emergency_stop()


def test_it_stands_in_station_toml(fake, tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "station.toml").write_text(
        f'[devices.camera]\ndriver = "genicam"\ncamera = "{fake}"\nfolder = "in"\ngain_db = 2\n'
    )
    bench = make_bench(read_config(tmp_path / "station.toml"), folder=tmp_path)
    bench.connect()
    bench.devices["camera"]._stop()
    bench.devices["camera"]._camera.set_region(0, 0, 32, 32)
    assert comment_of(bench.camera.expose().path)["gain_db"] == 2.0
    bench.close()
