"""The drift of a camera as a picture: the sessions with their uncertainties, and the line with its band."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from procedures.outcome import BadParameter
from station.common.sanitise import printable
from station.drawing.colours import INK, PLANE_COLOURS
from station.drawing.style import CONFIDENT, STYLE
from station.reports.trend import Trend, years_between

FORMATS = ("svg", "png")
MARKERS = {"R": "o", "G1": "s", "G2": "D", "B": "^", "Y": "o"}


def trend_picture(camera: str, trends: Sequence[Trend], path: Path) -> bytes:
    """The picture in the format of the path's suffix, svg or png: one row for each lens, plan and quantity. Raises
    BadParameter if it is another format, or there is nothing to draw."""
    kind = path.suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise BadParameter(f"a trend is drawn as {' or '.join(FORMATS)}, not {kind or 'a file without a suffix'}", "")
    if not trends:
        raise BadParameter(f"no session of {printable(camera)} has a number to draw", "see station session list")
    rows: dict[tuple[str, str, str], list[Trend]] = {}
    for trend in trends:
        rows.setdefault((trend.lens, trend.plan, trend.quantity), []).append(trend)
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "trend", "text.parse_math": False}):
        figure = Figure(figsize=(7.0, 0.6 + 2.4 * len(rows)), layout="constrained")
        axes = figure.subplots(len(rows), 1, squeeze=False, sharex=True)[:, 0]
        origin = min(trend.points[0].began for trend in trends)
        for place, ((lens, plan, quantity), several) in zip(axes, rows.items(), strict=True):
            _draw(place, several, origin)
            place.set_title(f"{printable(camera)}, {printable(lens)} ({printable(plan)}): {quantity}", loc="left")
        axes[-1].set_xlabel(f"years since {origin[:10]}")
        data = io.BytesIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type")) if kind == "svg" else {"Software": None}
        figure.savefig(data, format=kind, dpi=150, metadata=nothing)
    return data.getvalue()


def _draw(axes: Axes, several: Sequence[Trend], origin: str) -> None:
    """The planes of one quantity, distinguished by colour, marker and legend."""
    for one in several:
        start = years_between(origin, one.points[0].began)
        colour = PLANE_COLOURS.get(one.plane, INK)
        values = [point.value for point in one.points]
        bars = [CONFIDENT * point.uncertainty for point in one.points]
        label = f"{one.plane}: {one.finding}"
        marker = MARKERS.get(one.plane, "o")
        style: dict[str, Any] = {"fmt": marker, "ms": 4, "color": colour, "lw": 0.9, "capsize": 2, "label": label}
        axes.errorbar(start + one.years, values, bars, **style)
        if one.line is not None:
            x = np.linspace(0.0, float(one.years.max()), 50)
            y, uncertainty = one.line.at(x)
            axes.plot(x, y, color=colour, lw=0.9)
            axes.fill_between(
                x, y - CONFIDENT * uncertainty, y + CONFIDENT * uncertainty, color=colour, alpha=0.12, lw=0
            )
    axes.set_ylabel(several[0].unit)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
