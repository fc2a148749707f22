"""The page of a batch: both verdicts counted, the numbers of every item with error bars, outliers, reasons."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from procedures.numbers import label
from procedures.outcome import Quantity
from station.common.sanitise import stated
from station.drawing.colours import FAINT, INK, MARK, PLANE_COLOURS
from station.drawing.plots import DASHED, Figure, drawn, legend, points
from station.drawing.style import axes_grid, title_along
from station.reports.page import SORTABLE, Block, Figures, Note, Section, Table, html, page, plane_name, tag, unit_of
from station.reports.report_page import MAX_WHOLE_ROWS
from station.results.comparison import measurement_words
from station.results.explanation import OUTLIER, outliers

MAX_LINES = 500
"""Photographs in the page's table and figures; summary.csv has all."""
MAX_COLUMNS = 3
MAX_BINS = 40
MAX_NAME = 18
MARKERS = "osD^vPX"


@dataclass(frozen=True)
class BatchLine:
    """One item: files, both verdicts, the reason against it, its folder from the page's, camera, numbers by plane."""

    files: str
    measurement: str
    specification: str
    against: str
    folder: str
    page: bool = False
    camera: str = ""
    planes: Mapping[str, Mapping[str, Quantity]] = field(default_factory=dict)


@dataclass(frozen=True)
class NumberGroup:
    """One number of all items by a camera in a plane, in the order of the items."""

    camera: str
    plane: str
    number: str
    unit: str
    values: Sequence[float]
    uncertainties: Sequence[float]

    @property
    def key(self) -> tuple[str, str, str]:
        """Camera, plane and number."""
        return self.camera, self.plane, self.number


