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
from station.results.verdict_words import measurement_words

MAX_LINES = 500
"""Photographs in the page's table; summary.csv has all."""
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
class Sample:
    """One number of one item, with its camera."""

    camera: str
    plane: str
    number: str
    value: float
    unit: str


@dataclass(frozen=True)
class BatchReport:
    """Contents of the page.

    Attributes
    ----------
    measurements, specifications : mapping of verdict to count
    bounds : bounds of the limits by number
    """

    title: str
    measurements: Mapping[str, int]
    specifications: Mapping[str, int]
    lines: Sequence[BatchLine]
    samples: Sequence[Sample] = ()
    bounds: Mapping[str, Sequence[float]] = field(default_factory=dict)
    undone: int = 0


FILES = (
    'All items are in <a href="summary.csv">summary.csv</a>, with every number, and in '
    '<a href="results.jsonl">results.jsonl</a>.'
)


def batch_page(report: BatchReport) -> str:
    """The page as HTML with embedded figures, and links to the results."""
    shown = report.lines[:MAX_LINES]
    rest = len(report.lines) - len(shown)
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
        *([Section("Distribution by camera", _distributions(report))] if report.samples else []),
        Section(
            "All items",
            [
                Table(rows, ["files", "measurement", "specification", "why"], "rwwr"),
                Note(html(f"And {rest} more. {FILES}" if rest else FILES)),
            ],
        ),
    ]
    return page(f"Batch: {len(report.lines)} items", sections)


def _large(counts: Sequence[tuple[str, str]]) -> Markup:
    tags = [html('<strong class="tag large {}">{}</strong>', name.replace(" ", "-"), words) for name, words in counts]
    return Markup(", ").join(tags)


def _link(one: BatchLine) -> str:
    target = f"{one.folder}/{'report.html' if one.page else 'result.json'}"
    return html('<a href="{}">{}</a>', target, one.files) if one.folder else one.files


def _groups(samples: Sequence[Sample]) -> dict[tuple[str, str, str], list[Sample]]:
    """Samples by camera, plane and number."""
    groups: dict[tuple[str, str, str], list[Sample]] = {}
    for one in samples:
        groups.setdefault((one.camera, one.plane, one.number), []).append(one)
    return groups


def _distributions(report: BatchReport) -> list[Block]:
    names = dict.fromkeys(one.number for one in report.samples)
    figures = [_distribution([one for one in report.samples if one.number == name], name, report) for name in names]
    rows = []
    for (camera, plane, number), group in sorted(_groups(report.samples).items()):
        values, unit = np.array([one.value for one in group]), group[0].unit
        shown = [f"{one:.4g}" for one in (np.median(values), values.min(), values.max())]
        rows.append(
            [camera or "—", plane_name(plane), label(number), str(len(group)), *shown, "" if unit == "1" else unit]
        )
    head = ["camera", "plane", "number", "photographs", "median", "least", "greatest", "unit"]
    return [Figures(figures), Table(rows, head, "rwwnnnnw")]


def _distribution(samples: Sequence[Sample], name: str, report: BatchReport) -> Figure:
    """Every item's number as a point, a row for each camera and plane, with the medians and the limits."""
    groups, unit = _groups(samples), samples[0].unit
    several = len({camera for camera, *_ in groups}) > 1
    axes = plot_axes(4.6, 0.9 + 0.28 * len(groups), (1.6 if several else 0.4, 0.25, 0.42, 0.08))
    for row, ((_, plane, _), group) in enumerate(groups.items()):
        values = np.array([one.value for one in group])
        axes.plot(values, np.full(len(values), row), "|", ms=9, mew=1, color=PLANE_COLOURS.get(plane, INK), alpha=0.7)
        axes.plot(np.median(values), row, "o", ms=4, color=INK)
    for bound in report.bounds.get(name, ()):
        axes.axvline(bound, color=FAINT, lw=1, ls=DASHED)
    labels = [f"{textwrap.shorten(camera, MAX_NAME, placeholder='…')} {plane}".strip() if several else plane
              for camera, plane, _ in groups]  # fmt: skip
    axes.set_yticks(range(len(groups)), labels)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    caption = f"{label(name)}: a stroke for each photograph, a point for their median"
    caption += "; dashed, the limits." if report.bounds else "."
    settings = {"ylim": (len(groups) - 0.5, -0.5), "xlabel": unit if unit != "1" else ""}
    return finished(axes, f"batch-{name.replace('.', '-')}", caption, **settings)
