"""What stands around a bench: nothing of it is a device. A simulated bench has a room and a person of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from procedures.plan import Fact, Facts
    from simulators.bench.bench import SimulatedBench


class Hands(Protocol):
    """What stands for a person's hands and eyes."""

    def knows(self, key: str) -> Fact | None:
        """What a person there would answer; None where the question's own default will do."""
        ...

    def do(self, key: str, facts: Facts) -> None:
        """What the person did who confirms this question."""
        ...

    def take_up(self, facts: Facts) -> None:
        """Everything is as an earlier run, which knew these facts, left it."""
        ...

    def follow(self, by_hand: Mapping[str, float]) -> None:
        """What was asked for in numbers: turn the chart, the focus ring, the exposure dial."""
        ...


class Surroundings:
    """A real room: whatever is asked of hands, the operator does."""

    @property
    def hands(self) -> Hands | None:
        """Nobody's but the operator's."""
        return None

    def stand_before(self, subject: str) -> None:
        """The rig stands before "chart", "wall", "depth" or "panel"."""

    def number_next_frame(self, number: int) -> None:
        """The next frame is the session's shot of this number."""


class SimulatedSurroundings(Surroundings):
    """The room of a simulated bench: its subjects, its person, and frames whose noise follows from their number."""

    def __init__(self, truth: SimulatedBench) -> None:
        self._truth = truth

    @property
    def hands(self) -> Hands:
        """The simulated person."""
        return self._truth.hands

    def stand_before(self, subject: str) -> None:
        """Put that before the camera."""
        self._truth.show(subject)

    def number_next_frame(self, number: int) -> None:
        """Its noise follows from this number."""
        self._truth.body.next_number = number
