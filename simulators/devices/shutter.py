"""Shutter boxes at byte level, which close a camera's contacts: a STRIG/4 box with shaker, inertial unit and motor
enable, and a bare RTS line.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Protocol

from simulators.devices.serial_device import SerialDevice, drained

NEVER = float("inf")
LONGEST_MS = 3_600_000
LONGEST_LINE = 63
WATCHDOG_S = 5.0
HEARTBEAT_MS, LONGEST_HEARTBEAT_MS = 100, 1000
MOTORS = ("ENABLE", "BEAT")
SHAKES = ("PATH", "POINT", "SHAKE")
MOST, FULL = 128, 4095
MOST_SAMPLES_HZ = 200


class Contacts(Protocol):
    """The camera's contacts wired to a shutter box."""

    def close(self, now_s: float) -> None:
        """Close the release contact."""

    def release(self, now_s: float) -> None:
        """Open it."""

    def flash_s(self) -> float | None:
        """When the hot shoe next fires; returned once."""


class Actuators(Protocol):
    """The actuators wired to a box's two channels, which rest at 2048."""

    def play(self, points: Sequence[tuple[int, int]], interval_s: float, now_s: float) -> None:
        """Play these points repeatedly from now on."""

    def rest(self, now_s: float) -> None:
        """Return to rest."""


Inertial = Callable[[float], Sequence[int]]
"""Three accelerations and three rotation rates at a time, in digits of 8 g and 500 degrees per second in 16 bits."""
Enable = Callable[[bool, float], None]  # callback of a box's motor enable output: on or off, and when


@dataclass
class MotorEnable:
    """The motor enable output: its last command, when the next heartbeat is due, when it was released."""

    seq: int = 0
    due_s: float = NEVER
    released_s: float | None = None


@dataclass
class PendingShot:
    """One accepted shot: its number and the times of its contacts."""

    seq: int
    close_at_s: float
    release_at_s: float
    closed: bool = False


@dataclass
class PathPlayback:
    """A path as received, and while it is played: number of the command, begin, end."""

    points: list[tuple[int, int]]
    number: int
    interval_us: int
    seq: int = 0
    began_s: float = NEVER
    rest_at_s: float = NEVER

    @property
    def runs(self) -> bool:
        """Whether it is being played."""
        return self.began_s != NEVER


