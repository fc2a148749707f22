"""Machine-vision pixel formats as arrays: grey and Bayer, of 8 to 16 bits, unpacked or packed.

Reference: EMVA, GenICam Pixel Format Naming Convention 2.4 (names, `p`: the least significant bits first, no gaps);
GigE Vision 2.0, pixel formats (`Packed`: two pixels in three bytes, their high bits in the outer ones).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Mosaic = npt.NDArray[np.uint16]
TILES = {"RG": "RGGB", "BG": "BGGR", "GR": "GRBG", "GB": "GBRG"}
NAME = re.compile(r"(?:Mono|Bayer(RG|BG|GR|GB))(8|10|12|14|16)(p|Packed)?")


@dataclass(frozen=True)
class PixelFormat:
    """Bits per pixel, packing, and the colours of the 2 x 2 tile; None for a monochrome sensor.

    packing : "" for whole bytes, low bits used, little-endian; "p" or "Packed" as in the names; "csi2": the high bytes
        of 4 pixels (2 of 12 bits), then their low bits, as on the serial lines of sensors.
    """

    name: str
    bits: int
    packing: str = ""
    cfa: str | None = None

    @property
    def white(self) -> int:
        """The largest number."""
        return int(2**self.bits - 1)

    def octets(self, pixels: int) -> int:
        """Bytes of this many consecutive pixels."""
        if self.packing == "p":
            return -(-pixels * self.bits // 8)
        if self.packing == "Packed":
            return -(-pixels * 3 // 2)
        if self.packing == "csi2":
            group = csi2_group(self.bits)
            return -(-pixels // group) * group * self.bits // 8
        return pixels * (1 if self.bits == 8 else 2)


def csi2_group(bits: int) -> int:
    """Pixels in a group that ends at a byte."""
    return 2 if bits == 12 else 4


def pixel_format(name: str) -> PixelFormat | None:
    """The format of this name; None if it is not a grey or raw one that can be unpacked."""
    match = NAME.fullmatch(name)
    if match is None:
        return None
    tile, bits, packing = match[1], int(match[2]), match[3] or ""
    if packing and bits not in ((10, 12) if packing == "Packed" else (10, 12, 14)):
        return None
    return PixelFormat(name, bits, packing, TILES[tile] if tile else None)


def deepest(names: Iterable[str]) -> PixelFormat | None:
    """The format with the most bits that can be unpacked; of several, a mosaic first, then the most compact."""
    known = [form for form in map(pixel_format, names) if form is not None]
    return max(known, key=lambda form: (form.bits, form.cfa is not None, bool(form.packing)), default=None)


def unpack(data: bytes, form: PixelFormat, rows: int, columns: int, padding: int = 0) -> Mosaic:
    """Decode an image to (rows, columns) numbers.

    padding : bytes between rows; if 0, packed rows follow each other without a gap, also in mid-byte.

    Raises ValueError if there are fewer bytes than the picture takes.
    """
    lines, pixels = (rows, columns) if padding or form.packing == "csi2" else (1, rows * columns)
    each = form.octets(pixels)
    stride = each + padding
    if len(data) < lines * stride - padding:
        raise ValueError(
            f"{rows} x {columns} pixels of {form.name} take {lines * stride - padding} bytes; received {len(data)}"
        )
    flat = np.frombuffer(data[: lines * stride].ljust(lines * stride, b"\0"), np.uint8).reshape(lines, stride)[:, :each]
    read = {"": _whole, "p": _low_bits_first, "Packed": _in_three_bytes, "csi2": _high_bytes_first}[form.packing]
    return np.ascontiguousarray(read(flat, form.bits)[:, :pixels].reshape(rows, columns))


Octets = npt.NDArray[np.uint8]


def _whole(octets: Octets, bits: int) -> Mosaic:
    if bits == 8:
        return octets.astype(np.uint16)
    return np.ascontiguousarray(octets).view("<u2").astype(np.uint16)


def _low_bits_first(octets: Octets, bits: int) -> Mosaic:
    """Groups of pixels that end at a byte: 4 of 10 or 14 bits, 2 of 12, each group a little-endian number."""
    group = 2 if bits == 12 else 4
    size = group * bits // 8
    lines = octets.shape[0]
    padded = np.zeros((lines, -(-octets.shape[1] // size) * size), np.uint8)
    padded[:, : octets.shape[1]] = octets
    parts = padded.reshape(lines, -1, size).astype(np.uint64)
    word = sum((parts[..., i] << np.uint64(8 * i) for i in range(size)), np.zeros(parts.shape[:2], np.uint64))
    mask = np.uint64(2**bits - 1)
    numbers = np.stack([(word >> np.uint64(bits * i)) & mask for i in range(group)], axis=-1)
    return numbers.astype(np.uint16).reshape(lines, -1)


def _in_three_bytes(octets: Octets, bits: int) -> Mosaic:
    """High eight bits in the first and third byte, low bits of the first pixel in the low half of the second."""
    lines, low = octets.shape[0], bits - 8
    padded = np.zeros((lines, -(-octets.shape[1] // 3) * 3), np.uint8)
    padded[:, : octets.shape[1]] = octets
    first, middle, third = np.moveaxis(padded.reshape(lines, -1, 3).astype(np.uint16), -1, 0)
    mask = np.uint16(2**low - 1)
    pair = ((first << low) | (middle & mask), (third << low) | ((middle >> 4) & mask))
    return np.stack(pair, axis=-1).reshape(lines, -1)


def _high_bytes_first(octets: Octets, bits: int) -> Mosaic:
    """Groups of high bytes, followed by the low bits of the same pixels, the first pixel's lowest."""
    lines, group, low = octets.shape[0], csi2_group(bits), bits - 8
    parts = octets.reshape(lines, -1, group * bits // 8)
    high = parts[..., :group].astype(np.uint16) << np.uint16(low)
    single = np.unpackbits(parts[..., group:], axis=-1, bitorder="little").reshape(*high.shape, low).astype(np.uint16)
    return (high | single @ (1 << np.arange(low, dtype=np.uint16))).reshape(lines, -1)
