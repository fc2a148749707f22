"""The page of a batch: both verdicts counted, what is wrong with which photograph, and the numbers by camera."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from procedures.numbers import label
from station.drawing.colours import FAINT, INK, PLANE_COLOURS
from station.drawing.plots import DASHED, Figure, finished, plot_axes
from station.reports.page import Block, Figures, Note, Section, Table, html, page, plane_name, tag
from station.results.plane_result import measurement_words

MAX_LINES = 500
"""Photographs in the page's table; summary.csv has all."""
MAX_STROKES = 1000
"""Strokes of a group in a figure."""
MAX_NAME = 18
"""Characters of a camera's name beside a figure."""


@dataclass(frozen=True)
class BatchLine:
    """One item: its files, both verdicts, the reason against it, and its folder, from the page's."""

    files: str
    measurement: str
    specification: str
    against: str
    folder: str
    page: bool = False


@dataclass(frozen=True)
class NumberGroup:
    """One number of all items by a camera in a plane, in the order of the items."""

    camera: str
    plane: str
    number: str
    unit: str
    values: Sequence[float]


@dataclass(frozen=True)
class BatchReport:
    """Contents of the page.

    Attributes
    ----------
    measurements, specifications : mapping of verdict to count
    lines : the first items, at most `MAX_LINES`; count : of all
    bounds : bounds of the limits by number
    """

    title: str
    measurements: Mapping[str, int]
    specifications: Mapping[str, int]
    lines: Sequence[BatchLine]
    count: int
    groups: Sequence[NumberGroup] = ()
    bounds: Mapping[str, Sequence[float]] = field(default_factory=dict)
    undone: int = 0


FILES = (
    'All items are in <a href="summary.csv">summary.csv</a>, with every number, and in '
    '<a href="results.jsonl">results.jsonl</a>.'
)


def batch_page(report: BatchReport) -> str:
    """The page as HTML with embedded figures, and links to the results."""
    shown = report.lines[:MAX_LINES]
    rest = report.count - len(shown)
    measurements = [(one, f"{count} {measurement_words(one)}") for one, count in report.measurements.items()]
    specifications = [(one, f"{count} {one}") for one, count in report.specifications.items()]
    missing = "None was given: what the lenses should be is not judged."
    counts = [
        ["Measurements", _large(measurements)],
        ["Specification", _large(specifications) if specifications else missing],
    ]
    undone = [f"{report.undone} were not begun before the batch was stopped."] if report.undone else []
    summary: list[Block] = [Table(counts, columns="ww", style="numbers verdicts", boxed=False), *undone]
    rows = [
        [_link(one), tag(one.measurement), tag(one.specification, one.specification), one.against] for one in shown
    ]  # fmt: skip
    sections = [
        Section(report.title, summary, verdict="pass", kicker="batch"),
        *([Section("Distribution by camera", _distributions(report))] if report.groups else []),
        Section(
            "All items",
            [
                Table(rows, ["files", "measurement", "specification", "why"], "rwwr"),
                Note(html(f"And {rest} more. {FILES}" if rest else FILES)),
            ],
        ),
    ]
    return page(f"Batch: {report.count} items", sections)


def _large(counts: Sequence[tuple[str, str]]) -> Markup:
    tags = [html('<strong class="tag large {}">{}</strong>', name.replace(" ", "-"), words) for name, words in counts]
    return Markup(", ").join(tags)


def _link(one: BatchLine) -> str:
    target = f"{one.folder}/{'report.html' if one.page else 'result.json'}"
    return html('<a href="{}">{}</a>', target, one.files) if one.folder else one.files


def _distributions(report: BatchReport) -> list[Block]:
    by_number: dict[str, list[NumberGroup]] = {}
    for group in report.groups:
        by_number.setdefault(group.number, []).append(group)
    figures = [_distribution(groups, name, report) for name, groups in by_number.items()]
    rows = []
    for one in sorted(report.groups, key=lambda group: (group.camera, group.plane, group.number)):
        values, unit = np.asarray(one.values), "" if one.unit == "1" else one.unit
        shown = [f"{value:.4g}" for value in (np.median(values), values.min(), values.max())]
        rows.append([one.camera or "—", plane_name(one.plane), label(one.number), str(len(values)), *shown, unit])
    head = ["camera", "plane", "number", "photographs", "median", "least", "greatest", "unit"]
    return [Figures(figures), Table(rows, head, "rwwnnnnw")]


def _strokes(values: np.ndarray) -> np.ndarray:
    """All values, or as many of their quantiles as the figure can resolve."""
    return values if len(values) <= MAX_STROKES else np.quantile(values, np.linspace(0, 1, MAX_STROKES))


def _distribution(groups: Sequence[NumberGroup], name: str, report: BatchReport) -> Figure:
    """Every item's number as a point, a row for each camera and plane, with the medians and the limits."""
    unit = groups[0].unit
    several = len({one.camera for one in groups}) > 1
    axes = plot_axes(4.6, 0.9 + 0.28 * len(groups), (1.6 if several else 0.4, 0.25, 0.42, 0.08))
    for row, one in enumerate(groups):
        values = np.asarray(one.values)
        color = PLANE_COLOURS.get(one.plane, INK)
        strokes = _strokes(values)
        axes.plot(strokes, np.full(len(strokes), row), "|", ms=9, mew=1, color=color, alpha=0.7)
        axes.plot(np.median(values), row, "o", ms=4, color=INK)
    for bound in report.bounds.get(name, ()):
        axes.axvline(bound, color=FAINT, lw=1, ls=DASHED)
    labels = [f"{textwrap.shorten(one.camera, MAX_NAME, placeholder='…')} {one.plane}".strip() if several else one.plane
              for one in groups]  # fmt: skip
    axes.set_yticks(range(len(groups)), labels)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    each = "each photograph" if max(len(one.values) for one in groups) <= MAX_STROKES else f"{MAX_STROKES} quantiles"
    caption = f"{label(name)}: a stroke for {each}, a point for their median"
    caption += "; dashed, the limits." if report.bounds else "."
    settings = {"ylim": (len(groups) - 0.5, -0.5), "xlabel": unit if unit != "1" else ""}
    return finished(axes, f"batch-{name.replace('.', '-')}", caption, **settings)
