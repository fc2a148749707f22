"""The page of any measurement: verdict, numbers with uncertainties, limits, curves, provenance; and its report."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from procedures.numbers import NUMBERS, label
from procedures.outcome import Quantity
from station.common.versions import software
from station.drawing.colours import PLANE_COLOURS
from station.drawing.style import axes_grid, svg
from station.reports.page import render
from station.reports.pattern_report import (
    PlaneSheet,
    Report,
    ReportShot,
    camera_words,
    curves_over,
    exposure_lines,
)
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.result_files import RECORD


def measurement_page(found: Measurement, title: str) -> str:
    """The page of a measurement; `title` is its procedure's."""
    return render(
        "measurement.html", report=measurement_report(found, title), title=title, numbers=numbers_in_words,
        missed=found.missed or (), figures=[curve_figure(found, name) for name in _curves(found)],
    )  # fmt: skip


def measurement_report(found: Measurement, title: str, method: str = "") -> Report:
    """Contents of pages and certificates of a measurement."""
    inputs = found.head.input
    first = inputs[0].path.rpartition("/")[2] if inputs else RECORD
    return Report(
        subject=camera_words(found.exposure) or (title if first == RECORD else first),
        procedure=method or title,
        planes=[PlaneSheet(one) for one in found.planes],
        shots=[ReportShot(one.path, one.sha256) for one in inputs],
        parameters=found.head.parameters,
        conditions=exposure_lines(found.exposure),
        specification=found.terms.specification,
        software=software(),
        overlays=found.overlays,
        beside="",
    )


def numbers_in_words(plane: PlaneResult) -> list[tuple[str, Quantity]]:
    """All numbers of a plane with labels, in the order of `procedures.numbers`."""
    order = {name: at for at, name in enumerate(NUMBERS)}
    names = sorted(plane.numbers, key=lambda name: order.get(name, len(order)))
    return [(label(name, plane.unit), plane.numbers[name]) for name in names]


def _curves(found: Measurement) -> list[str]:
    """Names of the curves, which are functions of the first column."""
    names = (name for one in found.planes for name in list(one.curves)[1:] if not name.endswith("_uncertainty"))
    return list(dict.fromkeys(names))


def curve_figure(found: Measurement, name: str) -> Markup:
    """One curve of all planes with the band of two standard uncertainties, where it has one."""
    figure, ((axes,),) = axes_grid(3.6, 2.6, rim_in=(0.5, 0.1, 0.42, 0.08))
    over = ""
    for one in (plane for plane in found.planes if name in plane.curves):
        over, x = next(iter(one.curves.items()))
        colour = PLANE_COLOURS[one.name] if one.name in PLANE_COLOURS else PLANE_COLOURS["Y"]
        y, spread = one.curves[name], one.curves.get(f"{name}_uncertainty")
        axes.plot(x, y, color=colour, lw=1.2, label=one.name)
        if spread is not None:
            axes.fill_between(x, y - 2 * spread, y + 2 * spread, color=colour, alpha=0.2, lw=0)
        for other, columns in curves_over(found.overlays, one).items():
            if name in columns:
                axes.plot(columns["frequency"], columns[name], color=colour, lw=1, ls="--", label=other)
    if found.overlays:
        axes.legend(frameon=False)
    axes.set(xlabel=over.replace("_", " "), ylabel=name.replace("_", " "), xlim=(float(np.min(x)), float(np.max(x))))
    return svg(figure, f"curve-{name}", f"{name.replace('_', ' ')} over {over.replace('_', ' ')}")
