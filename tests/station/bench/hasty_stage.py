"""A hastily written driver of an ESP301: it keeps every promise on a good line, and stops once without asking again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from drivers.errors import EmergencyStopped, MoveFailed, NoAnswer
from drivers.interfaces import Condition, Identity, Travel
from drivers.making import LineOptions
from drivers.move_checks import HOME, UNHOMED, OneMover, Trust, check_arrival, check_target, left_still
from drivers.newport import NewportParser
from drivers.wire.connection import anything, not_connected, opened
from simulators.devices.newport import Esp301Twin
from simulators.world.motion import Axis


class HastyStage:
    """One axis of 100 mm."""

    def __init__(self, transport, clock):
        self.clock, self.trust, self._mover, self._transport = clock, Trust(), OneMover(), transport

    address = property(lambda self: self._transport.address)

    def connect(self) -> Identity:
        self._transport.close()
        self.trust.lose(UNHOMED)
        with opened(self._transport):
            firmware = self._ask("VE?", str)
            self._transport.write(b"1MO\r")
        self.trust.why = UNHOMED
        return Identity("ESP301", firmware, "", self.address)

    def close(self) -> None:
        self.trust.lose(UNHOMED)
        self._transport.close()

    def condition(self) -> Condition:
        return self.trust.refusal(self._transport.is_open) or Condition("idle")

    def _ask(self, query: str, convert: Callable[[str], object]):
        def answer(reply):
            try:
                return convert(reply.value)
            except ValueError:
                return None

        return self._transport.request(f"{query}\r".encode(), answer, 0.3, 3)

    def travel(self) -> Mapping[str, Travel]:
        return {"x_mm": Travel(0.0, 100.0)}

    def position(self) -> Mapping[str, float]:
        return {"x_mm": self._ask("1TP", float)}

    def moving(self) -> bool:
        return self._ask("1MD?", int) == 0

    def home(self, allowed: Callable[[], None] = anything) -> None:
        with self._mover as stops:
            epoch = self.trust.begin(self.trust.preemptions)
            may_go = self._mover.unless_stopped(stops, allowed, partial(self.trust.undisturbed, epoch))
            self._travel("1MO;1OR4\r", may_go)
            if self._mover.stopped(stops):
                raise MoveFailed("homing was stopped", HOME)
            self.trust.give(epoch)

    def move_to(self, **target: float) -> None:
        with self._mover as stops:
            if not self._transport.is_open:
                raise not_connected(self.address)
            self.trust.require()
            check_target(target, self.travel())
            self._travel(f"1PA{target['x_mm']:.4f}\r", self._mover.unless_stopped(stops, self.trust.require))
            self.trust.require()
            check_arrival("x_mm", target["x_mm"], self.position()["x_mm"], 0.002, self._mover.stopped(stops))

    def _travel(self, order: str, may_go: Callable[[], None]) -> None:
        with left_still(self._halt, self.emergency_stop, self.trust):
            self._transport.write(order.encode(), may_go)
            deadline_s = self.clock.now_s() + 30.0
            while self.moving():
                if self.clock.now_s() > deadline_s:
                    raise NoAnswer("it still moves", "check the mechanics")
                self.clock.sleep(0.1)

    def _halt(self) -> None:
        self._transport.write(b"1ST\r")

    def stop(self) -> None:
        self._mover.stop()
        self._halt()
        while self.moving():
            self.clock.sleep(0.05)

    def emergency_stop(self) -> None:
        self._mover.stop()
        error = EmergencyStopped(f"emergency stop at {self.address}", f"make it safe, then {HOME}")
        self.trust.preempt(error)
        self._transport.preempt(b"\rST\r", error)


@dataclass(frozen=True, kw_only=True)
class HastyOptions(LineOptions):
    baud: int = 921600
    twin = staticmethod(lambda: Esp301Twin({"x_mm": Axis(0.0, 100.0, 37.0)}))

    def make(self, parts):
        return HastyStage(parts.wire(self.port, NewportParser, baud=self.baud), parts.clock)
