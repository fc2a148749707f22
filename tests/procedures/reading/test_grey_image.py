import io
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from procedures import BadInput, read_frame
from procedures.reading.grey_image import read_pgm

LEVELS = (np.arange(12 * 20).reshape(12, 20) * 17).astype(np.uint16)


def grey(path):
    return read_frame(path).planes["Y"]


def encoded(suffix, image, flags=()):
    return cv2.imencode(suffix, image, list(flags))[1].tobytes()


def pages(*sizes):
    """A TIFF of several pages."""
    file = io.BytesIO()
    first, *more = (Image.new("L", size[::-1]) for size in sizes)
    first.save(file, "TIFF", save_all=True, append_images=more)
    return file.getvalue()


def small_tiff(*, bits=8, photometric=1, orientation=1, compression=1):
    """A TIFF of one strip of 8 bits, whatever its tags say."""
    samples = LEVELS.astype(np.uint8).tobytes()
    rows, columns = LEVELS.shape
    tags = (
        (256, columns), (257, rows), (258, bits), (259, compression), (262, photometric), (273, 8), (274, orientation),
        (277, 1), (278, rows), (279, len(samples)),
    )  # fmt: skip
    entries = b"".join(struct.pack(">HHIHH", code, 3, 1, value, 0) for code, value in tags)
    head = b"MM\0*" + struct.pack(">I", 8 + len(samples))
    return head + samples + struct.pack(">H", len(tags)) + entries + bytes(4)


@given(
    levels=hnp.arrays(np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.integers(0, 4095)),
    comment=st.sampled_from(["", "# by a camera, 12 bit\n", "# 1 2 3\n#\n"]),
    plain=st.booleans(),
)
def test_pgm_gives_back_what_was_written(levels, comment, plain):
    rows, columns = levels.shape
    head = f"{'P2' if plain else 'P5'}\n{comment}{columns} {rows}\n{comment}4095\n".encode()
    body = " ".join(map(str, levels.ravel())).encode() if plain else levels.astype(">u2").tobytes()
    found, white = read_pgm(head + body, "a.pgm")
    np.testing.assert_array_equal(found, levels)
    assert white == 4095


@pytest.mark.parametrize("maxval", [1, 100, 255, 256, 1023, 4095, 65535])
def test_maxval_of_a_pgm_is_white(tmp_path, maxval):
    path = tmp_path / "white.pgm"
    kind = np.uint8 if maxval < 256 else ">u2"
    path.write_bytes(f"P5 3 2 {maxval}\n".encode() + np.array([0, maxval, maxval] * 2, kind).tobytes())
    plane = grey(path)
    np.testing.assert_allclose(plane.samples, [[0, 1, 1]] * 2, atol=1e-7)
    assert plane.quantisation == pytest.approx(1 / maxval)


def test_samples_that_look_like_blanks_or_comments_are_samples(tmp_path):
    path = tmp_path / "tricky.pgm"
    path.write_bytes(b"P5 2 2 255\n#\n \t")
    np.testing.assert_array_equal((grey(path).samples * 255).round().ravel(), list(b"#\n \t"))


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".tif"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_png_and_tiff_of_both_depths_are_scaled_by_their_range(tmp_path, suffix, kind):
    levels = (LEVELS % 256).astype(kind)
    path = tmp_path / f"image{suffix}"
    path.write_bytes(encoded(suffix, levels))
    plane = grey(path)
    np.testing.assert_allclose(plane.samples * np.iinfo(kind).max, levels, rtol=1e-6)
    assert (plane.pitch, plane.origin, plane.white) == (1, (0, 0), np.iinfo(kind).max)


