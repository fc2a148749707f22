import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import rawpy

from procedures import BadInput, BadParameter, DumpLayout
from procedures.raw import default_plane, linear_colours, read_frame, read_planes

WHITE = 16383
BLACKS = np.array([[256, 257], [258, 259]])
ORDERS = {"RGGB": (0, 1, 1, 2), "BGGR": (2, 1, 1, 0), "GRBG": (1, 0, 2, 1), "GBRG": (1, 2, 0, 1)}
SIGNALS = {"R": 1000, "G1": 2000, "G2": 3000, "B": 4000}
ONE_BLACK = {50713: ("H", [1, 1]), 50714: ("H", [256])}
X_TRANS = (1, 1, 0, 1, 1, 2, 1, 1, 2, 1, 1, 0, 2, 0, 1, 0, 2, 1, 1, 1, 2, 1, 1, 0, 1, 1, 0, 1, 1, 2, 0, 2, 1, 2, 0, 1)


def mosaic_of(order, corner=(0, 0), shape=(60, 80)):
    """Signals of the four planes over a black level for each position, the pattern starting at `corner`."""
    rows, columns = ((np.arange(n) - c) % 2 for n, c in zip(shape, corner, strict=True))
    letters = np.array(list(order)).reshape(2, 2)
    names = letters.astype("<U2")
    red_row = int(np.argwhere(letters == "R")[0, 0])
    names[red_row][letters[red_row] == "G"] = "G1"
    names[1 - red_row][letters[1 - red_row] == "G"] = "G2"
    cell = BLACKS + np.vectorize(SIGNALS.get)(names)
    return cell[rows[:, None], columns].astype(np.uint16)


def assert_flat_planes(frame):
    """Each plane is its signal over the range from its own black to white, to the rounding of float32."""
    for name, signal in SIGNALS.items():
        plane = frame.planes[name]
        assert plane.samples.dtype == np.float32
        np.testing.assert_allclose(plane.samples, signal / (WHITE - plane.black), rtol=2e-7)
    assert sorted(plane.black for plane in frame.planes.values()) == sorted(BLACKS.ravel())


@pytest.mark.parametrize("order", ORDERS)
def test_mosaic_of_any_order_gives_back_the_planes_that_made_it(write_dng, order):
    frame = read_frame(write_dng(mosaic_of(order), ORDERS[order]))
    assert list(frame.planes) == ["R", "G1", "G2", "B"]
    assert_flat_planes(frame)


@pytest.mark.parametrize("corner", [(8, 16), (7, 16), (8, 15), (7, 15)])
def test_odd_active_area_moves_neither_colours_nor_their_black(write_dng, corner):
    # LibRaw rounds odd corners up, moves the mosaic with them and leaves the black levels where they were
    area = [corner[0], corner[1], corner[0] + 48, corner[1] + 60]
    frame = read_frame(write_dng(mosaic_of("RGGB", corner, (64, 96)), tags={50829: ("I", area)}))
    assert_flat_planes(frame)


@pytest.mark.parametrize("order", ORDERS)
def test_origin_tells_where_in_the_mosaic_a_plane_begins(write_dng, order):
    mosaic = mosaic_of(order)
    for plane in read_frame(write_dng(mosaic, ORDERS[order])).planes.values():
        x, y = plane.origin
        numbers = plane.samples * (plane.white - plane.black) + plane.black
        np.testing.assert_allclose(numbers, mosaic[y::2, x::2], atol=0.01)
        assert plane.pitch == 2


def test_masked_areas_do_not_replace_the_black_level_that_is_written(write_dng):
    mosaic = mosaic_of("RGGB")
    mosaic[:8] = 9000
    tags = {50829: ("I", [8, 0, 60, 80]), 50830: ("I", [0, 0, 8, 80])}
    assert_flat_planes(read_frame(write_dng(mosaic, tags=tags)))


