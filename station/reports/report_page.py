"""The page of any measurement: verdicts, sections of its procedure, numbers, limits, provenance."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from markupsafe import Markup

from procedures.numbers import Group, in_group
from procedures.numerics.arrays import Array
from station.drawing.colours import PLANE_COLOURS
from station.drawing.plots import Figure, curve, finished, legend, plot_axes
from station.reports.explore import ExploredPlaces, explorer
from station.reports.page import (
    Block,
    Figures,
    Heading,
    Items,
    KeyNumbers,
    Note,
    Section,
    Table,
    causes,
    exclusions,
    html,
    page,
    plane_name,
    sentence,
    shown_unit,
    small,
    tag,
    value_of,
)
from station.reports.report import Report, comparison, numbers_of_page, parameters_words
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.units import Pixels, Unit

SUMMARY_FIGURES = 3
MAX_WHOLE_ROWS = 12
"""Inputs that stay on one sheet of paper."""
DRIFT = (
    "Slopes of straight lines through the photographs that were taken from one position, ± one standard uncertainty. "
    "Time and temperature are compared one at a time: in a session in which the temperature only rises or falls, a "
    "slope per kelvin includes whatever else changed with time."
)
MAIN_NUMBERS = 5
"""Numbers that are stated with the verdict, at least, where there are so many."""
UNJUDGED = "None was given: what the lens should be is not judged."


def measurement_page(report: Report) -> str:
    """The page of a procedure without sections of its own: its curves, numbers and provenance."""
    figures = [_curve_figure(report, name) for name in _curves(report)]
    leading, rest = figures[:SUMMARY_FIGURES], figures[SUMMARY_FIGURES:]
    summary: list[Block] = [Figures(leading)] if leading else []
    return report_page(report, summary=summary, closing=[Section("Curves", [Figures(rest)])] if rest else [])


def report_page(
    report: Report,
    *,
    summary: Sequence[Block] = (),
    plane_blocks: Callable[[PlaneResult], Sequence[Block]] = lambda plane: (),
    closing: Sequence[Section] = (),
    spots: Mapping[str, ExploredPlaces] = MappingProxyType({}),
) -> str:
    """The page of a report.

    summary : blocks below the verdicts
    plane_blocks : what a plane's section shows before its numbers; the first figures for the summary are moved there
    closing : sections between those of the planes and the provenance
    spots : places of the frame that are explored, by plane
    """
    shown = [(plane, plane_blocks(plane)) for plane in report.planes]
    figures = ((plane, one) for plane, blocks in shown for one in blocks if isinstance(one, Figures) and one.summary)
    plane, one = next(figures, (None, None))
    leading: list[Block] = [Heading(plane_name(plane.name))] if plane and len(shown) > 1 else []
    leading += [one] if one else []
    sections = [_head(report, [*leading, *summary])]
    lines = (("Conditions", report.conditions), ("Devices", report.devices))
    sections += [
        Section(title, [Table([[fact.name, fact.words] for fact in facts], columns="ww", style="numbers conditions")])
        for title, facts in lines
        if facts
    ]
    for plane, blocks in shown:
        own = [*(block for block in blocks if block is not one), *_numbers(plane), *_limits(plane)]
        if own or plane.unavailable:
            name = plane_name(plane.name, tag(plane.verdict))
            words = [sentence(one) for one in plane.unavailable]
            new_page = bool(blocks) and plane is shown[0][0]  # the first page stands alone
            sections.append(Section(name, [*words, *own], new_page=new_page, anchor=f"plane-{plane.name}"))
    if report.drift:
        rows = [[one.name, one.per_hour, one.per_kelvin] for one in report.drift]
        sections.append(Section("Drift over the session", [Table(rows, ["", "per hour", "per kelvin"]), Note(DRIFT)]))
    sections += [*closing, *exclusions("Excluded inputs", report.missed, "input"), _provenance(report)]
    if report.files:
        links = [html('<a href="{}"><code>{}</code></a>', file, file) for file in report.files]
        files = html("<p>{}</p>", Markup(", ").join(links))
        sections.append(Section("The files beside this page", [files], closing=True))
    version = report.software.get("version")
    cited = (
        f"Measured with calibration-station{f' {version}' if version else ''}, procedure “{report.procedure}”; "
        "photographs and parameters as under Provenance."
    )
    method = [f"The method: {report.method}."] if report.method else []
    sections.append(Section("How to cite", [cited, *method], closing=True))
    return page(f"{report.subject}: {report.headline}", sections, explored=explorer(report, spots))


def _head(report: Report, summary: Sequence[Block]) -> Section:
    judged = report.against_specification
    rows = [
        ["Measurement", _large(report.verdict, report.measurement)],
        [
            small("Specification", report.specification),
            _large(str(report.judged or ""), judged) if judged else UNJUDGED,
        ],
    ]
    blocks: list[Block] = [Table(rows, columns="ww", style="numbers verdicts", boxed=False)]
    for plane in report.planes:
        compared = comparison(plane)
        blocks += causes(plane, plane_name(plane.name, tag(plane.verdict), Markup(" ")))
        if compared.against:
            name = plane_name(plane.name, tag(str(compared.judged or ""), str(compared.judged or "")))
            blocks.append(html("<p>{} {}</p>", name, sentence("; ".join(compared.against))))
    kicker = " · ".join(one for one in (report.title or report.procedure, report.made) if one)
    return Section(report.subject, [*blocks, *_main_numbers(report), *summary], report.verdict, kicker)


def _large(verdict: str, words: str) -> Markup:
    return html('<strong class="tag large {}">{}</strong>', verdict.replace(" ", "-"), sentence(words))


def _main_numbers(report: Report) -> list[Block]:
    """The numbers that are stated with the verdict: large for a single plane, else a table."""
    names = [name for one in report.planes for name in (*one.numbers, *one.values)]
    numbers = in_group(Group.LINE, names)
    more = [one for one in in_group(Group.HEADLINE, names) if one not in numbers]
    numbers += more[: max(MAIN_NUMBERS - len(numbers), 0)]
    if not numbers:
        return []
    first = report.planes[0]
    pixel = f" {Pixels(first.pitch).words}" if first.unit is Unit.CYCLES and first.pitch else ""
    frequencies = f"Frequencies in {first.unit}{pixel}; " if any(one.unit == Unit.CYCLES for one in numbers) else ""
    note = Note(html('<span class="own-unit">{}</span>± is one standard uncertainty.', frequencies))
    quantities = [[plane.quantity(number) for number in numbers] for plane in report.planes]
    units = [next(shown_unit(one) for one in column if one is not None) for column in zip(*quantities, strict=True)]
    labels = [Markup(", ").join(filter(None, (one.label, unit))) for one, unit in zip(numbers, units, strict=True)]
    values = [["—" if one is None else value_of(one) for one in row] for row in quantities]
    if len(report.planes) == 1:
        return [KeyNumbers(list(zip(values[0], labels, strict=True))), note]
    rows = []
    for plane, row in zip(report.planes, values, strict=True):
        judged = str(comparison(plane).judged or "")
        rows.append([plane_name(plane.name, tag(plane.verdict), tag(judged, judged)), *row])
    return [Table(rows, ["plane", *labels], style="numbers"), note]


def _numbers(plane: PlaneResult) -> list[Block]:
    """All numbers of a plane, with intervals if some have one."""
    numbers = numbers_of_page(plane)
    if not numbers:
        return []
    intervals = any(hasattr(one, "low") for _, one in numbers)
    rows = []
    for words, one in numbers:
        interval = [f"{one.low:.5g} to {one.high:.5g}".replace("-", "−") if hasattr(one, "low") else ""]
        rows.append([small(words, one.method), value_of(one), shown_unit(one), *(interval if intervals else [])])
    head = ["number", "value ± standard uncertainty", "unit", *(["95 % interval"] if intervals else [])]
    return [Heading("Numbers"), Table(rows, head, "wnun", "numbers")]


def _limits(plane: PlaneResult) -> list[Block]:
    judgements = comparison(plane).judgements
    texts = [html("{} {}", tag(str(one.judged), str(one.judged)), sentence(one.words)) for one in judgements]
    return [Heading("Against the specification"), Items(texts)] if texts else []


def _provenance(report: Report) -> Section:
    rows = [
        [small(html("<code>{}</code>", shot.file), shot.note), small(shot.exposure, shot.taken),
         html('<code class="hash">{}</code>', shot.sha256)]
        for shot in report.shots
    ]  # fmt: skip
    given = parameters_words(report.parameters)
    made = [f"calibration-station {report.software.get('version') or 'not installed'}"]
    made += [f"{name} {version}" for name, version in report.software.get("packages", {}).items()]
    took = [] if report.duration_s is None else [Note(f"time taken {report.duration_s} s")]
    blocks: list[Block] = [Table(rows, ["input", "exposure", "SHA-256"], "rrr")] if rows else []
    blocks += [Note(html("{}. ", given))] if given else []
    return Section("Provenance", [*blocks, Note(f"{', '.join(made)}."), *took], closing=len(rows) <= MAX_WHOLE_ROWS)


def _curves(report: Report) -> list[str]:
    """Names of the curves, which are functions of the first column."""
    names = (name for plane in report.planes for name in list(plane.curves)[1:] if not name.endswith("_uncertainty"))
    return list(dict.fromkeys(names))


def _curve_figure(report: Report, name: str) -> Figure:
    """One curve of all planes, with its 95 % band if it has an uncertainty."""
    axes, over = plot_axes(3.6, 2.6, (0.5, 0.1, 0.42, 0.08)), ""
    for plane in (one for one in report.planes if name in one.curves):
        over, x = next(iter(plane.curves.items()))
        colour, uncertainty = PLANE_COLOURS.get(plane.name, PLANE_COLOURS["Y"]), plane.curves.get(f"{name}_uncertainty")
        curve(axes, x, plane.curves[name], uncertainty, colour=colour, shade=0.2, width=1.2, label=plane.name)
        for other, columns in curves_over(report.overlays, plane).items():
            if name in columns:
                curve(axes, columns["frequency"], columns[name], colour=colour, width=1, ls="--", label=other)
    if report.overlays:
        legend(axes, "best")
    x_words, y_words = over.replace("_", " "), name.replace("_", " ")
    limits = (float(np.min(x)), float(np.max(x)))
    caption = f"{sentence(y_words)[:-1]} over {x_words}."
    return finished(axes, f"curve-{name}", caption, xlabel=x_words, ylabel=y_words, xlim=limits)


def curves_over(overlays: Sequence[Overlay], plane: PlaneResult) -> dict[str, Mapping[str, Array]]:
    """Curves of other results by name, of the same plane. Raises BadParameter if units differ."""
    columns = {overlay.name: overlay.of(plane.name, plane.unit) for overlay in overlays}
    return {name: column for name, column in columns.items() if column}
