"""A Micro-Manager shutter: in the light path, or on the trigger line of a camera."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

from drivers.clock import Clock, SystemClock
from drivers.errors import MoveFailed, Rejected
from drivers.interfaces import Condition, Identity, ShutterTimes
from drivers.making import MakerContext
from drivers.micromanager.core import SHUTTER, Core, CoreOptions, Label, check_device, identity_text, translated_errors
from drivers.options import SHUTTER as PROVIDES_SHUTTER
from drivers.wire.connection import line_condition, not_connected


class MicroManagerShutter:
    """A Shutter of a Micro-Manager configuration; its times are the host's."""

    def __init__(self, core: Core, device: str, *, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._shared, self._label = core, device
        self._core: Any = None
        self._end = threading.Condition()
        self._aborts = 0

    @property
    def address(self) -> str:
        """The device's label and its configuration."""
        return f"{self._label} in {self._shared.config.name}"

    def connect(self) -> Identity:
        """Load the configuration and close the shutter. Raises DeviceError."""
        self.close()
        core = self._shared.join(self)
        try:
            check_device(core, self._label, (SHUTTER,), "shutter", self._shared.config.name)
            self._set(core, False)
        except BaseException:
            self._shared.leave(self)
            raise
        self._core = core
        return Identity(f"Micro-Manager {identity_text(core, self._label)}", core.getVersionInfo(), "", self.address)

    def close(self) -> None:
        """Leave the configuration."""
        self._core = None
        self._shared.leave(self)

    def condition(self) -> Condition:
        """Whether it is connected."""
        return line_condition(self._core is not None)

    def focus(self, pressed: bool) -> None:
        """Not supported: there is no focus contact. Raises Rejected."""
        raise Rejected(f"{self.address} has no focus contact", "focus by hand, or use a STRIG/1 box")

    def fire(self, pulse_s: float, focus_s: float = 0.0) -> ShutterTimes:
        """Open for `pulse_s`. Raises DeviceError."""
        if (core := self._core) is None:
            raise not_connected(self.address)
        aborts = self._aborts
        self.clock.sleep(focus_s)
        begun_s = self.clock.now_s()
        try:
            if self._aborts == aborts:
                self._set(core, True)
            with self._end:
                self.clock.wait(self._end, lambda: self._aborts != aborts, self.clock.now_s() + pulse_s)
        finally:
            self._set(core, False)
        if self._aborts != aborts:
            raise MoveFailed(f"the shot at {self.address} was cut short", "fire again")
        return ShutterTimes(begun_s, self.clock.now_s())

    def _set(self, core: Any, opened: bool) -> None:
        with translated_errors(self.address, "check its power and cable, then connect it again"):
            core.setShutterOpen(self._label, opened)

    def abort(self) -> None:
        """Close now. Raises DeviceError."""
        self._aborts += 1
        with self._end:
            self._end.notify_all()
        if self._core is not None:
            self._set(self._core, False)

    def emergency_stop(self) -> None:
        """Close now, under any condition."""
        self._aborts += 1
        if (core := self._core) is not None:
            with suppress(Exception):
                core.setShutterOpen(self._label, False)
        # a waiting shot wakes by itself at the end of its pulse at the latest; waiting for it here is not allowed
        if self._end.acquire(blocking=False):
            self._end.notify_all()
            self._end.release()


@dataclass(frozen=True, kw_only=True)
class MicroManagerShutterOptions(CoreOptions):
    """Options of driver "micromanager_shutter"."""

    provides: ClassVar[tuple[str, ...]] = (PROVIDES_SHUTTER,)
    device: Label

    def make(self, parts: MakerContext) -> MicroManagerShutter:
        """The shutter."""
        return MicroManagerShutter(self.core(parts), self.device, clock=parts.clock)
