"""Common members of all Alpaca devices: names, versions, connections; and dispatch of members by name."""

import threading
import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import Any

from drivers.interfaces import Device
from station.common.versions import software
from station.service.alpaca.clients import ConnectedClients
from station.service.alpaca.protocol import (
    ACTION_NOT_IMPLEMENTED,
    INVALID_OPERATION,
    NOT_CONNECTED,
    NOT_IMPLEMENTED,
    AlpacaError,
    BadRequest,
    Parameters,
    as_alpaca,
)
from station.service.bench_state import ServedBench

Member = Callable[[Parameters], Any]
ALWAYS = frozenset((
    "connect", "connected", "connecting", "description", "disconnect", "driverinfo", "driverversion",
    "interfaceversion", "name", "supportedactions",
))  # fmt: skip
"""Members that answer before the device is connected."""
STOP = "EmergencyStop"
STOPS = frozenset(("halt", "abortexposure"))
POLLS = 2
"""Concurrent requests to one device; others wait."""
HALT_S = 0.02
"""How long a halt is awaited: its bytes are on the line by then; `IsMoving` reports whether the axis stands."""
AGAIN_S = 0.1
"""After this time a halt is repeated while its operation goes on: the order may have come after the first halt."""
HALTED_S = 3.0
"""Time for a driver to report the end of its move after the axis stands. Clients wait five seconds."""
NOT_AT_ALL: Mapping[str, Member] = {}


def not_implemented(what: str) -> AlpacaError:
    """The error for a member that this device does not have."""
    return AlpacaError(NOT_IMPLEMENTED, f"{what} is not implemented: this device has none")


def absent(*names: str) -> dict[str, Member]:
    """Members of the standard that this device does not have."""

    def refusing(name: str) -> Member:
        def refuse(given: Parameters) -> Any:
            raise not_implemented(name)

        return refuse

    return {name: refusing(name) for name in names}


def constant(value: Any) -> Member:
    """A member with a constant value."""
    return lambda given: value


def is_stop(member: str, given: Parameters) -> bool:
    """Whether this call stops something: it then waits for no other and is never refused."""
    action = given.given.get("Action", "") if member == "action" else ""
    return member in STOPS or action.lower() == STOP.lower()


