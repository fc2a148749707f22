"""What all drawings share: style, axes with told rims, and SVG that stands inside a page.

The same numbers give the same bytes.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from typing import Any

import matplotlib
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogFormatterSciNotation, MaxNLocator

from station.drawing.colours import FAINT, INK
from station.drawing.hover import with_titles
from station.drawing.palette_png import smaller

CONFIDENT = 1.96
"""Standard uncertainties on either side that hold 95 %."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "image.composite_image": False,
    "svg.fonttype": "none",
}


def svg(figure: Figure, name: str, description: str) -> Markup:
    """A figure as an SVG element as wide as its place, its parts named so that no other figure's are mistaken for them.

    Parameters
    ----------
    name : str
        Unique in the page.
    description : str
        What it shows, for those who do not see it.
    """
    _write_powers_plainly(figure)
    text = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata=nothing, transparent=True)
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = with_titles(re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.S))
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', drawn))
    drawn = re.sub(r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", drawn)
    drawn = re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", drawn)
    drawn = re.sub(r'(?<= d=")[^"]+', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), drawn)
    drawn = re.sub(r' (?:width|height)="[\d.]+pt"', "", drawn, count=2)
    drawn = re.sub(r"(?<=data:image/png;base64,)[^\"]+", lambda m: _smaller(m[0]), drawn)
    drawn = re.sub(r' xmlns(?::xlink)?="[^"]*"', "", drawn).replace("xlink:href", "href")
    return Markup(drawn.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1))


class Powers(LogFormatter):
    """Powers of ten in plain characters: as formulas, as matplotlib writes them, they take half of a figure's time."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The tick's label: 100, 2·10⁵, 10⁻³; none where the axis has enough of them."""
        digits, _, power = super().__call__(x, pos).replace("−", "-").partition("e")
        if not power:
            return digits
        return ("" if digits == "1" else f"{digits}·") + "10" + str(int(power)).translate(RAISED)


def _write_powers_plainly(figure: Figure) -> None:
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
                axis.set_major_formatter(Powers())
                axis.set_minor_formatter(Powers())


def _smaller(encoded: str) -> str:
    return base64.b64encode(smaller(base64.b64decode(encoded))).decode()


def axes_grid(
    width_in: float, height_in: float, rows: int = 1, columns: int = 1, *, rim_in: Sequence[float], **grid: Any
) -> tuple[Figure, Any]:
    """A figure and its axes, with a rim (left, right, bottom, top) for labels.

    The rim is told because finding it out takes matplotlib as long as drawing.
    """
    left, right, bottom, top = rim_in
    place = {"left": left / width_in, "right": 1 - right / width_in}
    place |= {"bottom": bottom / height_in, "top": 1 - top / height_in}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in))
        return figure, figure.subplots(rows, columns, gridspec_kw={**place, **grid}, squeeze=False)


def colour_bar(axes: Axes, image: Any, place: tuple[float, float, float, float], **options: Any) -> Any:
    """A colour bar at a place (x, y, width, height) in fractions of the axes."""
    with matplotlib.rc_context(STYLE):
        bar = axes.figure.colorbar(image, cax=axes.inset_axes(place), **options)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)
    return bar


def few_ticks(low: float, high: float) -> list[float]:
    """At most five round numbers between two, for the ticks of a bar; where there are none, the first of the two."""
    return [float(one) for one in MaxNLocator(4).tick_values(low, high) if low <= one <= high] or [low]
