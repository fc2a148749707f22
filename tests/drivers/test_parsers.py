"""Every parser: any split of the stream gives the same events, garbage never raises, and noise is left behind."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import shutter as strig
from drivers.light import DmxFrame, DmxParser, frame
from drivers.protocols import grbl as grbl
from drivers.protocols import zaber as zaber
from drivers.protocols.imu import FastParser, SampleBatch, TextMessage, WitFrame, WitParser, cobs_decode, crc16
from drivers.rangefinder import BoschFrame, BoschParser, JrtFrame, JrtParser, JrtRangefinder, crc8
from drivers.tmcl import link as tmcl
from drivers.transport import SerialTransport
from simulators.devices.imu import ccitt, stuff
from simulators.devices.instruments import bosch

FUZZ_BYTES = 1_000_000


def fast(body: bytes) -> bytes:
    return stuff(body + ccitt(body).to_bytes(2, "little")) + b"\0"


# per parser: a stream of good messages, the events it means, and the longest message
STREAMS: dict[str, tuple[Callable[[], Any], list[bytes], list[Any]]] = {
    "grbl": (
        grbl.GrblParser,
        [
            b"\r\nGrbl 1.1h ['$' for help]\r\n", b"[MSG:'$H'|'$X' to unlock]\r\n", b"ok\r\n", b"error:9\r\n",
            b"<Idle|MPos:0.000,-10.000,5.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n", b"$130=200.000\r\n", b"ALARM:2\r\n",
            b"Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]\r\n", b"[VER:1.1h.20190830:]\r\n",
            b"<Hold:0|WPos:1.5,2,-3|Bf:15,128|Pn:XYZ>\r\n",
            b"<Run|MPos:1.000,2.000|FS:500,0|A:|TLR:0|H:1,7|SD:12.50,/jobs/a part.nc>\r\n",
            b"<Run|MPos:1.0x0,2.000|FS:500,0>\r\n", b"$/axes/x/max_travel_mm=300.000\r\n",
        ],
        [
            grbl.Banner("GRBL", "1.1h"),
            grbl.Feedback("MSG", "'$H'|'$X' to unlock"),
            grbl.Ok(),
            grbl.Failed(9),
            grbl.Status("Idle", 0, {"MPos": "0.000,-10.000,5.000", "FS": "0,0", "WCO": "0.000,0.000,0.000"}),
            grbl.GrblSetting(130, 200.0),
            grbl.AlarmRaised(2),
            grbl.Banner("FluidNC", "3.7.8"),
            grbl.Feedback("VER", "1.1h.20190830:"),
            grbl.Status("Hold", 0, {"WPos": "1.5,2,-3", "Bf": "15,128", "Pn": "XYZ"}),
            grbl.Status(
                "Run",
                0,
                {
                    "MPos": "1.000,2.000",
                    "FS": "500,0",
                    "A": "",
                    "TLR": "0",
                    "H": "1,7",
                    "SD": "12.50,/jobs/a part.nc",
                },
            ),
            grbl.UnrecognisedLine(b"<Run|MPos:1.0x0,2.000|FS:500,0>"),
            grbl.ConfigItem("axes/x/max_travel_mm", "300.000"),
        ],
    ),
    "zaber": (
        zaber.ZaberParser,
        [b"@01 0 07 OK IDLE -- 0\r\n", b"@02 1 RJ BUSY NI BADDATA\r\n", b"!01 1 IDLE --\r\n", b"#01 0 text\r\n"],
        [
            zaber.Reply(1, 0, 7, True, False, "--", "0"),
            zaber.Reply(2, 1, None, False, True, "NI", "BADDATA"),
            zaber.Alert(1, 1, False, "--"),
            zaber.Info(1, 0, "text"),
        ],
    ),
    "tmcl": (
        tmcl.TmclParser,
        # answers to SIO, as a module gave them, and to a position of -1000
        [bytes.fromhex(one) for one in ("0201640e0000000075", "0201640e0000000176", "02016406fffffc187f")],
        [bytes.fromhex(one) for one in ("0201640e0000000075", "0201640e0000000176", "02016406fffffc187f")],
    ),
    "strig": (
        strig.StrigParser,
        [
            b"STRIG/1 uno 1.0 A7\n", b"STRIG/2 uno 2.0 A7\n", b"EVT SHAKE 4 123456\n", b"OK 3\n",
            b"EVT SHUTTER 3 123456789012\n", b"EVT FLASH 5\n", b"SYNC 77\n", b"ERR 3 busy\n",
            b"STRIG/4 uno 4.0 A7*48\n", b"SYNC 77 12*04\n", b"S 5 0001FFFE100080007FFF0000*1C\n",
        ],
        [
            strig.Hello("uno", "1.0", "A7"), strig.Hello("uno", "2.0", "A7", 2), strig.Contact("SHAKE", 4, 123456),
            strig.Accepted(3), strig.Contact("SHUTTER", 3, 123456789012), strig.Contact("FLASH", 0, 5),
            strig.BoxTime(77), strig.Refusal(3, "busy"), strig.Hello("uno", "4.0", "A7", 4), strig.BoxTime(77, 12),
            strig.Sample(5, (1, -2, 4096, -32768, 32767, 0)),
        ],
    ),
    "wit": (
        WitParser,
        [
            bytes.fromhex("55510000000000 08c4097b".replace(" ", "")),
            bytes.fromhex("5552a400000000 00c40918".replace(" ", "")),
            bytes.fromhex("55530040000000 000000e8".replace(" ", "")),
        ],
        [
            WitFrame(0x51, bytes.fromhex("00000000 0008c409")),
            WitFrame(0x52, bytes.fromhex("a4000000 0000c409")),
            WitFrame(0x53, bytes.fromhex("00400000 00000000")),
        ],
    ),
    "fast": (
        FastParser,
        [
            fast(b"\0OK"),
            fast(bytes.fromhex("01 0700 02 4000000000000000 40420f00") + bytes(range(24))),
        ],
        [
            TextMessage("OK"),
            SampleBatch(7, 64, 1000000, ((256, 770, 1284, 1798, 2312, 2826), (3340, 3854, 4368, 4882, 5396, 5910))),
        ],
    ),
    "jrt": (
        JrtParser,
        [bytes.fromhex("aa0000220003000008 59004fd5".replace(" ", "")), bytes.fromhex("ee 00 0000 0001 0008 09")],
        [JrtFrame(False, 0x22, bytes.fromhex("00000859004f")), JrtFrame(True, 0, b"\0\x08")],
    ),
    "bosch": (
        BoschParser,
        [bosch(bytes.fromhex("0004 40420f00")), bosch(b"\0\0")],
        [BoschFrame(0, bytes.fromhex("40420f00")), BoschFrame(0, b"")],
    ),
    "dmx": (
        DmxParser,
        [bytes.fromhex("7e0604 0000ff8000e7".replace(" ", "")), frame(10, bytes.fromhex("78563412"))],
        [DmxFrame(6, bytes.fromhex("00ff8000")), DmxFrame(10, bytes.fromhex("78563412"))],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STREAMS)
def test_a_good_stream_means_its_events(name):
    make, messages, events = STREAMS[name]
    assert make().feed(b"".join(messages)) == events


@pytest.mark.parametrize("name", STREAMS)
@given(cuts=st.lists(st.integers(0, 400), max_size=12), noise=st.binary(max_size=40))
@settings(max_examples=40, deadline=None)
def test_any_split_gives_the_same_events(name, cuts, noise):
    make, messages, _ = STREAMS[name]
    stream = noise + b"".join(messages) + noise[::-1]
    parser, at, found = make(), 0, []
    for cut in [*sorted(cuts), len(stream)]:
        found += parser.feed(stream[at:cut])
        at = max(at, cut)
    assert found == make().feed(stream)


@pytest.mark.parametrize("name", STREAMS)
@given(garbage=st.binary(max_size=400))
@settings(max_examples=60, deadline=None)
def test_garbage_never_raises(name, garbage):
    STREAMS[name][0]().feed(garbage)


@pytest.mark.parametrize("name", STREAMS)
def test_after_noise_the_parser_is_in_step_within_one_frame(name, rng):
    make, messages, events = STREAMS[name]
    parser = make()
    noise = rng.integers(0, 256, FUZZ_BYTES, dtype=np.uint8).tobytes()
    for at in range(0, len(noise), 997):
        parser.feed(noise[at : at + 997])
    longest = max(len(message) for message in messages)
    if name == "dmx":  # its frames have no checksum: a false start may claim up to the longest frame
        parser.feed(bytes(600))
    else:
        parser.feed(messages[0])
        if name in ("jrt", "bosch"):
            parser.feed(bytes([0x11]) * longest)
    assert parser.feed(b"".join(messages)) == events


@pytest.mark.parametrize("name", [name for name in STREAMS if name in ("grbl", "zaber", "wit", "jrt", "fast")])
@given(at=st.integers(0, 10_000), flip=st.integers(1, 255))
@settings(max_examples=40, deadline=None)
def test_one_damaged_byte_costs_its_own_message_only(name, at, flip):
    make, messages, events = STREAMS[name]
    which = at % len(messages)
    # not the byte that ends it: with that one the next message is lost too
    body = messages[which].rstrip(b"\r\n\0")
    spoilt = bytearray(messages[which])
    spoilt[at // len(messages) % len(body)] ^= flip
    stream = [*messages[:which], bytes(spoilt), *messages[which + 1 :]]
    found = make().feed(b"".join(stream))
    for i, event in enumerate(events):
        if i not in (which, which + 1):
            assert event in found


# --- vectors of the protocols' documents


@pytest.mark.parametrize(
    ("body", "digits"), [(b"01 tools echo", b"8F"), (b"1 0 1 home", b"65"), (b"1 1 2 move abs 20000", b"ED")]
)
def test_zaber_checksums(body, digits):
    assert zaber.checksum(body) == digits


def test_a_zaber_line_with_a_wrong_checksum_is_not_read():
    line = b"@01 0 OK IDLE -- 0"
    good = line + b":" + zaber.checksum(line[1:])
    assert isinstance(zaber.read_line(good), zaber.Reply)
    assert isinstance(zaber.read_line(good[:-1] + b"G"), zaber.UnrecognisedLine)


@pytest.mark.parametrize("frame_hex", ["c04000ee", "c0410096", "c042001e"])
def test_bosch_crcs(frame_hex):
    data = bytes.fromhex(frame_hex)
    assert crc8(data[:3]) == data[3]


def test_cobs_vector():
    assert cobs_decode(bytes.fromhex("0201030203 01".replace(" ", ""))) == bytes.fromhex("0100020300")


@given(st.binary(max_size=700))
def test_cobs_gives_back_what_was_stuffed(data):
    stuffed = stuff(data)
    assert 0 not in stuffed
    assert cobs_decode(stuffed) == data


def test_crc16_of_the_check_string():
    # the check value every catalogue gives for CRC-16/CCITT-FALSE
    assert crc16(b"123456789") == 0x29B1 == ccitt(b"123456789")


@pytest.mark.parametrize(
    ("frame_hex", "scale", "value"),
    [("5551000000000008c4097b", 16 / 32768, 1.0), ("5552a40000000000c40918", 2000 / 32768, 10.0)],
)
def test_wit_vectors(frame_hex, scale, value):
    (found,) = WitParser().feed(bytes.fromhex(frame_hex))
    # one digit of the converter
    assert max(found.words[:3]) * scale == pytest.approx(value, abs=scale)
    assert found.words[3] / 100 == 25.0


@pytest.mark.parametrize(
    "command",
    ["aa0000200001000021", "aa0000200001000122", "aa000020000100 0223", "aa0001be00010001c1", "aa0001be00010000c0"],
)
def test_jrt_commands_are_frames_of_their_family(command):
    (found,) = JrtParser().feed(bytes.fromhex(command))
    assert not found.error


@pytest.mark.parametrize(("register", "command"), [(0x00, "aa80000080"), (0x06, "aa80000686"), (0x0A, "aa80000a8a")])
def test_jrt_questions_are_as_documented(bench, register, command):
    transport = SerialTransport(bench.address("rangefinder"), JrtParser, baud=19200, clock=bench.clock)
    laser = JrtRangefinder(transport, clock=bench.clock)
    laser.connect()
    laser._read(register)
    laser.close()
    assert bytes.fromhex(command) in [passage.data for passage in transport.transcript.last()]


def test_dmx_vector():
    assert frame(6, bytes((0, 255, 128, 0))) == bytes.fromhex("7e06040000ff8000e7")


@pytest.mark.parametrize("code", range(1, 80))
def test_every_error_of_grbl_has_a_name_and_a_remedy(code):
    reason, remedy = grbl.error_text(code)
    assert reason
    assert remedy
