"""One configuration of Micro-Manager, loaded while any of its devices is connected, and shared by them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from drivers.errors import BadConfiguration, LineLost, Rejected


class Core:
    """The core with the devices of a configuration file; `adapters` is the folder of the device adapters.

    Calls may come from any thread: the core serialises them adapter by adapter. What needs several calls in a row,
    as choosing a camera and reading it, holds `in_a_row`.
    """

    def __init__(self, config: Path, adapters: Path | None = None) -> None:
        self.config, self.adapters = config, adapters or config.parent
        self.in_a_row = threading.RLock()
        self._users: set[int] = set()
        self._core: Any = None

    def join(self, user: object) -> Any:
        """The core, with all devices of the configuration. Raises BadConfiguration, LineLost."""
        with self.in_a_row:
            if self._core is None:
                self._core = self._load()
            self._users.add(id(user))
            return self._core

    def leave(self, user: object) -> None:
        """The last who leaves gives all devices back."""
        with self.in_a_row:
            self._users.discard(id(user))
            if self._users or self._core is None:
                return
            core, self._core = self._core, None
            with suppress(RuntimeError):  # a device that is gone cannot be left politely
                core.unloadAllDevices()

    def _load(self) -> Any:
        try:
            import pymmcore
        except ImportError as error:
            raise BadConfiguration(
                "pymmcore is not installed", "install it: pip install 'calibration-station[micromanager]'"
            ) from error
        if not self.config.is_file():
            raise BadConfiguration(f"there is no {self.config}", "write it with Micro-Manager's hardware wizard")
        core = pymmcore.CMMCore()
        core.setDeviceAdapterSearchPaths([str(self.adapters)])
        try:
            core.loadSystemConfiguration(str(self.config))
        except (RuntimeError, OSError) as error:
            with suppress(RuntimeError):
                core.unloadAllDevices()
            raise LineLost(
                f"{self.config.name}: {said(error)}",
                f"switch the devices on; adapters are looked for in {self.adapters} ({core.getAPIVersionInfo()})",
            ) from error
        return core


@contextmanager
def asked(address: str, remedy: str) -> Iterator[None]:
    """What the core refuses within, as Rejected."""
    try:
        yield
    except RuntimeError as error:
        raise Rejected(f"{address}: {said(error)}", remedy) from error


def said(error: Exception) -> str:
    """An adapter's words on one line."""
    return " ".join(str(error).split())


def check_device(core: Any, label: str, kinds: tuple[int, ...], what: str, config: str) -> None:
    """Raises BadConfiguration unless the configuration has such a device; `kinds` are Micro-Manager's numbers."""
    labels = core.getLoadedDevices()
    good = [one for one in labels if int(core.getDeviceType(one)) in kinds]
    if label not in good:
        told = "is none" if label in labels else "is not in it"
        there = ", ".join(good) or "there is none"
        raise BadConfiguration(f"{config}: {label} {told}, and a {what} is meant", f"name one of its {what}s: {there}")


CAMERA, SHUTTER, STAGE, XY_STAGE = 2, 3, 5, 6
"""Micro-Manager's numbers of its kinds of devices (MMDeviceConstants.h)."""


def identity_words(core: Any, label: str) -> str:
    """Which adapter plays a device."""
    return f"{core.getDeviceLibrary(label)} {core.getDeviceName(label)}"
