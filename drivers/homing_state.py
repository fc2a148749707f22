"""Whether a stage's position is trusted: homing establishes trust; reset, alarm and emergency stop revoke it."""

from __future__ import annotations

from drivers.errors import DeviceError, NotHomed
from drivers.interfaces import Condition

HOME = "home the stage"
UNHOMED = NotHomed("the stage is not homed", HOME)


class Trust:
    """The reason not to move, if any; thread-safe.

    `epoch` counts the events that revoked trust, so that a homing interrupted by an alarm establishes none.
    """

    def __init__(self) -> None:
        self.why: DeviceError | None = UNHOMED
        self.epoch = 0
        self.preemptions = 0

    def lose(self, error: DeviceError) -> None:
        """Revoke trust; the first reason is kept."""
        self.epoch += 1
        if self.why is None or self.why is UNHOMED:
            self.why = error

    def preempt(self, error: DeviceError) -> None:
        """Record an emergency stop, which replaces every other reason."""
        self.preemptions += 1
        self.why = error
        self.epoch += 1

    def begin(self, preemptions: int) -> int:
        """The epoch in which homing begins. Raises an emergency stop later than the count `preemptions`."""
        before, self.why = self.why, UNHOMED
        if self.preemptions != preemptions:
            self.why = before
            self.require()
        return self.epoch

    def give(self, epoch: int) -> None:
        """Establish trust if nothing has happened since `epoch`. Raises what has."""
        self.undisturbed(epoch)
        self.why = None

    def undisturbed(self, epoch: int) -> None:
        """Raises what has happened since `epoch`."""
        if self.epoch != epoch:
            raise self.why or UNHOMED

    def refusal(self, is_open: bool) -> Condition | None:
        """The condition of a stage that may not move, None if it may; `is_open`: whether it is connected."""
        if not is_open:
            return Condition("not connected", False, "connect it")
        return None if self.why is None else Condition(self.why.reason, False, self.why.remedy)

    def require(self) -> None:
        """Raises the reason not to move."""
        if self.why is not None:
            raise self.why
