"""Packed pixels: bits laid out by hand, as the naming convention and GigE Vision draw them."""

import numpy as np
import pytest

from drivers.genicam.pixel_formats import PixelFormat, deepest, pixel_format, unpack


def bits_low_first(numbers, bits):
    """Each number's bits from the least significant on, one after another; bytes are filled from their low bit on."""
    text = "".join(format(int(number), f"0{bits}b")[::-1] for number in numbers)
    text = text.ljust(-(-len(text) // 8) * 8, "0")
    return bytes(int(text[i : i + 8][::-1], 2) for i in range(0, len(text), 8))


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_twelve_and_ten_bits_are_packed_as_the_conventions_draw_them():
    # 0xABC and 0x123 (PFNC 2.4, figure of Mono12p): BC, A of the first in the low half, 3 above it, 12
    truth = [[0xABC, 0x123]]
    np.testing.assert_array_equal(unpack(bytes([0xBC, 0x3A, 0x12]), PixelFormat("", 12, "p"), 1, 2), truth)
    # GigE Vision's Mono12Packed: AB, C in the low half and 3 in the high one, 12
    np.testing.assert_array_equal(
        unpack(bytes([0xAB, 0x3C, 0x12]), PixelFormat("", 12, "Packed"), 1, 2), [[0xABC, 0x123]]
    )
    # 0b11_0000_0110 = 774 and 0b00_1111_1101 = 253: high eight bits outside, low two at bits 0 and 4 of the middle
    data = bytes([0b11000001, 0b0001_0010, 0b00111111])
    np.testing.assert_array_equal(unpack(data, PixelFormat("", 10, "Packed"), 1, 2), [[774, 253]])


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize(("rows", "columns"), [(4, 8), (3, 5), (1, 1), (5, 7)])
def test_bits_without_a_gap_come_back(rng, bits, rows, columns):
    truth = rng.integers(0, 2**bits, (rows, columns))
    form = PixelFormat("", bits, "p")
    np.testing.assert_array_equal(unpack(bits_low_first(truth.ravel(), bits), form, rows, columns), truth)


@pytest.mark.parametrize("bits", [10, 12])
def test_rows_with_bytes_between_them_begin_anew(rng, bits):
    truth = rng.integers(0, 2**bits, (4, 5))
    rows = [bits_low_first(row, bits) + b"\xff\xff" for row in truth]
    for data in (b"".join(rows), b"".join(rows)[:-2]):  # the last row's may be left out
        np.testing.assert_array_equal(unpack(data, PixelFormat("", bits, "p"), 4, 5, padding=2), truth)


@pytest.mark.parametrize(("bits", "kind"), [(8, "u1"), (10, "<u2"), (12, "<u2"), (14, "<u2"), (16, "<u2")])
def test_whole_bytes_come_back(rng, bits, kind):
    truth = rng.integers(0, 2**bits, (3, 5))
    np.testing.assert_array_equal(unpack(truth.astype(kind).tobytes(), PixelFormat("", bits), 3, 5), truth)


@pytest.mark.parametrize("columns", [4, 5])
def test_an_odd_last_pixel_of_three_bytes_is_there(rng, columns):
    truth = rng.integers(0, 4096, columns)
    pairs = np.append(truth, np.zeros(columns % 2, int)).reshape(-1, 2).tolist()
    data = bytes(v for a, b in pairs for v in (a >> 4, (b & 15) << 4 | a & 15, b >> 4))
    data = data[: -(-columns * 3 // 2)]
    np.testing.assert_array_equal(unpack(data, PixelFormat("", 12, "Packed"), 1, columns), [truth])


def test_a_picture_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match=r"4 x 4 pixels of Mono12p take 24 bytes; received 23"):
        unpack(bytes(23), pixel_format("Mono12p"), 4, 4)


@pytest.mark.parametrize(
    ("name", "reported"),
    [
        ("Mono8", PixelFormat("Mono8", 8)),
        ("Mono12Packed", PixelFormat("Mono12Packed", 12, "Packed")),
        ("BayerRG12p", PixelFormat("BayerRG12p", 12, "p", "RGGB")),
        ("BayerGB16", PixelFormat("BayerGB16", 16, "", "GBRG")),
        *(
            (name, None)
            for name in ("RGB8", "Mono8p", "Mono16Packed", "Mono14Packed", "YUV422Packed", "Mono1p", "mono8")
        ),
    ],
)
def test_names_report_bits_packing_and_colours(name, reported):
    assert pixel_format(name) == reported


def test_the_deepest_raw_format_is_chosen():
    offered = ["Mono8", "BayerRG8", "RGB8", "BayerRG10", "BayerRG12p", "BayerRG12", "Mono12"]
    assert deepest(offered).name == "BayerRG12p"
    assert deepest(["RGB8", "YUV422"]) is None
