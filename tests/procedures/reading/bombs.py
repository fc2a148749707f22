"""Small files that announce vast contents: each writes one and names the reader that must refuse it."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

SIDE = 20_000
"""Pixels each way of the pictures: 400 million."""


def _npy_head(shape: tuple[int, ...]) -> bytes:
    data = io.BytesIO()
    np.lib.format.write_array_header_1_0(data, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return data.getvalue()


def _directory(tags: list[tuple[int, int, int, int]], following: int = 0) -> bytes:
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return struct.pack("<H", len(tags)) + entries + struct.pack("<I", following)


def tiff(path: Path, **sizes: int) -> Path:
    """A deflated picture in one strip, or of one tile of `tile` pixels each way."""
    side = sizes.get("side", SIDE)
    tags = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, 8), (262, 3, 1, 1), (277, 3, 1, 1)]
    strip = zlib.compress(bytes(1 << 22), 9)
    where = [(273, 4, 1, 8), (278, 4, 1, side), (279, 4, 1, len(strip))]
    if "tile" in sizes:
        where = [(code, 4, 1, sizes["tile"]) for code in (322, 323)] + [(324, 4, 1, 8), (325, 4, 1, len(strip))]
    path.write_bytes(b"II*\0" + struct.pack("<I", 8 + len(strip)) + strip + _directory(sorted(tags + where)))
    return path


def png(path: Path) -> Path:
    """A picture of zeros, deflated a thousand times."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packer, rows = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS), bytes(100 * (1 + SIDE))
    part = packer.compress(rows) + packer.flush(zlib.Z_FULL_FLUSH)  # it refers to nothing before it
    times = SIDE // 100
    checksum = struct.pack(">HH", times * len(rows) % 65521, 1)  # Adler-32 of zeros
    body = b"\x78\x01" + times * part + packer.flush() + checksum
    head = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b""))
    return path


def chunk(path: Path) -> Path:
    """A picture of 256 x 256 whose chunk of samples announces 1 GB."""
    head = struct.pack(">IIBBBBB", 256, 256, 8, 0, 0, 0, 0)
    begin = (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + head + struct.pack(">I", zlib.crc32(b"IHDR" + head))
    )
    path.write_bytes(begin + struct.pack(">I", 1 << 30) + b"IDAT" + zlib.compress(bytes(257 * 256)))
    return path


def dng(path: Path, tags: int = 0, directories: int = 1, side: int = 64, notes: int = 0) -> Path:
    """A mosaic with so many unknown tags, each of 131 000 values at one place, in so many directories.

    notes : so many such tags in the directory of the camera's notes (EXIF)
    """
    values = bytes(1 << 20)
    own = [(254, 4, 1, 0), (256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 16), (259, 3, 1, 1), (262, 3, 1, 32803)]
    own += [(273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, side), (279, 4, 1, 2 * side * side), (33421, 3, 2, 2 | 2 << 16)]
    own += [(33422, 1, 4, 0 | 1 << 8 | 1 << 16 | 2 << 24), (50706, 1, 4, 1 | 4 << 8)]
    more = _unknown(tags)
    if notes:
        own.append((34665, 4, 1, 8 + len(values)))
        values += _directory(_unknown(notes))
    begin = 8 + len(values)
    data = b"II*\0" + struct.pack("<I", begin) + values
    one = sorted(own + more)
    length = 2 + 12 * len(one) + 4
    for n in range(directories):
        data += _directory(one, begin + (n + 1) * length if n + 1 < directories else 0)
    path.write_bytes(data)
    return path


def _unknown(n: int) -> list[tuple[int, int, int, int]]:
    return [(40_000 + i % 9000 if i < 9000 else 51_200 + i % 9000, 2 + 2 * (i % 2), 131_000, 8) for i in range(n)]


def npz(path: Path) -> Path:
    """A member of 1.2 GB of zeros that is one of a film's, and compressed a thousand times."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("samples.npy", "w") as member,
    ):
        member.write(_npy_head((150_000_000,)))
        for _ in range(300):
            member.write(bytes(4_000_000))
    return path


def npy(path: Path) -> Path:
    """A header that announces what no file has."""
    path.write_bytes(_npy_head((1 << 40,)) + bytes(64))
    return path


def exr(path: Path) -> Path:
    """A picture's header with a window of 400 million pixels."""
    import OpenEXR

    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"R": np.zeros((4, 4), np.float32)}).write(str(path))
    small, large = struct.pack("<4i", 0, 0, 3, 3), struct.pack("<4i", 0, 0, SIDE - 1, SIDE - 1)
    path.write_bytes(path.read_bytes().replace(small, large))
    return path


def hdf5(path: Path) -> Path:
    """A field whose nodes are announced by the million, in one chunk of zeros."""
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "station/psf-field/2"
        plane = file.create_group("G1")
        plane.attrs["samples_per_pixel"] = 4
        nodes = plane.create_group("nodes")
        for name in ("position", "position_covariance", "sensor_position", "psf", "covariance"):
            nodes.create_dataset(name, (100_000_000, 17), "f8", chunks=(1000, 17), compression="gzip")
    return path


def colours(path: Path) -> Path:
    """A field's lateral colour, announced by the hundred million, in one chunk of zeros."""
    import h5py

    with h5py.File(hdf5(path), "r+") as file:
        file["G1"].attrs.update({"rows": 40, "columns": 60})
        for name, shape in (("position", (2,)), ("shift", (2,)), ("covariance", (2, 2))):
            place = f"lateral_colour/G1/{name}"
            file.create_dataset(place, (100_000_000, *shape), "f8", chunks=(1000, *shape), compression="gzip")
    return path


def deep(path: Path, begin: str) -> Path:
    """Lists in lists, a million deep, after a beginning."""
    path.write_text(begin + "[" * 1_000_000)
    return path
