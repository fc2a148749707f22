"""The toy stage at byte level: what `station conform toy-stage` drives."""

from binascii import crc_hqx

from simulators.devices.serial_device import drained
from simulators.world.motion import Axis, travel_line

NEVER = float("inf")
SPEED, ACCELERATION = 40.0, 100.0


class ToyTwin:
    """One axis; homes to its low end; after a power cycle it takes its position for 0."""

    baud = 115200

    def __init__(self, axis: Axis | None = None) -> None:
        self._axis = axis or Axis(0.0, 200.0, 73.0)
        self.axes = {"x_mm": self._axis}
        self._homed, self._homing, self._rest_s, self._zero = False, False, NEVER, 0.0
        self._line, self._out = bytearray(), bytearray()

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """It has no modem lines."""

    def restart(self, now_s: float) -> None:
        """Off and on again."""
        self._halt(now_s)
        self._homed, self._zero = False, self._axis.position(now_s)
        self._line.clear()

    def _halt(self, now_s: float) -> None:
        self._axis.halt(now_s)
        self._homing, self._rest_s = False, NEVER

    def receive(self, data: bytes, now_s: float) -> None:
        """Lines of commands; `!` acts at once."""
        for byte in data:
            if byte == ord("!"):
                self._halt(now_s)
            elif byte == ord("\n"):
                self._obey(bytes(self._line), now_s)
                self._line.clear()
            else:
                self._line.append(byte)

    def _obey(self, line: bytes, now_s: float) -> None:
        body, _, check = line.rpartition(b"*")
        if check != b"%04X" % crc_hqx(body, 0):
            return
        number, command, *words = body.decode().split()
        answer = f"{number} {self._answer(command, words, now_s)}"
        self._out += f"{answer}*{crc_hqx(answer.encode(), 0):04X}\n".encode()

    def _answer(self, command: str, words: list[str], now_s: float) -> str:
        if command == "who":
            return "ok Toy 1.0 0042"
        if command == "travel":
            return f"ok {self._axis.low} {self._axis.high} {SPEED}"
        if command == "where":
            moving = self._rest_s != NEVER
            state = "homing" if self._homing else "moving" if moving else "still" if self._homed else "unhomed"
            return f"ok {state} {self._axis.position(now_s) - self._zero:.4f}"
        if self._rest_s != NEVER or (command == "go" and not self._homed):
            return "no moving" if self._rest_s != NEVER else "no reference"
        self._homing = command == "home"
        goal = self._axis.low if self._homing else float(words[0])
        self._homed = not self._homing
        self._rest_s = travel_line([self._axis], [goal], now_s, SPEED, ACCELERATION)
        return "ok"

    def advance(self, now_s: float) -> bytes:
        """Movements that have ended, and the output."""
        if self._rest_s <= now_s:
            self._homed, self._homing, self._rest_s, self._zero = True, False, NEVER, 0.0
        return drained(self._out)

    def next_event_s(self) -> float | None:
        """When the movement ends."""
        return None if self._rest_s == NEVER else self._rest_s