def test_black_level_that_grows_along_rows_and_columns_is_subtracted(write_dng):
    rows, columns = np.arange(60), np.arange(80)
    mosaic = mosaic_of("RGGB") + rows[:, None].astype(np.uint16) + 2 * columns.astype(np.uint16)
    frame = read_frame(write_dng(mosaic, tags={50715: ("r", 2.0 * columns), 50716: ("r", 1.0 * rows)}))
    for name, signal in SIGNALS.items():
        plane = frame.planes[name]
        np.testing.assert_allclose(plane.samples, signal / (WHITE - plane.black), rtol=1e-6)


def test_white_level_becomes_one_and_below_black_stays_negative(write_dng):
    mosaic = np.full((40, 40), WHITE, np.uint16)
    mosaic[:, :2] = 0
    plane = read_frame(write_dng(mosaic)).planes["R"]
    assert plane.samples[0, 1] == pytest.approx(1, abs=1e-7)
    assert plane.samples[0, 0] == pytest.approx(-256 / (WHITE - 256))
    assert plane.quantisation == pytest.approx(1 / (WHITE - 256))


@pytest.mark.parametrize(("stuck", "others"), [(WHITE, 0), (0, 2000)])
def test_stuck_pixels_are_listed(write_dng, stuck, others):
    mosaic = mosaic_of("RGGB") + np.uint16(others)
    mosaic[20, 30] = stuck
    np.testing.assert_array_equal(read_frame(write_dng(mosaic)).planes["R"].bad_pixels, [[10, 15]])


def test_planes_are_chosen_named_and_hashed_whatever_the_file_is_called(write_dng, shared_data):
    mosaic = mosaic_of("RGGB")
    mosaic[20:26, 30:36] = WHITE
    assert len(read_frame(write_dng(mosaic)).planes["R"].bad_pixels) == 0
    assert list(read_frame(write_dng(mosaic_of("RGGB")), ["B", "R"]).planes) == ["R", "B"]
    path = write_dng(mosaic_of("RGGB"))
    frame = read_frame(path, ["G1"])
    (plane,) = read_planes(path, ["G1"]).values()
    assert np.array_equal(plane.samples, frame.planes["G1"].samples)
    assert plane.origin == frame.planes["G1"].origin
    with pytest.raises(BadParameter, match=r"must be one of R, G1, G2, B for .*; got 'Y'"):
        read_frame(write_dng(mosaic_of("RGGB")), ["Y"])
    with pytest.raises(BadParameter, match=r"must be one of Y for .*; got 'G1'"):
        read_frame(shared_data / "pattern_photo" / "img_example.pgm", ["G1"])
    assert default_plane(write_dng(mosaic_of("RGGB"))) == "G1"
    assert default_plane(shared_data / "raw" / "RAW_KODAK_DC50.KDC") == "G1"
    assert default_plane(shared_data / "edges" / "Test_edge1_mono.tif") == "Y"
    assert "G1" in read_frame(write_dng(mosaic_of("RGGB"), name="frame.tif")).planes
    path = shared_data / "raw" / "RAW_KODAK_DC50.KDC"
    assert read_frame(path, ["R"]).sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_hash_and_planes_are_of_the_same_bytes_though_the_file_is_replaced_meanwhile(write_dng, monkeypatch):
    path = write_dng(mosaic_of("RGGB"), ORDERS["RGGB"])
    whole, imread = path.read_bytes(), rawpy.imread

    def replaced(file):
        path.write_bytes(b"another file")
        return imread(file)

    monkeypatch.setattr(rawpy, "imread", replaced)
    frame = read_frame(path)
    assert path.read_bytes() == b"another file"
    assert frame.sha256 == hashlib.sha256(whole).hexdigest()
    assert_flat_planes(frame)


def test_pipes_devices_and_links_to_nothing_are_refused_by_name(tmp_path):
    os.mkfifo(tmp_path / "pipe.dng")
    (tmp_path / "zero.pgm").symlink_to("/dev/zero")
    (tmp_path / "link.dng").symlink_to("nowhere.dng")
    for name, reason in (
        ("pipe.dng", "a pipe or a device"),
        ("zero.pgm", "a pipe or a device"),
        ("link.dng", "nowhere"),
    ):
        with pytest.raises(BadInput, match=f"{name}.*{reason}"):
            read_frame(tmp_path / name)


