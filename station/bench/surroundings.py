"""Everything around a bench that is not a device. A simulated bench has its own room and operator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from procedures.plan import Fact, Facts
    from simulators.bench.bench import SimulatedBench


class OperatorActions(Protocol):
    """Interface to an operator's actions and observations."""

    @property
    def in_real_time(self) -> bool:
        """Whether the bench's time passes as for a person, so that its moves can be watched."""

    def knows(self, key: str) -> Fact | None:
        """The operator's answer; None if the question's default applies."""

    def do(self, key: str, facts: Facts) -> None:
        """The action of the operator who confirms this question."""

    def take_up(self, facts: Facts) -> None:
        """Restore the state left by an earlier run with these facts."""

    def follow(self, by_hand: Mapping[str, float]) -> None:
        """Adjust what was requested in numbers: chart angle, focus ring, exposure dial."""


class Surroundings:
    """A real room, in which the operator acts."""

    @property
    def hands(self) -> OperatorActions | None:
        """None: the operator acts."""
        return None

    def stand_before(self, subject: str) -> None:
        """Place "chart", "wall", "depth", "panel" or "edge" before the camera."""

    def number_next_frame(self, number: int) -> None:
        """Announce the session's shot number of the next frame."""


class SimulatedSurroundings(Surroundings):
    """The room of a simulated bench: its subjects, its operator, and frames with noise seeded by their number."""

    def __init__(self, truth: SimulatedBench) -> None:
        self._truth = truth

    @property
    def hands(self) -> OperatorActions:
        """The simulated operator."""
        return self._truth.hands

    def stand_before(self, subject: str) -> None:
        """Place that subject before the camera."""
        self._truth.show(subject)

    def number_next_frame(self, number: int) -> None:
        """Seed the noise of the next frame by this number."""
        self._truth.body.next_number = number
