"""Execution of lines by a GRBL controller: `$` commands and G-code, on its settings, modes, offsets and motion."""

from collections.abc import Mapping

from simulators.devices import grbl_settings
from simulators.devices.grbl_code import LINEAR, Code, Modes, read
from simulators.devices.grbl_motion import NEVER, Activity, GrblMotion, Offsets, Outputs
from simulators.devices.grbl_settings import Counters, modes_line, numbers, offsets_lines
from simulators.world.motion import Axis

BLOCKS = {"GRBL": 15, "FluidNC": 15, "grblHAL": 100}
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H{} ~ ! ? ctrl-x]"
Answer = list[str] | None  # lines to send, the response last; None if the response comes later


class Program:
    """The state that lines act on; the controller around it handles bytes, realtime commands and alarms."""

    def __init__(
        self, axes: Mapping[str, Axis], variant: str, settings: Mapping[int, float], outputs: Outputs, options: str,
        rx_bytes: int,
    ) -> None:  # fmt: skip
        travels = [axis.high - axis.low for axis in axes.values()]
        self.variant = variant
        self.options = options
        self.rx_bytes = rx_bytes
        self.settings = grbl_settings.default_settings(travels, variant) | dict(settings)
        self.outputs = outputs
        self.motion = GrblMotion(axes, self.settings, "Z" in options)
        more = (59.1, 59.2, 59.3) if variant == "grblHAL" else ()
        self.offsets = Offsets(len(axes), (54, 55, 56, 57, 58, 59, *more, 28, 30))
        self.modes, self.run, self.counters = Modes(), Activity(), Counters()
        self.startup = ["", ""]
        self.note = ""
        self.homed = False
        self.tells_homed = False
        self.last_error = 0
        self.asks_reset = False
        self._factory = dict(self.settings)

    @property
    def letters(self) -> str:
        return "".join(self.motion.axes)

    @property
    def inches(self) -> bool:
        return self.settings[13] == 1

    def work_zero(self) -> tuple[float, ...]:
        """Work zero in machine space."""
        return self.offsets.total(self.modes.system)

    def obey(self, line: str, now_s: float) -> Answer:
        """Execute one line, already cleaned."""
        if not line:
            return ["ok"]
        if self.variant == "grblHAL":
            # grblHAL refuses the lines after a wrong one until a `$` command comes
            runs = not line.startswith("$") or line.startswith("$J=")
            if runs and self.last_error:
                return [f"error:{self.last_error}"]
            answer = self._line(line, now_s)
            wrong = answer is not None and answer[-1].startswith("error:")
            self.last_error = int(answer[-1][6:]) if answer is not None and wrong and runs else 0
            return answer
        return self._line(line, now_s)

    def _line(self, line: str, now_s: float) -> Answer:
        if line.startswith("$"):
            if line.startswith("$J"):
                return self._jog(line, now_s)
            if line.startswith("$/") and self.variant == "FluidNC":
                path = line[2:].lower()
                value = grbl_settings.config_item(self.settings, self.letters, path, self.motion.forced_origin)
                return ["error:3"] if value is None else [f"$/{path}={value}", "ok"]
            if line[1:2] in ("", "$", "G", "C", "X"):
                return self._at_any_time(line, now_s)
            if self.run.state not in ("Idle", "Alarm"):
                return ["error:8"]
            if line in ("$#", "$SLP", "$H", "$N"):
                return self._exactly(line, now_s)
            if line.startswith("$I"):
                return self._identify(line)
            if line.startswith("$RST"):
                return self._restore(line)
            if line.startswith("$N"):
                return self._startup(line, now_s)
            if line.startswith("$H") and self.variant == "GRBL":
                self.run.state = "Home"  # set before it reads on
            if line[1] in "#HRS":
                return ["error:3"]
            error = grbl_settings.assign(self.settings, line, self.variant)
            self.counters.offsets = 0 if line.startswith("$13=") else self.counters.offsets
            self.tells_homed = self.tells_homed or line.startswith("$22=")
            return [f"error:{error}" if error else "ok"]
        if self.run.state in ("Alarm", "Jog"):
            return ["error:9"]
        return self._gcode(line, now_s)

    def _at_any_time(self, line: str, now_s: float) -> Answer:
        if len(line) > 2:
            return ["error:3"]
        if line == "$":
            return [HELP.format(" $B" if self.variant == "grblHAL" else ""), "ok"]
        if line == "$$":
            if self.run.state in ("Run", "Hold"):
                return ["error:8"]
            return [*grbl_settings.settings_lines(self.settings, self.variant), "ok"]
        if line == "$G":
            return [modes_line(self.modes, self.inches, self.variant), "ok"]
        if line == "$C":
            if self.run.state == "Check":
                self.asks_reset = True
                return ["[MSG:Disabled]", "ok"]
            if self.run.state != "Idle":
                return ["error:8"]
            self.run.state = "Check"
            return ["[MSG:Enabled]", "ok"]
        if self.run.state != "Alarm":
            return ["ok"]
        self.run.state = "Idle"
        return ["[MSG:Caution: Unlocked]", "ok"]

    def _exactly(self, line: str, now_s: float) -> Answer:
        if line == "$#":
            offsets = self.offsets
            return [*offsets_lines(offsets.systems, offsets.shift, offsets.length, self.inches, self.variant), "ok"]
        if line == "$N":
            return [*(f"$N{i}={text}" for i, text in enumerate(self.startup)), "ok"]
        if line == "$SLP":
            self.run.state = "Sleep"
            self.switch_off(now_s)
            return ["ok", "[MSG:Sleeping]"]
        if not int(self.settings[22]) & 1:
            return ["error:5"]
        self.run.state, self.run.homing = "Home", True
        self.run.busy_until_s = self.motion.home(now_s)
        if self.variant == "grblHAL":
            return [f"<Home|MPos:{numbers(self.motion.machine(now_s), self.inches)}|FS:0,0>"]
        return None

    def _identify(self, line: str) -> Answer:
        if line.startswith("$I="):
            self.note = line[3:]
            return ["ok"]
        known = line in ("$I", "$I+")
        lines = known and grbl_settings.identity(
            self.variant, line, self.letters, self.rx_bytes, self.note, self.options
        )
        return [*lines, "ok"] if lines else ["error:3"]

    def _restore(self, line: str) -> Answer:
        if line not in ("$RST=$", "$RST=#", "$RST=*"):
            return ["error:3"]
        if line[5] in "$*":
            self.settings.update(self._factory)
        if line[5] in "#*":
            self.offsets.clear()
        if line[5] == "*":
            self.startup, self.note = ["", ""], ""
        self.asks_reset = True
        return ["[MSG:Restoring defaults]", "ok"]

    def _startup(self, line: str, now_s: float) -> Answer:
        number, equals, text = line[2:].partition("=")
        if self.run.state != "Idle":
            return ["error:8"]
        if not number.isdigit():
            return ["error:2"]
        if not equals:
            return ["error:3"]
        code = read(text, self.modes)
        if error := (code if isinstance(code, int) else 0):
            return [f"error:{error}"]
        if int(number) < len(self.startup):
            self.startup[int(number)] = text
        return ["ok"]

    def _jog(self, line: str, now_s: float) -> Answer:
        if self.run.state not in ("Idle", "Jog"):
            return ["error:8"]
        if line[2:3] != "=":
            return ["error:3"]
        code = read(line[3:], self.modes, jog=True)
        if isinstance(code, int):
            return [f"error:{code}"]
        if code.once not in (None, 53):
            return ["error:16"]
        target = self._target(code) if code.axes else (0.0,) * len(self.motion.planned)  # as the firmware does
        if not self.motion.inside(target) and int(self.settings[20]) & 1:
            return ["error:15"]
        self.motion.add(target, code.modes.feed, jog=True)
        return ["ok"]

    def _target(self, code: Code) -> tuple[float, ...]:
        target, zero = list(self.motion.planned), self.offsets.total(code.modes.system)
        for i, letter in enumerate(self.letters):
            if letter in code.axes:
                base = 0.0 if code.once == 53 else target[i] if code.modes.distance == 91 else zero[i]
                target[i] = base + code.axes[letter]
        return tuple(target)

    def _gcode(self, line: str, now_s: float) -> Answer:
        code = read(line, self.modes)
        if isinstance(code, int):
            return [f"error:{code}"]
        if not set(code.axes) <= set(self.letters):
            return ["error:20"]
        if self.run.state != "Check" and self._must_wait(code):
            self.run.waiting = code
            return None
        return self.finish(code, now_s)

    def _must_wait(self, code: Code) -> bool:
        """Whether the line executes only when nothing moves."""
        now, after = self.modes, code.modes
        outputs = (now.spindle, now.flood) != (after.spindle, after.flood)
        return outputs or code.once == 4 or code.flow is not None or (after.spindle != 5 and now.speed != after.speed)

    def begin_waited(self, now_s: float) -> Answer:
        """Motion has ended: switch, dwell, and continue with the line that waited for it."""
        code, self.run.waiting = self.run.waiting, None
        assert code is not None
        after = code.modes
        before = self.modes
        if (before.spindle, before.speed) != (after.spindle, after.speed):
            level = min(after.speed / self.settings[30], 1.0)
            self.outputs.spindle(0.0 if after.spindle == 5 else level, now_s)
        if before.flood != after.flood:
            self.outputs.relay(after.flood == 8, now_s)
        if (before.spindle, before.speed, before.flood) != (after.spindle, after.speed, after.flood):
            self._outputs_changed()
        if code.once == 4:
            self.run.dwelling, self.run.busy_until_s = code, now_s + code.values["P"]
            return None
        return self.finish(code, now_s)

    def _outputs_changed(self) -> None:
        """GRBL reports outputs with the overrides, in the next report; grblHAL separately."""
        if self.variant != "grblHAL":
            self.counters.overrides = 0

    def switch_off(self, now_s: float) -> None:
        """Switch spindle and relay off, as any reset does; shown in the next report.

        A spindle output that is off stays as it is: what it would switch may be lit by another device.
        """
        self._outputs_changed()
        self.outputs.relay(False, now_s)
        if self.modes.spindle != 5:
            self.outputs.spindle(0.0, now_s)

    def finish(self, code: Code, now_s: float) -> Answer:
        """Apply the modes, non-modal commands, motion, and the end of the program."""
        target = self._target(code)
        if self.modes.system != code.modes.system or code.length or code.once in (10, 92, 92.1):
            self.counters.offsets = 0
        self.modes = code.modes
        # G10, G28.1, G30.1, G92, G92.1, G43.1, G49
        offsets, here = self.offsets, self.motion.planned
        if code.length is not None:
            offsets.length = code.values["Z"] if code.length == 43.1 else 0.0
        if code.once in (28.1, 30.1):
            offsets.systems[int(code.once)] = here
        elif code.once == 92:
            zero = offsets.systems[self.modes.system]
            offsets.shift = self._changed(offsets.shift, code, [a - b for a, b in zip(here, zero, strict=True)])
        elif code.once == 92.1:
            offsets.shift = (0.0,) * len(here)
        elif code.once == 10:
            system = int(code.values.get("P", 0)) + 53
            system = self.modes.system if system == 53 else system
            at = [a - b for a, b in zip(here, offsets.shift, strict=True)] if code.values["L"] == 20 else None
            offsets.systems[system] = self._changed(offsets.systems[system], code, at)
        for way, rapid in self._ways(code, target):
            if int(self.settings[20]) & 1 and not self.motion.inside(way):
                self.run.limit, self.run.owed = True, "ok"
                return None
            if self.run.state != "Check":
                self.motion.add(way, code.modes.feed, rapid=rapid)
        return ["ok"] if code.flow is None else self._flow(code.flow, now_s)

    def _changed(self, before: tuple[float, ...], code: Code, at: list[float] | None) -> tuple[float, ...]:
        """New offsets for the named axes: the given values, or such that `at` has the given coordinates."""
        given = {LINEAR.index(letter): value for letter, value in code.axes.items()}
        return tuple(
            given.get(i, old) if at is None or i not in given else at[i] - given[i] for i, old in enumerate(before)
        )

    def _ways(self, code: Code, target: tuple[float, ...]) -> list[tuple[tuple[float, ...], bool]]:
        """The targets of the line's motions, and whether they are rapid."""
        if code.once in (28, 30):
            kept = self.offsets.systems[int(code.once)]
            end = tuple(k if letter in code.axes or not code.axes else t
                        for k, t, letter in zip(kept, target, self.letters, strict=True))  # fmt: skip
            return [*([(target, True)] if code.axes else []), (end, True)]
        return [(target, code.modes.motion == 0)] if code.moves else []

    def _flow(self, flow: int, now_s: float) -> Answer:
        if flow == 0:
            if self.run.state != "Check":
                self.run.state, self.run.owed = "Hold", "ok"
                return None
            return ["ok"]
        before = self.modes
        self.modes = Modes(motion=1, units=before.units, tool=before.tool, feed=before.feed, speed=before.speed)
        self.counters.offsets = 0
        self.switch_off(now_s)
        return ["[MSG:Pgm End]", "ok"]

    def busy_ended(self, now_s: float) -> Answer:
        """End of homing or of a dwell."""
        run = self.run
        run.busy_until_s = NEVER
        if run.dwelling is not None:
            code, run.dwelling = run.dwelling, None
            return self.finish(code, now_s)
        run.state, run.homing = "Idle", False
        self.motion.homed(now_s)
        self.homed = self.tells_homed = True
        pushed = {"FluidNC": [f"[MSG:Homed:{self.letters}]"], "grblHAL": ["[MSG:]"]}.get(self.variant, [])
        return [*pushed, *self.run_startup(now_s), "ok"]

    def run_startup(self, now_s: float) -> list[str]:
        """Run the stored startup lines; returns each with its response."""
        output = []
        for text in filter(None, self.startup):
            answer = self._gcode(text, now_s)
            if self.run.waiting is not None:  # nothing moves at a start
                answer = self.begin_waited(now_s)
            output.append(f">{text}:{(answer or ['ok'])[-1]}")
        return output


