"""The shutter box's firmware, compiled for this machine, beside its twin: the same lines bring the same answers."""

import ctypes
import functools
import operator
import random
import re

import pytest

from drivers.interfaces import ShakePath
from drivers.shaker import ShakerAxis, StrigShaker
from drivers.shutter import StrigParser, StrigShutter
from drivers.transport import SerialTransport
from simulators.devices.shutter import StrigBox

READING = (1, -2, 4096, -32768, 32767, 0)
TIME_US = 200
"""By which times may differ: the firmware looks every 50 us, the twin at once."""


@pytest.fixture
def library(strig_library):
    return strig_library


def checked(line):
    """A line without its checksum, which must be right."""
    text, _, checksum = line.rpartition("*")
    assert int(checksum, 16) == functools.reduce(operator.xor, text.encode(), 0)
    return text


class Firmware:
    """The compiled protocol."""

    def __init__(self, library, has_shaker=True):
        self._library = library
        library.host_begin(has_shaker)
        library.host_imu((ctypes.c_int16 * 6)(*READING))
        library.host_forget()

    def hear(self, line, at_s):
        self.run(at_s)
        self._library.host_hear(line.encode() + b"\n")

    def run(self, until_s):
        self._library.host_run(round(until_s * 1e6))

    def said(self):
        lines = self._library.host_said().decode().splitlines()
        self._library.host_forget()
        sent = [checked(line) for line in lines if not line.startswith("*")]
        return sent, [line for line in lines if line.startswith("*")]


class Outputs:
    """What the twin closes and plays."""

    def __init__(self):
        self.played = []
        self.motors = []

    def close(self, now_s):
        pass

    def release(self, now_s):
        pass

    def flash_s(self):
        return None

    def enable(self, on, now_s):
        self.motors.append((on, now_s))

    def play(self, points, interval_s, now_s):
        self.played.append(("play", tuple(points), interval_s, now_s))

    def rest(self, now_s):
        self.played.append(("rest", now_s))


class Twin:
    """The simulated box."""

    def __init__(self, has_shaker=True):
        self.outputs = Outputs()
        self._box = StrigBox(self.outputs, actuators=self.outputs if has_shaker else None, drift=0.0, boot_s=0.0,
                             enable=self.outputs.enable,
                             inertial=(lambda now_s: READING) if has_shaker else None)  # fmt: skip
        self._box.set_lines(False, True, 0.0)
        self._box.advance(0.0)
        self.outputs.motors.clear()

    def hear(self, line, at_s):
        self._heard = self._box.advance(at_s)
        self._box.receive(line.encode() + b"\n", at_s)
        return self._heard

    def run(self, until_s):
        return self._box.advance(until_s)


def compared_with_the_library(library, script, has_shaker=True):
    """Both hear the script: what the firmware said, what the twin said, what each put out."""
    firmware, twin, heard = Firmware(library, has_shaker), Twin(has_shaker), b""
    for at_s, line in script:
        firmware.hear(line, at_s)
        heard += twin.hear(line, at_s)
    end_s = script[-1][0] + 8.0
    firmware.run(end_s)
    heard += twin.run(end_s)
    ours, outputs = firmware.said()
    return ours, [checked(line) for line in heard.decode().splitlines()], outputs, twin.outputs


TIMED = re.compile(r"^(EVT \w+(?: \d+)?|SYNC|S) (\d+)((?: \w+)?)$")


def split(line):
    """A line without its time, and the time."""
    found = TIMED.match(line)
    return (line, 0) if found is None else (found[1] + found[3], int(found[2]))


def compare(ours, theirs):
    first, second = [split(line) for line in ours], [split(line) for line in theirs]
    assert [line for line, _ in first] == [line for line, _ in second]
    assert max((abs(a - b) for (_, a), (_, b) in zip(first, second, strict=True)), default=0) <= TIME_US


