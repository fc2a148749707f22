"""Numbers with uncertainties, as text."""

from __future__ import annotations

import math


def stated(value: float, uncertainty: float) -> str:
    """A value with its standard uncertainty, rounded to two digits of it: 0.5782 ± 0.0014."""
    if not math.isfinite(value):
        return "—"
    if not math.isfinite(uncertainty) or uncertainty <= 0:
        return f"{value:.4g}".replace("-", "−")
    decimals = max(0, 1 - math.floor(math.log10(uncertainty)))
    return f"{value:z.{decimals}f} ± {uncertainty:.{decimals}f}".replace("-", "−")
