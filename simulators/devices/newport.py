"""Newport ESP301 and SMC100 at byte level.

An ESP301 executes the commands of a line one after another and keeps its errors; a line longer than 80 characters is
an error. An SMC100 executes one command a line if the number is its own, or a stop without number. Both ignore blanks.
Source: Newport, ESP301 user's manual EDH0235; SMC100CC/PP user's manual EDH0206.
"""

import re
from collections import deque
from collections.abc import Mapping
from functools import partial
from itertools import count

from simulators.devices.serial_device import MotorController
from simulators.world.motion import Axis

CYCLE_S = 400e-6  # servo cycle of an ESP301, the unit of its time stamps
ESP_ERRORS = {
    0: "NO ERROR DETECTED", 6: "COMMAND DOES NOT EXIST", 7: "PARAMETER OUT OF RANGE", 9: "AXIS NUMBER OUT OF RANGE",
    20: "HOMING ABORTED", 30: "MOTOR NOT ENABLED",
}  # fmt: skip
SMC_ERRORS = {
    "@": "No error", "A": "Unknown message code", "C": "Parameter missing or out of range",
    "H": "Execution not allowed in NOT REFERENCED state", "K": "Execution not allowed in READY state",
    "M": "Execution not allowed in MOVING state",
}  # fmt: skip
COMMAND = re.compile(r"(\d*)([A-Z]{2})([-+0-9.?A-Z@]*)")


class NewportTwin(MotorController[int]):
    """Common part of both: numbered motors, lines of commands, a power switch."""

    baud = 57600
    longest = 80

    def __init__(self, axes: Mapping[str, Axis] | None = None) -> None:
        two = {"x_mm": Axis(0.0, 100.0, 37.0), "y_mm": Axis(0.0, 50.0, 21.0)}
        super().__init__(axes or two, count(1))
        self._booted_s = 0.0

    def restart(self, now_s: float) -> None:
        super().restart(now_s)
        self._booted_s = now_s

    def receive(self, data: bytes, now_s: float) -> None:
        """Lines, ended by a carriage return."""
        for byte in data:
            if byte != ord("\r"):
                self._received.append(byte)
                continue
            line = re.sub(r"\s", "", self._received.decode("ascii", "replace")).upper()
            self._received.clear()
            if line:
                self.obey(line, now_s)

    def obey(self, line: str, now_s: float) -> None:
        raise NotImplementedError

    def say(self, text: str) -> None:
        """Send a line."""
        self._out += text.encode() + b"\r\n"


class Esp301Twin(NewportTwin):
    """An ESP301; its motors are off after a power cycle."""

    baud = 921600

    def __init__(self, axes: Mapping[str, Axis] | None = None) -> None:
        super().__init__(axes)
        self._powered: set[int] = set()
        self._errors: deque[tuple[int, float]] = deque(maxlen=10)

    def restart(self, now_s: float) -> None:
        """Off and on again: its motors stay off."""
        super().restart(now_s)
        self._powered.clear()
        self._errors.clear()

    def obey(self, line: str, now_s: float) -> None:
        for text in line.split(";"):
            match = COMMAND.fullmatch(text)
            whole = len(line) <= self.longest
            code = self._obey(match[1], match[2], match[3], now_s) if match and whole else 6
            if code:
                self._errors.append((code, now_s))

    def _obey(self, number: str, command: str, value: str, now_s: float) -> int:
        if command in ("ST", "AB") and not number:
            for motor in self.motors.values():
                motor.stop(now_s)
            return 0
        if command == "VE":
            self.say("ESP301 Version 3.0.1 6/1/99")
            return 0
        if command == "TS":
            moving = sum(motor.moves() << number - 1 for number, motor in self.motors.items())
            self.say(chr(0x40 | moving | bool(self._powered) << 4))
            return 0
        if command in ("TB", "TE"):  # with or without a number
            code, at_s = self._errors.popleft() if self._errors else (0, now_s)
            cycles = round((at_s - self._booted_s) / CYCLE_S)
            self.say(f"{code}, {cycles}, {ESP_ERRORS[code % 100]}" if command == "TB" else str(code))
            return 0
        if not number or int(number) not in self.motors:
            return 9
        axis = int(number)
        if value in ("", "?") and command in (reports := self._reports(axis, now_s)):
            self.say(reports[command])
            return 0
        code = self._execute(axis, command, value, now_s)
        return code if code < 10 else 100 * axis + code

    def _reports(self, axis: int, now_s: float) -> dict[str, str]:
        motor = self.motors[axis]
        return {
            "TP": f"{motor.position(now_s):.5f}", "MD": str(int(not motor.moves())), "ID": f"ILS100CC, SN{1000 + axis}",
            "SN": "2", "SL": f"{motor.axis.low:.5f}", "SR": f"{motor.axis.high:.5f}", "VA": f"{motor.speed:.5f}",
        }  # fmt: skip

    def _execute(self, axis: int, command: str, value: str, now_s: float) -> int:
        motor = self.motors[axis]
        match command:
            case "MO" if value == "?":
                self.say(str(int(axis in self._powered)))
            case "MO":
                self._powered.add(axis)
            case "MF":
                self._powered.discard(axis)
                motor.stop(now_s)
            case "ST":
                motor.stop(now_s)
            case "DH":
                motor.place_of_zero = motor.axis.position(now_s) - (number_in(value) or 0.0)
            case "VA" if number_in(value):
                motor.speed = float(value)
            case "OR" | "PA" | "PR" if axis not in self._powered:
                return 30
            case "OR":
                motor.home(now_s)
            case "PA" | "PR":
                goal = number_in(value)
                if goal is None:
                    return 7
                goal += motor.position(now_s) if command == "PR" else 0.0
                if not motor.axis.low <= goal <= motor.axis.high:
                    return 7
                motor.go(goal, now_s)
            case _:
                return 6
        return 0


