"""A GRBL controller at byte level: lines and realtime bytes in, responses and pushed messages out.

Protocol only: its motors move axes of the world, its relay and spindle output close contacts there. Modelled on GRBL
1.1h (RX buffer, planner, modes, alarms, homing to the high end, soft limits); `variant` makes it greet and identify
as grblHAL or FluidNC. Moves begin and end at rest: there is no look-ahead at corners.
"""

from __future__ import annotations

from collections.abc import Mapping

from simulators.devices import grbl_words as words
from simulators.devices.grbl_state import NEVER, Block, Modes, Outputs, Run, Sync
from simulators.world.motion import Axis, brake_line, travel_line

RESET, CANCEL, DOOR = 0x18, 0x85, 0x84
BOOT_S = 0.4
PLANNER = 15


class GrblController:
    """The controller; `axes` by letter, in the order the firmware knows them."""

    baud = 115200

    def __init__(
        self,
        axes: Mapping[str, Axis],
        *,
        variant: str = "GRBL",
        settings: Mapping[int, float] | None = None,
        outputs: Outputs | None = None,
        rx_bytes: int = 128,
    ) -> None:
        self.axes = dict(axes)
        self.variant = variant
        self.rx_bytes = rx_bytes
        self.outputs = outputs or Outputs()
        self.settings = words.default_settings([axis.high - axis.low for axis in axes.values()]) | dict(settings or {})
        self.work_offset = tuple(0.0 for _ in self.axes)
        self._zero = [axis.position(0.0) for axis in self.axes.values()]  # world position of machine zero
        self._planned = tuple(0.0 for _ in self.axes)
        self._modes, self._run = Modes(), Run()
        self._out = bytearray()
        self._rx = bytearray()
        self._line: str | None = None
        self._dtr = False
        self._boot_s = NEVER
        self._critical = False
        self._reports = 0
        self.feed_override = 100
        self.door_open = False

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A rising DTR resets the board, as on every Arduino."""
        if dtr and not self._dtr:
            self.restart(now_s)
        self._dtr = dtr

    def restart(self, now_s: float) -> None:
        """Power-up: silence, then the greeting; position forgotten, locked until homed."""
        self._halt(now_s)
        self._zero = [axis.position(now_s) for axis in self.axes.values()]
        self._planned = tuple(0.0 for _ in self.axes)
        self._run, self._modes, self._critical = Run(), Modes(), False
        self._out.clear()
        self._forget_lines()
        self._boot_s = now_s + BOOT_S

    def receive(self, data: bytes, now_s: float) -> None:
        """Realtime bytes act at once, the rest fills the RX buffer; what does not fit is lost."""
        for byte in data:
            if self._boot_s != NEVER:
                return
            if byte in (RESET, CANCEL, DOOR) or byte in b"?!~":
                self._realtime(byte, now_s)
            elif byte < 0x80 and len(self._rx) < self.rx_bytes:
                self._rx.append(byte)
        self._main_loop(now_s)

    def advance(self, now_s: float) -> bytes:
        """Everything that has happened by now, in order; what was said."""
        while (moment_s := self.next_event_s()) is not None and moment_s <= now_s:
            self._event(moment_s)
        said = bytes(self._out)
        self._out.clear()
        return said

    def next_event_s(self) -> float | None:
        """End of boot, of a motion, of a dwell or of homing."""
        moment_s = min(self._boot_s, self._run.motion_end_s, self._run.busy_until_s)
        return None if moment_s == NEVER else moment_s

    @property
    def locked(self) -> bool:
        """Whether it refuses motion: not homed yet, homing, or in alarm."""
        return self._run.state in ("Alarm", "Home")

    def alarm(self, code: int, now_s: float) -> None:
        """A limit switch, the emergency button, a driver fault."""
        self._halt(now_s)
        self._run = Run()
        self._forget_lines()
        self._raise(code)

    def door(self, is_open: bool, now_s: float) -> None:
        """Somebody opens or closes the safety door: opening stops, closing alone starts nothing."""
        self.door_open = is_open
        if is_open and self._run.state != "Door":
            self._realtime(DOOR, now_s)

    def _forget_lines(self) -> None:
        self._rx.clear()
        self._line = None

    def _say(self, *lines: str) -> None:
        for line in lines:
            self._out += line.encode() + b"\r\n"

    def _machine(self, now_s: float) -> tuple[float, ...]:
        return tuple(
            axis.position(now_s) - zero + 0.0 for axis, zero in zip(self.axes.values(), self._zero, strict=True)
        )

    def _halt(self, now_s: float) -> None:
        for axis in self.axes.values():
            if axis.moves(now_s):
                axis.halt(now_s)

    def _event(self, now_s: float) -> None:
        run = self._run
        if self._boot_s <= now_s:
            self._boot_s = NEVER
            self._greet()
        elif run.motion_end_s <= now_s:
            self._motion_ended(now_s)
        elif run.busy_until_s <= now_s:
            run.busy_until_s = NEVER
            self._busy_ended(now_s)
        self._main_loop(now_s)

    def _greet(self) -> None:
        self._out += b"\r\n"
        self._say(words.BANNERS[self.variant])
        if self._run.state == "Alarm":
            self._say("[MSG:'$H'|'$X' to unlock]")

    def _raise(self, code: int) -> None:
        self._run.state = "Alarm"
        self._say(f"ALARM:{code}")
        if code in (1, 2):
            self._critical = True
            self._say("[MSG:Reset to continue]")

    def _realtime(self, byte: int, now_s: float) -> None:
        if byte == RESET:
            self._soft_reset(now_s)
        elif self._critical or self._run.homing:
            return
        elif byte == ord("?"):
            self._say(self._report(now_s))
        elif byte == ord("~") and self._run.state in ("Hold", "Door") and self._sub == 0:
            self._run.state = "Idle"
            self._next_block(now_s)
        elif byte in (ord("!"), CANCEL, DOOR):
            self._pause(byte, now_s)

    def _soft_reset(self, now_s: float) -> None:
        moving = self._run.motion_end_s != NEVER or self._run.state in ("Run", "Jog")
        homing, alarmed = self._run.homing, self._run.state == "Alarm"
        self._halt(now_s)
        self.outputs.relay(False, now_s)
        self.outputs.spindle(0.0, now_s)
        self._run, self._modes, self._critical = Run(state="Alarm" if alarmed else "Idle"), Modes(), False
        self._forget_lines()
        self._planned = self._machine(now_s)
        if homing or moving:
            self._raise(6 if homing else 3)
        self._greet()

    def _pause(self, byte: int, now_s: float) -> None:
        """Feed hold, door or jog cancel: brake; a jog is forgotten by any of them."""
        run = self._run
        if run.state == "Jog":
            run.plan.clear()
            run.current = None
        elif byte == CANCEL or run.state not in ("Run", "Idle"):
            return
        if run.state != "Jog" or byte == DOOR:
            run.state, run.hold = ("Door" if byte == DOOR else "Hold"), int(run.motion_end_s != NEVER)
        if run.motion_end_s != NEVER:
            if run.current is not None:
                run.plan.appendleft(run.current)
                run.current = None
            run.motion_end_s = brake_line(list(self.axes.values()), now_s, self._acceleration())

    def _acceleration(self) -> float:
        return min(self.settings[120 + i] for i in range(len(self.axes)))

    def _motion_ended(self, now_s: float) -> None:
        run = self._run
        run.motion_end_s, run.current, run.hold = NEVER, None, 0
        if run.state in ("Hold", "Door"):
            if not run.plan:  # a jog is forgotten by the door
                self._planned = self._machine(now_s)
            return
        if not run.plan:
            run.state = "Idle"
            self._planned = self._machine(now_s)
        self._next_block(now_s)

    def _next_block(self, now_s: float) -> None:
        run = self._run
        if run.motion_end_s != NEVER or not run.plan or run.state in ("Hold", "Door", "Alarm"):
            return
        run.current = run.plan.popleft()
        run.state = "Jog" if run.current.jog else "Run"
        where = [value + zero for value, zero in zip(run.current.target, self._zero, strict=True)]
        run.motion_end_s = travel_line(
            list(self.axes.values()), where, now_s, run.current.feed / 60, self._acceleration()
        )

    def _busy_ended(self, now_s: float) -> None:
        homed, self._run.homing = self._run.homing, False
        if homed:
            self._zero = [axis.high for axis in self.axes.values()]
            self._planned = self._machine(now_s)
            self._run.state = "Idle"
        self._say("ok")

    def _main_loop(self, now_s: float) -> None:
        """Execute complete lines while nothing blocks."""
        while self._free(now_s):
            if self._line is None:
                self._line = self._take_line()
            if self._line is None or len(self._run.plan) >= PLANNER:  # the line waits outside the RX buffer
                return
            line, self._line = self._line, None
            self._execute(line, now_s)

    def _free(self, now_s: float) -> bool:
        """Whether no homing, dwell, planner sync or critical alarm holds the main loop."""
        run = self._run
        if self._critical or run.busy_until_s != NEVER:
            return False
        if run.sync is None:
            return True
        if run.motion_end_s != NEVER or run.plan:
            return False
        sync, run.sync = run.sync, None
        self._synced(sync, now_s)
        return run.busy_until_s == NEVER

    def _take_line(self) -> str | None:
        ends = [self._rx.find(end) for end in b"\r\n" if end in self._rx]
        if not ends:
            return None
        line = bytes(self._rx[: min(ends)])
        del self._rx[: min(ends) + 1]
        return words.clean(line)

    def _execute(self, line: str, now_s: float) -> None:
        if len(line) > 79:
            self._say("error:11")
        elif not line:
            self._say("ok")
        elif line.startswith("$J="):
            self._answer(self._jog(line[3:], now_s))
        elif line.startswith("$"):
            self._system(line, now_s)
        elif self._run.state == "Alarm" or self._run.state == "Jog":
            self._say("error:9")
        else:
            self._answer(self._gcode(line, now_s))

    def _answer(self, code: int | None) -> None:
        if code is not None:
            self._say(f"error:{code}" if code else "ok")

    def _system(self, line: str, now_s: float) -> None:
        still = self._run.state in ("Idle", "Alarm")
        if line == "$G":
            self._say("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]", "ok")
        elif line == "$X":
            if self._run.state == "Alarm":
                self._run.state = "Idle"
                self._say("[MSG:Caution: Unlocked]")
            self._say("ok")
        elif not still:
            self._say("error:8")
        elif line == "$H":
            self._home(now_s)
        elif line == "$#":
            self._say(*words.offsets(self.work_offset), "ok")
        elif line == "$$":
            self._say(*words.settings_lines(self.settings, self.variant), "ok")
        elif line in ("$I", "$I+"):
            told = words.identity(self.variant, line, self.rx_bytes)
            self._say(*told, "ok") if told else self._say("error:3")
        elif assignment := words.assignment(line):
            self.settings[assignment[0]] = assignment[1]
            self._say("ok")
        else:
            self._say("error:3")

    def _home(self, now_s: float) -> None:
        if self.settings[22] != 1:
            self._say("error:5")
            return
        if self.door_open:
            self._say("error:13")
            return
        end_s = now_s
        for axis in self.axes.values():
            arrived_s = travel_line([axis], [axis.high], now_s, self.settings[25] / 60, self._acceleration())
            off = axis.high - self.settings[27]
            end_s = max(end_s, travel_line([axis], [off], arrived_s, self.settings[24] / 60, self._acceleration()))
        self._run.state, self._run.homing, self._run.busy_until_s = "Home", True, end_s

    def _jog(self, text: str, now_s: float) -> int | None:
        if self._run.state not in ("Idle", "Jog"):
            return 9 if self._run.state == "Alarm" else 8
        line = words.read(text)
        if isinstance(line, int):
            return line
        if not line.axes or not line.gs <= {20, 21, 90, 91, 53} or line.other:
            return 16
        if not line.values.get("F"):
            return 22
        target = self._target(line, line.inches(self._modes.inches), 91 in line.gs, 53 in line.gs)
        if isinstance(target, int):
            return target
        if not self._inside(target):
            return 15
        return self._plan(target, line.values["F"], True, now_s)

    def _gcode(self, text: str, now_s: float) -> int | None:
        line = words.read(text)
        if isinstance(line, int):
            return line
        modes = self._modes
        modes.inches = line.inches(modes.inches)
        modes.relative = 91 in line.gs or (modes.relative and 90 not in line.gs)
        modes.motion = next((g for g in (0, 1) if g in line.gs), modes.motion)
        modes.feed = line.values.get("F", modes.feed)
        if 4 in line.gs or line.ms:
            if 4 in line.gs and "P" not in line.values:
                return 28
            dwell_s = line.values.get("P", 0.0) if 4 in line.gs else 0.0
            self._run.sync = Sync(dwell_s, tuple(sorted(line.ms)), line.values.get("S", 0.0))
            return None
        if not line.axes:
            return 0
        if modes.motion == 1 and not modes.feed:
            return 22
        target = self._target(line, modes.inches, modes.relative, 53 in line.gs)
        if isinstance(target, int):
            return target
        if self.settings[20] == 1 and not self._inside(target):
            self._halt(now_s)
            self._run = Run()
            self._raise(2)
            return None
        return self._plan(target, modes.feed if modes.motion == 1 else NEVER, False, now_s)

    def _synced(self, sync: Sync, now_s: float) -> None:
        for switch in sync.switches:
            if switch in (7, 8, 9):
                self.outputs.relay(switch != 9, now_s)
            else:
                self.outputs.spindle(0.0 if switch == 5 else min(sync.speed / self.settings[30], 1.0), now_s)
        if sync.dwell_s:
            self._run.busy_until_s = now_s + sync.dwell_s
        else:
            self._say("ok")

    def _target(self, line: words.Words, inches: bool, relative: bool, machine: bool) -> tuple[float, ...] | int:
        scale = 25.4 if inches else 1.0
        target = list(self._planned)
        for i, letter in enumerate(self.axes):
            if letter in line.values:
                base = self._planned[i] if relative else 0.0 if machine else self.work_offset[i]
                target[i] = base + scale * line.values[letter]
        return tuple(target) if line.axes <= set(self.axes) else 31

    def _inside(self, target: tuple[float, ...]) -> bool:
        return all(-self.settings[130 + i] - 1e-9 <= value <= 1e-9 for i, value in enumerate(target))

    def _plan(self, target: tuple[float, ...], feed: float, jog: bool, now_s: float) -> int:
        way = [abs(b - a) for a, b in zip(self._planned, target, strict=True)]
        length = sum(part**2 for part in way) ** 0.5
        if length > 0:
            top = min(self.settings[110 + i] * length / part for i, part in enumerate(way) if part > 0)
            self._run.plan.append(Block(target, min(feed, top), jog))
            self._planned = target
            self._next_block(now_s)
        return 0

    @property
    def _sub(self) -> int:
        """Hold: 1 while it brakes. Door: 2 while it brakes, 1 while the door is open, 0 when it may go on."""
        if self._run.state == "Hold":
            return self._run.hold
        return 2 if self._run.hold else int(self.door_open)

    def _report(self, now_s: float) -> str:
        self._reports += 1
        run = self._run
        state = f"{run.state}:{self._sub}" if run.state in ("Hold", "Door") else run.state
        busy = run.current is not None
        where = self._machine(now_s)
        fields = words.places(self.settings, where, self.work_offset, self._reports, busy, self.feed_override)
        if int(self.settings[10]) & 2:
            fields.insert(1, f"Bf:{PLANNER - len(run.plan)},{self.rx_bytes - len(self._rx)}")
        fields.insert(1, f"FS:{run.current.feed if run.current else 0:.0f},0")
        return "<" + "|".join([state, *fields]) + ">"
