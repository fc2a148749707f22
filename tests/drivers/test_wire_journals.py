"""What two stages say on their wires, and when, from connecting to an emergency stop: as it was."""

import re
from pathlib import Path

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
JOURNALS = Path(__file__).with_name("journals")


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
    assert [known, *journal(wire.transcript)] == (JOURNALS / f"{name}.txt").read_text().splitlines()
