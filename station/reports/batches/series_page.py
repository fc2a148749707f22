"""The page of a series: every number over the f-number with error bars, and the best aperture."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from station.calibration.series import Best, Point
from station.drawing.colours import PLANE_COLOURS
from station.drawing.style import CONFIDENT, axes_grid, svg
from station.reports.page import render


def series_page(points: Sequence[Point], best: Sequence[Best]) -> str:
    """The page; what the camera noted no f-number of is in its table alone."""
    titles = dict.fromkeys(one.title for one in points)
    figures = [(title, _figure([one for one in points if one.title == title], f"series{i}"))
               for i, title in enumerate(titles)]  # fmt: skip
    return render("series.html", points=points, best=best, figures=[one for one in figures if one[1]])


def _figure(points: Sequence[Point], name: str) -> Markup | None:
    """One number over the f-number, a line for each plane, focus and ISO, with 95 % bars."""
    lines: dict[tuple[str, float | None, float | None], list[Point]] = {}
    for one in points:
        if one.setting.f_number is not None:
            lines.setdefault((one.plane, one.setting.focus_mm, one.setting.iso), []).append(one)
    if not lines:
        return None
    figure, ((axes,),) = axes_grid(4.6, 2.9, rim_in=(0.6, 0.2, 0.45, 0.12))
    stops: set[float] = set()
    for number, ((plane, _, _), line) in enumerate(lines.items()):
        x = [one.setting.f_number or 0.0 for one in line]
        bars = [CONFIDENT * one.uncertainty for one in line]
        dashes = ("-", "--", ":", "-.")[number // max(len(PLANE_COLOURS), 1) % 4]
        style = {"color": PLANE_COLOURS.get(plane), "marker": "o", "ms": 3, "lw": 1.1, "ls": dashes, "capsize": 2}
        axes.errorbar(x, [one.value for one in line], bars, label=plane, **style)
        stops |= set(x)
    axes.set_xscale("log")
    axes.set_xticks(sorted(stops), [f"{one:g}" for one in sorted(stops)])
    axes.minorticks_off()
    unit = points[0].unit
    axes.set(xlabel="f-number", ylabel=points[0].title.split(",")[0] + ("" if unit == "1" else f", {unit}"))
    return svg(figure, name, f"{points[0].title} over the f-number with 95 % bars")
