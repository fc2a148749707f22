import shutil

import pytest

from drivers.errors import EmergencyStopped, FrameMissing, FrameWrong, LineLost, NoAnswer
from drivers.folder_camera import FolderCamera, Tether
from drivers.frames import ExposureMetadata, is_raw
from drivers.interfaces import CameraSettings


def inspect(path):
    if not path.read_bytes().endswith(b"END"):
        raise ValueError("the end is missing")
    return ExposureMetadata(exposure_s=0.02, iso=100)


@pytest.fixture
def camera(bench, box):
    camera = FolderCamera(bench.folder, box, inspect, tether=Tether(patience_s=8.0), clock=bench.clock)
    camera.connect()
    return camera


@pytest.mark.parametrize(("pieces", "pause_s"), [(5, 0.4), (3, 2.0)])  # the second: longer than it must rest
def test_a_file_that_grows_in_pieces_is_taken_when_it_is_whole(camera, bench, pieces, pause_s):
    bench.body.settings.pieces, bench.body.settings.pause_s = pieces, pause_s
    assert camera.expose().path.read_bytes().endswith(b"END")


def test_a_file_renamed_into_place_is_found(camera, bench):
    bench.body.settings.rename = True
    assert camera.expose().path.name == "IMG_0001.DNG"


def test_the_jpeg_beside_a_raw_is_a_companion_not_the_frame(camera, bench):
    bench.body.settings.companion = True
    exposure = camera.expose()
    assert is_raw(exposure.path)
    assert [path.name for path in exposure.companions] == ["IMG_0001.JPG"]


def test_half_a_file_is_never_accepted_and_is_named(camera, bench):
    bench.body.settings.half_frames = frozenset({1})
    with pytest.raises(FrameMissing, match=r"IMG_0001.DNG: it does not decode \(the end is missing\)"):
        camera.expose()


def test_a_copy_of_an_earlier_frame_is_not_a_new_one(camera, bench):
    first = camera.expose()
    bench.body.settings.lose_frames = frozenset({2})
    bench.body._plan(
        bench.clock.now_s() + 1.0, lambda: (bench.folder / "COPY.DNG").write_bytes(first.path.read_bytes())
    )
    with pytest.raises(FrameMissing):
        camera.expose()


def test_what_lay_in_the_folder_before_is_left_alone(camera, bench):
    (bench.folder / "OLD.DNG").write_bytes(b"old END")
    assert camera.expose().path.name == "IMG_0001.DNG"


def test_two_raw_files_for_one_exposure_are_refused(camera, bench):
    bench.body._plan(0.0, lambda: None)
    bench.body.settings.companion = False
    real = bench.body.develop

    def twice(opening):
        (bench.folder / "EXTRA.DNG").write_bytes(b"another END")
        return real(opening)

    bench.body.develop = twice
    with pytest.raises(FrameWrong, match="gave 2 RAW files"):
        camera.expose()


def test_the_frame_of_a_failed_exposure_is_not_taken_for_the_next_ones(camera, bench):
    faults = bench.cables["shutter"].faults
    now_s = bench.clock.now_s()
    # the order to shoot arrives, its answer does not
    faults.silent, spoil = ((now_s + 0.0, now_s + 2.0),), faults.spoil
    faults.spoil = lambda data, at_s: data
    faults.spoil_reply = lambda data, at_s: b"" if b"OK" in data or b"EVT" in data else data
    with pytest.raises(NoAnswer):
        camera.expose()
    faults.silent, faults.spoil = (), spoil
    del faults.spoil_reply
    assert camera.expose().path.name == "IMG_0002.DNG"
    assert [path.name for path in sorted(bench.folder.iterdir())] == ["IMG_0001.DNG", "IMG_0002.DNG"]


@pytest.mark.parametrize(
    "wrong", [CameraSettings(exposure_s=0.03), CameraSettings(iso=200), CameraSettings(exposure_s=0.02, iso=50)]
)
def test_settings_that_the_file_contradicts_are_an_error(camera, wrong):
    camera.configure(wrong)
    with pytest.raises(FrameWrong, match=r"instead of .*; set the body, repeat"):
        camera.expose()


def test_a_third_of_a_stop_is_how_bodies_round(camera):
    camera.configure(CameraSettings(exposure_s=0.02 * 1.2, iso=100))
    assert camera.expose().settings.iso == 100


def test_in_bulb_the_contact_is_held_for_the_exposure(bench, box):
    bench.body.settings.bulb = True
    tether = Tether(bulb=True)
    camera = FolderCamera(
        bench.folder, box, lambda path: ExposureMetadata(exposure_s=3.0), tether=tether, clock=bench.clock
    )
    camera.connect()
    camera.configure(CameraSettings(exposure_s=3.0))
    camera.expose()
    assert bench.body.openings[0].exposure_s == pytest.approx(3.0, abs=1e-3)


def test_a_folder_that_is_not_there_is_reported(bench, box):
    with pytest.raises(LineLost, match="there is no folder"):
        FolderCamera(bench.folder / "nowhere", box, inspect, clock=bench.clock).connect()


def test_a_folder_that_goes_away_is_an_error_of_the_device(camera):
    shutil.rmtree(camera.address)
    with pytest.raises(LineLost, match="cannot be read: No such file or directory; bring it back"):
        camera.expose()


def test_an_emergency_stop_ends_the_wait_for_a_frame(camera, bench):
    bench.body.settings.lose_frames = frozenset({1})

    def stop():
        bench.clock.sleep(3.0)
        camera.emergency_stop()

    begin_s = bench.clock.now_s()
    exposed, _ = bench.clock.together(camera.expose, stop)
    assert isinstance(exposed, EmergencyStopped)
    assert bench.clock.now_s() - begin_s < 4.0  # of the 8 s that a frame is awaited


def test_a_stop_while_the_folder_is_read_leaves_the_contacts_open(camera, bench, monkeypatch):
    look = camera._look
    monkeypatch.setattr(camera, "_look", lambda: (camera.emergency_stop(), look())[1])
    with pytest.raises(EmergencyStopped):
        camera.expose()
    assert not bench.body.openings