def test_camera_dngs_are_scaled_and_interpolated_ones_refused(shared_data):
    frame = read_frame(shared_data / "raw" / "tinydng_colorchart.dng")
    for plane in frame.planes.values():
        assert plane.samples.shape == (578, 867)
        assert (plane.black, plane.white) == (2056, 15000)
        assert 0 < plane.samples.mean() < plane.samples.max() < 1
    # the two greens see the same light; 2 % is room for the mismatch of two channels
    assert frame.planes["G1"].samples.mean() == pytest.approx(frame.planes["G2"].samples.mean(), rel=0.02)
    planes = read_frame(shared_data / "raw" / "RAW_KODAK_DC50.KDC").planes
    assert planes["G1"].origin == (0, 0)
    assert np.corrcoef(planes["G1"].samples.ravel(), planes["G2"].samples.ravel())[0, 1] > 0.95
    with pytest.raises(BadInput, match="already demosaicked; a mosaic is required"):
        read_frame(shared_data / "raw" / "linear_no_mosaic.dng")


@pytest.mark.parametrize(
    ("cfa", "tags", "reason"),
    [
        (X_TRANS, {}, "6 x 6 mosaic of X-Trans"),
        (ORDERS["RGGB"], {33421: None, 33422: None}, "monochrome sensor"),
        ((3, 1, 5, 4), {}, "must have a 2 x 2 mosaic of red, green, green, blue"),
        ((0, 0, 1, 1), {}, "must have a 2 x 2 mosaic of red, green, green, blue"),
        (ORDERS["RGGB"], {50717: ("I", [200])}, "white level above its black level 256; it is 200"),
        (ORDERS["RGGB"], {50713: None}, "repeat pattern of 1 x 1 requires as many black levels; .* has 4"),
        (ORDERS["RGGB"], {50715: ("r", [1.0] * 7)}, "one value per column; .* has 7"),
        (ORDERS["RGGB"], {50716: ("r", [])}, "one value per row; .* has 0"),
        (ORDERS["RGGB"], {50713: ("H", [0, 0])}, "repeat pattern of 0 x 0 requires as many black levels; .* has 4"),
        (ORDERS["RGGB"], {50713: ("H", [4, 4]), 50714: ("R", range(16))}, "black must be one level per plane"),
    ],
)
def test_what_is_no_bayer_mosaic_is_refused_by_name(write_dng, cfa, tags, reason):
    with pytest.raises(BadInput, match=reason):
        read_frame(write_dng(mosaic_of("RGGB"), cfa, tags))


@pytest.mark.parametrize(
    ("cfa", "tags"), [((0, 1, 2, 3), {50710: ("B", [3, 4, 5, 1])}), ((0, 0, 1, 1) * 4, {33421: ("H", [4, 4])})]
)
def test_a_mosaic_of_four_colours_or_4_x_4_pixels_is_not_demosaicked(write_dng, cfa, tags):
    path = write_dng(mosaic_of("RGGB"), cfa, tags)
    with pytest.raises(BadInput, match="must have three colours in 2 x 2 or 6 x 6"):
        linear_colours(path.read_bytes(), "a.dng")


def test_a_monochrome_dng_gives_every_pixel_as_y(write_dng):
    # black by position as the writer's (256..259), white 16383: what comes out is what went in
    truth = np.random.default_rng(0).integers(300, 16000, (40, 50)).astype(np.uint16)
    path = write_dng(truth, tags={33421: None, 33422: None, 262: ("H", [34892])})
    frame = read_frame(path)
    assert list(frame.planes) == [default_plane(path)] == ["Y"]
    plane = frame.planes["Y"]
    black = np.tile([[256.0, 257.0], [258.0, 259.0]], (20, 25))
    np.testing.assert_allclose(plane.samples * (16383 - 257.5) + black, truth, atol=0.01)  # single precision
    assert (plane.pitch, plane.origin, frame.exposure.exposure_s) == (1, (0, 0), 0.02)
    with pytest.raises(BadParameter, match="must be one of Y"):
        read_frame(path, ["G1"])