def number_in(text: str) -> float | None:
    """The number, None where it is none."""
    try:
        return float(text)
    except ValueError:
        return None


class Smc100Twin(NewportTwin):
    """A chain of SMC100; each moves only once it is referenced, and reports its state."""

    def __init__(self, axes: Mapping[str, Axis] | None = None) -> None:
        super().__init__(axes)
        self._states = dict.fromkeys(self.motors, "0A")
        self._errors = dict.fromkeys(self.motors, "@")

    def restart(self, now_s: float) -> None:
        """Off and on again: not referenced."""
        super().restart(now_s)
        self._states = dict.fromkeys(self.motors, "0A")
        self._errors = dict.fromkeys(self.motors, "@")

    def advance(self, now_s: float) -> bytes:
        """States after drives that have ended."""
        moved = [number for number, motor in self.motors.items() if motor.rest_s <= now_s]
        output = super().advance(now_s)
        for number in moved:
            searched = self._states[number] == "1E"
            referenced = self.motors[number].referenced
            self._states[number] = ("32" if referenced else "0B") if searched else "33"
        return output

    def obey(self, line: str, now_s: float) -> None:
        match = COMMAND.fullmatch(line)
        if match is None:
            return
        number, command, value = match.groups()
        if command == "ST" and not number:
            for each in self.motors:
                self._stop(each, now_s)
        elif number and int(number) in self.motors:
            self._errors[int(number)] = self._obey(int(number), command, value, now_s) or self._errors[int(number)]

    def _stop(self, number: int, now_s: float) -> None:
        self.motors[number].stop(now_s)

    def _obey(self, number: int, command: str, value: str, now_s: float) -> str:
        motor, say = self.motors[number], partial(self._report, number, command)
        match command:
            case "VE":
                say("SMC_CC v2.0.1")
            case "ID":
                say(f"ILS100CC_SN{1000 + number}")
            case "TE":
                say(self._errors[number])
                self._errors[number] = "@"
            case "TB":
                say(f"{value or '@'} {SMC_ERRORS.get(value or '@', 'Unknown')}")
            case "TP" | "TH":
                say(f"{motor.position(now_s):.6f}")
            case "TS":
                say("0000" + self._states[number])
            case "SL" | "SR" | "VA" if value == "?":
                say(f"{({'SL': motor.axis.low, 'SR': motor.axis.high, 'VA': motor.speed})[command]:g}")
            case "VA" if number_in(value):
                motor.speed = float(value)
            case "ST":
                self._stop(number, now_s)
            case "RS":
                motor.restart(now_s)
                self._states[number] = "0A"
            case "OR" | "PA" | "PR":
                return self._drive(number, command, value, now_s)
            case _:
                return "A"
        return ""

    def _report(self, number: int, command: str, value: str) -> None:
        self.say(f"{number}{command}{value}")

    def _drive(self, number: int, command: str, value: str, now_s: float) -> str:
        motor, state = self.motors[number], self._states[number]
        if motor.moves():
            return "M"
        if command == "OR":
            if motor.referenced:
                return "K"
            motor.home(now_s)
            self._states[number] = "1E"
            return ""
        if not state.startswith("3"):
            return "H"
        goal = number_in(value)
        goal = None if goal is None else goal + (motor.position(now_s) if command == "PR" else 0.0)
        if goal is None or not motor.axis.low <= goal <= motor.axis.high:
            return "C"
        motor.go(goal, now_s)
        self._states[number] = "28"
        return ""
