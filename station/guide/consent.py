"""Nothing moves unasked: a request that moves says what moves, from where and to where, and the operator begins it.

One question per request. What moves again and again in one request, a look that is mended or a tour, says so and is
begun once; it is begun anew after hands were asked to the rig, and before a stage that lost its position homes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from procedures.plan import Ask
from station.bench.axis_words import in_words, label
from station.guide.active_devices import Rig
from station.guide.dialogue import Conversation, Skipped
from station.guide.frontend import MOVE

AGAIN = "It moves on as this step needs, without asking again."
STANDS_MM = 5e-4
"""An axis that goes less far than this does not move: millimetres, or degrees."""


class MoveApproval:
    """Whether what a request wants to move may move."""

    def __init__(self, rig: Rig, talk: Conversation) -> None:
        self._rig, self._talk = rig, talk
        self._given = False
        rig.agree = self.to_home_again

    def withdraw(self) -> None:
        """The next move is asked about: another request begins, or hands were at the rig."""
        self._given = False

    def to_home(self, then: Mapping[str, float] | None = None) -> None:
        """Every stage goes to its switches, then to these places. Raises Skipped, Stopped."""
        back = f", then {self._ways(then, known=False)}" if then else ""
        self._begin(f"{self._homing(self._rig.movers())}{back}.")

    def to_home_again(self, names: Sequence[str]) -> None:
        """These stages lost their position: they go to their switches, and back. Raises Skipped, Stopped."""
        self.withdraw()
        self._begin(f"{self._homing(names)}, then back to where it was.")

    def to_go(self, places: Mapping[str, float], *, again: bool = False) -> None:
        """The axes go to places; `again`: and on from there, in this request. Raises Skipped, Stopped."""
        if self._rig.moves(places, STANDS_MM):
            self._begin(f"Moving {self._ways(places)}.{f' {AGAIN}' if again else ''}")

    def to_scan(self, axis: str, places: Sequence[float]) -> None:
        """One axis goes to each of these places, then to the best. Raises Skipped, Stopped."""
        low, high = in_words(axis, min(places)), in_words(axis, max(places))
        self._begin(f"Moving {self._ways({axis: places[0]})}, then to {len(places)} places between {low} and {high}.")

    def _begin(self, words: str) -> None:
        if self._given:
            return
        if not self._talk.ask(Ask(MOVE, words)):
            raise Skipped
        self._given = True

    def _homing(self, names: Sequence[str]) -> str:
        travels = self._rig.travels(names)
        ends = [f"{label(axis)} within {one.low:.0f} to {in_words(axis, one.high, 0)}" for axis, one in travels.items()]
        return f"Homing, each axis to its switch: {', '.join(ends) or ', '.join(names)}"

    def _ways(self, places: Mapping[str, float], *, known: bool = True) -> str:
        here = self._rig.places if known else {}
        begin = {axis: f" from {in_words(axis, here[axis]).partition(' ')[0]}" for axis in places if axis in here}
        return ", ".join(f"{label(axis)}{begin.get(axis, '')} to {in_words(axis, at)}" for axis, at in places.items())
