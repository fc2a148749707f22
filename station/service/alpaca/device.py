"""What every Alpaca device has: names, versions, being connected; and members by their names."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from drivers.interfaces import Device
from station.service.alpaca.errors import (
    ACTION_NOT_IMPLEMENTED,
    INVALID_OPERATION,
    NOT_CONNECTED,
    NOT_IMPLEMENTED,
    AlpacaError,
    BadRequest,
    as_alpaca,
)
from station.service.alpaca.parameters import Parameters
from station.service.bench_state import ServedBench

Member = Callable[[Parameters], Any]
ALWAYS = frozenset((
    "connect", "connected", "connecting", "description", "disconnect", "driverinfo", "driverversion",
    "interfaceversion", "name", "supportedactions",
))  # fmt: skip
"""Members that answer before the device is connected."""
STOP = "EmergencyStop"
HALTED_S = 3.0
"""How long a driver may take to tell that its move has ended, after the axis stands. Clients wait five seconds."""
NOT_AT_ALL: Mapping[str, Member] = {}


def not_implemented(what: str) -> AlpacaError:
    """This device has not got that."""
    return AlpacaError(NOT_IMPLEMENTED, f"{what} is not implemented: this device has none")


def absent(*names: str) -> dict[str, Member]:
    """Members that the standard has and this device has not."""

    def refusing(name: str) -> Member:
        def refuse(given: Parameters) -> Any:
            raise not_implemented(name)

        return refuse

    return {name: refusing(name) for name in names}


def constant(value: Any) -> Member:
    """A member that always answers this."""
    return lambda given: value


class AlpacaDevice:
    """A device of the bench as Alpaca knows it.

    Parameters
    ----------
    kind, number : "camera", "focuser", "switch"; counted from 0 in its kind
    devices : those of the bench that must answer, by name
    """

    interface_version = 4
    actions: Mapping[str, Callable[[str], str]] = {}

    def __init__(self, served: ServedBench, kind: str, number: int, name: str, devices: Mapping[str, Device]) -> None:
        self.served, self.kind, self.number, self.name = served, kind, number, name
        self.devices = devices
        self._connected = False
        self._connecting: threading.Thread | None = None
        self._failure: Exception | None = None
        self.gets = {**self._common_gets(), **self.readable()}
        self.puts = {**self._common_puts(), **self.writable()}

    def readable(self) -> Mapping[str, Member]:
        """The members of its kind that are read."""
        return NOT_AT_ALL

    def writable(self) -> Mapping[str, Member]:
        """The members of its kind that are written or called."""
        return NOT_AT_ALL

    def state(self) -> Mapping[str, Any]:
        """The operational state, by the members' names; what cannot be told is left out."""
        return {}

    @property
    def unique_id(self) -> str:
        """The same in every run of a bench with these addresses."""
        addresses = "/".join(device.address for device in self.devices.values())
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"{addresses}/{self.kind}/{self.name}"))

    def answer(self, method: str, member: str, given: Parameters) -> Any:
        """The value of a member. Raises AlpacaError, BadRequest, and what the bench raises."""
        table = self.gets if method == "GET" else self.puts
        if member not in table:
            raise BadRequest(f"a {self.kind} has no {method} of {member!r}")
        if member not in ALWAYS and not self._connected:
            raise AlpacaError(NOT_CONNECTED, f"{self.name} is not connected; put Connected = True first")
        return table[member](given)

    def _common_gets(self) -> dict[str, Member]:
        return {
            "connected": lambda given: self._connected,
            "connecting": lambda given: self._is_connecting(),
            "description": constant(f"{self.name} of the calibration station's bench"),
            "devicestate": lambda given: [{"Name": name, "Value": value} for name, value in self.state().items()],
            "driverinfo": constant("calibration station, an Alpaca server for the devices of its bench"),
            "driverversion": constant(program_version()),
            "interfaceversion": constant(self.interface_version),
            "name": constant(self.name),
            "supportedactions": lambda given: [*self.actions, STOP],
        }

    def _common_puts(self) -> dict[str, Member]:
        return {
            "action": lambda given: self._act(given.text("Action"), given.text("Parameters")),
            "connect": lambda given: self._begin_connecting(),
            "connected": lambda given: self._set_connected(given.flag("Connected")),
            "disconnect": lambda given: self._set_connected(False),
            **absent("commandblind", "commandbool", "commandstring"),
        }

    def _act(self, name: str, words: str) -> str:
        known = {one.lower(): action for one, action in self.actions.items()}
        if name.lower() == STOP.lower():
            self.served.stop()
            return ""
        if name.lower() not in known:
            offered = ", ".join((*self.actions, STOP))
            raise AlpacaError(ACTION_NOT_IMPLEMENTED, f"there is no action {name!r}; there are {offered}")
        return known[name.lower()](words)

    # --- being connected: the bench keeps its lines; a client's word only says whether it may use them

    def _set_connected(self, connected: bool) -> None:
        if connected:
            self._connect()
        self._connected = connected

    def _connect(self) -> None:
        """Connect what is not. Raises InUse, DeviceError."""
        missing = [one for one in self.devices.values() if one.condition().word == "not connected"]
        if missing:
            with self.served.tenancy.held(f"the connecting of {self.name}"):
                for device in missing:
                    device.connect()

    def _begin_connecting(self) -> None:
        if self._connecting is not None and self._connecting.is_alive():
            return
        self._failure = None
        self._connecting = threading.Thread(target=self._connect_beside, name="connect", daemon=True)
        self._connecting.start()

    def _connect_beside(self) -> None:
        try:
            self._set_connected(True)
        except Exception as error:  # told to whoever asks whether it is connecting
            self._failure = error

    def _is_connecting(self) -> bool:
        if self._connecting is not None and self._connecting.is_alive():
            return True
        failure, self._failure = self._failure, None
        if failure is not None:
            raise as_alpaca(failure)
        return False


class Task:
    """What a device does beside its answers: one thing at a time, whose failure is told to whoever asks how it went."""

    def __init__(self, served: ServedBench) -> None:
        self._served = served
        self._thread: threading.Thread | None = None
        self.failure: Exception | None = None
        self._halted = False

    def halted(self) -> None:
        """Whoever asked for what is under way has it ended: that is no failure."""
        self._halted = True

    @property
    def was_halted(self) -> bool:
        """Whether what was begun last was ended by who asked for it."""
        return self._halted

    @property
    def running(self) -> bool:
        """Whether it goes on."""
        return self._thread is not None and self._thread.is_alive()

    def check(self) -> None:
        """Raises what ended the last one."""
        if not self.running and self.failure is not None:
            raise as_alpaca(self.failure)

    def begin(self, what: str, work: Callable[[], None]) -> None:
        """Do this beside; nothing begins while something goes on, but what was halted is waited for. Raises InUse."""
        if self._halted and self._thread is not None:
            self._thread.join(HALTED_S)
        stops = self._served.bench.stops if self._served.bench is not None else 0

        def run() -> None:
            try:
                if self._served.bench is not None:
                    self._served.bench.check_stops(stops)
                work()
            except Exception as error:  # told to whoever asks how it went
                self.failure = None if self._halted else error

        self.failure, self._halted = None, False
        self._thread = self._served.tenancy.begin(what, run)


def program_version() -> str:
    """Of this program."""
    try:
        return version("calibration-station")
    except PackageNotFoundError:
        return "0"


def refuse_operation(message: str) -> AlpacaError:
    """Not now."""
    return AlpacaError(INVALID_OPERATION, message)
