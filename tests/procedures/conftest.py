"""Small DNG files, tag by tag, so that a test can write what no camera of ours writes."""

import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

WriteDng = Callable[..., Path]
Tag = tuple[str, Sequence[float] | bytes]

CODES = {"B": 1, "s": 2, "H": 3, "I": 4, "R": 5, "r": 10}
SIZES = {"B": 1, "s": 1, "H": 2, "I": 4, "R": 8, "r": 8}


def _payload(kind: str, values: Sequence[float] | bytes) -> bytes:
    if isinstance(values, bytes):
        return values
    if kind in "Rr":
        number = "I" if kind == "R" else "i"
        return b"".join(struct.pack(f"<2{number}", round(v * 10000), 10000) for v in values)
    return struct.pack(f"<{len(values)}{kind}", *values)


def _directory(tags: Mapping[int, Tag], base: int) -> bytes:
    entries, heap = b"", b""
    heap_at = base + 2 + 12 * len(tags) + 4
    for code in sorted(tags):
        kind, values = tags[code]
        payload = _payload(kind, values)
        value = payload.ljust(4, b"\0")
        if len(payload) > 4:
            value = struct.pack("<I", heap_at + len(heap))
            heap += payload + b"\0" * (len(payload) % 2)
        entries += struct.pack("<HHI", code, CODES[kind], len(payload) // SIZES[kind]) + value
    return struct.pack("<H", len(tags)) + entries + b"\0\0\0\0" + heap


def _tags(mosaic: npt.NDArray[np.uint16], cfa: Sequence[int], pixels_at: int, exif_at: int) -> dict[int, Tag]:
    rows, columns = mosaic.shape
    side = round(len(cfa) ** 0.5)
    return {
        254: ("I", [0]), 256: ("I", [columns]), 257: ("I", [rows]), 258: ("H", [16]), 259: ("H", [1]),
        262: ("H", [32803]), 271: ("s", b"Bench\0"), 272: ("s", b"Bench One\0"), 273: ("I", [pixels_at]),
        274: ("H", [1]), 277: ("H", [1]), 278: ("I", [rows]), 279: ("I", [2 * mosaic.size]), 284: ("H", [1]),
        33421: ("H", [side, side]), 33422: ("B", list(cfa)), 34665: ("I", [exif_at]), 50706: ("B", [1, 4, 0, 0]),
        50707: ("B", [1, 1, 0, 0]), 50708: ("s", b"Bench One\0"), 50710: ("B", [0, 1, 2]), 50711: ("H", [1]),
        50713: ("H", [2, 2]), 50714: ("R", [256, 257, 258, 259]), 50717: ("I", [16383]),
        50721: ("r", [1, 0, 0, 0, 1, 0, 0, 0, 1]), 50728: ("R", [0.5, 1, 0.7]), 50778: ("H", [21]),
    }  # fmt: skip


EXIF: dict[int, Tag] = {
    33434: ("R", [0.02]), 33437: ("R", [5.6]), 34855: ("H", [200]), 36867: ("s", b"2026:02:03 04:05:06\0"),
    37382: ("R", [2.35]), 37386: ("R", [50.0]), 42036: ("s", b"Bench 50mm\0"),
}  # fmt: skip


@pytest.fixture
def write_dng(tmp_path: Path) -> WriteDng:
    """A writer of 16-bit mosaics: `write(mosaic, cfa, tags={code: (kind, values) or None}, exif=...)`."""

    def write(
        mosaic: npt.NDArray[np.uint16],
        cfa: Sequence[int] = (0, 1, 1, 2),
        tags: Mapping[int, Tag | None] | None = None,
        exif: Mapping[int, Tag] | None = None,
        name: str = "frame.dng",
    ) -> Path:
        room = 4096
        chosen = {**_tags(mosaic, cfa, room, room // 2), **(tags or {})}
        head = b"II*\0" + struct.pack("<I", 8) + _directory({c: t for c, t in chosen.items() if t is not None}, 8)
        head = head.ljust(room // 2, b"\0") + _directory(EXIF if exif is None else exif, room // 2)
        path = tmp_path / name
        path.write_bytes(head.ljust(room, b"\0") + mosaic.astype("<u2").tobytes())
        return path

    return write
