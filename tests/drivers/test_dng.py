from datetime import datetime

import exifread
import numpy as np
import pytest
import rawpy

from drivers.dng import Shot, pack, write_dng

ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG")
SHOT = Shot(
    exposure_s=1 / 80, f_number=7.1, iso=320, focal_length_mm=85.0, subject_distance_mm=2345.0,
    captured_at=datetime(2026, 3, 1, 10, 20, 30), lens="Test 85 mm", serial="A-17", lens_serial="L-4",
    comment='{"truth": 1}',
)  # fmt: skip
BLACK = (256, 257, 258, 259)


def written(path, rng, cfa="RGGB", bits=14, container=16, shape=(400, 500)):
    mosaic = rng.integers(0, 2**bits, shape, dtype=np.uint16)
    write_dng(path, mosaic, SHOT, cfa=cfa, black=BLACK, white=2**bits - 1, bits=container)
    return mosaic


@pytest.mark.parametrize("cfa", ORDERS)
@pytest.mark.parametrize(("bits", "container"), [(10, 16), (12, 16), (14, 16), (16, 16), (10, 10), (12, 12), (14, 14)])
def test_every_number_is_read_back(tmp_path, rng, cfa, bits, container):
    mosaic = written(tmp_path / "a.dng", rng, cfa, bits, container)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image, mosaic)
        assert raw.white_level == 2**bits - 1
        names = raw.color_desc.decode()
        assert "".join(names[i] for i in raw.raw_pattern.ravel()) == cfa


@pytest.mark.parametrize("cfa", ORDERS)
def test_each_position_keeps_its_black_level(tmp_path, rng, cfa):
    written(tmp_path / "a.dng", rng, cfa)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        by_position = [raw.black_level_per_channel[raw.raw_colors[i // 2, i % 2]] for i in range(4)]
    assert tuple(by_position) == BLACK


@pytest.mark.parametrize("shape", [(400, 502), (401, 501), (400, 503)])
@pytest.mark.parametrize("container", [10, 12, 14])
def test_rows_that_do_not_end_on_a_byte_are_filled_up(tmp_path, rng, shape, container):
    mosaic = written(tmp_path / "a.dng", rng, bits=container, container=container, shape=shape)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        rows, columns = raw.raw_image.shape
        np.testing.assert_array_equal(raw.raw_image, mosaic[:rows, :columns])


def test_the_exposure_is_read_back_by_libraw(tmp_path, rng):
    written(tmp_path / "a.dng", rng)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        other = raw.other
        assert other.iso_speed == 320
        assert other.shutter_speed == pytest.approx(1 / 80, rel=1e-6)
        assert other.aperture == pytest.approx(7.1, rel=1e-6)
        assert other.focal_length == pytest.approx(85)
        assert other.timestamp == SHOT.captured_at
        assert raw.lens.model == "Test 85 mm"


def test_the_exposure_is_read_back_by_an_exif_reader(tmp_path, rng):
    written(tmp_path / "a.dng", rng)
    with open(tmp_path / "a.dng", "rb") as file:
        tags = exifread.process_file(file, details=False)
    assert float(tags["EXIF ExposureTime"].values[0]) == pytest.approx(1 / 80)
    assert float(tags["EXIF FNumber"].values[0]) == pytest.approx(7.1)
    assert tags["EXIF ISOSpeedRatings"].values == [320]
    assert float(tags["EXIF FocalLength"].values[0]) == 85
    assert float(tags["EXIF SubjectDistance"].values[0]) == pytest.approx(2.345)
    assert str(tags["EXIF BodySerialNumber"]) == "A-17"
    assert str(tags["EXIF LensSerialNumber"]) == "L-4"
    assert str(tags["EXIF DateTimeOriginal"]) == "2026:03:01 10:20:30"


def test_without_a_mosaic_the_file_is_monochrome(tmp_path, rng):
    mosaic = written(tmp_path / "a.dng", rng, cfa=None)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image, mosaic)
        assert raw.num_colors == 1


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_packing_puts_the_most_significant_bit_first(rng, bits):
    row = rng.integers(0, 2**bits, (1, 11), dtype=np.uint16)
    text = "".join(format(int(v), f"0{bits}b") for v in row[0])
    text = text.ljust(-(-len(text) // 8) * 8, "0")
    assert pack(row, bits) == bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8))


def test_numbers_too_large_for_the_file_are_refused(tmp_path):
    with pytest.raises(ValueError, match="do not fit into 12 bits; write 16"):
        write_dng(tmp_path / "a.dng", np.full((4, 4), 5000, np.uint16), SHOT, cfa="RGGB", black=BLACK, white=1, bits=12)
    assert not (tmp_path / "a.dng").exists()


@pytest.mark.parametrize(("orientation", "flip"), [(1, 0), (3, 3), (6, 6), (8, 5)])
def test_a_turned_camera_reports_it_and_keeps_its_numbers(tmp_path, rng, orientation, flip):
    mosaic = rng.integers(0, 4096, (400, 500), dtype=np.uint16)
    write_dng(tmp_path / "a.dng", mosaic, SHOT, cfa="RGGB", black=BLACK, white=4095, orientation=orientation)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.sizes.flip == flip
        np.testing.assert_array_equal(raw.raw_image, mosaic)


def test_what_is_not_known_is_not_written_and_the_pitch_is(tmp_path, rng):
    shot = Shot(exposure_s=0.01, f_number=None, iso=None, focal_length_mm=None, lens="", pixel_pitch_um=3.45)
    write_dng(
        tmp_path / "a.dng", rng.integers(0, 4096, (30, 40), np.uint16), shot, cfa=None, black=(0,) * 4, white=4095
    )
    with open(tmp_path / "a.dng", "rb") as file:
        tags = exifread.process_file(file, details=False)
    assert not {"EXIF FNumber", "EXIF ISOSpeedRatings", "EXIF FocalLength", "EXIF LensModel"} & set(tags)
    assert float(tags["EXIF ExposureTime"].values[0]) == 0.01
    # pixels in a centimetre (unit 3)
    assert 10_000 / float(tags["EXIF FocalPlaneXResolution"].values[0]) == pytest.approx(3.45, rel=1e-6)
    assert tags["EXIF FocalPlaneResolutionUnit"].values == [3]
