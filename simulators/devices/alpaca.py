"""An Alpaca server with focusers on motors with reference switches, over HTTP on this machine, and its faults.

TCP neither loses nor changes bytes, so faults are those of a server and its network: connections that end without a
reply, before or after the order was carried out, errors in place of replies, replies that come late, restarts.
Source: ASCOM Alpaca API reference, Focuser.
"""

import json
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from simulators.devices.serial_device import Faults, Motor
from simulators.world.clock import VirtualClock
from simulators.world.motion import Axis

STEPS_PER_MM = 1000
MESSAGE_BYTES = 200  # length of a message, for faults whose probability is per byte
INVALID_VALUE, NOT_CONNECTED, NO_ACTION = 0x401, 0x407, 0x40C


class AlpacaFocusers:
    """A server of focusers, one for each axis, with an action that homes; `port` is that of its address."""

    def __init__(self, clock: VirtualClock, axes: Mapping[str, Axis] | None = None) -> None:
        self.axes = dict(axes or {"z_mm": Axis(0.0, 100.0, 37.0), "x_mm": Axis(0.0, 50.0, 21.0)})
        self.clock, self.faults = clock, Faults()
        self._motors = [Motor(axis) for axis in self.axes.values()]
        self._connected: set[int] = set()
        self._lock = threading.Lock()
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _Handler)
        self._server.daemon_threads = True
        self._server.focusers = self  # type: ignore[attr-defined]
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def device(self) -> "AlpacaFocusers":
        """The server itself: a line and its device in one."""
        return self

    def happen(self, act: Callable[[float], None]) -> None:
        with self._lock:
            act(self.clock.now_s())

    def restart(self, now_s: float) -> None:
        """Off and on again: nobody is connected, and every place counts as 0."""
        self._connected.clear()
        for motor in self._motors:
            motor.restart(now_s)

    def answer(self, number: str, member: str, values: Mapping[str, str]) -> tuple[int, bytes] | None:
        """Status and body of a reply, None where the connection ends without one."""
        if self._is_cut():
            return None
        now_s = self.clock.now_s()
        self.clock.sleep(max((end - now_s for begin, end in self.faults.silent if begin <= now_s), default=0.0))
        with self._lock:
            status, reply = self._obey(number, member, values, self.clock.now_s())
        self.clock.sleep(self.faults.delay_s)
        if self._is_cut():
            return None
        if self._happens(self.faults.garbage):
            return 500, b"<html>Internal Server Error</html>"
        return status, reply

    def _is_cut(self) -> bool:
        return self.faults.unplugged(self.clock.now_s()) or self._happens(self.faults.lost)

    def _happens(self, probability: float) -> bool:
        with self._lock:
            return bool(self.faults.rng.random() < 1 - (1 - probability) ** MESSAGE_BYTES)

    def _obey(self, number: str, member: str, values: Mapping[str, str], now_s: float) -> tuple[int, bytes]:
        if not number.isdecimal() or int(number) >= len(self._motors):
            return 400, f"there is no focuser {number}".encode()
        motor = self._motors[int(number)]
        motor.advance(now_s)
        reply: dict[str, Any] = {"ErrorNumber": 0, "ErrorMessage": ""}
        if member == "connected" and values:
            (self._connected.add if values["Connected"] == "True" else self._connected.discard)(int(number))
        elif int(number) not in self._connected:
            reply |= {"ErrorNumber": NOT_CONNECTED, "ErrorMessage": "not connected"}
        elif member in (orders := self._orders(motor, values, now_s)):
            if error := orders[member]():
                reply |= {"ErrorNumber": error, "ErrorMessage": f"{member} is refused"}
        else:
            known = _members(motor, now_s)
            if member not in known:
                return 400, f"there is no {member}".encode()
            reply["Value"] = known[member]
        return 200, json.dumps(reply).encode()

    @staticmethod
    def _orders(motor: Motor, values: Mapping[str, str], now_s: float) -> dict[str, Callable[[], int | None]]:
        def move() -> int | None:
            place = int(values["Position"]) / STEPS_PER_MM
            if not 0 <= place <= motor.axis.high - motor.axis.low:
                return INVALID_VALUE
            motor.go(place, now_s)
            return None

        def act() -> int | None:
            if values["Action"] != "Home":
                return NO_ACTION
            motor.home(now_s)
            return None

        return {"move": move, "action": act, "halt": lambda: motor.stop(now_s)}


def _members(motor: Motor, now_s: float) -> dict[str, Any]:
    return {
        "name": "simulated focuser", "driverversion": "1.0", "supportedactions": ["Home"], "absolute": True,
        "connected": True, "maxstep": round((motor.axis.high - motor.axis.low) * STEPS_PER_MM),
        "stepsize": 1000 / STEPS_PER_MM, "ismoving": motor.moves(),
        "position": round(motor.position(now_s) * STEPS_PER_MM),
    }  # fmt: skip


class _Handler(BaseHTTPRequestHandler):
    def _reply(self, text: str) -> None:
        focusers: AlpacaFocusers = self.server.focusers  # type: ignore[attr-defined]
        focusers.clock.stand_in()
        *_, number, member = urlsplit(self.path).path.split("/")
        ids = {"ClientID", "ClientTransactionID"}
        values = {name: value[0] for name, value in parse_qs(text).items() if name not in ids}
        answer = focusers.answer(number, member, values)
        if answer is None:
            self.close_connection = True
            return
        status, data = answer
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def do_GET(self) -> None:
        self._reply(urlsplit(self.path).query)

    def do_PUT(self) -> None:
        self._reply(self.rfile.read(int(self.headers.get("Content-Length", 0))).decode())

    def log_message(self, *_: object) -> None:
        """Requests are not logged."""
