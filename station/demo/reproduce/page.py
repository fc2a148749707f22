"""The page: every row with what was published, the values computed here, and its state."""

from __future__ import annotations

import math

from station.common.versions import software
from station.demo.reproduce.catalogue import NOT_HERE
from station.demo.reproduce.runner import Reproduction, RowState
from station.reports.page import render

PLAIN_FROM, PLAIN_TO = 1e-3, 1e5
"""Numbers outside this range are written with a power of ten."""


def reproduction_page(result: Reproduction) -> str:
    """One self-contained HTML page."""
    return render(
        "reproduce.html", found=result, State=RowState, shown=shown, not_here=NOT_HERE, software=software(),
    )  # fmt: skip


def shown(value: float) -> str:
    """A number to four digits: 0.1961, 31806, 2.1×10¹²."""
    if not math.isfinite(value):
        return "none"
    if value and not PLAIN_FROM <= abs(value) < PLAIN_TO:
        mantissa, power = f"{value:.2e}".split("e")
        return f"{mantissa}×10^{int(power)}".replace("-", "−")
    digits = max(0, 3 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{digits}f}".replace("-", "−")
