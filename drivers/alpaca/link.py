"""The way to an Alpaca server: the ASCOM Initiative's client (alpyca) for what is asked; for the stop a way past it.

The client sends one request at a time, whatever device it is for: behind one that is not answered, a stop would wait
for its deadline, five seconds. So the stop goes over a connection of its own.
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
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import numpy as np
import numpy.typing as npt

from drivers.errors import BadConfiguration, LineLost, NoAnswer, Rejected
from drivers.interfaces import Identity
from drivers.wire.connection import not_connected

SHOUT_S, SHOUTS = 10.0, 3
"""How long a stop waits for its server's answer, and how often it is sent; whoever stops does not wait for it. A server
that is slow may drop the request of a client that has hung up.
"""
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
ELEMENTS = {1: "<i2", 2: "<i4", 6: "u1", 8: "<u2", 9: "<u4"}
"""Types of whole numbers that an image is sent as, by the standard's numbers."""
NOT_NOW = "0x40b"
"""The code of what a device may do at other times."""
Levels = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True)
class AlpacaServer:
    """A server: "192.168.1.20:11111", and the variable of the environment that holds its password, "" for none.

    What is configured is kept with every session: a password stands in the environment only.
    """

    address: str
    password_variable: str = ""

    def password(self) -> str:
        """The password, "" for none. Raises BadConfiguration."""
        name = self.password_variable
        if name and not os.environ.get(name):
            told = f"{name} in the environment is to hold the password of {self.address}, and it is not set"
            raise BadConfiguration(told, f"set it before the program is started: export {name}=...")
        return os.environ[name] if name else ""


class AlpacaLink:
    """One device of an Alpaca server: "focuser", "camera" or "switch", by its number from 0."""

    def __init__(self, server: AlpacaServer, kind: str, number: int) -> None:
        self._server, self.kind, self.number = server, kind, number
        parts = urlsplit(f"http://{server.address}")
        self._host, self._port = parts.hostname or "", parts.port or 80
        self._headers: dict[str, str] = {}
        self._device: Any = None

    @property
    def address(self) -> str:
        """Device and server."""
        return f"{self.kind} {self.number} at {self._host}:{self._port}"

    @property
    def is_open(self) -> bool:
        """Whether it was connected."""
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
        with self.asked():
            device.Connected = True
            name, version = str(device.Name), str(device.DriverVersion)
        self._device = device
        return Identity(f"Alpaca {name}", version, "", self.address)

    def close(self) -> None:
        """Leave it; it stays connected, as other programs may use it."""
        self._device = None

    @contextmanager
    def asked(self) -> Iterator[None]:
        """Within, what the client raises becomes an error of ours."""
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
            raise Rejected(f"{self.address}: {error.message}", "look at its server", hex(error.number)) from error
        except (ValueError, KeyError) as error:
            raise Rejected(
                f"{self.address} does not answer as Alpaca does: {error}", "check address and port"
            ) from error

    def _unanswered(self, status: int, message: str) -> Rejected | BadConfiguration:
        if status in (401, 403):
            remedy = 'write server = "any:TOKEN@host:port" with its password or token'
            return BadConfiguration(f"{self.address} wants a password, and another or none came", remedy)
        return Rejected(
            f"{self.address} refused the request: {message[:200]}", "check the device's number", str(status)
        )

    # --- past the client

    def shout(self, member: str, form: Mapping[str, str] | None = None) -> None:
        """Call a member now, waiting for no request that is under way, until it is answered; never raises."""
        for _ in range(SHOUTS):
            with suppress(OSError, HTTPException, ValueError):
                self._ask("PUT", member, urlencode(form or {}), SHOUT_S)
                return

    def image(self, timeout_s: float) -> Levels:
        """The image (rows, columns) of a camera. Raises DeviceError.

        The client's own way to it has no deadline.
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
        """Content type and body of an answer."""
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
    """An image (rows, columns) of the bytes of an answer: ImageBytes, version 1, or JSON. Raises ValueError."""
    if BYTES not in kind:
        told = json.loads(data)
        if told.get("ErrorNumber"):
            raise ValueError(told.get("ErrorMessage") or f"error {told['ErrorNumber']:#x}")
        columns = np.array(told["Value"])
        if columns.ndim != 2 or not np.issubdtype(columns.dtype, np.integer):
            raise ValueError(f"one plane of whole numbers is needed, and {columns.ndim} dimensions came")
        return columns.T
    _, error, _, _, start, _, sent, rank, width, height, _ = HEADER.unpack_from(data)
    if error:
        raise ValueError(data[start:].decode("utf-8", "replace") or f"error {error:#x}")
    if rank != 2 or sent not in ELEMENTS:
        raise ValueError(f"one plane of whole numbers is needed; {rank} dimensions of type {sent} came")
    return np.frombuffer(data, ELEMENTS[sent], width * height, start).reshape(width, height).T


def _client(address: str, kind: str, number: int) -> Any:
    """The client's device. Raises BadConfiguration where it is not installed."""
    try:
        from alpaca import camera, focuser, switch
    except ImportError as error:
        remedy = "install it: pip install 'calibration-station[alpaca]'"
        raise BadConfiguration("alpyca is not installed", remedy) from error
    classes = {"camera": camera.Camera, "focuser": focuser.Focuser, "switch": switch.Switch}
    return classes[kind](address, number)
