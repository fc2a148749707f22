"""The connection to an Alpaca server: requests by HTTP, each on a connection of its own, so no stop waits for another.

Source: ASCOM Alpaca API reference, and its error numbers.
"""

import base64
import json
import math
import os
import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from itertools import count
from typing import Annotated, Any
from urllib.parse import urlencode, urlsplit

import numpy as np
import numpy.typing as npt

from drivers.errors import BadConfiguration, Held, LineLost, NoAnswer, NoReading, Rejected
from drivers.interfaces import PROBE_UNITS, Identity, ProbeReading
from drivers.making import DriverOptions, MakerContext
from drivers.options import Count, Uncertainty, has_port, option
from drivers.wire.connection import LineDevice, closed_after_errors, not_connected

CLIENT = os.getpid() & 0xFFFF  # the client number of this program
PREEMPT_S, PREEMPT_TRIES = 10.0, 3
"""How long a stop waits for its server's answer, and how often it is sent; the caller does not wait for it. A slow
server may drop the request of a client that has disconnected.
"""
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
ELEMENTS = {1: "<i2", 2: "<i4", 6: "u1", 8: "<u2", 9: "<u4"}
"""Integer types in which an image is transmitted, by the standard's numbers."""
REQUEST_S = 5.0
NOT_NOW = "0x40b"  # error code of an operation that is not possible at this moment
NO_CONNECTION = 0x407
REMEDIES = {0x400: "use a device that has it", 0x401: "give another value", 0x40B: "do what it says, then repeat"}
"""Remedies of the standard's errors, by number: not implemented, invalid value, invalid operation."""
RESUME, HELD = "Resume", 0x501
"""The action of a device that a person can pause, and its own error number while it is paused."""
Levels = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True)
class AlpacaAddress:
    """A server: "192.168.1.20:11111", and the environment variable that holds its password, "" for none.

    The configuration is stored with every session, so a password is read from the environment only.
    """

    address: str
    password_variable: str = ""

    def password(self) -> str:
        """The password, "" for none. Raises BadConfiguration."""
        name = self.password_variable
        if name and not os.environ.get(name):
            reason = f"{name} in the environment must hold the password of {self.address}, and it is not set"
            raise BadConfiguration(reason, f"set it before the program is started: export {name}=...")
        return os.environ[name] if name else ""


