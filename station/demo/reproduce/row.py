"""A row: something published, the values computed for it, and what the paper claims of them as ranges of values."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

from markupsafe import Markup

from procedures.outcome import BadParameter

Values = tuple[float, ...]


@dataclass(frozen=True)
class Setting:
    """Folder of published photographs and films, whether to compute more than the quick cases, and threads."""

    data: Path | None = None
    full: bool = False
    threads: int = 1

    def path(self, names: str) -> Path:
        """The first file of the data folder that exists, of one or several names "a|b". Raises BadParameter if none."""
        for name in names.split("|"):
            if self.data is not None and (self.data / name).exists():
                return self.data / name
        needed = names.replace("|", " or ")
        where = "no data folder" if self.data is None else f"no {needed} in {self.data}"
        raise BadParameter(f"the row needs {needed}; {where}", "name the data folder with --data, and add --fetch")


@dataclass(frozen=True)
class ClaimCheck:
    """One quantity and the paper's claim about it.

    published : a number as printed, or the paper's words
    low, high : the claim as a range of values: a printed number with its rounding, or how the words are read
    """

    quantity: str
    published: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""

    def agrees(self, value: float) -> bool:
        """Whether the value is within the claim; a value that is not finite is not."""
        return math.isfinite(value) and self.low <= value <= self.high

    @property
    def claim(self) -> str:
        """The claim's range in words."""
        if math.isinf(self.low):
            return f"at most {self.high:.4g}"
        return f"at least {self.low:.4g}" if math.isinf(self.high) else f"{self.low:.4g} to {self.high:.4g}"

    def deviation(self, value: float) -> str:
        """Distance of the value from the claim, empty within it: "0.105 pixels above, 1.41 times"."""
        if self.agrees(value) or not math.isfinite(value):
            return "" if math.isfinite(value) else "not finite"
        bound, side = (self.high, "above") if value > self.high else (self.low, "below")
        ratio = f", {value / bound:.3g} times" if value * bound > 0 else ""
        return f"{abs(value - bound):.3g}{' ' * bool(self.unit)}{self.unit} {side}{ratio}"


PLAIN_FROM, PLAIN_TO = 1e-3, 1e5
"""Numbers outside this range are written with a power of ten."""


def shown(value: float) -> str:
    """A number to four digits: 0.1961, 31806, 2.1×10¹²."""
    if not math.isfinite(value):
        return "none"
    if value and not PLAIN_FROM <= abs(value) < PLAIN_TO:
        mantissa, power = f"{value:.2e}".split("e")
        return f"{mantissa}×10^{int(power)}".replace("-", "−")
    digits = max(0, 3 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{digits}f}".replace("-", "−")


def half_digit(printed: str) -> float:
    """Half a unit of the last digit of a printed number."""
    return 0.5 * 10.0 ** -len(printed.partition(".")[2])


@dataclass(frozen=True)
class Order:
    """A comparison that the paper draws from its numbers; it can hold where the numbers differ."""

    statement: str
    holds: Callable[[Values], bool]


def increases(statement: str, *ranges: tuple[int, int]) -> Order:
    """The values of each range of positions increase."""
    return Order(statement, lambda v: all(a < b for start, stop in ranges for a, b in pairwise(v[start:stop])))


@dataclass(frozen=True, eq=False)
class RowValues:
    """One value for each check of a row, in their order; figures, and a remark on this computation."""

    values: Values
    figures: tuple[Markup, ...] = ()
    remark: str = ""


Compute = Callable[[Setting], RowValues]


@dataclass(frozen=True)
class Row:
    """One table, figure or statement of a paper that can be computed here.

    name, chapter : either selects the row on the command line
    place, title : where and what was published
    checks : tuple of Check
    setup : difference between the paper's set-up and this one, the reason for values that deviate
    order : what must hold for a row whose values deviate to have the same direction
    needs : files of the data folder
    long : computed with --full, or by its name
    """

    name: str
    chapter: str
    place: str
    title: str
    checks: tuple[ClaimCheck, ...]
    setup: str
    compute: Compute
    order: Order | None = None
    needs: tuple[str, ...] = ()
    long: bool = False


def ordered(order: Order) -> Callable[[Compute], Compute]:
    """A decorator of a row's function: what must hold for values that deviate to have the paper's direction."""

    def mark(compute: Compute) -> Compute:
        compute.order = order  # type: ignore[attr-defined]
        return compute

    return mark


def read_row(name: str, table: Mapping[str, Any]) -> Row:
    """The row of a table of `rows.toml`, computed by the function of its name in its module."""
    given = dict(table)
    compute = getattr(import_module(f"{__package__}.{given.pop('module')}"), name.replace("-", "_"))
    each, needs = given.pop("each", ()), tuple(given.pop("needs", ()))
    entries: list[Mapping[str, Any]] = []
    for entry in given.pop("checks"):
        published, quantity = entry["published"], entry["quantity"]
        if isinstance(published, str):
            entries.append(entry)
            continue
        for case, number in zip(each, published, strict=True):
            entries.append({**entry, "quantity": f"{quantity}, {case}", "published": number})
    checks = tuple(map(read_check, entries))
    title, order = compute.__doc__.removesuffix("."), getattr(compute, "order", None)
    return Row(name, title=title, checks=checks, needs=needs, compute=compute, order=order, **given)


def read_check(entry: Mapping[str, Any]) -> ClaimCheck:
    """The check of an entry: a range of values, or a printed number read with its rounding."""
    given = dict(entry)
    if read := given.pop("read", ""):
        value, half = float(given["published"]), half_digit(given["published"])
        low, high = {"low": value - half}, {"high": value + half}
        # of an error smaller values are as good, of a gain larger ones
        given |= {"printed": low | high, "at most": high, "at least": low}[read]
    return ClaimCheck(**given)
