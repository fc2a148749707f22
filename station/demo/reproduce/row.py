"""What a row is: something published, what is computed for it, and how near the two must be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from procedures.outcome import BadParameter


@dataclass(frozen=True)
class Setting:
    """What rows may use.

    Attributes
    ----------
    data : Path or None
        The folder of photographs and films with known truth.
    full : bool
        Whether there is time for more cases than a first look needs.
    threads : int
    """

    data: Path | None = None
    full: bool = False
    threads: int = 1

    def path(self, name: str) -> Path:
        """A file of the data folder. Raises BadParameter where there is none."""
        if self.data is None or not (self.data / name).exists():
            where = "no data folder" if self.data is None else f"no {name} in {self.data}"
            raise BadParameter(f"the row needs {name}; {where}", "name the data folder with --data")
        return self.data / name


@dataclass(frozen=True)
class Check:
    """One number: what it is, what the paper prints, and the least and the most that agrees with it.

    `published` is a number as printed, or what the text claims in words.
    """

    quantity: str
    published: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""

    @classmethod
    def near(cls, quantity: str, published: str, share: float, unit: str = "") -> Check:
        """Passes within a share of the printed number."""
        value = float(published)
        return cls(quantity, published, value * (1 - share), value * (1 + share), unit)

    @classmethod
    def within_factor(cls, quantity: str, published: str, factor: float, unit: str = "") -> Check:
        """Passes within a factor of the printed number."""
        value = float(published)
        return cls(quantity, published, value / factor, value * factor, unit)

    def agrees(self, ours: float) -> bool:
        """Whether our number passes; one that is not finite does not."""
        return math.isfinite(ours) and self.low <= ours <= self.high

    @property
    def range_words(self) -> str:
        """What passes, in words."""
        if math.isinf(self.low):
            return f"at most {self.high:.4g}"
        return f"at least {self.low:.4g}" if math.isinf(self.high) else f"{self.low:.4g} to {self.high:.4g}"


@dataclass(frozen=True, eq=False)
class Found:
    """What a row computed: one number for each check, in their order; figures; and what is to be said about them."""

    values: tuple[float, ...]
    figures: tuple[Markup, ...] = ()
    remark: str = ""


@dataclass(frozen=True)
class Row:
    """One table, figure or statement of a paper that can be computed here.

    Attributes
    ----------
    name : str
        For the command line.
    chapter : str
        A group of rows that is computed by its name too.
    place : str
        Where it was published.
    title : str
        What was published, in a sentence.
    checks : tuple of Check
    tolerance : str
        Why the checks are as wide as they are.
    compute : callable
    needs : tuple of str
        Files of the data folder.
    long : bool
        Computed with --full, or when it is named.
    """

    name: str
    chapter: str
    place: str
    title: str
    checks: tuple[Check, ...]
    tolerance: str
    compute: Callable[[Setting], Found]
    needs: tuple[str, ...] = ()
    long: bool = False