class AlpacaDevice:
    """A device of the bench as an Alpaca device.

    kind, number : "camera", "focuser", "switch", "observingconditions"; counted from 0 in its kind
    devices : devices of the bench that must be connected, by name
    """

    interface_version = 4
    type_name = ""
    """The standard's name of its kind, where it is not the kind itself with a capital."""
    actions: Mapping[str, Callable[[str], str]] = {}

    def __init__(self, served: ServedBench, kind: str, number: int, name: str, devices: Mapping[str, Device]) -> None:
        self.served, self.kind, self.number, self.name = served, kind, number, name
        self.devices = devices
        self.clients = ConnectedClients(self._connect)
        self.polls = served.threads(POLLS, f"{kind} {number}")
        self.gets: dict[str, Member] = {
            "connected": lambda given: given.client() in self.clients,
            "connecting": lambda given: self.clients.connecting(given.client()),
            "description": constant(f"{self.name} of the calibration station's bench"),
            "devicestate": lambda given: [{"Name": name, "Value": value} for name, value in self.state().items()],
            "driverinfo": constant("calibration station, an Alpaca server for the devices of its bench"),
            "driverversion": constant(software()["version"] or "0"),
            "interfaceversion": constant(self.interface_version),
            "name": constant(self.name),
            "supportedactions": lambda given: [*self.actions, STOP],
            **self.readable(),
        }
        self.puts: dict[str, Member] = {
            "action": self._act,
            "connect": lambda given: self.clients.begin(given.client()),
            "connected": self._set_connected,
            "disconnect": lambda given: self.clients.remove(given.client()),
            **absent("commandblind", "commandbool", "commandstring"),
            **self.writable(),
        }

    def _set_connected(self, given: Parameters) -> None:
        change = self.clients.add if given.flag("Connected") else self.clients.remove
        change(given.client())

    def readable(self) -> Mapping[str, Member]:
        """Members of its kind that are read."""
        return NOT_AT_ALL

    def writable(self) -> Mapping[str, Member]:
        """Members of its kind that are written or called."""
        return NOT_AT_ALL

    def state(self) -> Mapping[str, Any]:
        """The operational state by members' names; unknown values are omitted."""
        return {}

    @property
    def unique_id(self) -> str:
        """Identical in every run of a bench with these addresses."""
        addresses = "/".join(device.address for device in self.devices.values())
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"{addresses}/{self.kind}/{self.name}"))

    def answer(self, method: str, member: str, given: Parameters) -> Any:
        """The value of a member. Raises AlpacaError, BadRequest, and errors of the bench."""
        table = self.gets if method == "GET" else self.puts
        if member not in table:
            raise BadRequest(f"a {self.kind} has no {method} of {member!r}")
        if member not in ALWAYS and not self.clients and not (method == "PUT" and is_stop(member, given)):
            raise AlpacaError(NOT_CONNECTED, f"{self.name} is not connected; put Connected = True first")
        return table[member](given)

    def _act(self, given: Parameters) -> str:
        if is_stop("action", given):
            self.served.stop()
            return ""
        name, words = given.text("Action"), given.text("Parameters")
        known = {one.lower(): action for one, action in self.actions.items()}
        if name.lower() not in known:
            offered = ", ".join((*self.actions, STOP))
            raise AlpacaError(ACTION_NOT_IMPLEMENTED, f"there is no action {name!r}; there are {offered}")
        return known[name.lower()](words)

    def _connect(self) -> None:
        """Connect missing devices. Raises InUse, DeviceError."""
        missing = [one for one in self.devices.values() if one.condition().word == "not connected"]
        if missing:
            with self.served.tenancy.held(f"the connecting of {self.name}"):
                for device in missing:
                    device.connect()


class Task:
    """An asynchronous operation of a device: one at a time; its error is reported to the clients that poll it."""

    def __init__(self, served: ServedBench) -> None:
        self._served = served
        self._thread: threading.Thread | None = None
        self.failure: Exception | None = None
        self.halted = False
        """Whether the last operation was ended on request."""
        self._halting: Future[None] | None = None

    def halt(self, stop: Callable[[], None]) -> None:
        """End the operation by `stop`, which continues in the background after HALT_S. Raises what it does."""
        self.halted = True
        self._halting = self._served.stopper.submit(self._stop_until_ended, stop)
        with suppress(TimeoutError):
            self._halting.result(HALT_S)

    def _stop_until_ended(self, stop: Callable[[], None]) -> None:
        thread = self._thread
        for _ in range(round(HALTED_S / AGAIN_S)):
            stop()
            if thread is None:
                return
            thread.join(AGAIN_S)
            if not thread.is_alive():
                return

    @property
    def running(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def check(self) -> None:
        """Raises the error that ended the last one."""
        if not self.running and self.failure is not None:
            raise as_alpaca(self.failure)

    def begin(self, what: str, work: Callable[[], None]) -> None:
        """Start an operation in the background, after one that was halted. Raises InUse during another one."""
        if self.halted and self._thread is not None:
            self._thread.join(HALTED_S)
        if self._halting is not None:
            wait((self._halting,), HALTED_S)
        stops = self._served.bench.stops if self._served.bench is not None else 0

        known = threading.Event()

        def run() -> None:
            known.wait()  # so that whoever sees its effects can halt it
            try:
                if self._served.bench is not None:
                    self._served.bench.check_stops(stops)
                work()
            except Exception as error:  # reported to the clients that poll
                self.failure = None if self.halted else error

        self.failure, self.halted = None, False
        self._thread = self._served.tenancy.begin(what, run)
        known.set()


def refuse_operation(message: str) -> AlpacaError:
    """The error for an operation that is not possible at present."""
    return AlpacaError(INVALID_OPERATION, message)