@dataclass(frozen=True)
class BatchReport:
    """Contents of the page.

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

    @cached_property
    def by_key(self) -> dict[tuple[str, str, str], NumberGroup]:
        """The groups by camera, plane and number."""
        return {group.key: group for group in self.groups}


MEANING = (
    f"Outliers lie more than {OUTLIER:g} robust standard deviations from the median of their camera and plane; the "
    "standard deviation is that of the values by their median absolute deviation, and their own uncertainty is added."
)
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
    names = list(dict.fromkeys(group.number for group in report.groups))[:MAX_COLUMNS]
    units = {group.number: group.unit for group in reversed(report.groups) if group.unit != "1"}
    columns = [", ".join(filter(None, (label(name), units.get(name)))) for name in names]
    head = ["files", "plane", "measurement", "specification", *columns, "why"]
    rows = [row for one in shown for row in _rows(one, names, report)]
    sections = [
        Section(report.title, summary, verdict="pass", kicker="batch"),
        *([_distributions(report)] if report.groups else []),
        Section(
            "All items",
            [
                Table(rows, head, f"rwww{'n' * len(names)}r", SORTABLE),
                Note(f"± is one standard uncertainty. {MEANING}"),
                Note(html(f"And {rest} more. {FILES}" if rest else FILES)),
            ],
            closing=len(rows) <= MAX_WHOLE_ROWS,
        ),
    ]
    return page(f"Batch: {report.count} items", sections)


def _large(counts: Sequence[tuple[str, str]]) -> Markup:
    tags = [html('<strong class="tag large {}">{}</strong>', name.replace(" ", "-"), words) for name, words in counts]
    return Markup(", ").join(tags)


def _link(line: BatchLine) -> str:
    target = f"{line.folder}/{'report.html' if line.page else 'result.json'}"
    return html('<a href="{}">{}</a>', target, line.files) if line.folder else line.files


def _rows(line: BatchLine, names: Sequence[str], report: BatchReport) -> list[list[str]]:
    """A row for each plane of an item, or one without."""
    rows = []
    for plane, numbers in line.planes.items() or [("", {})]:
        cells = [_cell(numbers.get(name), report.by_key.get((line.camera, plane, name))) for name in names]
        judged = tag(line.specification, line.specification)
        rows.append([_link(line), plane and plane_name(plane), tag(line.measurement), judged, *cells, line.against])
    return rows


def _cell(number: Quantity | None, group: NumberGroup | None) -> str:
    """A number with its uncertainty, marked if it is an outlier of its group."""
    if number is None:
        return "—"
    words = stated(number.value, number.uncertainty)
    if group is None or not outliers(group.values, [number.value], [number.uncertainty])[0]:
        return words
    return html('<strong class="outlier">{}<small>outlier</small></strong>', words)


def _distributions(report: BatchReport) -> Section:
    by_number: dict[str, list[NumberGroup]] = {}
    for group in report.groups:
        by_number.setdefault(group.number, []).append(group)
    figures = [_distribution(groups, name, report) for name, groups in by_number.items()]
    rows, several = [], len({group.camera for group in report.groups}) > 1
    for one in sorted(report.groups, key=lambda group: group.key):
        values, unit = np.asarray(one.values), "" if one.unit == "1" else one.unit
        spread = np.std(values, ddof=len(values) > 1)
        shown = [f"{value:.4g}" for value in (np.median(values), spread, values.min(), values.max())]
        count = str(np.count_nonzero(outliers(values, values, one.uncertainties)))
        row = [plane_name(one.plane), label(one.number), str(len(values)), *shown, count, unit]
        rows.append([one.camera or "—", *row] if several else row)
    head = ["plane", "number", "items", "median", "standard deviation", "least", "greatest", "outliers", "unit"]
    table = Table(rows, ["camera", *head] if several else head, f"{'r' * several}wwnnnnnnw", SORTABLE)
    title = "Distribution of the numbers"
    heading = title if several else ", ".join(filter(None, (title, report.groups[0].camera)))
    return Section(heading, [Figures(figures, wide=True), table])


def _distribution(groups: Sequence[NumberGroup], name: str, report: BatchReport) -> Figure:
    """Every item's number with its error bar in the order of the items, and beside it a histogram of all."""
    figure, ((axes, beside),) = axes_grid(
        6.0, 1.8, 1, 2, rim_in=(0.62, 0.1, 0.42, 0.12), width_ratios=(4, 1), wspace=0.04
    )  # fmt: skip
    cameras = list(dict.fromkeys(one.camera for one in groups))
    edges = np.histogram_bin_edges(np.concatenate([one.values for one in groups]), "auto")
    edges = edges if len(edges) <= MAX_BINS + 1 else np.linspace(edges[0], edges[-1], MAX_BINS + 1)
    titles: dict[int, list[str]] = {}
    for group in groups:
        colour, marker = PLANE_COLOURS.get(group.plane, INK), MARKERS[cameras.index(group.camera) % len(MARKERS)]
        measured = [
            (at, line.files, number)
            for at, line in enumerate(report.lines[:MAX_LINES], 1)
            if line.camera == group.camera and (number := line.planes.get(group.plane, {}).get(name)) is not None
        ]
        if measured:
            at, _, numbers = zip(*measured, strict=True)
            x, values, own = np.array(at), [one.value for one in numbers], [one.uncertainty for one in numbers]
            camera = textwrap.shorten(group.camera, MAX_NAME, placeholder="…") if len(cameras) > 1 else ""
            name_of_group = f"{camera} {group.plane}".strip()
            points(axes, x, values, own, colour=colour, marker=marker, ls="none", label=name_of_group)
            odd = outliers(group.values, values, own)
            axes.plot(x[odd], np.array(values)[odd], "o", ms=9, mfc="none", mec=MARK, mew=1.4)
            for place, file, number in measured:
                words = f"{group.plane} {stated(number.value, number.uncertainty)} {unit_of(number)}"
                titles.setdefault(place, [file]).append(words.strip())
        beside.hist(group.values, edges, orientation="horizontal", histtype="stepfilled", color=colour, alpha=0.35)
    for one in (axes, beside):
        for bound in report.bounds.get(name, ()):
            one.axhline(bound, color=FAINT, lw=1, ls=DASHED)
    if titles:
        title_along(axes, np.array(sorted(titles), dtype=np.float64), ["; ".join(titles[at]) for at in sorted(titles)])
    low, high = axes.get_ylim()
    axes.set(xlabel="item", ylabel="" if (unit := groups[0].unit) == "1" else unit)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    beside.set(ylim=(min(low, edges[0]), max(high, edges[-1])), xlabel="items", yticks=[])
    axes.set_ylim(beside.get_ylim())
    beside.xaxis.set_major_locator(MaxNLocator(2, integer=True))
    legend(axes, "best", handles=axes.get_legend_handles_labels()[0], fontsize=7, handlelength=0.6)
    caption = f"{label(name)}: every item with its 95 % interval, and the histogram of all; outliers are ringed"
    return drawn(
        figure,
        f"batch-{name.replace('.', '-')}",
        caption + ("; dashed, the limits." if report.bounds.get(name) else "."),
    )
