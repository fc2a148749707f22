"""One Micro-Manager configuration, loaded while any of its devices is connected, and shared by them."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from drivers.errors import BadConfiguration, LineLost, Rejected
from drivers.making import DriverOptions, MakerContext
from drivers.options import text


class Core:
    """The core with the devices of a configuration file; `adapters` is the folder of the device adapters.

    Calls may come from any thread: the core serialises them per adapter. A sequence of calls, such as selecting a
    camera and reading it, holds `in_a_row`.
    """

    def __init__(self, config: Path, adapters: Path | None = None) -> None:
        self.config, self.adapters = config, adapters or config.parent
        self.in_a_row = threading.RLock()
        self._users: set[int] = set()
        self._core: Any = None

    def join(self, user: object) -> Any:
        """The core with all devices loaded. Raises BadConfiguration, LineLost."""
        with self.in_a_row:
            if self._core is None:
                self._core = self._load()
            self._users.add(id(user))
            return self._core

    def leave(self, user: object) -> None:
        """Unload all devices when the last user leaves."""
        with self.in_a_row:
            self._users.discard(id(user))
            if self._users or self._core is None:
                return
            core, self._core = self._core, None
            with suppress(RuntimeError):  # a device that is gone raises on unloading
                core.unloadAllDevices()

    def _load(self) -> Any:
        try:
            import pymmcore
        except ImportError as error:
            raise BadConfiguration(
                "pymmcore is not installed", "install it: pip install 'calibration-station[micromanager]'"
            ) from error
        if not self.config.is_file():
            raise BadConfiguration(f"{self.config} does not exist", "write it with Micro-Manager's hardware wizard")
        core = pymmcore.CMMCore()
        core.setDeviceAdapterSearchPaths([str(self.adapters)])
        try:
            core.loadSystemConfiguration(str(self.config))
        except (RuntimeError, OSError) as error:
            with suppress(RuntimeError):
                core.unloadAllDevices()
            raise LineLost(
                f"{self.config.name}: {adapter_message(error)}",
                f"switch the devices on; adapters are searched for in {self.adapters} ({core.getAPIVersionInfo()})",
            ) from error
        return core


@contextmanager
def translated_errors(address: str, remedy: str) -> Iterator[None]:
    """Context that converts the core's exceptions to Rejected."""
    try:
        yield
    except RuntimeError as error:
        raise Rejected(f"{address}: {adapter_message(error)}", remedy) from error


def adapter_message(error: Exception) -> str:
    """An adapter's error message on one line."""
    return " ".join(str(error).split())


def check_device(core: Any, label: str, kinds: tuple[int, ...], what: str, config: str) -> None:
    """Raises BadConfiguration unless the configuration has such a device; `kinds` are Micro-Manager's type numbers."""
    labels = core.getLoadedDevices()
    good = [one for one in labels if int(core.getDeviceType(one)) in kinds]
    if label not in good:
        state = "has another type" if label in labels else "is not in it"
        there = ", ".join(good) or "it has none"
        raise BadConfiguration(f"{config}: {label} {state}; a {what} is required", f"name one of its {what}s: {there}")


CAMERA, SHUTTER, STAGE, XY_STAGE = 2, 3, 5, 6
"""Micro-Manager's device type numbers (MMDeviceConstants.h)."""


def identity_text(core: Any, label: str) -> str:
    """Adapter library and name of a device."""
    return f"{core.getDeviceLibrary(label)} {core.getDeviceName(label)}"


Label = Annotated[str, text('"Camera"', "a device's label in that configuration in quotes")]


@dataclass(frozen=True, kw_only=True)
class CoreOptions(DriverOptions):
    """A Micro-Manager configuration, whose devices share a core."""

    config: Annotated[str, text('"microscope.cfg"', "the name of a configuration file in quotes")]
    adapters: (
        Annotated[str, text('"/opt/micro-manager"', "the folder of Micro-Manager's adapters in quotes")] | None
    ) = None

    def core(self, parts: MakerContext) -> Core:
        """The core of the configuration file."""
        path = (parts.folder / self.config).resolve()
        adapters = None if self.adapters is None else parts.folder / self.adapters
        core: Core = parts.shared.setdefault(path, Core(path, adapters))
        return core
