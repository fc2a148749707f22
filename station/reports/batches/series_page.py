"""The page of a series: every number over f-number or focus with error bars, and the best setting."""

from collections.abc import Sequence
from typing import Any

from station.calibration.series import Point
from station.common.sanitise import stated
from station.drawing.colours import INK, PLANE_COLOURS
from station.drawing.plots import Figure, finished, plot_axes, points
from station.reports.page import Figures, Note, Section, Table, html, page, plane_name, sentence

NO_BEST = "No best setting is reported: it needs photographs at two f-numbers, as recorded by the camera, or more."
CONFIDENCE = (
    "The confidence is the probability, by the points’ uncertainties, that no other aperture of the series is better; "
    "at each aperture the best focus and ISO count."
)
FILES = (
    'All points are in <a href="series.csv">series.csv</a>; both verdicts of every photograph in '
    '<a href="summary.csv">summary.csv</a>.'
)
DASHES = ("-", "--", ":", "-.")


def series_page(measured: Sequence[Point], best: Sequence[str]) -> str:
    """The page, with the best settings as sentences; photographs without a setting are only in its table."""
    axis = "focus_steps" if any(one.setting.focus_steps is not None for one in measured) else "f_number"
    titles = dict.fromkeys(one.title for one in measured if getattr(one.setting, axis) is not None)
    figures = [
        _figure([one for one in measured if one.title == title], axis, f"series{i}") for i, title in enumerate(titles)
    ]
    rows = [
        [plane_name(one.plane), one.title,
         *("—" if value is None else f"{value:g}" for value in vars(one.setting).values()),
         stated(one.value, one.uncertainty), "" if one.unit == "1" else one.unit, str(one.photographs)]
        for one in measured
    ]  # fmt: skip
    head = [
        "plane",
        "number",
        "f-number",
        "focus distance, mm",
        "ISO",
        "focus steps",
        "value ± standard uncertainty",
        "unit",
        "photographs",
    ]
    words = [sentence(one) for one in best] or [NO_BEST]
    title = "Numbers over aperture, focus and ISO"
    sections = [
        Section(title, [*words, Note(CONFIDENCE)], verdict="pass", kicker="series"),
        *([Section("", [Figures(figures)])] if figures else []),
        Section("All points", [Table(rows, head, "wwnnnnnwn"), Note(html(FILES))]),
    ]
    return page(title, sections)


def _figure(measured: Sequence[Point], axis: str, name: str) -> Figure:
    """One number over the f-number or the focus, a line for each plane and other setting, with 95 % bars."""
    lines: dict[tuple[Any, ...], list[Point]] = {}
    for one in measured:
        if getattr(one.setting, axis) is not None:
            others = (value for key, value in vars(one.setting).items() if key != axis)
            lines.setdefault((one.plane, *others), []).append(one)
    axes, stops = plot_axes(4.6, 2.9, (0.6, 0.2, 0.45, 0.12)), set[float]()
    for number, ((plane, *_), line) in enumerate(lines.items()):
        x = [getattr(one.setting, axis) for one in line]
        looks: dict[str, Any] = {
            "ls": DASHES[number // len(PLANE_COLOURS) % len(DASHES)],
            "lw": 1.1,
            "capsize": 2,
            "label": plane,
        }
        values, uncertainties = [one.value for one in line], [one.uncertainty for one in line]
        points(axes, x, values, uncertainties, colour=PLANE_COLOURS.get(plane, INK), **looks)
        stops |= set(x)
    if axis == "f_number":
        axes.set_xscale("log")
    axes.set_xticks(sorted(stops), [f"{stop:g}" for stop in sorted(stops)])
    axes.minorticks_off()
    title, unit = measured[0].title, measured[0].unit
    label = title.split(",")[0] + ("" if unit == "1" else f", {unit}")
    over = "f-number" if axis == "f_number" else "small steps of the focus ring towards infinity"
    return finished(axes, name, f"{title} over the {over}; the bars hold 95 %.", xlabel=over, ylabel=label)
