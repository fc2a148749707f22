"""A GRBL controller at byte level: lines and realtime bytes in, responses and pushed messages out.

Its motors move axes of the world, its relay and spindle outputs close contacts there. Modelled on GRBL 1.1h, whose
answers are recorded in tests/conformance/grbl_1.1h.txt; `variant` selects the behaviour of grblHAL or FluidNC.
"""

from collections.abc import Mapping

from simulators.devices.grbl_motion import NEVER, Activity, Outputs
from simulators.devices.grbl_program import (
    BLOCKS,
    CANCEL,
    DOOR,
    OVERRIDES,
    RESET,
    Answer,
    LineReader,
    Overflow,
    Program,
)
from simulators.devices.grbl_settings import BANNERS, Counters, State, locked_at_first, status
from simulators.devices.serial_device import drained
from simulators.world.motion import Axis

BOOT_S = 0.4
DEAF_S = 0.5  # GRBL's pause after an alarm message: input is ignored, including resets


class GrblController:
    """The controller; `axes` by letter, in the order the firmware knows them. `options` are letters of `$I`."""

    baud = 115200

    def __init__(
        self, axes: Mapping[str, Axis], *, variant: str = "GRBL", settings: Mapping[int, float] | None = None,
        outputs: Outputs | None = None, options: str = "", rx_bytes: int | None = None,
    ) -> None:  # fmt: skip
        rx_bytes = rx_bytes or (1024 if variant == "grblHAL" else 128)
        self.program = Program(axes, variant, settings or {}, outputs or Outputs(), options, rx_bytes)
        self.motion, self.settings = self.program.motion, self.program.settings
        self.spindle_override = 100
        self.door_open = False
        self.job = ""
        self._out, self._rx = bytearray(), bytearray()
        self._reader = LineReader(79 if variant == "GRBL" else 255, "" if variant == "FluidNC" else "/")
        self._line: str | type[Overflow] | None = None
        self._dtr = False
        self._boot_s = self._deaf_until_s = NEVER
        self._alarmed = 0
        self._critical = False

    @property
    def axes(self) -> dict[str, Axis]:
        return self.motion.axes

    @property
    def variant(self) -> str:
        """Name of the firmware."""
        return self.program.variant

    def offset(self, *place: float) -> None:
        """Set the work zero, in machine space."""
        self.program.offsets.systems[54] = place

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A rising DTR resets the board, as on every Arduino."""
        if dtr and not self._dtr:
            self.restart(now_s)
        self._dtr = dtr

    def restart(self, now_s: float, off_s: float = 0.0) -> None:
        """Power-up after `off_s`: silence, then the greeting; position lost, locked if homing is enabled."""
        self.motion.halt(now_s)
        self.motion.forget_place(now_s)
        self.program.homed = False
        self._begin_anew("Alarm" if locked_at_first(self.settings, self.variant) else "Idle", now_s)
        self._deaf_until_s = NEVER
        self._out.clear()
        self._boot_s = now_s + off_s + BOOT_S

    def _begin_anew(self, state: str, now_s: float) -> None:
        self.program.run, self.program.counters = Activity(state), Counters()
        self.program.last_error = 0
        self.program.switch_off(now_s)
        self.program.modes = type(self.program.modes)()
        self.motion.overrides[:] = [100, 100]
        self.spindle_override, self._critical, self._alarmed = 100, False, 0
        self._forget_lines()

    def receive(self, data: bytes, now_s: float) -> None:
        """Realtime bytes act at once, the others go to the RX buffer; what does not fit is lost."""
        for byte in data:
            if self._boot_s != NEVER:
                return
            if byte in b"?!~\x18" or byte >= 0x80:
                self._realtime(byte, now_s)
            elif len(self._rx) < self.program.rx_bytes:
                self._rx.append(byte)
                self._main_loop(now_s)
        self._main_loop(now_s)

    def advance(self, now_s: float) -> bytes:
        """Process everything until now, in order; returns the output."""
        while (moment_s := self.next_event_s()) is not None and moment_s <= now_s:
            run, motion = self.program.run, self.motion
            if self._boot_s <= moment_s:
                self._boot_s = NEVER
                self._greet(moment_s)
            elif self._deaf_until_s <= moment_s:
                self._end_alarm_pause(moment_s)
            elif motion.trip_s <= moment_s:
                self.alarm(1, moment_s)
            elif motion.end_s <= moment_s:
                self._motion_ended(moment_s)
            elif run.busy_until_s <= moment_s:
                self._answer(self.program.busy_ended(moment_s))
            self._main_loop(moment_s)
        return drained(self._out)

    def next_event_s(self) -> float | None:
        """End of boot, of the pause after an alarm, of a motion, dwell or homing; a switch that is hit."""
        motion = self.motion
        moment_s = min(self._boot_s, self._deaf_until_s, motion.end_s, motion.trip_s, self.program.run.busy_until_s)
        return None if moment_s == NEVER else moment_s

    @property
    def state(self) -> str:
        """The state's name in its reports."""
        return self.program.run.state

    @property
    def locked(self) -> bool:
        """Whether it refuses motion: not homed, homing, or in alarm."""
        return self.state in ("Alarm", "Home")

    def alarm(self, code: int, now_s: float) -> None:
        """Raise an alarm: a limit switch, the emergency button, a driver fault."""
        self.motion.halt(now_s)
        self.motion.planned = self.motion.machine(now_s)
        self.program.run = Activity()
        self._forget_lines()
        self._raise(code, now_s)

    def door(self, is_open: bool, now_s: float) -> None:
        """Open or close the safety door: opening stops, closing alone starts nothing."""
        self.door_open = is_open
        if is_open and self.program.run.state != "Door":
            self._realtime(DOOR, now_s)

    def press(self, letter: str, closed: bool, now_s: float) -> None:
        """Close or open an axis' limit switch."""
        (self.motion.pressed.add if closed else self.motion.pressed.discard)(letter)
        if int(self.settings[21]) & 1 and self.program.run.state not in ("Alarm", "Home"):
            self.alarm(1, now_s)

    def _forget_lines(self) -> None:
        self._rx.clear()
        self._reader.clear()
        self._line = None

    def _send(self, *lines: str) -> None:
        for line in lines:
            self._out += line.encode() + b"\r\n"

    def _answer(self, answer: Answer) -> None:
        if answer is not None:
            self._send(*answer)

    def _greet(self, now_s: float) -> None:
        self._out += b"\r\n"
        self._send(BANNERS[self.variant])
        if self.program.run.state == "Alarm":
            self._send("[MSG:'$H'|'$X' to unlock]")
        else:
            self._send(*self.program.run_startup(now_s))

    def _raise(self, code: int, now_s: float) -> None:
        self.program.run.state = "Alarm"
        self._send(f"ALARM:{code}")
        self._alarmed = code
        if self.variant == "GRBL":
            self._deaf_until_s = now_s + DEAF_S
        else:
            self._end_alarm_pause(now_s)

    def _end_alarm_pause(self, now_s: float) -> None:
        """End of the pause after an alarm: await a reset, or restart after one that caused it."""
        self._deaf_until_s = NEVER
        if self._alarmed in (1, 2):
            self._critical = True
            self._send("[MSG:Reset to continue]")
        elif self._alarmed in (3, 6):
            self._begin_anew("Alarm", now_s)
            self._greet(now_s)

    def _realtime(self, byte: int, now_s: float) -> None:
        run = self.program.run
        if self._deaf_until_s != NEVER:
            return
        if byte == RESET:
            self._soft_reset(now_s)
        elif self._critical or run.homing:
            return
        elif byte == ord("?"):
            self._send(self._report(now_s))
        elif byte == ord("~"):
            run = self.program.run
            if run.state in ("Hold", "Door") and self._sub == 0:
                run.state, run.reported_state = "Idle", ""
                if self.variant == "grblHAL":
                    self._send("[MSG:]")
                if run.owed:
                    self._send(run.owed)
                    run.owed = ""
                self._drive(now_s)
        elif byte in OVERRIDES:
            self._override(*OVERRIDES[byte])
        elif byte in (ord("!"), CANCEL, DOOR):
            self._pause(byte, now_s)

    def _override(self, which: int, change: int) -> None:
        overrides = self.motion.overrides
        if which == 1:
            overrides[1] = change
        elif which == 0:
            overrides[0] = min(max(overrides[0] + change, 10), 200) if change else 100
        else:
            self.spindle_override = min(max(self.spindle_override + change, 10), 200) if change else 100
        self.program.counters.overrides = 0

    def _soft_reset(self, now_s: float) -> None:
        run = self.program.run
        moving, homing = self.motion.end_s != NEVER or run.state in ("Run", "Jog"), run.state == "Home"
        locked = run.state in ("Alarm", "Sleep")
        self.motion.halt(now_s)
        self.motion.planned = self.motion.machine(now_s)
        self.program.switch_off(now_s)
        if run.owed:
            self._send(run.owed)
        self._begin_anew("Alarm" if locked else "Idle", now_s)
        if homing or moving:
            self._raise(6 if homing else 3, now_s)
            if self.variant == "GRBL":
                return
        else:
            self._greet(now_s)

    def _pause(self, byte: int, now_s: float) -> None:
        """Feed hold, door or jog cancel: decelerate; each of them discards a jog."""
        run, motion = self.program.run, self.motion
        jogging = run.state == "Jog"
        if byte == DOOR and run.state not in ("Alarm", "Check"):
            self._send("[MSG:Check Door]")
        if jogging:
            motion.plan.clear()
        elif byte == CANCEL or run.state not in ("Run", "Idle"):
            return
        if not jogging or byte == DOOR:
            run.state, run.braking = ("Door" if byte == DOOR else "Hold"), motion.end_s != NEVER
            run.reported_state = "Jog" if jogging and self.variant == "grblHAL" else ""  # as in its simulator
        motion.brake(now_s, keep=not jogging)

    def _motion_ended(self, now_s: float) -> None:
        run, motion = self.program.run, self.motion
        motion.ended()
        run.braking = False
        if not motion.plan:
            motion.planned = motion.machine(now_s)
        if run.limit:
            self._soft_limit(now_s)
        elif run.state not in ("Hold", "Door"):
            run.state = "Idle" if not motion.plan else run.state
            self._drive(now_s)

    def _soft_limit(self, now_s: float) -> None:
        """Decelerate before a target outside, then raise the alarm; the response comes with the reset."""
        if self.motion.end_s != NEVER:
            self.motion.brake(now_s, keep=False)
            self.motion.plan.clear()
            self.program.run.state, self.program.run.braking = "Hold", True
            return
        owed = self.program.run.owed
        self.motion.halt(now_s)
        self.motion.planned = self.motion.machine(now_s)
        self.program.run = Activity(owed=owed)
        self._raise(2, now_s)

    def _drive(self, now_s: float) -> None:
        run = self.program.run
        if run.state in ("Idle", "Run", "Jog") and self.motion.begin_next(now_s):
            assert self.motion.current is not None
            run.state = "Jog" if self.motion.current.jog else "Run"

    def _main_loop(self, now_s: float) -> None:
        while self._free(now_s):
            if self._line is None and not self._take_line():
                return
            if len(self.motion.plan) >= BLOCKS[self.variant]:  # the line waits outside the RX buffer
                return
            line, self._line = self._line, None
            self._answer(["error:11"] if not isinstance(line, str) else self.program.obey(line, now_s))
            self._after_line(now_s)

    def _after_line(self, now_s: float) -> None:
        program = self.program
        if program.asks_reset:
            program.asks_reset = False
            self._soft_reset(now_s)
        elif program.run.limit:
            self._soft_limit(now_s)
        else:
            self._drive(now_s)

    def _take_line(self) -> bool:
        while self._rx and self._line is None:
            self._line = self._reader.take(self._rx.pop(0))
        return self._line is not None

    def _free(self, now_s: float) -> bool:
        """Whether nothing blocks the main loop: alarm, homing, dwell, pause, or a line that waits for motion."""
        run = self.program.run
        held = run.state in ("Hold", "Door", "Sleep") or run.homing or run.limit
        if held or self._critical or self._deaf_until_s != NEVER or run.busy_until_s != NEVER:
            return False
        if run.waiting is None:
            return True
        if self.motion.busy:
            return False
        self._answer(self.program.begin_waited(now_s))
        self._after_line(now_s)
        return self._free(now_s)

    @property
    def _sub(self) -> int:
        """Hold: 1 while decelerating. Door: 2 while decelerating, 1 while the door is open, 0 when it may resume."""
        run = self.program.run
        if run.state == "Hold":
            return int(run.braking)
        return 2 if run.braking else int(self.door_open)

    def _homed(self) -> str | None:
        """grblHAL's report of a change in homing, or in the known reference."""
        if not self.program.tells_homed or self.variant != "grblHAL":
            return None
        return "1" if self.program.homed else "0"

    def _report(self, now_s: float) -> str:
        run, program, motion = self.program.run, self.program, self.motion
        modes = program.modes
        state = State(
            run.reported_state or (f"{run.state}:{self._sub}" if run.state in ("Hold", "Door") else run.state),
            motion.machine(now_s),
            program.work_zero(),
            motion.feed(now_s),
            0.0 if modes.spindle == 5 else modes.speed,
            BLOCKS[self.variant] - len(motion.plan) - (motion.current is not None),
            program.rx_bytes - len(self._rx) - (self.variant == "grblHAL"),
            [*motion.overrides, self.spindle_override],
            {3: "S", 4: "C"}.get(modes.spindle, "") + ("F" if modes.flood == 8 else ""),
            motion.closed(now_s),
            self._homed(),
            self.job if self.variant == "FluidNC" else "",
        )
        program.tells_homed = False
        return status(state, self.settings, program.counters, self.variant)
