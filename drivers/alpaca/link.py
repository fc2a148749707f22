"""The connection to an Alpaca server: the ASCOM Initiative's client (alpyca) for requests, a second path for stops.

The client sends one request at a time, whatever device it is for. A stop behind an unanswered request would wait for
that request's deadline, five seconds; stops therefore use a connection of their own.
"""

from __future__ import annotations

import base64
import json
import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from typing import Annotated, Any
from urllib.parse import quote, urlencode, urlsplit

import numpy as np
import numpy.typing as npt

from drivers.errors import BadConfiguration, Held, LineLost, NoAnswer, Rejected
from drivers.interfaces import Identity
from drivers.making import DriverOptions
from drivers.options import Count, option
from drivers.wire.connection import not_connected

PREEMPT_S, PREEMPT_TRIES = 10.0, 3
"""How long a stop waits for its server's answer, and how often it is sent; the caller does not wait for it. A slow
server may drop the request of a client that has disconnected.
"""
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
ELEMENTS = {1: "<i2", 2: "<i4", 6: "u1", 8: "<u2", 9: "<u4"}
"""Integer types in which an image is transmitted, by the standard's numbers."""
NOT_NOW = "0x40b"
"""Error code of an operation that is not possible at this moment."""
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
        self._device: Any = None
        self.can_resume = False

    @property
    def address(self) -> str:
        """Device and server."""
        return f"{self.kind} {self.number} at {self._host}:{self._port}"

    @property
    def is_open(self) -> bool:
        """Whether it is connected."""
        return self._device is not None

    @property
    def device(self) -> Any:
        """The client's device. Raises LineLost."""
        if self._device is None:
            raise not_connected(self.address)
        return self._device

    def open(self) -> Identity:
        """Connect the device. Raises DeviceError."""
        password = self._server.password()
        key = base64.b64encode(f"any:{password}".encode()).decode()
        self._headers = {"Authorization": f"Basic {key}"} if password else {}
        login = f"any:{quote(password, safe='')}@" if password else ""
        device = _client(login + self._server.address, self.kind, self.number)
        with self.translated_errors():
            device.Connected = True
            name, version = str(device.Name), str(device.DriverVersion)
        self._device = device
        with suppress(Rejected), self.translated_errors():
            self.can_resume = RESUME in device.SupportedActions
        return Identity(f"Alpaca {name}", version, "", self.address)

    def close(self) -> None:
        """Disconnect here; the device stays connected, as other programs may use it."""
        self._device = None

    @contextmanager
    def translated_errors(self) -> Iterator[None]:
        """Context that converts the client's exceptions into device errors."""
        from alpaca import exceptions
        from requests import exceptions as lost

        try:
            yield
        except lost.Timeout as error:
            raise NoAnswer(f"{self.address} did not answer in time", "look at its server") from error
        except lost.RequestException as error:
            raise LineLost(f"{self.address} cannot be reached", "start its server, check address and port") from error
        except exceptions.AlpacaRequestException as error:
            raise self._unanswered(error.number, error.message) from error
        except exceptions.NotConnectedException as error:
            raise LineLost(f"{self.address}: {error.message}", "connect it again") from error
        except exceptions.InvalidValueException as error:
            raise Rejected(f"{self.address}: {error.message}", "give another value", "0x401") from error
        except exceptions.NotImplementedException as error:
            raise Rejected(f"{self.address}: {error.message}", "use a device that has it", "0x400") from error
        except exceptions.InvalidOperationException as error:
            raise Rejected(f"{self.address}: {error.message}", "do what it says, then repeat", NOT_NOW) from error
        except (
            exceptions.ActionNotImplementedException, exceptions.ValueNotSetException, exceptions.DriverException,
        ) as error:  # fmt: skip
            if error.number == HELD and self.can_resume:
                raise Held(f"{self.address}: {error.message}", "end the pause there, or try again") from error
            raise Rejected(f"{self.address}: {error.message}", "look at its server", hex(error.number)) from error
        except (ValueError, KeyError) as error:
            raise Rejected(
                f"{self.address} does not answer as an Alpaca server does: {error}", "check address and port"
            ) from error

    def _unanswered(self, status: int, message: str) -> Rejected | BadConfiguration:
        if status in (401, 403):
            remedy = 'write server = "any:TOKEN@host:port" with its password or token'
            return BadConfiguration(f"{self.address} requires a password, and none or a wrong one was sent", remedy)
        return Rejected(
            f"{self.address} refused the request: {message[:200]}", "check the device's number", str(status)
        )

    # --- requests outside the client

    def preempt(self, member: str, form: Mapping[str, str] | None = None) -> None:
        """Call a member at once, not behind pending requests, and retry until it is answered; never raises."""
        for _ in range(PREEMPT_TRIES):
            with suppress(OSError, HTTPException, ValueError):
                self._ask("PUT", member, urlencode(form or {}), PREEMPT_S)
                return

    def image(self, timeout_s: float) -> Levels:
        """The image (rows, columns) of a camera. Raises DeviceError.

        The client's own download has no deadline.
        """
        try:
            kind, data = self._ask("GET", "imagearray", None, timeout_s)
        except TimeoutError as error:
            raise NoAnswer(f"{self.address} sent no image within {timeout_s:g} s", "look at its server") from error
        except (OSError, HTTPException) as error:
            raise LineLost(f"{self.address} cannot be reached", "start its server, check address and port") from error
        try:
            return read_image(kind, data)
        except (ValueError, struct.error, KeyError, TypeError) as error:
            raise Rejected(f"{self.address} sent no image: {error}", "look at its server") from error

    def _ask(self, method: str, member: str, form: str | None, timeout_s: float) -> tuple[str, bytes]:
        """Content type and body of the reply."""
        connection = HTTPConnection(self._host, self._port, timeout=timeout_s)
        headers = {**self._headers, "Accept": f"{BYTES}, application/json"}
        if form is not None:
            headers["Content-Type"] = "application/x-www-form-urlencoded"
        try:
            connection.request(method, f"/api/v1/{self.kind}/{self.number}/{member}", form, headers)
            reply = connection.getresponse()
            return reply.getheader("content-type") or "", reply.read()
        finally:
            connection.close()