def test_slanted_edge_sample_is_read(shared_data):
    plane = grey(shared_data / "edges" / "Test_edge1_mono.tif")
    assert plane.samples.shape == (124, 343)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("short.pgm", b"P5 4 2 255\n123", "declares 8 samples; it has 3"),
        ("short.pgm", b"P2 4 2 255\n1 2 3", "declares 8 samples; it has 3"),
        ("short.pgm", b"P5 4 2 65535\n12345678", "declares 8 samples; it has 4"),
        ("vast.pgm", b"P5 99999999 99999999 255\n12", "is truncated"),
        ("odd.pgm", b"P5 of a dog", "without width, height and maxval"),
        ("odd.pgm", b"P5 0 2 255\n12", "0 x 2"),
        ("odd.pgm", b"P5 1 1 70000\n12", "maxval of 1 to 65535"),
        ("odd.pgm", b"P5 1 1 100\n\xff", "must not exceed the maxval 100; .* has 255"),
        ("odd.pgm", b"P2 2 1 255\n1 x", "other text"),
        ("odd.pgm", b"P2 2 1 255\n1 -1", "outside its maxval"),
        ("colour.png", encoded(".png", np.zeros((4, 4, 3), np.uint8)), "has colours"),
        ("colour.png", encoded(".png", np.zeros((4, 4, 4), np.uint8)), "colours and transparency"),
        (
            "bits.png",
            encoded(".png", np.zeros((4, 4), np.uint8), (cv2.IMWRITE_PNG_BILEVEL, 1)),
            "8 or 16 bits; .* has 1",
        ),
        ("cut.png", encoded(".png", LEVELS)[:-40], "no end chunk"),
        ("cut.png", encoded(".png", LEVELS)[:20], "truncated: 20 bytes"),
        ("colour.tif", encoded(".tif", np.zeros((4, 4, 3), np.uint8)), "3 channels"),
        ("real.tif", encoded(".tif", np.zeros((4, 4), np.float32)), "has floating-point"),
        ("cut.tif", encoded(".tif", LEVELS)[:40], "cannot be decoded completely"),
        ("none.tif", b"II*\0" + bytes(50), "cannot be decoded completely"),
        ("inverted.tif", small_tiff(photometric=0), "with white as 0"),
        ("deep.tif", small_tiff(bits=12), "8 or 16 bits; .* has 12"),
        ("coded.tif", small_tiff(compression=50000), "compression 50000, in strips"),
        ("stack.tif", pages((12, 20), (12, 20)), "largest of 2; a later one"),
        ("thumbnail.tif", pages((3, 5), (12, 20)), "largest of 2; a later one"),
    ],
)
def test_what_is_no_grey_plane_is_refused_by_name(tmp_path, capfd, name, content, reason):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BadInput, match=reason):
        read_frame(path)
    assert capfd.readouterr() == ("", "")


def test_damaged_png_is_refused(tmp_path, rng, capfd):
    content = bytearray(encoded(".png", rng.integers(0, 65535, (40, 40), np.uint16)))
    content[1500] ^= 0xFF
    path = tmp_path / "damaged.png"
    path.write_bytes(content)
    with pytest.raises(BadInput, match="cannot be decoded completely"):
        read_frame(path)
    assert capfd.readouterr() == ("", "")


def big_tiff(levels, columns=None):
    """A BigTIFF of one strip; `columns` is what it announces."""
    rows, width = levels.shape
    tags = {256: columns or width, 257: rows, 258: 16, 259: 1, 262: 1, 273: 16, 277: 1, 278: rows, 279: levels.nbytes}
    entries = b"".join(struct.pack("<HHQQ", code, 4 if code != 258 else 3, 1, value) for code, value in tags.items())
    head = b"II+\0" + struct.pack("<HHQ", 8, 0, 16 + levels.nbytes)
    return head + levels.astype("<u2").tobytes() + struct.pack("<Q", len(tags)) + entries + bytes(8)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_camera_held_upright_gives_the_sensors_rows(tmp_path, orientation):
    path = tmp_path / "turned.tif"
    path.write_bytes(small_tiff(orientation=orientation))
    np.testing.assert_allclose(grey(path).samples * 255, LEVELS % 256, rtol=1e-6)


def test_big_tiff_is_read_and_its_size_is_looked_at_as_well(tmp_path):
    path = tmp_path / "big.tif"
    path.write_bytes(big_tiff(LEVELS))
    np.testing.assert_allclose(grey(path).samples * 65535, LEVELS, rtol=1e-6)
    path.write_bytes(big_tiff(LEVELS, columns=100_000_000))
    with pytest.raises(BadInput, match="100000000 x 12 samples: 4800 MB in memory"):
        read_frame(path)
