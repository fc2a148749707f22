"""The part of a page that a script makes: place by place the PSF, MTF and budget; units; other results; limits. The
page is complete without it. The script is `templates/explore.js`; what it draws is in the page as JSON."""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from procedures.choice import TERMS
from procedures.numbers import label
from procedures.numerics.arrays import Array
from procedures.outcome import Quantity
from station.drawing.colours import INK, PLANE_COLOURS
from station.reports.report import Report, comparison
from station.results.plane_result import PlaneResult
from station.results.units import pixels_of

DRAWN = ("frequency", "horizontal", "vertical", "mtf")
MAX_POINTS = 101


@dataclass(frozen=True, eq=False)
class ExploredPlace:
    """A place of the frame: position in the plane, numbers and curves in cycles per pixel, budgets, samples of the PSF.

    inside : whether it is enclosed by the charts
    """

    x: float
    y: float
    inside: bool
    numbers: Mapping[str, Quantity]
    budgets: Mapping[str, Mapping[str, float]]
    curves: Mapping[str, Array]
    samples: Array
    s: int


@dataclass(frozen=True, eq=False)
class ExploredPlaces:
    """The places of a plane of shape (rows, columns)."""

    shape: tuple[int, int]
    places: Sequence[ExploredPlace] = field(default_factory=list)


def explorer(report: Report, spots: Mapping[str, ExploredPlaces]) -> Markup | None:
    """The data of a page; None without a number that has an uncertainty."""
    planes = [_plane_entry(one, report, spots.get(one.name)) for one in report.planes if _uncertain(one.numbers)]
    if not planes:
        return None
    first = next(plane for plane in report.planes if _uncertain(plane.numbers))
    others = [
        {"name": other.name, "planes": {name: _curves(curves, first.factor) for name, curves in other.planes.items()}}
        for other in report.overlays
        if not other.length
    ]
    entry = {
        "name": report.subject, "unit": str(first.unit), "factor": first.factor, "pitch_um": _pitch_um(report),
        "planes": planes, "others": others,
    }  # fmt: skip
    text = json.dumps(entry, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return Markup(f'<script type="application/json" id="explore-data">{text}</script>')


def _uncertain(numbers: Mapping[str, Quantity]) -> dict[str, Quantity]:
    return {name: one for name, one in numbers.items() if 0 < one.uncertainty < math.inf and math.isfinite(one.value)}


def _pitch_um(report: Report) -> float | None:
    """The pitch of the sensor's pixels, as given or recorded by the camera."""
    exposures = [*(frame.exposure for frame in report.frames), *(plane.exposure for plane in report.planes)]
    recorded = (exposure.pixel_pitch_um for exposure in exposures if exposure is not None)
    given = report.parameters.get("pixel_pitch_um")
    return float(given) if isinstance(given, int | float) else next((one for one in recorded if one), None)


def _plane_entry(plane: PlaneResult, report: Report, spots: ExploredPlaces | None) -> dict[str, Any]:
    height = min(spots.shape) if spots else None
    if report.frames and plane.name in report.frames[0].planes:
        height = pixels_of(report.frames[0])[plane.name].height
    budgets = plane.quality.budgets if plane.quality is not None else {}
    limits = {
        one.number: [bound and bound / _factor(one.unit, plane) for bound in (one.least, one.most)]
        for one in comparison(plane).judgements
    }
    return {
        "name": plane.name, "colour": PLANE_COLOURS.get(plane.name, INK), "pitch": plane.pitch, "height": height,
        "numbers": _numbers(plane.numbers, budgets, plane), "curves": _curves(plane.curves, plane.factor),
        "limits": limits, "shape": spots and spots.shape,
        "spots": [
            {
                "x": round(spot.x, 1), "y": round(spot.y, 1), "inside": spot.inside,
                "numbers": _numbers(spot.numbers, spot.budgets), "curves": _curves(spot.curves, 1.0),
                "psf": _psf_entry(spot.samples, spot.s),
            }
            for spot in (spots.places if spots else ())
        ],
        "psf": None if plane.psf is None else _psf_entry(plane.psf.h, plane.psf.s),
    }  # fmt: skip


def _factor(unit: str, plane: PlaneResult) -> float:
    return plane.factor if unit == plane.unit else 1.0


def _numbers(
    numbers: Mapping[str, Quantity], budgets: Mapping[str, Mapping[str, float]], plane: PlaneResult | None = None
) -> list[dict[str, Any]]:
    entries = []
    for name, one in _uncertain(numbers).items():
        factor = _factor(one.unit, plane) if plane else 1.0
        terms = {TERMS.get(term, term): _short(size / factor) for term, size in budgets.get(name, {}).items() if size}
        entries.append({
            "name": name, "label": label(name, plane.unit if plane else ""), "value": _short(one.value / factor),
            "uncertainty": _short(one.uncertainty / factor), "unit": one.unit, "budget": terms,
        })  # fmt: skip
    return entries


def _curves(curves: Mapping[str, Array], factor: float) -> dict[str, list[float]]:
    if "frequency" not in curves:
        return {}
    step = -(-len(curves["frequency"]) // MAX_POINTS)
    kept = {name: values[::step] for name, values in curves.items() if name.removesuffix("_uncertainty") in DRAWN}
    return {
        name: [_short(value / factor if name == "frequency" else value, 4) for value in values]
        for name, values in kept.items()
    }


def _psf_entry(samples: Array, s: int) -> dict[str, Any]:
    levels = np.rint(255 * np.sqrt(np.clip(samples / samples.max(), 0, 1))).astype(np.uint8)
    return {"levels": base64.b64encode(levels.tobytes()).decode(), "s": s}


def _short(value: float, digits: int = 7) -> float:
    return float(f"{value:.{digits}g}")
