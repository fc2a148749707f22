"""A chain of Zaber devices at byte level; each axis moves one axis of the world.

Checksums, message ids, warning flags and alerts as in firmware 6 and 7. After power-up an axis has no reference, homes
to its low end, and refuses absolute moves until then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from simulators.devices.serial_device import SerialDevice, drained
from simulators.world.motion import Axis, brake_line, travel_line

NEVER = float("inf")
SPEED_UNIT = 1.6384
FAULT_FLAGS = [f"F{letter}" for letter in "FNZHVOCMDQIARSBPET"]
PRIORITY = [*FAULT_FLAGS, "WL", "WV", "WT", "WS", "WM", "WP", "WR", "WH", "NC", "NI"]


@dataclass
class ZaberMotor:
    """One axis of a device: its axis of the world, units per microstep, its settings and flags."""

    axis: Axis
    unit_per_step: float
    settings: dict[str, float] = field(default_factory=dict)
    flags: list[str] = field(default_factory=lambda: ["WR"])
    zero: float = 0.0
    busy_until_s: float = NEVER
    homing: bool = False
    stalls: bool = False
    parked: bool = False
    driven: bool = True

    def __post_init__(self) -> None:
        steps = int((self.axis.high - self.axis.low) / self.unit_per_step)
        speed = (self.axis.high - self.axis.low) / 10 / self.unit_per_step * SPEED_UNIT
        self.settings = {"limit.min": 0, "limit.max": steps, "maxspeed": round(speed), "accel": 205, "resolution": 64}
        self.zero = self.axis.position(0.0)

    def steps(self, now_s: float) -> int:
        return round((self.axis.position(now_s) - self.zero) / self.unit_per_step)

    def flag(self) -> str:
        """The flag of highest priority."""
        return min(self.flags, key=PRIORITY.index, default="--")

    def refuses(self) -> str:
        """Why it does not move: parked, or its driver is disabled."""
        return "PARKED" if self.parked else "" if self.driven else "DRIVERDISABLED"

    def go(self, place: float, now_s: float, speed: float | None = None, acceleration: float | None = None) -> None:
        """Move to a position in the world, in the device's units; interrupts and flags an earlier movement."""
        start_s = now_s
        if self.busy_until_s != NEVER:
            start_s = self.halt(now_s, self._acceleration())
            self.flags = sorted({*self.flags, "NI"})
        else:
            self.flags = [flag for flag in self.flags if flag != "NI"]
        fast = (speed or self.settings["maxspeed"]) / SPEED_UNIT * self.unit_per_step
        rise = self._acceleration() * (acceleration or self.settings["accel"]) / self.settings["accel"]
        self.busy_until_s = max(travel_line([self.axis], [place], start_s, fast, rise), now_s)
        if self.stalls:
            self.busy_until_s = (start_s + self.busy_until_s) / 2

    def halt(self, now_s: float, acceleration: float | None) -> float:
        """Stop, at once if there is no acceleration; returns the time of rest."""
        if acceleration is None:
            self.axis.halt(now_s)
            return now_s
        return brake_line([self.axis], now_s, acceleration)

    def _acceleration(self) -> float:
        return (self.axis.high - self.axis.low) / 5

    def wake(self, now_s: float) -> None:
        """Power-up: the reference is lost and the position becomes zero, unless it was parked."""
        self.axis.halt(now_s)
        self.busy_until_s, self.homing, self.driven = NEVER, False, True
        if self.parked:
            self.parked = False
            self.flags = [flag for flag in self.flags if flag in ("WR", "WH")]
        else:
            self.flags, self.zero = ["WR"], self.axis.position(now_s)

    def switch(self, on: bool, now_s: float) -> None:
        """Switch the motor's current; without it, it stands and raises a flag."""
        self.driven = on
        self.flags = [flag for flag in self.flags if flag != "FO"] + ([] if on else ["FO"])
        if not on and self.busy_until_s != NEVER:
            self.busy_until_s, self.homing = self.halt(now_s, None), False

    def ended(self, now_s: float) -> None:
        self.busy_until_s = NEVER
        if self.stalls:
            self.stalls, self.homing = False, False
            self.halt(now_s, None)
            self.flags = sorted({*self.flags, "FS"})
        elif self.homing:
            self.homing = False
            self.zero = self.axis.low
            self.flags = [flag for flag in self.flags if flag not in ("WR", "WH")]


@dataclass
class ZaberDevice:
    """One device: its address, identity and motors."""

    address: int
    motors: list[ZaberMotor]
    deviceid: int = 50081
    serial: int = 12345
    version: str = "7.36"
    checksum: bool = False
    alert: bool = False

    def wake(self, now_s: float) -> None:
        """Power-up: neither checksums nor alerts are enabled."""
        for motor in self.motors:
            motor.wake(now_s)
        self.alert = self.checksum = False


