"""A controller of Physik Instrumente with GCS 2.0 at byte level.

Lines end with a line feed; all lines of a reply but the last have a blank before it. Single bytes act at once, also
within a line. The last error is kept until it is read.
Source: PI, GCS 2.0 commands, in the user manuals of the C-863 and C-884.
"""

from collections.abc import Callable, Mapping
from itertools import count

from simulators.devices.serial_device import Motor, MotorController
from simulators.world.motion import Axis

IDENTITY = "(c)2015 Physik Instrumente (PI) GmbH & Co. KG, C-884.4DC, 118057582, 1.2.1.3"
UNKNOWN, UNREFERENCED, OUTSIDE, STOPPED, NO_AXIS = 2, 5, 7, 10, 15
COMMANDS = (
    "*IDN?", "CSV?", "ERR?", "FNL", "FPL", "FRF", "FRF?", "FNL?", "FPL?", "HLT", "HLP?", "MOV", "MOV?", "MVR", "ONT?",
    "POS?", "SAI?", "STP", "SVO", "SVO?", "TMN?", "TMX?", "VEL", "VEL?", "VER?",
)  # fmt: skip


class GcsTwin(MotorController[str]):
    """Motors by their identifiers 1, 2, ...; none moves before its servo is on and it is referenced."""

    baud = 115200

    def __init__(self, axes: Mapping[str, Axis] | None = None) -> None:
        two = {"x_mm": Axis(0.0, 100.0, 37.0), "y_mm": Axis(0.0, 50.0, 21.0)}
        super().__init__(axes or two, map(str, count(1)))
        self._servo: set[str] = set()
        self._error = 0

    def restart(self, now_s: float) -> None:
        """Off and on again: its servos are off, and nothing is referenced."""
        super().restart(now_s)
        self._servo.clear()
        self._error = 0

    def receive(self, data: bytes, now_s: float) -> None:
        for byte in data:
            if byte == 0x18:
                self._stop(now_s)
            elif byte == 0x05:
                moving = sum(motor.moves() << place for place, motor in enumerate(self.motors.values()))
                self._say([f"{moving:X}"])
            elif byte == 0x07:
                self._out += b"\xb1\n"
            elif byte == ord("\n"):
                line = self._received.decode("ascii", "replace").split()
                self._received.clear()
                if line:
                    self._error = self._obey(line[0].upper(), line[1:], now_s) or self._error
            else:
                self._received.append(byte)

    def _say(self, lines: list[str]) -> None:
        self._out += " \n".join(lines).encode() + b"\n"

    def _stop(self, now_s: float) -> None:
        for motor in self.motors.values():
            motor.stop(now_s)
        self._error = STOPPED

    def _obey(self, command: str, words: list[str], now_s: float) -> int:
        if command == "ERR?":
            self._say([str(self._error)])
            self._error = 0
        elif command in (fixed := self._fixed()):
            self._say(fixed[command])
        elif command in ("STP", "HLT"):
            self._stop(now_s)
        elif command.endswith("?"):
            return self._report(command[:-1], words, now_s)
        elif command in ("FRF", "FNL", "FPL"):
            return self._each([(axis, "0") for axis in words or self.motors], command, now_s)
        else:
            return self._each(list(zip(words[::2], words[1::2], strict=False)), command, now_s)
        return 0

    def _fixed(self) -> dict[str, list[str]]:
        return {
            "*IDN?": [IDENTITY], "CSV?": ["2.0"], "SAI?": list(self.motors), "VER?": [IDENTITY],
            "HLP?": [*(f"{name} - see the manual" for name in COMMANDS), "end of help"],
        }  # fmt: skip

    def _report(self, query: str, axes: list[str], now_s: float) -> int:
        values: dict[str, Callable[[str, Motor], float]] = {
            "POS": lambda _, motor: motor.position(now_s),
            "MOV": lambda _, motor: motor.position(now_s),
            "TMN": lambda _, motor: motor.axis.low,
            "TMX": lambda _, motor: motor.axis.high,
            "VEL": lambda _, motor: motor.speed,
            "ONT": lambda _, motor: not motor.moves(),
            "SVO": lambda axis, _: axis in self._servo,
            **dict.fromkeys(("FRF", "FNL", "FPL"), lambda _, motor: motor.referenced),
        }
        if query not in values:
            return UNKNOWN
        if any(axis not in self.motors for axis in axes):
            return NO_AXIS
        shown = {axis: values[query](axis, self.motors[axis]) for axis in axes or self.motors}
        self._say([f"{axis}={int(v) if isinstance(v, bool) else f'{v:.7f}'}" for axis, v in shown.items()])
        return 0

    def _each(self, pairs: list[tuple[str, str]], command: str, now_s: float) -> int:
        """An order to each of these axes; the first error, which leaves all of them where they are."""
        try:
            values = [(axis, float(value)) for axis, value in pairs]
        except ValueError:
            return UNKNOWN
        for execute in (False, True):
            for axis, value in values:
                if code := self._one(command, axis, value, now_s, execute):
                    return code
        return 0 if values else UNKNOWN

    def _one(self, command: str, axis: str, value: float, now_s: float, execute: bool) -> int:
        motor = self.motors.get(axis)
        if motor is None:
            return NO_AXIS
        if command in ("MOV", "MVR"):
            goal = value + (motor.position(now_s) if command == "MVR" else 0.0)
            if not motor.referenced or axis not in self._servo:
                return UNREFERENCED
            if not motor.axis.low <= goal <= motor.axis.high:
                return OUTSIDE
            if execute:
                motor.go(goal, now_s)
        elif command in ("FRF", "FNL", "FPL"):
            if axis not in self._servo:
                return UNREFERENCED
            if execute:
                motor.home(now_s)
        elif command == "SVO":
            (self._servo.add if value else self._servo.discard)(axis)
        elif command == "VEL" and value > 0:
            motor.speed = value
        else:
            return UNKNOWN
        return 0
