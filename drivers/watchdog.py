"""A watchdog for motors on a STRIG/3 box: it keeps their drivers enabled only while this program sends heartbeats.

A program that is suspended, has crashed, or gets no processor time cannot stop an axis. The box then releases
the motors: after 100 ms while an axis moves, after a second while all rest, as computations may hold Python's lock for
longer than 100 ms. The protocol is described in `firmware/STRIG.md`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from threading import Lock, Thread
from typing import Annotated, Protocol

from drivers.errors import DeviceError, EmergencyStopped, NotHomed
from drivers.making import DriverOptions, MakerContext
from drivers.move_checks import HOME
from drivers.options import ENABLED_STAGE, STRIG_BOX, device, distinct, option
from drivers.shutter import BoxDevice, StrigShutter

HEARTBEAT_S = 0.025  # interval between heartbeats
MOVING_MS, STANDING_MS = 100, 1000  # deadlines of the next heartbeat
RELEASE = "RELEASE"
LATE = "no heartbeat of this program came in time"
END_S = 1.0  # how long closing waits for the last heartbeat to be written
Work = Callable[[], None]


class Released(Protocol):
    """A stage whose motor drivers are enabled by the watchdog."""

    power: Callable[[], AbstractContextManager[None]]
    """Context of a move: the motors are kept enabled within. Raises DeviceError."""

    def lose_position(self, error: DeviceError) -> None:
        """Stop, and refuse to move with `error` until homed; never raises."""


def in_background(work: Work) -> Thread:
    """Run in a new thread."""
    thread = Thread(target=work, name="heartbeat", daemon=True)
    thread.start()
    return thread


class StrigWatchdog(BoxDevice):
    """The motor enable output of a box connected by a StrigShutter.

    The motors are enabled when one of the stages homes, and stay so until `close`. After a release by the box,
    every stage has lost its position, and homing enables them again.
    """

    what, since = "watchdog", 3

    def __init__(
        self, box: StrigShutter, stages: Sequence[Released], *, begin: Callable[[Work], Thread] = in_background
    ) -> None:
        super().__init__(box)
        self._stages, self._begin = tuple(stages), begin
        self._lock = Lock()
        self._holding = False
        self._moving = 0
        self._keeper: Thread | None = None
        for stage in self._stages:
            stage.power = self.power

    @property
    def _word(self) -> str:
        return "motors enabled" if self._holding else "motors released"

    @contextmanager
    def power(self) -> Iterator[None]:
        """Context in which a stage may move: the motors are enabled, with the short heartbeat deadline.

        Raises DeviceError.
        """
        with self._lock:
            if not self._holding:
                self._require()
                self._box.command("ENABLE 1")
                self._box.motion.pop(RELEASE, None)  # of an earlier release
                self._holding = True
                self._keeper = self._begin(self._keep)
            self._moving += 1
        try:
            self._beat()
            yield
        finally:
            with self._lock:
                self._moving -= 1

    def _beat(self) -> None:
        with self._lock:  # a heartbeat with the long deadline must not follow the first one of a move
            self._box.beat(MOVING_MS if self._moving else STANDING_MS)

    def _keep(self) -> None:
        """Send heartbeats until `close`, or until the motors are released."""
        while self._holding:
            try:
                self._beat()
                if self._box.wait(lambda: RELEASE in self._box.motion, HEARTBEAT_S):
                    self._lost(LATE)
            except EmergencyStopped:  # it ended the wait; axes need their motors' current to brake
                continue
            except DeviceError as error:  # the box receives no heartbeat either
                self._lost(error.reason)

    def _lost(self, why: str) -> None:
        with self._lock:
            if self._holding:
                self._holding = False
                self._report(NotHomed(f"the watchdog at {self.address} released the motors: {why}", HOME))

    def _report(self, error: DeviceError) -> None:
        for stage in self._stages:
            stage.lose_position(error)

    def emergency_stop(self) -> None:
        """Leave the motors enabled: an axis needs their current to brake and stay."""

    def close(self) -> None:
        """Release the motors; the line belongs to the shutter."""
        with self._lock:
            held, self._holding = self._holding, False
        if not held:
            return
        if self._keeper is not None:
            self._keeper.join(END_S)
        with suppress(DeviceError):
            self._box.command("ENABLE 0")
        self._report(NotHomed(f"the motors were released by closing the watchdog at {self.address}", HOME))


@dataclass(frozen=True, kw_only=True)
class WatchdogOptions(DriverOptions):
    """Options of driver "strig_watchdog"."""

    box: Annotated[str, device(STRIG_BOX, '"shutter"')]
    stages: Annotated[
        tuple[str, ...],
        option('["stage"]', "a list of names of devices in [ ], none twice", holds=distinct, kind=ENABLED_STAGE),
    ]

    def make(self, parts: MakerContext) -> StrigWatchdog:
        return StrigWatchdog(parts.other(self.box), [parts.other(stage) for stage in self.stages])