def lrc(body: bytes) -> bytes:
    """Two hex digits that make the sum zero."""
    return b"%02X" % ((256 - sum(body) % 256) % 256)


class ZaberChain(SerialDevice):
    """Devices on one line."""

    baud = 115200

    def __init__(self, axes: Mapping[int, Sequence[tuple[Axis, float]]]) -> None:
        self.devices = {
            number: ZaberDevice(number, [ZaberMotor(axis, unit) for axis, unit in motors], serial=12340 + number)
            for number, motors in axes.items()
        }
        self._line = bytearray()
        self._out = bytearray()

    def restart(self, now_s: float) -> None:
        """Off and on again, the whole chain."""
        for device in self.devices.values():
            device.wake(now_s)
        self._line.clear()

    def receive(self, data: bytes, now_s: float) -> None:
        """Lines that begin with a slash; CR, LF or both end them."""
        for byte in data:
            if byte in b"\r\n":
                line, self._line = bytes(self._line), bytearray()
                start = line.rfind(b"/")
                if start >= 0:
                    self._obey(line[start + 1 :], now_s)
            elif len(self._line) < 256:
                self._line.append(byte)

    def advance(self, now_s: float) -> bytes:
        """Process the movements that have ended, with their alerts; returns the output."""
        while (moment_s := self.next_event_s()) is not None and moment_s <= now_s:
            for device in self.devices.values():
                for number, motor in enumerate(device.motors, 1):
                    if motor.busy_until_s <= moment_s:
                        motor.ended(moment_s)
                        if device.alert:
                            self._send(device, f"!{device.address:02d} {number} IDLE {motor.flag()}")
        return drained(self._out)

    def next_event_s(self) -> float | None:
        """The end of the next movement."""
        moments = [motor.busy_until_s for device in self.devices.values() for motor in device.motors]
        return None if min(moments, default=NEVER) == NEVER else min(moments)

    def _send(self, device: ZaberDevice, line: str) -> None:
        text = line.encode()
        if device.checksum:
            text += b":" + lrc(text[1:])
        self._out += text + b"\r\n"

    def _obey(self, line: bytes, now_s: float) -> None:
        if line[-3:-2] == b":":
            if lrc(line[:-3]) != line[-2:].upper():
                return
            line = line[:-3]
        words = line.decode("ascii", "replace").split()
        numbers: list[int] = []
        while words and len(numbers) < 3 and (words[0].isdigit() or (len(numbers) == 2 and words[0] == "--")):
            word = words.pop(0)
            numbers.append(int(word) if word != "--" else -1)
        address, axis = (*numbers, 0, 0)[:2]
        reply_id = f" {numbers[2]:02d}" if len(numbers) > 2 and numbers[2] >= 0 else ""
        for device in self.devices.values():
            if address in (0, device.address):
                motors = device.motors if axis == 0 else device.motors[axis - 1 : axis]
                verdict, data = self._do(device, motors, axis, words, now_s) if motors else ("RJ", "BADAXIS")
                shown = motors or device.motors
                busy = "BUSY" if any(motor.busy_until_s != NEVER for motor in shown) else "IDLE"
                flag = next((motor.flag() for motor in shown if motor.flags), "--")
                self._send(device, f"@{device.address:02d} {axis}{reply_id} {verdict} {busy} {flag} {data}")

    def _do(
        self, device: ZaberDevice, motors: list[ZaberMotor], axis: int, words: list[str], now_s: float
    ) -> tuple[str, str]:
        match words:
            case []:
                return "OK", "0"
            case ["get", name]:
                return self._get(device, motors, name, now_s)
            case ["set", name, value] if _number(value):
                return self._set(device, motors, name, float(value))
            case ["home"] if refusal := next(filter(None, (motor.refuses() for motor in motors)), ""):
                return "RJ", refusal
            case ["home"]:
                for motor in motors:
                    motor.homing = True
                    motor.go(motor.axis.low, now_s)
                return "OK", "0"
            case ["move", *how]:
                return self._move(motors, how, now_s)
            case ["stop"] | ["estop"]:
                for motor in motors:
                    self._stop(motor, words[0] == "estop", now_s)
                return "OK", "0"
            case ["warnings", *clear]:
                return self._warnings(motors, bool(clear))
            case ["tools", "echo", *text]:
                return "OK", " ".join(text) or "0"
            case ["tools", "parking", "park" | "unpark" as how]:
                return self._park(motors, how == "park")
            case ["driver", "enable" | "disable" as how]:
                for motor in motors:
                    motor.switch(how == "enable", now_s)
                return "OK", "0"
            case ["system", "reset"] | ["io", *_] | ["renumber", *_] if axis != 0:
                return "RJ", "DEVICEONLY"
            case ["system", "reset"]:
                device.wake(now_s)
                return "OK", "0"
            case ["io", "info"]:
                return "OK", "0 0 0 0"  # analog out and in, digital out and in: these stages have none
            case ["io", *_]:
                return "RJ", "BADDATA"
            case ["renumber", *_]:
                return "OK", "0"
        return "RJ", "BADCOMMAND"

    def _stop(self, motor: ZaberMotor, dead: bool, now_s: float) -> None:
        if motor.busy_until_s != NEVER:
            motor.homing = False
            motor.flags = sorted({*motor.flags, "NI"})
            motor.busy_until_s = motor.halt(now_s, None if dead else motor._acceleration())

    def _park(self, motors: list[ZaberMotor], park: bool) -> tuple[str, str]:
        if park and any(motor.busy_until_s != NEVER for motor in motors):
            return "RJ", "STATUSBUSY"
        if park and any("WR" in motor.flags for motor in motors):
            return "RJ", "BADDATA"  # without a reference there is no position to keep
        for motor in motors:
            motor.parked = park
        return "OK", "0"

    def _warnings(self, motors: list[ZaberMotor], clear: bool) -> tuple[str, str]:
        flags = sorted({flag for motor in motors for flag in motor.flags})
        if clear:
            for motor in motors:
                motor.flags = [flag for flag in motor.flags if flag in ("WR", "WH")]
        return "OK", " ".join([f"{len(flags):02d}", *flags])

    def _get(self, device: ZaberDevice, motors: list[ZaberMotor], name: str, now_s: float) -> tuple[str, str]:
        values: dict[str, object] = {
            "deviceid": device.deviceid,
            "device.id": device.deviceid,
            "system.serial": device.serial,
            "version": device.version,
            "version.build": 7000,
            "system.axiscount": len(device.motors),
            "comm.checksum": int(device.checksum),
            "comm.alert": int(device.alert),
            "comm.address": device.address,
            "system.access": 1,
            "system.voltage": 24.1,
        }
        if name in values:
            return "OK", str(values[name])
        if name in ("parking.state", "driver.enabled"):
            return "OK", " ".join(str(int(m.parked if name == "parking.state" else m.driven)) for m in motors)
        if name in ("pos", "encoder.pos"):
            return "OK", " ".join(str(motor.steps(now_s)) for motor in motors)
        if all(name in motor.settings for motor in motors):
            return "OK", " ".join(f"{motor.settings[name]:g}" for motor in motors)
        return "RJ", "BADCOMMAND"

    def _set(self, device: ZaberDevice, motors: list[ZaberMotor], name: str, value: float) -> tuple[str, str]:
        if name == "comm.checksum":
            device.checksum = bool(value)
        elif name == "comm.alert":
            device.alert = bool(value)
        elif all(name in motor.settings for motor in motors):
            if value < 0 or (name == "maxspeed" and value < 1):
                return "RJ", "BADDATA"
            for motor in motors:
                motor.settings[name] = value
        else:
            return "RJ", "BADCOMMAND"
        return "OK", "0"

    def _move(self, motors: list[ZaberMotor], how: list[str], now_s: float) -> tuple[str, str]:
        how, (speed, acceleration) = how[:2], _pace(how)
        if refusal := next(filter(None, (motor.refuses() for motor in motors)), ""):
            return "RJ", refusal
        targets = [self._target(motor, how, now_s) for motor in motors]
        if None in (speed, acceleration):
            return "RJ", "BADDATA"
        for motor, target in zip(motors, targets, strict=True):
            low, high = motor.settings["limit.min"], motor.settings["limit.max"]
            if target is None or "WR" in motor.flags or not low <= target <= high:
                return "RJ", "BADDATA"
        for motor, target in zip(motors, targets, strict=True):
            if target is not None:
                motor.go(motor.zero + target * motor.unit_per_step, now_s, speed, acceleration)
        return "OK", "0"

    def _target(self, motor: ZaberMotor, how: list[str], now_s: float) -> float | None:
        match how:
            case ["min" | "max" as end]:
                return motor.settings[f"limit.{end}"]
            case ["abs", number] if _number(number):
                return float(number)
            case ["rel", number] if _number(number):
                return motor.steps(now_s) + float(number)
            case ["vel", number] if _number(number):
                return motor.settings["limit.max" if float(number) > 0 else "limit.min"]
        return None


def _pace(how: list[str]) -> tuple[float | None, float | None]:
    """Speed and acceleration after `abs N`, `rel N`, `min` or `max`; 0 for the device's default, None if invalid."""
    given = how[1:] if how[:1] in (["min"], ["max"]) else how[2:]
    values = [float(text) if _number(text) and float(text) > 0 else None for text in given[:2]]
    if len(given) > 2 or (given and how[0] in ("vel", "stored")):
        return None, None
    speed, acceleration = (*values, 0.0, 0.0)[:2]
    return speed, acceleration


def _number(text: str) -> bool:
    return text.lstrip("-").replace(".", "", 1).isdigit() and text.isascii()
