"""Sensor dumps: parsing of layouts, and files that disagree with them."""

import numpy as np
import pytest

from procedures.outcome import BadInput, BadParameter
from procedures.raw import read_frame
from procedures.reading.sensor_dump import EXAMPLE, DumpLayout, has_raw_header


def test_layout_reads_as_it_is_written():
    assert DumpLayout.parse(EXAMPLE) == DumpLayout(1920, 1080, "RGGB", "u16le", 64, 1023)
    assert str(DumpLayout.parse(EXAMPLE)) == EXAMPLE
    assert str(DumpLayout.parse(" 8X6, y, U8, 0, 255")) == "8x6,Y,u8,0,255"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1920x1080,RGGB,u16le,64", "must have five or three parts; got '1920x1080,RGGB,u16le,64'"),
        ("1920,RGGB,u16le,64,1023", "the height of a sensor's samples must be a whole number; got ''"),
        ("-8x6,RGGB,u16le,64,1023", "the width of a sensor's samples must be a whole number; got '-8'"),
        ("8x1,RGGB,u16le,64,1023", "at least 2 x 2 pixels; got 8 x 1"),
        ("8x6,RGBG,u16le,64,1023", "one of RGGB, BGGR, GRBG, GBRG, Y; got 'RGBG'"),
        ("8x6,RGGB,u12,64,1023", "one of u8, u16le, u16be; got 'u12'"),
        ("8x6,RGGB,u16le,64.5,1023", "the black of a sensor's samples must be a whole number; got '64.5'"),
        ("8x6,RGGB,u16le,1023,1023", "black must be below white.*got 1023 and 1023"),
        ("8x6,RGGB,u8,0,1023", "white at most 255 for u8; got 0 and 1023"),
        ("RGGB,0,70000", "white at most 65535 for picture"),
    ],
)
def test_what_is_no_layout_is_said_with_an_example(text, reason):
    with pytest.raises(BadParameter, match=reason):
        DumpLayout.parse(text)


def test_a_mosaic_in_a_grey_picture_is_divided_into_planes_with_the_stated_levels(tmp_path):
    layout, levels = DumpLayout.parse("rggb,64,1023"), 64 + 20 * np.arange(48).reshape(6, 8)
    assert str(layout) == "RGGB,64,1023"
    (tmp_path / "mosaic.pgm").write_bytes(b"P5 8 6 65535\n" + levels.astype(">u2").tobytes())
    planes = read_frame(tmp_path / "mosaic.pgm", layout=layout).planes
    assert list(planes) == ["R", "G1", "G2", "B"]
    assert planes["B"].raw
    np.testing.assert_allclose(planes["B"].samples, (levels[1::2, 1::2] - 64.0) / (1023 - 64), rtol=1e-6)
    with pytest.raises(BadInput, match=r"x\.raw is no grey PGM, PNG or TIFF"):
        layout.read(bytes(96), "x.raw")


@pytest.mark.parametrize("more", [-1, 1, 96])
def test_size_that_disagrees_is_told_in_bytes(more):
    layout = DumpLayout.parse("8x6,RGGB,u16le,64,1023")
    with pytest.raises(BadInput, match=f"8 x 6 samples of u16le must have 96 bytes; x.raw has {96 + more}"):
        layout.read(bytes(96 + more), "x.raw")


def test_the_order_of_bytes_and_of_first_pixels_is_shown():
    levels = np.full((6, 8), 900, "<u2")
    assert (DumpLayout.parse("8x6,RGGB,u16le,64,1000").read(levels.tobytes(), "x.raw") == 900).all()
    with pytest.raises(BadInput, match=r"a white of 1000 samples must be at most 1023; x\.raw has 33795"):
        DumpLayout.parse("8x6,RGGB,u16be,64,1000").read(levels.tobytes(), "x.raw")
    assert DumpLayout.parse("8x6,GBRG,u8,0,255").first_pixels() == {
        "R": (1, 0),
        "G1": (1, 1),
        "G2": (0, 0),
        "B": (0, 1),
    }
    assert DumpLayout.parse("8x6,Y,u8,0,255").first_pixels() == {"Y": (0, 0)}


@pytest.mark.parametrize("head", [b"\0\0\0\x18ftypcrx ", b"FUJIFILMCCD-RAW", b"IIU\0\x18", b"II\x1a\0\0\0HEAPCCDR"])
def test_headers_of_raw_formats_are_known(head):
    assert has_raw_header(head)
    assert not has_raw_header(b"\x01" + head)
