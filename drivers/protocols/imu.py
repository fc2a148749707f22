"""Frames of two kinds of IMU: WitMotion's 0x55 frames, and the COBS frames of fast accelerometers.

WitMotion: `55 TT d0..d7 SUM`, SUM the low byte of the sum of the ten bytes before it. 0x55 occurs in data, too: a frame
is recognised by header, known type and checksum together.

Fast: `COBS(ver u8 | seq u16 | n u8 | t0_us u64 | dt_ns u32 | n x (ax ay az gx gy gz) i16 | crc16) 00`, little endian,
CRC-16/CCITT-FALSE over all bytes before it; ver 1 carries samples, ver 0 a text instead.
"""

import binascii
import struct
from dataclasses import dataclass
from functools import partial

from drivers.protocols.framing import BAD, MORE, Decoder, FrameSplitter

WIT_KINDS = frozenset(range(0x50, 0x5B)) | {0x5F}
WIT_LENGTH = 11
TEXT, SAMPLES = 0, 1
LONGEST_COBS = 4096


@dataclass(frozen=True)
class WitFrame:
    """Type and eight data bytes."""

    kind: int
    data: bytes

    @property
    def words(self) -> tuple[int, int, int, int]:
        """The data as four signed 16-bit numbers."""
        a, b, c, d = struct.unpack("<4h", self.data)
        return a, b, c, d

    def seconds(self) -> float:
        """The time of a 0x50 frame, in seconds since the beginning of its month."""
        day, hour, minute, second = self.data[2:6]
        return ((day * 24 + hour) * 60 + minute) * 60 + second + int.from_bytes(self.data[6:8], "little") / 1000


def _measure_wit(head: bytes) -> int:
    if len(head) > 1 and head[1] not in WIT_KINDS:
        return BAD
    if len(head) < WIT_LENGTH:
        return MORE
    return WIT_LENGTH if sum(head[:10]) & 0xFF == head[10] else BAD


WitParser = partial(
    Decoder[WitFrame], partial(FrameSplitter, b"\x55", _measure_wit), lambda frame: WitFrame(frame[1], frame[2:10])
)


def cobs_decode(stuffed: bytes) -> bytes | None:
    """Decode the bytes between two zeros; None if they are damaged."""
    out, at = bytearray(), 0
    while at < len(stuffed):
        code = stuffed[at]
        if code == 0 or at + code > len(stuffed):
            return None
        out += stuffed[at + 1 : at + code]
        at += code
        if code < 255 and at < len(stuffed):
            out.append(0)
    return bytes(out)


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF."""
    return binascii.crc_hqx(data, 0xFFFF)


@dataclass(frozen=True)
class SampleBatch:
    """A batch: sequence number, device time of the first sample, spacing, raw numbers per sample."""

    seq: int
    t0_us: int
    dt_ns: int
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class TextMessage:
    """A text message of the device."""

    text: str


def read_fast(stuffed: bytes) -> SampleBatch | TextMessage | None:
    """Decode one COBS frame; None if it is invalid."""
    frame = cobs_decode(stuffed)
    if frame is None or len(frame) < 3 or crc16(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
        return None
    body = frame[:-2]
    if body[0] == TEXT:
        return TextMessage(body[1:].decode("ascii", "replace"))
    if body[0] != SAMPLES or len(body) < 16:
        return None
    _, seq, n, t0_us, dt_ns = struct.unpack_from("<BHBQI", body)
    if len(body) != 16 + 12 * n:
        return None
    return SampleBatch(seq, t0_us, dt_ns, tuple(struct.iter_unpack("<6h", body[16:])))


class FastParser:
    """Bytes to batches and texts; a damaged frame is dropped, and shows as a gap in the sequence numbers."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[SampleBatch | TextMessage]:
        *frames, rest = (self._rest + data).split(b"\0")
        self._rest = rest[-LONGEST_COBS:]
        return [event for frame in frames if frame and (event := read_fast(frame[-LONGEST_COBS:])) is not None]
