"""Scale of a printed chart with its record: reading, ruler and certificate, temperatures, expansion, uncertainty.

```toml
width_mm = 299.62                       # of the ten blocks, as read on the ruler
reading_uncertainty_mm = 0.03           # standard uncertainty of the reading, k = 1
ruler = "steel rule 500 mm"
certificate = "D-K-15080 2026-0417"
ruler_uncertainty_mm = 0.01             # from the certificate, k = 1
measured_at_c = 22.5                    # of ruler and chart when it was read
used_at_c = 24.0                        # of the chart when it was photographed
temperature_uncertainty_c = 0.5
expansion_per_k = 8e-6                  # of the chart's sheet: 8e-6 glass, about 1e-5 paper at constant humidity
ruler_expansion_per_k = 11.5e-6
```

A ruler is right at 20 degrees. The width in use is

    width_mm (1 + a_ruler (t_measured - 20)) (1 + a_chart (t_used - t_measured)).
"""

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from station.common.models import TableSource, read_model

REFERENCE_C = 20.0
"""Temperature to which a ruler's certificate refers (ISO 1)."""
EXPANSION_SHARE = 0.1
"""Relative standard uncertainty of coefficients of expansion."""

Length = Annotated[float, msgspec.Meta(gt=0)]
Spread = Annotated[float, msgspec.Meta(ge=0)]


@dataclass(frozen=True, kw_only=True)
class ChartScale:
    """The record of a chart's scale; standard uncertainties."""

    width_mm: Length
    reading_uncertainty_mm: Spread
    ruler: str
    certificate: str
    ruler_uncertainty_mm: Spread
    measured_at_c: float = REFERENCE_C
    used_at_c: float = REFERENCE_C
    temperature_uncertainty_c: Spread = 0.5
    expansion_per_k: Spread = 1e-5
    ruler_expansion_per_k: Spread = 11.5e-6

    @classmethod
    def read(cls, path: Path) -> "ChartScale":
        """The record in a TOML file. Raises BadParameter where it is unreadable, or a key or value is not valid."""
        return read_model(cls, *TableSource.read(path))

    @property
    def used_width_mm(self) -> float:
        """Width at the temperature of use."""
        ruler = 1 + self.ruler_expansion_per_k * (self.measured_at_c - REFERENCE_C)
        return self.width_mm * ruler * (1 + self.expansion_per_k * (self.used_at_c - self.measured_at_c))

    @cached_property
    def budget(self) -> dict[str, float]:
        """Terms of the width's standard uncertainty, in mm."""
        expansion, warmer = self.expansion_per_k, self.used_at_c - self.measured_at_c
        ruler = self.ruler_expansion_per_k * (self.measured_at_c - REFERENCE_C)
        # the temperature of the reading moves ruler and chart alike, that of use the chart alone
        read, used = self.ruler_expansion_per_k - expansion, expansion
        return {
            "reading": self.reading_uncertainty_mm,
            "ruler": self.ruler_uncertainty_mm,
            "temperature": self.width_mm * self.temperature_uncertainty_c * float(np.hypot(read, used)),
            "expansion": self.width_mm * EXPANSION_SHARE * float(np.hypot(ruler, expansion * warmer)),
        }

    @property
    def uncertainty_mm(self) -> float:
        """Combined standard uncertainty of the width."""
        return float(np.linalg.norm(list(self.budget.values())))

    def to_record(self) -> dict[str, Any]:
        """The record with the width in use, and its budget."""
        combined = {"used_width_mm": self.used_width_mm, "uncertainty_mm": self.uncertainty_mm}
        return {**asdict(self), **combined, "budget": self.budget}