# --- Realtime bytes, and line assembly as in GRBL's main loop: capitals, without spaces and comments ---

RESET, CANCEL, DOOR = 0x18, 0x85, 0x84
OVERRIDES = {
    0x90: (0, 0), 0x91: (0, 10), 0x92: (0, -10), 0x93: (0, 1), 0x94: (0, -1), 0x95: (1, 100), 0x96: (1, 50),
    0x97: (1, 25), 0x99: (2, 0), 0x9A: (2, 10), 0x9B: (2, -10), 0x9C: (2, 1), 0x9D: (2, -1),
}  # fmt: skip
"""Realtime bytes of the overrides: the change in percent, 0 for back to 100 %; rapids are absolute."""


class Overflow:
    """A line longer than the line buffer."""


class LineReader:
    """Assembles one line at a time; `limit` is the size of the line buffer, `drops` the characters it skips."""

    def __init__(self, limit: int = 79, drops: str = "/") -> None:
        self.limit = limit
        self.drops = drops
        self._begin()

    def _begin(self) -> None:
        self._text, self._until, self._long = "", "", False

    def clear(self) -> None:
        """Discard the partial line."""
        self._begin()

    def take(self, byte: int) -> str | type[Overflow] | None:
        """The line completed by this byte, if any."""
        char = chr(byte)
        if char in "\r\n":
            line = Overflow if self._long else self._text
            self._begin()
            return line
        if self._long or self._until:
            self._until = "" if char == self._until else self._until
        elif char in "(;":
            self._until = {"(": ")", ";": "\n"}[char]
        elif char > " " and char not in self.drops:
            self._long = len(self._text) >= self.limit
            self._text += "" if self._long else char.upper()
        return None
