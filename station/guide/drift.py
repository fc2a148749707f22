"""Drift over a session, from its photographs: per hour of their times, per kelvin of a probe's temperature."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from procedures.numerics.arrays import Array
from procedures.pattern_psf.combine import CombinedPsf
from procedures.pattern_psf.drift import DriftSeries, Slope, chart_series, slope_of
from station.common.uncertainty_text import stated
from station.reports.report import DriftLine
from station.results.environment import temperature_during
from station.results.plane_result import PlaneResult
from station.sessions.state import SessionShot, SessionState

PLANES = ("G1", "Y")
"""Planes whose drift is given, in order of preference."""
SAME_PLACE = 3
"""Decimals of the axes' positions that are equal at one position."""
SMALLEST_CHANGE_K = 0.2
"""Change of the temperature below which no slope per kelvin is given: probes resolve about a tenth of it."""
HOUR_S = 3600.0


def drift_lines(state: SessionState, planes: Mapping[str, PlaneResult]) -> list[DriftLine]:
    """The drift of each number of the chart's photographs; none for other procedures, or with few photographs."""
    plane = next((planes[name] for name in PLANES if name in planes), None)
    if plane is None or not isinstance(plane.estimate, CombinedPsf):
        return []
    counting, combined = state.counting(), plane.estimate
    photographs = [(counting[place], shot) for place, shot in zip(combined.places, combined.shots, strict=True)]
    place = Counter(_place(shot) for shot, _ in photographs).most_common(1)[0][0]
    photographs = [one for one in photographs if _place(one[0]) == place]
    shots = [shot for shot, _ in photographs]
    series = chart_series([estimate for _, estimate in photographs], plane.pitch or 1)
    hours, kelvins = _hours(shots), _temperatures(shots)
    return [line for name, one in series.items() if (line := _line(name, one, hours, kelvins)) is not None]


def _line(name: str, series: DriftSeries, hours: Array | None, kelvins: Array | None) -> DriftLine | None:
    per_hour, per_kelvin = (None if x is None else slope_of(x, series) for x in (hours, kelvins))
    if per_hour is None and per_kelvin is None:
        return None
    return DriftLine(name, _words(per_hour, f"{series.unit}/h"), _words(per_kelvin, f"{series.unit}/K"))


def _words(slope: Slope | None, unit: str) -> str:
    return "—" if slope is None else f"{stated(slope.value, slope.uncertainty)} {unit}"


def _place(shot: SessionShot) -> tuple[tuple[str, float], ...]:
    """The axes' positions at a photograph."""
    axes = shot.snapshot.get("axes", {})
    return tuple(sorted((str(name), round(float(value), SAME_PLACE)) for name, value in axes.items()))


def _hours(shots: Sequence[SessionShot]) -> Array | None:
    """Times of the photographs; None where the bench's clock began again between them."""
    times = np.array([float(shot.exposure.get("requested_s", np.nan)) for shot in shots]) / HOUR_S
    return times if np.all(np.diff(times) > 0) else None


def _temperatures(shots: Sequence[SessionShot]) -> Array | None:
    """Temperatures at the photographs; None without a probe, or where they hardly differ."""
    readings = [temperature_during(shot.snapshot) for shot in shots]
    if any(one is None for one in readings):
        return None
    kelvins = np.array(readings, np.float64)
    return kelvins if np.ptp(kelvins) >= SMALLEST_CHANGE_K else None