def read_image(kind: str, data: bytes) -> Levels:
    """Decode an image (rows, columns) from ImageBytes, version 1, or JSON. Raises ValueError."""
    if BYTES not in kind:
        reply = json.loads(data)
        if reply.get("ErrorNumber"):
            raise ValueError(reply.get("ErrorMessage") or f"error {reply['ErrorNumber']:#x}")
        columns = np.array(reply["Value"])
        if columns.ndim != 2 or not np.issubdtype(columns.dtype, np.integer):
            raise ValueError(f"the image must be one plane of integers; received {columns.ndim} dimensions")
        return columns.T
    _, error, _, _, start, _, sent, rank, width, height, _ = HEADER.unpack_from(data)
    if error:
        raise ValueError(data[start:].decode("utf-8", "replace") or f"error {error:#x}")
    if rank != 2 or sent not in ELEMENTS:
        raise ValueError(f"the image must be one plane of integers; received {rank} dimensions of type {sent}")
    return np.frombuffer(data, ELEMENTS[sent], width * height, start).reshape(width, height).T


def _client(address: str, kind: str, number: int) -> Any:
    """The client's device. Raises BadConfiguration where it is not installed."""
    try:
        from alpaca import camera, focuser, observingconditions, switch
    except ImportError as error:
        remedy = "install it: pip install 'calibration-station[alpaca]'"
        raise BadConfiguration("alpyca is not installed", remedy) from error
    classes = {
        "camera": camera.Camera, "focuser": focuser.Focuser, "switch": switch.Switch,
        "observingconditions": observingconditions.ObservingConditions,
    }  # fmt: skip
    return classes[kind](address, number)


@dataclass(frozen=True, kw_only=True)
class ServerOptions(DriverOptions):
    """A server."""

    server: Annotated[
        str,
        option(
            '"192.168.1.20:11111"', "address and port of a server in quotes",
            pattern=r"^(\[[^\]\s]+\]|[^:@\s/]+):\d{1,5}\Z",
        ),
    ]  # fmt: skip
    password_variable: Annotated[
        str, option('"STATION_TOKEN"', "the name of a variable of the environment", pattern=r"^[A-Za-z_]\w*\Z")
    ] = ""

    @property
    def at(self) -> AlpacaAddress:
        """Its address."""
        return AlpacaAddress(self.server, self.password_variable)


@dataclass(frozen=True, kw_only=True)
class NumberedOptions(ServerOptions):
    """A device of a server, by its number."""

    device: Count = 0
