"""Image file directories of TIFF 6.0 (sections 2 and 8) and EXIF as bytes, little-endian."""

import struct
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import accumulate

Entry = tuple[int, int, bytes]  # type, count, and the values' bytes

BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SRATIONAL = 1, 2, 3, 4, 5, 7, 10
STRIPS, EXIF = 273, 34665
FIRST = 8  # address of the first directory


def byte(*values: int) -> Entry:
    """An entry of bytes."""
    return BYTE, len(values), bytes(values)


def short(*values: int) -> Entry:
    """An entry of 16-bit numbers."""
    return SHORT, len(values), struct.pack(f"<{len(values)}H", *values)


def long(*values: int) -> Entry:
    """An entry of 32-bit numbers."""
    return LONG, len(values), struct.pack(f"<{len(values)}I", *values)


def text(value: str) -> Entry:
    """An entry of ASCII text."""
    raw = value.encode("ascii", "replace") + b"\0"
    return ASCII, len(raw), raw


def rational(*values: float, signed: bool = False) -> Entry:
    """An entry of fractions that round to these numbers, with denominators up to a million."""
    parts = [Fraction(value).limit_denominator(1_000_000) for value in values]
    code, most = ("<2i", 2**31 - 1) if signed else ("<2I", 2**32 - 1)
    raw = b"".join(struct.pack(code, min(part.numerator, most), part.denominator) for part in parts)
    return (SRATIONAL if signed else RATIONAL), len(values), raw


def head(tags: Mapping[int, Entry], exif: Mapping[int, Entry], sizes: Sequence[int]) -> bytes:
    """Everything before the strips, padded to a multiple of 16 bytes.

    tags, exif : entries by tag, without those of addresses; sizes : bytes of each strip.
    """
    # the lengths do not depend on the addresses: lay out once with zeros, then with the addresses
    links = {STRIPS: long(*[0] * len(sizes)), **({EXIF: long(0)} if exif else {})}
    exif_at = FIRST + len(directory({**tags, **links}, FIRST))
    after = directory(exif, exif_at) if exif else b""
    data_at = -(-(exif_at + len(after)) // 16) * 16
    strips = accumulate((data_at, *sizes[:-1]))
    links = {STRIPS: long(*strips), **({EXIF: long(exif_at)} if exif else {})}
    whole = struct.pack("<2sHI", b"II", 42, FIRST) + directory({**tags, **links}, FIRST) + after
    return whole.ljust(data_at, b"\0")


def directory(tags: Mapping[int, Entry], at: int) -> bytes:
    """A directory at this address: its entries, then the values that do not fit into them."""
    beyond, entries, values = at + 2 + 12 * len(tags) + 4, b"", b""
    for tag, (kind, count, raw) in sorted(tags.items()):
        place = raw.ljust(4, b"\0")
        if len(raw) > 4:
            place = struct.pack("<I", beyond + len(values))
            values += raw + b"\0" * (len(raw) % 2)
        entries += struct.pack("<HHI", tag, kind, count) + place
    return struct.pack("<H", len(tags)) + entries + bytes(4) + values
