"""What two stages say on their wires, and when, from connecting to an emergency stop: as it was."""

import re

import pytest

from drivers.grbl import GrblStage
from drivers.protocols.grbl import GrblParser
from drivers.protocols.zaber import ZaberParser
from drivers.zaber import ZaberStage

from .grbl.axes import AXES as GRBL_AXES
from .test_zaber import AXES as ZABER_AXES

STAGES = {
    "grbl": (GrblStage, GrblParser, "stage", GRBL_AXES, 0.2),
    "zaber": (ZaberStage, ZaberParser, "head", ZABER_AXES, 1.0),
}
POLL = re.compile(r"\?|/\d 1( get pos)?$")
JOURNALS = {
    "grbl": r"""
GRBL, 1.1h.20190830, ; z_mm 0.000 to 1500.000, x_mm 0.000 to 300.000
0.40 > $I+
0.40 > $I
0.40 > $$
0.40 > $$
2 polls
0.40 > $H
4 polls
15.88 > $J=G53 G90 G21 X-1497.000 Y-290.000 F3055.5
4 polls
46.05 > $J=G53 G90 G21 Y-289.500 F1500.0
2 polls
46.15 > \x85
1 polls
46.15 ! !\x18
""",
    "zaber": r"""
Zaber 50081, 7.36, 12341; 12342; pan_deg -30.000 to 30.000, tilt_deg -20.000 to 20.000
0.00 > /1 0 set comm.checksum 1
0.00 > /1 0 get deviceid
0.00 > /1 0 get version
0.00 > /1 0 get system.serial
0.00 > /2 0 set comm.checksum 1
0.00 > /2 0 get deviceid
0.00 > /2 0 get version
0.00 > /2 0 get system.serial
0.00 > /1 0 set comm.alert 1
0.00 > /1 1 get limit.min
0.00 > /1 1 get limit.max
0.00 > /1 1 set maxspeed 69905
0.00 > /1 1 get maxspeed
0.00 > /2 0 set comm.alert 1
0.00 > /2 1 get limit.min
0.00 > /2 1 get limit.max
0.00 > /2 1 get maxspeed
0.00 > /1 1 warnings clear
0.00 > /1 1 home
0.00 > /2 1 warnings clear
0.00 > /2 1 home
30 polls
5.50 > /1 1 move abs 140800
5.50 > /2 1 move abs 128000
41 polls
13.50 > /2 1 move abs 130133
4 polls
14.00 > /0 0 stop
14.00 > /0 0 stop
4 polls
14.00 ! /0 0 estop
""",
}


def journal(transcript):
    """Times and orders of the transcript, without numbers and checksums; of polls how many there were."""
    lines, polls = [], 0
    for entry in transcript.last():
        words = re.sub(r"^(/\d \d) \d+", r"\1", entry.data.decode("latin-1").strip("\n").partition(":")[0])
        if entry.way == ">" and POLL.match(words):
            polls += 1
        elif entry.way in ">!":
            lines += [f"{polls} polls"] if polls else []
            lines.append(f"{entry.time_s:.2f} {entry.way} {words.encode('unicode_escape').decode()}")
            polls = 0
    return lines


@pytest.mark.parametrize("name", STAGES)
def test_orders_on_a_wire_are_what_they_were(wired, name):
    driver, parser, line, axes, poll_s = STAGES[name]
    stage = wired(driver, parser, line, axes, poll_s=poll_s)
    identity = stage.connect()
    known = f"{identity.model}, {identity.firmware}, {identity.serial}; " + ", ".join(
        f"{axis} {ends.low:.3f} to {ends.high:.3f}" for axis, ends in stage.travel().items()
    )
    stage.home()
    first, second = stage.travel()
    stage.move_to(**{first: 3.0, second: 10.0})
    stage.move_to(**{second: 10.5})
    stage.stop()
    stage.emergency_stop()
    wire = getattr(stage, "link", stage)._transport
    assert [known, *journal(wire.transcript)] == JOURNALS[name].strip("\n").split("\n")
