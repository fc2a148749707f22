"""Results as text: MTF curves with uncertainty bands, verdicts, numbers, and the comparison of two results."""

from collections.abc import Callable, Sequence

import numpy as np

from procedures.numbers import Group, in_group
from procedures.outcome import Quantity, WithVerdict
from station.app.widgets import verdict_words
from station.common.sanitise import stated
from station.drawing.glyphs import Glyphs
from station.drawing.terminal_plots import TerminalCurve, TerminalFrame, plot
from station.results.comparison import specification_words
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult, line_numbers
from station.results.reader import Change
from station.results.terms import specification_verdict

Plotted = Callable[[int, int, bool], list[str]]

SHOWN = tuple((one, one.short) for one in in_group(Group.SCREEN))
COVERAGE = 1.96
"""Half-width of a 95 % band in standard uncertainties."""
LETTERS = "*o"


def mtf_plot(planes: Sequence[PlaneResult]) -> Plotted | None:
    """The MTF of each plane, radial or across an edge, with 95 % bands, the second dashed; None without one."""
    curves: list[TerminalCurve] = []
    for plane, letter in zip([one for one in planes if {"radial", "mtf"} & one.curves.keys()], LETTERS, strict=False):
        name = "radial" if "radial" in plane.curves else "mtf"
        band = plane.curves.get(f"{name}_uncertainty")
        dashed = bool(curves)
        wide = None if band is None else COVERAGE * band
        curves.append(TerminalCurve(plane.curves["frequency"], plane.curves[name], wide, letter=letter, dashed=dashed))
    if not curves:
        return None
    highest = max(float(np.max(curve.x)) for curve in curves)
    frame = TerminalFrame((0.0, highest), (0.0, 1.05), f"MTF, {planes[0].unit}")
    return lambda width, height, ascii: plot(curves, frame, width, height, ascii=ascii)


def specified(planes: Sequence[PlaneResult]) -> list[str]:
    """Joint verdict on the planes' specification, and the limits that are not met; empty without one."""
    judged = specification_verdict(planes)
    against = [f"{one.name}: {words}" for one in planes if one.specification for words in one.specification.against]
    return [f"Lens: {specification_words(judged)}", *against] if judged else []


def plane_in_words(plane: PlaneResult, glyphs: Glyphs) -> list[str]:
    """Verdict and causes, then the numbers with unit and uncertainty."""
    lines = [f"Plane {plane.name}: {verdict_words(plane.verdict, glyphs)}"]
    lines += [*_causes_in_words(plane), *number_lines(plane, glyphs)]
    if plane.specification is not None and plane.specification.judged is not None:
        lines.append(specification_words(plane.specification.judged).capitalize())
        lines += plane.specification.against
    return lines


def number_lines(plane: PlaneResult, glyphs: Glyphs) -> list[str]:
    """The numbers with unit and uncertainty; the group LINE where it has none of those of the screen."""
    lines = []
    for key, words in SHOWN:
        if key in plane.numbers:
            one = plane.numbers[key]
            value = stated(one.value, one.uncertainty).replace("±", glyphs.plus_minus)
            lines.append(f"{words:14} {value} {_unit(one)}")
    return lines or [glyphs.spelt(line) for line in line_numbers(plane)]


def _causes_in_words(judged: WithVerdict) -> list[str]:
    """The most likely cause with its remedy, then other possible ones."""
    others = [f"- {cause.reason}; {cause.remedy}" for cause in judged.other_causes]
    lines = [text for text in (judged.reason, judged.remedy) if text]
    return lines + (["Other possible causes:", *others] if others else [])


def restored_in_words(restoration: Measurement, glyphs: Glyphs) -> list[str]:
    """Verdict and causes of a restoration, and the range of its depth map."""
    (plane,), w = restoration.planes, restoration.entries.get("w", {})
    lines = [f"Restoration: {verdict_words(plane.verdict, glyphs)}", *_causes_in_words(plane)]
    try:
        return [*lines, f"w of the depth map: {w['least']:.4g} to {w['greatest']:.4g} {w.get('unit', '')}".rstrip()]
    except (AttributeError, KeyError, TypeError, ValueError):  # a refusal, or a damaged record
        return lines


def changes_in_words(changes: Sequence[Change], glyphs: Glyphs) -> list[str]:
    """Both values of each number, and their difference in standard uncertainties."""
    by_name = {change.name: change for change in changes}
    lines = []
    for key, words in SHOWN:
        if key in by_name:
            one = by_name[key]
            pair = " | ".join(stated(q.value, q.uncertainty) for q in (one.one, one.other))
            apart = "" if np.isnan(one.sigmas) else f"  differ by {abs(one.sigmas):.1f} sigma"
            lines.append(f"{words:14} {pair.replace('±', glyphs.plus_minus)} {_unit(one.one)}{apart}")
    return lines


def _unit(quantity: Quantity) -> str:
    return "" if quantity.unit == "1" else quantity.unit