def test_a_path_is_played_around_and_around_and_ends_with_its_round(library):
    points = [(2048 + 100 * i, 4095 - 7 * i) for i in range(5)]
    script = [(0.1, "PATH 5 2000"), *((0.2, f"POINT {i} {x} {y}") for i, (x, y) in enumerate(points))]
    script += [(0.3, "SHAKE 1"), (0.3237, "SHAKE 0")]
    ours, theirs, outputs, twin = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert ours[-1].startswith("EVT REST 7 ")
    began_us, rested_us = (split(line)[1] for line in (ours[-3], ours[-1]))
    assert (began_us, rested_us) == (300_000, 330_000)  # three rounds of 10 ms
    shaken = [line for line in outputs if "shaker" in line]
    assert shaken == [f"* shaker {x:04d} {y:04d}" for x, y in points * 3] + ["* shaker 2048 2048"]
    assert twin.played == [("play", tuple(points), 0.002, 0.3), ("rest", pytest.approx(0.33))]


def test_a_shot_is_taken_while_it_shakes_by_the_same_clock(library):
    script = [
        (0.1, "PATH 2 5000"),
        (0.1, "POINT 0 0 0"),
        (0.1, "POINT 1 4095 4095"),
        (0.2, "SHAKE 1"),
        (0.25, "SHOT 0 30"),
    ]
    ours, theirs, _, _ = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert [split(line)[0] for line in ours[4:]] == ["EVT SHAKE 4", "OK 5", "EVT SHUTTER 5", "EVT DONE 5", "EVT REST 4"]


@pytest.mark.parametrize("has_shaker", [True, False])
def test_any_lines_bring_the_same_answers(library, has_shaker):
    rng = random.Random(5)
    words = [
        "PATH", "POINT", "SHAKE", "SHOT", "BULB", "FOCUS", "ENABLE", "BEAT", "ABORT", "ID?", "SYNC?", "IMU 0", "IMUS",
        "HELLO", "PATHS", "SHAKE1",
    ]  # fmt: skip
    numbers = [0, 1, 2, 3, 4, 128, 129, 500, 999, 1000, 4095, 4096, 1_000_000, 1_000_001, 3_600_001, 99999999]
    script, at_s = [], 0.1
    for _ in range(400):
        line = " ".join([rng.choice(words), *(str(rng.choice(numbers)) for _ in range(rng.choice([0, 1, 2, 2, 3, 4])))])
        likely = ["PATH 2 1000", "POINT 0 1 2", "POINT 1 3 4", "SHAKE 1", "SHAKE 0", "POINT 2 5 6", "ABORT", "SHOT 0 3"]
        likely += ["ENABLE 1", "ENABLE 0", "BEAT", "BEAT 1000"]
        script.append((at_s, rng.choice([line, rng.choice(likely), rng.choice(likely)])))
        at_s += rng.choice([0.0001, 0.0103, 0.0507])
    ours, theirs, _, _ = compared_with_the_library(library, script, has_shaker)
    compare(ours, theirs)
    assert ("EVT SHAKE" in "".join(ours)) == has_shaker
    assert has_shaker or "ERR 4 no shaker" in ours


def test_a_silent_host_lets_the_shaker_rest(library):
    script = [(0.1, "PATH 2 1000"), (0.1, "POINT 0 0 0"), (0.1, "POINT 1 9 9"), (0.2, "SHAKE 1")]
    ours, theirs, outputs, _ = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert split(ours[-1]) == ("EVT REST 4", pytest.approx(5_200_000, abs=100))
    assert outputs[-1] == "* shaker 2048 2048"


BEATS = [(0.1, "ENABLE 1"), *((round(0.1 + 0.05 * i, 3), "BEAT") for i in range(1, 40))]
"""Heartbeats until 2.05 s."""


def motors(outputs):
    return [line.split()[2] == "0001" for line in outputs if "motors" in line]


def test_heartbeats_keep_the_motors_enabled_also_in_a_shot(library):
    script = sorted([*BEATS, (0.33, "SHOT 0 300"), (2.06, "SYNC?"), (2.07, "ENABLE 0")])
    ours, theirs, outputs, twin = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert not [line for line in ours if "RELEASE" in line]
    assert motors(outputs) == [True, False]
    assert twin.motors == [(True, 0.1), (False, pytest.approx(2.07))]