@pytest.mark.parametrize("lost", [1, 100, 1_000_000, 3_905_000])
def test_truncated_raw_is_refused_in_silence(shared_data, tmp_path, capfd, lost):
    whole = (shared_data / "raw" / "tinydng_colorchart.dng").read_bytes()
    cut = tmp_path / "cut.dng"
    cut.write_bytes(whole[:-lost])
    with pytest.raises(BadInput, match="truncated or damaged") as refusal:
        read_frame(cut)
    assert "card again" in refusal.value.remedy
    assert capfd.readouterr() == ("", "")


def test_truncated_raw_without_a_known_layout_is_refused(shared_data, tmp_path):
    cut = tmp_path / "cut.kdc"
    cut.write_bytes((shared_data / "raw" / "RAW_KODAK_DC50.KDC").read_bytes()[:-5000])
    with pytest.raises(BadInput, match="truncated or damaged"):
        read_frame(cut)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty"),
        (b"remember to photograph the chart\n", "is a text file"),
        (b"remember to photograph the chart\n" * 500, "is a text file"),
        (b"II*\0" + bytes(range(256)) * 40, "must have the header of a RAW format"),
        (b"FUJIFILM" + bytes(range(256)) * 40, "is not a RAW file that LibRaw"),
        (bytes(range(256)) * 40, "must have the header of a RAW format"),
        (b"\xff\xd8\xff\xe0" + bytes(100), "of the format JPEG"),
        (b"P6 2 2 255\n" + bytes(12), "of the format PPM"),
        (b"\0\0\0\x20ftypavif" + bytes(100), "of the format AVIF"),
        (b"\0\0\0\x20ftypheic" + bytes(100), "of the format HEIC"),
    ],
)
def test_what_is_no_photograph_is_refused_by_name(tmp_path, capfd, content, reason):
    path = tmp_path / "frame.dng"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=reason):
        read_frame(path)
    assert capfd.readouterr() == ("", "")


def test_missing_file_and_folder_are_refused(tmp_path):
    with pytest.raises(BadInput, match="there is no file"):
        read_frame(tmp_path / "absent.dng")
    with pytest.raises(BadInput, match="is a folder"):
        read_frame(tmp_path)


def test_name_with_other_letters_is_read(shared_data, tmp_path):
    path = Path(shutil.copyfile(shared_data / "raw" / "RAW_KODAK_DC50.KDC", tmp_path / "märz – 1.kdc"))
    assert read_frame(path).path == path


# LibRaw takes a file of 4 147 200 bytes for a headerless camera's, whatever it holds
@pytest.mark.parametrize("begins", [b"", b"II*\0", b"MM\0*\0\0\0\x08"])
def test_no_size_makes_a_photograph_of_random_bytes(tmp_path, begins):
    path = tmp_path / "noise.raw"
    path.write_bytes((begins + np.random.default_rng(0).bytes(4_147_200))[:4_147_200])
    with pytest.raises(BadInput, match="must have the header of a RAW format") as refused:
        read_frame(path)
    assert "--raw WIDTHxHEIGHT" in refused.value.remedy


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", ["u16le", "u16be"])
def test_sensor_dump_gives_the_planes_of_the_dng_with_the_same_samples(write_dng, tmp_path, order, kind):
    mosaic = mosaic_of(order) - np.tile(BLACKS, (30, 40)).astype(np.uint16) + np.uint16(256)
    path = tmp_path / "frame.raw"
    path.write_bytes(mosaic.astype("<u2" if kind == "u16le" else ">u2").tobytes())
    layout = DumpLayout.parse(f"80x60,{order},{kind},256,{WHITE}")
    dumped, dng = read_frame(path, layout=layout), read_frame(write_dng(mosaic, ORDERS[order], tags=ONE_BLACK))
    assert default_plane(path, layout) == "G1"
    assert list(dumped.planes) == list(dng.planes)
    for name, plane in dumped.planes.items():
        np.testing.assert_array_equal(plane.samples, dng.planes[name].samples)
        assert (plane.origin, plane.pitch, plane.white) == (dng.planes[name].origin, 2, WHITE)
    assert list(read_frame(path, ["B"], layout).planes) == ["B"]
