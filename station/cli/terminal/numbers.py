"""Numbers on the command line: finite, and within bounds. click accepts NaN, which compares with no bound."""

import math
from typing import Any

import click


class FiniteNumber(click.FloatRange):
    """A finite number, within optional bounds."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number

    def _describe_range(self) -> str:
        """The bounds in the help; without bounds click would write x<=None."""
        return "" if self.min is None and self.max is None else super()._describe_range()


UNITS = click.Choice(["cycles/pixel", "lp/mm", "lw/ph"], case_sensitive=False)
"""Units of frequencies."""
SEED = click.IntRange(0, 2**63 - 1)
"""Seed of a generator of random numbers."""
