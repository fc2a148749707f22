"""Whether a stage's position may be believed: homing gives trust; reset, alarm and emergency stop take it."""

from __future__ import annotations

from drivers.errors import DeviceError, NotHomed
from drivers.interfaces import Condition

HOME = "home the stage"
UNHOMED = NotHomed("the stage is not homed", HOME)


class Trust:
    """The reason not to move, if there is one; safe to be told from any thread.

    `epoch` counts what shook the trust, so that a homing that was overtaken by an alarm gives none.
    """

    def __init__(self) -> None:
        self.why: DeviceError | None = UNHOMED
        self.epoch = 0
        self.shouts = 0

    def lose(self, error: DeviceError) -> None:
        """Believe no more; the first reason stays."""
        self.epoch += 1
        if self.why is None or self.why is UNHOMED:
            self.why = error

    def shout(self, error: DeviceError) -> None:
        """An emergency stop: it replaces every other reason."""
        self.shouts += 1
        self.why = error
        self.epoch += 1

    def begin(self, shouts: int) -> int:
        """The epoch in which homing begins. Raises the emergency stop that came since `shouts` were counted."""
        before, self.why = self.why, UNHOMED
        if self.shouts != shouts:
            self.why = before
            self.require()
        return self.epoch

    def give(self, epoch: int) -> None:
        """Believe, if nothing has happened since `epoch`. Raises what has."""
        self.undisturbed(epoch)
        self.why = None

    def undisturbed(self, epoch: int) -> None:
        """Raises what has happened since `epoch`."""
        if self.epoch != epoch:
            raise self.why or UNHOMED

    def refusal(self, is_open: bool) -> Condition | None:
        """The condition of a stage that may not move, None of one that may; `is_open`: whether it is connected."""
        if not is_open:
            return Condition("not connected", False, "connect it")
        return None if self.why is None else Condition(self.why.reason, False, self.why.remedy)

    def require(self) -> None:
        """Raises the reason not to move."""
        if self.why is not None:
            raise self.why
