"""What became of the rows: each with its checks, figures and time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from markupsafe import Markup

from station.demo.reproduce.row import Check, Row


class RowState(StrEnum):
    """What became of a row."""

    PASS = "pass"
    FAIL = "fail"
    LEFT_OUT = "left out"


@dataclass(frozen=True, eq=False)
class CheckedFigure:
    """One check of a row, our number, and whether it passes."""

    check: Check
    ours: float

    @property
    def passes(self) -> bool:
        """Whether it agrees with what was published."""
        return self.check.agrees(self.ours)


@dataclass(frozen=True, eq=False)
class Done:
    """A row and what became of it; one left out or broken has a reason and no lines.

    `processor_s` is what the row took of the processor, beside other work too, of all threads.
    """

    row: Row
    state: RowState
    lines: tuple[CheckedFigure, ...] = ()
    figures: tuple[Markup, ...] = ()
    remark: str = ""
    reason: str = ""
    seconds: float = 0.0
    processor_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Reproduction:
    """All rows that were asked for."""

    done: tuple[Done, ...]
    full: bool
    seconds: float

    @property
    def processor_s(self) -> float:
        """Processor time of all rows, seconds."""
        return sum(one.processor_s for one in self.done)

    def count(self, state: RowState) -> int:
        """How many rows ended so."""
        return sum(one.state is state for one in self.done)

    @property
    def agrees(self) -> bool:
        """Whether something was computed, and all of it passes."""
        return self.count(RowState.PASS) > 0 and self.count(RowState.FAIL) == 0