class AlpacaLink:
    """One device of an Alpaca server: "focuser", "camera", "switch" or "observingconditions", by its number from 0."""

    def __init__(self, server: AlpacaAddress, kind: str, number: int) -> None:
        self._server, self.kind, self.number = server, kind, number
        parts = urlsplit(f"http://{server.address}")
        self._host, self._port = parts.hostname or "", parts.port or 80
        self._headers: dict[str, str] = {}
        self._requests = count(1)
        self.is_open = self.is_claimed = False
        """`is_claimed` from `open` to `close`, also after the server was lost: stops are sent then."""
        self.can_resume = False

    @property
    def address(self) -> str:
        return f"{self.kind} {self.number} at {self._host}:{self._port}"

    def open(self) -> Identity:
        password = self._server.password()
        key = base64.b64encode(f"any:{password}".encode()).decode()
        self._headers = {"Authorization": f"Basic {key}"} if password else {}
        self.is_open = self.is_claimed = True
        with closed_after_errors(self):
            self.put("connected", Connected=True)
            identity = Identity(f"Alpaca {self.get('name')}", str(self.get("driverversion")), "", self.address)
            with suppress(Rejected, TypeError):  # null where it has none
                self.can_resume = RESUME in self.get("supportedactions")
        return identity

    def close(self) -> None:
        """Disconnect here; the device stays connected, as other programs may use it."""
        self.is_open = self.is_claimed = False

    # --- requests

    def get(self, member: str, **values: object) -> Any:
        """The value of a member. Raises DeviceError."""
        return self._call("GET", member, values)

    def put(self, member: str, **values: object) -> Any:
        """Set or call a member. Raises DeviceError."""
        return self._call("PUT", member, values)

    def number_of(self, member: str, **values: object) -> float:
        """The value of a member that is a number. Raises DeviceError."""
        value = self.get(member, **values)
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise self._no_alpaca(f"{member} is {value!r:.100}")
        return number

    def _call(self, method: str, member: str, values: Mapping[str, object]) -> Any:
        if not self.is_open:
            raise not_connected(self.address)
        _, data = self._reply(method, member, values, REQUEST_S)
        try:
            number, message, value = _decoded(data)
        except ValueError as error:
            raise self._no_alpaca(str(error)) from error
        if number:
            raise self._failure(number, message)
        return value

    def _no_alpaca(self, reason: str) -> Rejected:
        return Rejected(f"{self.address} does not answer as an Alpaca server does: {reason}", "check address and port")

    def _failure(self, number: int, message: str) -> Rejected | LineLost | Held:
        reason = f"{self.address}: {message}"
        if number == NO_CONNECTION:
            self.is_open = False
            return LineLost(reason, "connect it again")
        if number == HELD and self.can_resume:
            return Held(reason, "end the pause there, or try again")
        return Rejected(reason, REMEDIES.get(number, "look at its server"), hex(number))

    def _reply(self, method: str, member: str, values: Mapping[str, object], timeout_s: float) -> tuple[str, bytes]:
        """Content type and body of a reply with a status of success. Raises DeviceError."""
        try:
            status, kind, data = self._ask(method, member, urlencode(values), timeout_s)
        except TimeoutError as error:
            raise NoAnswer(
                f"{self.address} did not answer {member} within {timeout_s:g} s", "look at its server"
            ) from error
        except (OSError, HTTPException) as error:
            self.is_open = False
            raise LineLost(f"{self.address} cannot be reached", "start its server, check address and port") from error
        if status in (401, 403):
            remedy = "set password_variable to the name of the environment variable with its password or token"
            raise BadConfiguration(f"{self.address} requires a password, and none or a wrong one was sent", remedy)
        if status >= 400:
            reason = f"{self.address} refused the request: {data.decode('utf-8', 'replace')[:200]}"
            raise Rejected(reason, "check the device's number", str(status))
        return kind, data

    def preempt(self, member: str, **values: object) -> None:
        """Call a member, and retry until it is acknowledged; never raises."""
        for _ in range(PREEMPT_TRIES):
            with suppress(OSError, HTTPException, ValueError):
                _, _, data = self._ask("PUT", member, urlencode(values), PREEMPT_S)
                if not _decoded(data)[0]:  # a reply without success is no JSON
                    return

    def image(self, timeout_s: float) -> Levels:
        """The image (rows, columns) of a camera. Raises DeviceError."""
        try:
            return read_image(*self._reply("GET", "imagearray", {}, timeout_s))
        except (ValueError, struct.error) as error:
            raise Rejected(f"{self.address} sent no image: {error}", "look at its server") from error

    def _ask(self, method: str, member: str, values: str, timeout_s: float) -> tuple[int, str, bytes]:
        """Status, content type and body of the reply."""
        connection = HTTPConnection(self._host, self._port, timeout=timeout_s)
        headers = {**self._headers, "Accept": f"{BYTES}, application/json"}
        path = f"/api/v1/{self.kind}/{self.number}/{member}"
        values = f"ClientID={CLIENT}&ClientTransactionID={next(self._requests)}" + (f"&{values}" if values else "")
        if method == "PUT":
            headers["Content-Type"] = "application/x-www-form-urlencoded"
        try:
            if method == "PUT":
                connection.request(method, path, values, headers)
            else:
                connection.request(method, f"{path}?{values}", headers=headers)
            reply = connection.getresponse()
            return reply.status, reply.getheader("content-type") or "", reply.read()
        finally:
            connection.close()


