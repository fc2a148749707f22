"""Approval of movements: before a request moves anything, the operator confirms what moves, from where and to where.

One question per request. A request that moves repeatedly (a look with corrections, a tour) says so and is confirmed
once; it is confirmed again after manual work at the rig, and before a stage that lost its position homes.
"""

from collections.abc import Mapping, Sequence

from procedures.plan import Ask
from station.bench.axis_text import label, moves_text, position_text
from station.guide.active_devices import ActiveDevices
from station.guide.dialogue import Conversation, Skipped
from station.guide.frontend import LAMP, MOVE

AGAIN = "Further moves of this step follow without asking again."
LIT = "it may change during the run without another question, and goes out at the end."
LEAST_MOVE = 5e-4
"""Shorter distances, in millimetres or degrees, count as no movement."""


class MoveApproval:
    """Asks the operator before movements of a request."""

    def __init__(self, rig: ActiveDevices, talk: Conversation) -> None:
        self._rig, self._talk = rig, talk
        self._approved = self._lit = False
        rig.approve_homing = self.to_home_again

    def withdraw(self) -> None:
        """Ask again before the next move: a new request begins, or somebody worked at the rig."""
        self._approved = False

    def to_home(self, then: Mapping[str, float] | None = None) -> None:
        """Approve homing of every stage, then moves to these places. Raises Skipped, Stopped."""
        back = f", then {moves_text(then)}" if then else ""
        self._ask(f"{self._homing_text(self._rig.movers())}{back}.")

    def to_home_again(self, names: Sequence[str]) -> None:
        """Approve homing of stages that lost their position, then the moves back. Raises Skipped, Stopped."""
        self.withdraw()
        self._ask(f"{self._homing_text(names)}, then back to the last position.")

    def to_go(self, places: Mapping[str, float], *, again: bool = False) -> None:
        """Approve moves to places; `again` : more moves of this request follow. Raises Skipped, Stopped."""
        if self._rig.moves(places, LEAST_MOVE):
            self._ask(f"Moving {moves_text(places, self._rig.places)}.{f' {AGAIN}' if again else ''}")

    def to_scan(self, axis: str, places: Sequence[float]) -> None:
        """Approve a scan of one axis over these places, then to the best. Raises Skipped, Stopped."""
        low, high = position_text(axis, min(places)), position_text(axis, max(places))
        first = moves_text({axis: places[0]}, self._rig.places)
        self._ask(f"Moving {first}, then to {len(places)} places between {low} and {high}.")

    def to_light(self, level: float) -> None:
        """Approve that the lamp is lit, once a run; darkness needs no approval. Raises Skipped, Stopped."""
        if self._lit or not level or not self._rig.has_light:
            return
        if not self._talk.ask(Ask(LAMP, f"The lamp goes on, now to {100 * level:.0f} % of its power; {LIT}")):
            raise Skipped
        self._lit = True

    def _ask(self, words: str) -> None:
        if self._approved:
            return
        if not self._talk.ask(Ask(MOVE, words)):
            raise Skipped
        self._approved = True

    def _homing_text(self, names: Sequence[str]) -> str:
        travels = self._rig.travels(names)
        ends = [
            f"{label(axis)} within {travel.low:.0f} to {position_text(axis, travel.high, 0)}"
            for axis, travel in travels.items()
        ]
        return f"Homing each axis to its switch: {', '.join(ends) or ', '.join(names)}"
