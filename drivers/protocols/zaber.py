"""Messages of Zaber ASCII devices: bytes to events, checksums, rejections and warning flags with reason and remedy.

`@01 0 [id] OK IDLE -- data[:CC]` replies, `#01 0 text` information, `!01 1 IDLE --` alerts. CC is two hex digits of
minus the sum of the bytes between the first one and the colon.
Source: Zaber ASCII protocol manual.
"""

import re
from dataclasses import dataclass
from functools import partial

from drivers.protocols.framing import Decoder, LineSplitter, UnrecognisedLine, codes

REJECTIONS = codes("zaber rejection")
FLAGS = codes("zaber flag")
UNREFERENCED = ("WR", "WH", "WP")


def checksum(body: bytes) -> bytes:
    """The two digits of the bytes between the first byte and the colon."""
    return f"{-sum(body) & 0xFF:02X}".encode()


@dataclass(frozen=True)
class Reply:
    """An answer to a command; `number` is the message id, None if absent; `checked`: by a valid checksum."""

    device: int
    axis: int
    number: int | None
    accepted: bool
    busy: bool
    flag: str
    data: str
    checked: bool = False


@dataclass(frozen=True)
class Alert:
    """An unsolicited event, usually the end of a movement."""

    device: int
    axis: int
    busy: bool
    flag: str


@dataclass(frozen=True)
class Info:
    """Further information."""

    device: int
    axis: int
    text: str


Event = Reply | Alert | Info | UnrecognisedLine
_REPLY = re.compile(r"@(\d\d) (\d)(?: (\d\d|--))? (OK|RJ) (IDLE|BUSY) (\S\S) (.*)")
_ALERT = re.compile(r"!(\d\d) (\d)(?: (?:\d\d|--))? (IDLE|BUSY) (\S\S).*")
_INFO = re.compile(r"#(\d\d) (\d)(?: (?:\d\d|--))? (.*)")


def read_line(raw: bytes) -> Event:
    """Decode one line."""
    checked = len(raw) > 3 and raw[-3:-2] == b":"
    if checked and checksum(raw[1:-3]) != raw[-2:]:
        return UnrecognisedLine(raw)
    body = raw[:-3] if checked else raw
    line = body.decode("ascii", "replace")
    if match := _REPLY.fullmatch(line):
        number = int(match[3]) if match[3] and match[3] != "--" else None
        accepted, busy = match[4] == "OK", match[5] == "BUSY"
        return Reply(int(match[1]), int(match[2]), number, accepted, busy, match[6], match[7], checked)
    if match := _ALERT.fullmatch(line):
        return Alert(int(match[1]), int(match[2]), match[3] == "BUSY", match[4])
    if match := _INFO.fullmatch(line):
        return Info(int(match[1]), int(match[2]), match[3])
    return UnrecognisedLine(raw)


ZaberParser = partial(Decoder[Event], LineSplitter, read_line)