def _decoded(data: bytes) -> tuple[int, str, Any]:
    """Error number, message and value of a reply. Raises ValueError."""
    try:
        reply = json.loads(data)
        return int(reply.get("ErrorNumber", 0)), str(reply.get("ErrorMessage", "")), reply.get("Value")
    except (TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(str(error)) from error


def read_image(kind: str, data: bytes) -> Levels:
    """Decode an image (rows, columns) from ImageBytes, version 1, or JSON. Raises ValueError."""
    if BYTES not in kind:
        number, message, value = _decoded(data)
        if number:
            raise ValueError(message or f"error {number:#x}")
        columns = np.array(value)
        if columns.ndim != 2 or not np.issubdtype(columns.dtype, np.integer):
            raise ValueError(f"the image must be one plane of integers; received {columns.ndim} dimensions")
        return columns.T
    _, error, _, _, start, _, sent, rank, width, height, _ = HEADER.unpack_from(data)
    if error:
        raise ValueError(data[start:].decode("utf-8", "replace") or f"error {error:#x}")
    if rank != 2 or sent not in ELEMENTS:
        raise ValueError(f"the image must be one plane of integers; received {rank} dimensions of type {sent}")
    return np.frombuffer(data, ELEMENTS[sent], width * height, start).reshape(width, height).T


@dataclass(frozen=True, kw_only=True)
class ServerOptions(DriverOptions):
    """A server."""

    server: Annotated[
        str,
        option(
            '"192.168.1.20:11111"', "address and port of a server in quotes",
            pattern=r"^(\[[^\]\s]+\]|[^:@\s/]+):\d{1,5}\Z", holds=has_port,
        ),
    ]  # fmt: skip
    password_variable: Annotated[
        str, option('"STATION_TOKEN"', "the name of a variable of the environment", pattern=r"^[A-Za-z_]\w*\Z")
    ] = ""

    @property
    def at(self) -> AlpacaAddress:
        return AlpacaAddress(self.server, self.password_variable)


@dataclass(frozen=True, kw_only=True)
class NumberedOptions(ServerOptions):
    """A device of a server, by its number."""

    device: Count = 0


# --- Weather sensors of an Alpaca server (ObservingConditions) as a Probe of the room ---

QUANTITIES = ("temperature", "humidity", "pressure")
"""Members of the standard, which has them in the units of `PROBE_UNITS`."""


class AlpacaProbe(LineDevice[AlpacaLink]):
    """A Probe; `uncertainties` by quantity, as stated by the sensors' makers."""

    def __init__(self, server: AlpacaAddress, number: int, uncertainties: Mapping[str, float | None]) -> None:
        self._link = AlpacaLink(server, "observingconditions", number)
        super().__init__(self._link)
        self._uncertainties = uncertainties
        self._quantities: tuple[str, ...] = ()

    def connect(self) -> Identity:
        """Connect, and see which quantities the device has. Raises DeviceError."""
        identity = self._link.open()
        self._quantities = tuple(name for name in QUANTITIES if self._has(name))
        if not self._quantities:
            self.close()
            raise BadConfiguration(f"{self.address} measures none of {', '.join(QUANTITIES)}", "name another device")
        return identity

    def _has(self, name: str) -> bool:
        try:
            self._link.number_of(name)
        except Rejected as error:
            return error.code != "0x400"  # not implemented; a value may come later
        return True

    def read(self) -> Mapping[str, ProbeReading]:
        try:
            values = {name: self._link.number_of(name) for name in self._quantities}
        except Rejected as error:
            raise NoReading(error.reason, error.remedy) from error
        return {
            name: ProbeReading(value, PROBE_UNITS[name], self._uncertainties.get(name))
            for name, value in values.items()
        }

    def emergency_stop(self) -> None:
        """Nothing moves."""


@dataclass(frozen=True, kw_only=True)
class AlpacaProbeOptions(NumberedOptions):
    """Options of driver "alpaca_probe"."""

    temperature_uncertainty: Uncertainty | None = None
    humidity_uncertainty: Uncertainty | None = None
    pressure_uncertainty: Uncertainty | None = None

    def make(self, parts: MakerContext) -> AlpacaProbe:
        return AlpacaProbe(self.at, self.device, {name: getattr(self, f"{name}_uncertainty") for name in QUANTITIES})