def test_without_a_heartbeat_for_100_ms_the_motors_are_released_until_they_are_enabled_again(library):
    script = [*BEATS, (2.2, "BEAT"), (2.25, "BEAT"), (2.3, "ENABLE 1"), (2.35, "BEAT")]
    ours, theirs, outputs, twin = compared_with_the_library(library, script)
    compare(ours, theirs)
    release = ["EVT RELEASE 1 2150000"] * 3  # and each late heartbeat is reported again
    assert ours == ["OK 1", *release, "OK 2", "EVT RELEASE 2 2450000"]
    assert motors(outputs) == [True, False, True, False]
    assert [on for on, _ in twin.motors] == motors(outputs)
    assert [at_s for on, at_s in twin.motors if not on] == pytest.approx([2.15, 2.45])


def test_a_heartbeat_may_allow_the_next_more_time(library):
    script = [(0.1, "ENABLE 1"), (0.15, "BEAT 1000"), (1.1, "BEAT 20"), (1.15, "BEAT 1001"), (1.15, "BEAT 0")]
    ours, theirs, _, _ = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert ours == ["OK 1", "EVT RELEASE 1 1120000", "ERR 2 bad argument", "ERR 2 bad argument"]


def test_other_lines_are_no_heartbeat(library):
    script = [(0.1, "ENABLE 1"), *((round(0.1 + 0.02 * i, 3), "SYNC?") for i in range(1, 20))]
    ours, theirs, _, _ = compared_with_the_library(library, script)
    compare(ours, theirs)
    assert "EVT RELEASE 1 200000" in ours


def test_a_box_that_enabled_nothing_answers_a_heartbeat_with_that(library):
    ours, theirs, _, _ = compared_with_the_library(library, [(0.1, "BEAT")])
    assert ours == theirs == ["EVT RELEASE 0 0"]


def test_late_heartbeats_are_found_by_a_board_that_waits_for_room_to_send(library):
    firmware = Firmware(library)
    firmware.hear("ENABLE 1", 0.1)
    library.host_wait(ctypes.c_uint64(250_000))
    assert motors(firmware.said()[1]) == [True, False]


def test_the_greeting_reports_the_version(library):
    library.host_begin(True)
    assert checked(library.host_said().decode().splitlines()[-1]) == "STRIG/4 simulated 4.0 SIM-1"


def test_inertial_samples_are_stamped_by_the_clock_of_the_shutter(library):
    script = [(0.1, "IMU 100"), (0.123, "SHOT 0 30"), (0.2504, "IMU 0"), (0.3, "IMU 201"), (0.31, "SYNC? 5")]
    ours, theirs, _, _ = compared_with_the_library(library, script)
    compare(ours, theirs)
    samples = [split(line) for line in ours if line.startswith("S ")]
    assert {line for line, _ in samples} == {"S 0001FFFE100080007FFF0000"}
    assert [t_us for _, t_us in samples] == pytest.approx([110_000 + 10_000 * i for i in range(15)], abs=TIME_US)
    assert "ERR 2 bad argument" in ours
    assert split(ours[-1])[0] == "SYNC 5"
    assert "ERR 5 no inertial unit" in compared_with_the_library(library, [(0.1, "IMU 100")], has_shaker=False)[0]


@pytest.mark.slow  # the processor runs in real time
def test_the_real_processor_goes_around_in_whole_rounds(simavr_port):
    box = StrigShutter(SerialTransport(simavr_port, StrigParser))
    box.connect()
    shaker = StrigShaker(box, [ShakerAxis("x_mm", 0, 2.0), ShakerAxis("y_mm", 1, 2.0)])
    assert shaker.connect().model == "STRIG/2 shaker"
    shaker.start(ShakePath(0.002, {"x_mm": tuple(i / 20 for i in range(40)), "y_mm": (1.0, -1.0) * 20}))
    box.clock.sleep(0.2)
    began_us = box.motion["SHAKE"].t_us
    shaker.stop()
    rounds = (box.motion["REST"].t_us - began_us) / 80_000
    # it looks every 128 us and says so when it has
    assert rounds == pytest.approx(round(rounds), abs=0.01)
    assert rounds >= 1
    box.close()
