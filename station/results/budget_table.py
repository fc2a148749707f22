"""Uncertainty budgets as tables: of a page's headline numbers, and of all numbers for other programs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.budget import TERMS
from procedures.numbers import Group, in_group
from procedures.outcome import Quantity
from station.common.sanitise import cell
from station.results.exports import csv_bytes

if TYPE_CHECKING:
    from procedures.quality import Quality
    from station.results.plane_result import PlaneResult

HEADLINE = tuple((one, one.label) for one in in_group(Group.BUDGET))
"""The numbers whose uncertainty a page takes apart, in their order."""
NEGLIGIBLE = 1e-3
"""Share of the whole below which a term is none."""


@dataclass(frozen=True)
class BudgetRow:
    """One number's uncertainty.

    Attributes
    ----------
    title : str
    number : Quantity
    terms : (n,) float
        Standard uncertainties, in the order of the budget's columns.
    """

    title: str
    number: Quantity
    terms: tuple[float, ...]

    @property
    def value(self) -> str:
        """The number with as many decimals as its uncertainty has."""
        return f"{self.number.value:z.{self._decimals}f}".replace("-", "−")

    @property
    def together(self) -> str:
        """The combined standard uncertainty, of two digits."""
        return f"{self.number.uncertainty:.{self._decimals}f}"

    @property
    def words(self) -> list[Term]:
        """The terms, rounded as the combined uncertainty is."""
        most = max(self.terms, default=0.0)
        rounded = [f"{term:.{self._decimals}f}" for term in self.terms]
        return [
            Term(words if float(words) else "–", term == most > 0)
            for words, term in zip(rounded, self.terms, strict=True)
        ]

    @property
    def _decimals(self) -> int:
        uncertainty = self.number.uncertainty
        return max(0, 1 - math.floor(math.log10(uncertainty))) if uncertainty > 0 else 4


@dataclass(frozen=True)
class Term:
    """A term in words, and whether it is the largest of its line."""

    words: str
    ruling: bool


@dataclass(frozen=True)
class BudgetTable:
    """The headline numbers' uncertainties.

    Attributes
    ----------
    columns : (n,) str
        The terms in words; those that add nothing to any number are left out.
    rows : sequence of BudgetRow
    """

    columns: tuple[str, ...]
    rows: Sequence[BudgetRow]


def budget_table(quality: Quality) -> BudgetTable:
    """The budget of the headline numbers that a plane has."""
    told = [(name, title) for name, title in HEADLINE if name in quality.numbers]
    terms = [term for term in TERMS if any(_counts(quality, name, term) for name, _ in told)]
    rows = [
        BudgetRow(title, quality.numbers[name], tuple(quality.budgets[name].get(term, 0.0) for term in terms))
        for name, title in told
    ]
    return BudgetTable(tuple(TERMS[term] for term in terms), rows)


def _counts(quality: Quality, name: str, term: str) -> bool:
    return quality.budgets[name].get(term, 0.0) > NEGLIGIBLE * quality.numbers[name].uncertainty


def budget_csv(planes: Sequence[PlaneResult]) -> bytes:
    """Every term that adds to a number of a plane, as CSV: plane, number, term, uncertainty, unit."""
    return csv_bytes([["plane", "number", "term", "uncertainty", "unit"], *(row for p in planes for row in _rows(p))])


def _rows(plane: PlaneResult) -> Iterator[list[str]]:
    if plane.quality is None:
        return
    for name, number in plane.quality.numbers.items():
        for term, uncertainty in plane.quality.budgets.get(name, {}).items():
            if uncertainty > 0:
                yield [plane.name, name, term, f"{uncertainty:.9g}", cell(number.unit)]
