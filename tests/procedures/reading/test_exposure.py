import io

import numpy as np
import pytest

from procedures import BadParameter, read_frame
from procedures.reading.exposure import Exposure, check_typed, disagreements, read_exposure

MOSAIC = np.full((40, 60), 1000, np.uint16)


def test_exposure_of_a_dng_comes_from_libraw_then_exif(write_dng):
    exposure = read_frame(write_dng(MOSAIC)).exposure
    assert exposure == Exposure(
        camera="Bench One", lens="Bench 50mm", exposure_s=0.02, f_number=5.6, iso=200, focal_length_mm=50,
        subject_distance_mm=2350, captured_at="2026-02-03T04:05:06", sources=exposure.sources,
    )  # fmt: skip
    assert exposure.sources is not None
    assert {name for name, source in exposure.sources.items() if source == "EXIF"} == {"camera", "subject_distance_mm"}


def test_what_the_camera_did_not_write_stays_unknown(write_dng):
    exposure = read_frame(write_dng(MOSAIC, exif={36867: ("s", b"    :  :     :  :  \0")})).exposure
    assert exposure == Exposure(camera="Bench One", sources={"camera": "EXIF"})


def test_zero_and_old_exposures_are_read_as_they_are_meant(shared_data):
    # LibRaw reads this file's zero ApertureValue and ShutterSpeedValue as f/1 and 1 s
    exposure = read_frame(shared_data / "raw" / "tinydng_colorchart.dng").exposure
    assert (exposure.f_number, exposure.exposure_s) == (None, None)
    assert exposure.camera == "Canon EOS Kiss X4"
    exposure = read_frame(shared_data / "raw" / "RAW_KODAK_DC50.KDC").exposure
    assert (exposure.f_number, exposure.exposure_s) == (6.2, 0.00435)
    assert (exposure.focal_length_mm, exposure.subject_distance_mm) == (37, 8200)


def test_infinite_distance_is_unknown(write_dng):
    assert read_frame(write_dng(MOSAIC, exif={37382: ("H", [0])})).exposure.subject_distance_mm is None


@pytest.mark.parametrize("content", [b"", b"no tags", b"II*\0" + b"\xff" * 60, b"MM\0*\0\0\0\x08\0\x01" + b"\xff" * 12])
def test_broken_tags_tell_nothing_and_raise_nothing(content):
    assert read_exposure(io.BytesIO(content)) == Exposure(sources={})


@pytest.mark.parametrize(("unit", "per_unit"), [(None, 25400.0), (2, 25400.0), (3, 10000.0), (4, 1000.0)])
def test_pixel_pitch_comes_from_the_resolution_of_the_focal_plane(write_dng, unit, per_unit):
    exif = {41486: ("R", [per_unit / 4.0])} | ({} if unit is None else {41488: ("H", [unit])})
    assert read_frame(write_dng(MOSAIC, exif=exif)).exposure.pixel_pitch_um == pytest.approx(4.0)


def test_what_is_typed_must_not_contradict_the_camera():
    noted = Exposure(f_number=2.8, focal_length_mm=50.0, pixel_pitch_um=4.3)
    assert disagreements(noted, {"f_number": 2.83, "focal_length_mm": 51.6, "pixel_pitch_um": 4.35}) == []
    assert disagreements(noted, {"f_number": None}) == disagreements(Exposure(), {"f_number": 5.6}) == []
    with pytest.raises(
        BadParameter, match=r"a\.dng: the f-number was given as 5\.6, but the camera recorded 2\.8; "
    ) as found:
        check_typed(noted, {"f_number": 5.6, "pixel_pitch_um": 8.6}, "a.dng", "add --trust-typed")
    assert "the pixel pitch was given as 8.6 µm, but the camera recorded 4.3 µm" in found.value.reason
    assert found.value.remedy == "omit or correct it; to keep it, add --trust-typed"