class StrigBox:
    """A box with STRIG/4, see drivers/firmware/STRIG.md; its clock is fast by `drift`.

    `enable` : what is connected to its motor enable output; `inertial` : its unit's reading at a time, or None.
    """

    baud = 115200

    def __init__(
        self, contacts: Contacts, *, actuators: Actuators | None = None, enable: Enable = lambda on, now_s: None,
        inertial: Inertial | None = None, serial: str = "SIM-1", drift: float = 20e-6, boot_s: float = 0.3,
    ) -> None:  # fmt: skip
        self.contacts, self.actuators, self.enable = contacts, actuators, enable
        self._inertial = inertial
        self._sample_s, self._interval_us = NEVER, 0
        self._hello = f"STRIG/4 simulated 4.0 {serial}"
        self._hold = MotorEnable()
        self._path = PathPlayback([], 0, 0)
        self._drift, self._boot = drift, boot_s
        self._booted_s = 0.0
        self._boot_end_s = NEVER
        self._line = bytearray()
        self._out = bytearray()
        self._shot: PendingShot | None = None
        self._seq = 0
        self._received_s = 0.0
        self._flash_at_s = NEVER
        self._dtr = False

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A rising DTR restarts the board."""
        if dtr and not self._dtr:
            self.restart(now_s)
        self._dtr = dtr

    def restart(self, now_s: float) -> None:
        """Power-up: contacts open, motors off, clock and count at zero."""
        self._open(now_s)
        self.enable(False, now_s)
        self._hold = MotorEnable()
        self._shot, self._seq, self._sample_s = None, 0, NEVER
        if self._path.runs and self.actuators is not None:
            self.actuators.rest(now_s)
        self._path = PathPlayback([], 0, 0)
        self._line.clear()
        self._out.clear()
        self._booted_s, self._boot_end_s = now_s, now_s + self._boot

    def receive(self, data: bytes, now_s: float) -> None:
        """Receive lines; any byte feeds the watchdog."""
        if self._boot_end_s != NEVER:
            return
        self._received_s = now_s
        for byte in data:
            if byte == 10:
                line, self._line = bytes(self._line), bytearray()
                if line:
                    self._obey(line, now_s)
            elif byte != 13 and len(self._line) <= LONGEST_LINE:
                self._line.append(byte)

    def advance(self, now_s: float) -> bytes:
        """Process contacts and events, in order."""
        while (moment_s := self.next_event_s()) is not None and moment_s <= now_s:
            if self._hold.due_s <= moment_s:
                self._release(moment_s)
                self._report_release()
            if self._boot_end_s <= moment_s:
                self._boot_end_s = NEVER
                self._send(self._hello)
            if self._flash_at_s <= moment_s:
                self._send(f"EVT FLASH {self._t_us(self._flash_at_s)}")
                self._flash_at_s = NEVER
            if self._shot is not None:
                shot = self._shot
                if not shot.closed and shot.close_at_s <= moment_s:
                    shot.closed = True
                    self.contacts.close(moment_s)
                    self._send(f"EVT SHUTTER {shot.seq} {self._t_us(moment_s)}")
                    self._flash_at_s = self.contacts.flash_s() or NEVER
                elif shot.closed and shot.release_at_s <= moment_s:
                    self._end("DONE", moment_s)
                elif shot.closed and self._received_s + WATCHDOG_S <= moment_s:
                    self._end("WATCHDOG", moment_s)
            if self._sample_s <= moment_s and self._inertial is not None:
                digits = "".join(f"{number & 0xFFFF:04X}" for number in self._inertial(moment_s))
                self._send(f"S {self._t_us(moment_s)} {digits}")
                self._sample_s += self._interval_us * 1e-6 / (1 + self._drift)
            if self._path.runs and min(self._path.rest_at_s, self._received_s + WATCHDOG_S) <= moment_s:
                self._rest(moment_s)
        return drained(self._out)

    def next_event_s(self) -> float | None:
        """The earliest of boot, contacts, watchdogs and flash."""
        moments = [self._boot_end_s, self._flash_at_s, self._hold.due_s, self._sample_s]
        if self._path.runs:
            moments.append(min(self._path.rest_at_s, self._received_s + WATCHDOG_S))
        if self._shot is not None:
            shot = self._shot
            moments.append(min(shot.release_at_s, self._received_s + WATCHDOG_S) if shot.closed else shot.close_at_s)
        return None if min(moments) == NEVER else min(moments)

    def _release(self, now_s: float) -> None:
        """Remove the motors' current: no heartbeat came, or the host ordered it."""
        self.enable(False, now_s)
        self._hold.due_s, self._hold.released_s = NEVER, now_s

    def _report_release(self) -> None:
        released_s = self._hold.released_s
        self._send(f"EVT RELEASE {self._hold.seq} {0 if released_s is None else self._t_us(released_s)}")

    def _feel_beat(self, next_ms: int, now_s: float) -> None:
        if self._hold.due_s == NEVER:
            self._report_release()
        else:
            self._hold.due_s = now_s + next_ms / 1000

    def _set_enable(self, on: bool, now_s: float) -> None:
        seq = self._accept()
        if on:
            self.enable(True, now_s)
            self._hold.seq, self._hold.due_s = seq, now_s + HEARTBEAT_MS / 1000
        elif self._hold.due_s != NEVER:
            self._release(now_s)

    def _rest(self, now_s: float) -> None:
        if self._path.runs and self.actuators is not None:
            self.actuators.rest(now_s)
            self._send(f"EVT REST {self._path.seq} {self._t_us(now_s)}")
            self._path.began_s = self._path.rest_at_s = NEVER

    def _end(self, kind: str, now_s: float) -> None:
        if self._shot is not None:
            self._open(now_s)
            self._send(f"EVT {kind} {self._shot.seq} {self._t_us(now_s)}")
            self._shot = None

    def _open(self, now_s: float) -> None:
        if self._shot is not None and self._shot.closed:
            self.contacts.release(now_s)

    def _send(self, line: str) -> None:
        self._out += b"%s*%02X\n" % (line.encode(), reduce(xor, line.encode(), 0))

    def _t_us(self, now_s: float) -> int:
        return round((now_s - self._booted_s) * (1 + self._drift) * 1e6)

    def _obey(self, line: bytes, now_s: float) -> None:
        if len(line) > LONGEST_LINE:
            self._send("ERR 2 bad argument")
            return
        command, *words = line.decode("ascii", "replace").split(" ")
        if line == b"ID?":
            self._send(self._hello)
        elif command == "SYNC?":
            if len(words) > 1 or not all(w.isascii() and w.isdigit() and int(w) <= LONGEST_MS for w in words):
                self._send("ERR 2 bad argument")
            else:
                self._send(" ".join(("SYNC", str(self._t_us(now_s)), *(str(int(w)) for w in words))))
        elif line == b"ABORT":
            self._accept()
            self._end("ABORT", now_s)
            self._rest(now_s)
        elif command == "IMU" and self._inertial is None:
            self._send("ERR 5 no inertial unit")
        elif command not in ("FOCUS", "SHOT", "BULB", "IMU", *MOTORS, *SHAKES):
            self._send("ERR 1 unknown command")
        elif command in SHAKES and self.actuators is None:
            self._send("ERR 4 no shaker")
        elif command not in (*MOTORS, "IMU") and (
            self._shot is not None or (self._path.runs and command in SHAKES and line != b"SHAKE 0")
        ):
            self._send("ERR 3 busy")
        else:
            self._act(command, [int(w) if w.isascii() and w.isdigit() and len(w) < 8 else -1 for w in words], now_s)

    def _accept(self) -> int:
        self._seq += 1
        self._send(f"OK {self._seq}")
        return self._seq

    def _act(self, command: str, numbers: list[int], now_s: float) -> None:
        good = all(0 <= n <= LONGEST_MS for n in numbers)
        match command, numbers:
            case "FOCUS", [0 | 1] if good:
                self._accept()
            case "ENABLE", [0 | 1 as on] if good:
                self._set_enable(bool(on), now_s)
            case "IMU", [rate] if 0 <= rate <= MOST_SAMPLES_HZ:
                self._accept()
                self._interval_us = 1_000_000 // rate if rate else 0
                self._sample_s = now_s + self._interval_us * 1e-6 / (1 + self._drift) if rate else NEVER
            case "BEAT", []:
                self._feel_beat(HEARTBEAT_MS, now_s)
            case "BEAT", [next_ms] if 1 <= next_ms <= LONGEST_HEARTBEAT_MS:
                self._feel_beat(next_ms, now_s)
            case "SHOT", [focus, pulse, *delay] if good and pulse > 0 and len(delay) < 2:
                start_s = now_s + (delay[0] if delay else 0) / 1000
                close_s = start_s + focus / 1000
                self._shot = PendingShot(self._accept(), close_s, close_s + pulse / 1000)
            case "BULB", [pulse] if good and pulse > 0:
                self._shot = PendingShot(self._accept(), now_s, now_s + pulse / 1000)
            case "PATH", [number, interval_us] if good and 2 <= number <= MOST and 1000 <= interval_us <= 1_000_000:
                self._accept()
                self._path = PathPlayback([], number, interval_us)
            case "POINT", [i, x, y] if good and i <= len(self._path.points) and i < self._path.number and x <= FULL:
                self._take_point(i, x, y)
            case "SHAKE", [0 | 1 as on] if good:
                self._shake(bool(on), now_s)
            case _:
                self._send("ERR 2 bad argument")

    def _take_point(self, i: int, x: int, y: int) -> None:
        if y > FULL:
            self._send("ERR 2 bad argument")
            return
        self._accept()
        self._path.points[i : i + 1] = [(x, y)]

    def _shake(self, on: bool, now_s: float) -> None:
        path = self._path
        if on and (self.actuators is None or not path.points or len(path.points) < path.number):
            self._send("ERR 2 bad argument")
            return
        seq = self._accept()
        if not on:
            if path.runs:  # at the end of the current round, by the box's clock
                round_s = path.number * path.interval_us * 1e-6 / (1 + self._drift)
                path.rest_at_s = path.began_s + round_s * max(math.ceil((now_s - path.began_s) / round_s), 1)
            return
        assert self.actuators is not None
        path.seq, path.began_s, path.rest_at_s = seq, now_s, NEVER
        self.actuators.play(path.points, path.interval_us * 1e-6 / (1 + self._drift), now_s)
        self._send(f"EVT SHAKE {seq} {self._t_us(now_s)}")


class RtsLine(SerialDevice):
    """An adapter whose RTS line closes the contact; it sends nothing."""

    baud = 0

    def __init__(self, contacts: Contacts) -> None:
        self.contacts = contacts
        self._closed = False

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        if rts and not self._closed:
            self.contacts.close(now_s)
        elif self._closed and not rts:
            self.contacts.release(now_s)
        self._closed = rts

    def receive(self, data: bytes, now_s: float) -> None:
        """Ignored."""

    def advance(self, now_s: float) -> bytes:
        return b""
