"""A VISA resource as a line, by pyvisa: USB-TMC, GPIB and VXI-11 instruments beside serial and TCP ones.

Its replies are read within the request: no thread reads a line on which an instrument speaks only when it is asked.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from drivers.errors import BadConfiguration, Clock, LineLost, NoAnswer, SystemClock
from drivers.interfaces import Parser
from drivers.wire.connection import WRITE_S, Transcript, anything, not_connected

T = TypeVar("T")
VISA = "visa:"  # addresses of resources begin with it: `visa:USB0::0x1313::0x8078::P0012345::INSTR`


class VisaTransport:
    """A Transport of one resource; `library` is pyvisa's name of the VISA library, `@py` that of pyvisa-py."""

    def __init__(
        self, address: str, parser: Callable[[], Parser[str]], *, library: str = "@py", clock: Clock | None = None,
        transcript: Transcript | None = None,
    ) -> None:  # fmt: skip
        self.address = address
        self.clock = clock or SystemClock()
        self.transcript = transcript or Transcript()
        self._new_parser, self._library = parser, library
        self._resource: Any = None
        self._manager: Any = None
        self._turn = threading.RLock()

    @property
    def is_open(self) -> bool:
        return self._resource is not None

    def open(self, listen: Callable[[str, float], None]) -> None:
        """Open the resource. Raises BadConfiguration without pyvisa, LineLost."""
        self.close()
        try:
            import pyvisa
        except ImportError as error:
            remedy = "install it: pip install 'calibration-station[visa]'"
            raise BadConfiguration("pyvisa is not installed", remedy) from error
        self._failures = (pyvisa.errors.Error, OSError, ValueError)
        self._parser = self._new_parser()
        try:
            self._manager = pyvisa.ResourceManager(self._library)
            self._resource = self._manager.open_resource(self.address.removeprefix(VISA))
            if not isinstance(self._resource, pyvisa.resources.MessageBasedResource):
                raise ValueError("it exchanges no messages")
        except self._failures as error:
            self.close()
            remedy = "check cable, name and VISA library; `pyvisa-shell list` names the resources"
            raise LineLost(f"cannot open {self.address}: {error}", remedy) from error

    def close(self) -> None:
        for one in (self._resource, self._manager):
            if one is not None:
                with suppress(Exception):  # it may have gone already
                    one.close()
        self._resource = self._manager = None
        self.transcript.close()

    def request(
        self, data: bytes, answer: Callable[[str], T | None], timeout_s: float, tries: int = 1,
        allowed: Callable[[], None] = anything,
    ) -> T:  # fmt: skip
        """Write, and read until `answer` accepts a line, up to `tries` times. Raises NoAnswer, LineLost."""
        for _ in range(tries):
            with self._turn:
                self.write(data, allowed)
                deadline_s = self.clock.now_s() + timeout_s
                while (left_s := deadline_s - self.clock.now_s()) > 0:
                    value = next((v for line in self._read(left_s) if (v := answer(line)) is not None), None)
                    if value is not None:
                        return value
        raise NoAnswer(f"{self.address} did not answer {data!r} within {timeout_s:g} s", "check power and cable")

    def _read(self, timeout_s: float) -> list[str]:
        """The lines of the next message; none if there is none in time."""
        from pyvisa.constants import StatusCode

        resource = self._there()
        resource.timeout = max(1000 * timeout_s, 1.0)
        try:
            data = bytes(resource.read_raw())
        except self._failures as error:
            if getattr(error, "error_code", None) == StatusCode.error_timeout:
                return []
            self.close()
            raise LineLost(f"{self.address} went away: {error}", "check the cable, connect again") from error
        self.transcript.record(self.clock.now_s(), "<", data)
        return list(self._parser.feed(data))

    def _there(self) -> Any:
        resource = self._resource
        if resource is None:
            raise not_connected(self.address)
        return resource

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait: nothing is heard meanwhile."""
        self.clock.sleep(timeout_s)
        return ready()

    def write(
        self, data: bytes, allowed: Callable[[], None] = anything, *, noted: bool = True, within_s: float = WRITE_S
    ) -> None:
        resource = self._there()
        allowed()
        self.transcript.record(self.clock.now_s(), ">", data)
        try:
            for line in data.splitlines(keepends=True):  # one message each
                resource.write_raw(line)
        except self._failures as error:
            self.close()
            raise LineLost(f"{self.address} went away: {error}", "check the cable, connect again") from error

    def preempt(self, data: bytes, error: Exception) -> None:
        """Instruments have no emergency bytes: a request ends with its reply."""

    def set_lines(self, **lines: bool) -> None:
        """A resource has no modem lines."""
