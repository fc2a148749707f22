"""Common parts of figures: style, axes with fixed margins, and SVG for embedding in a page. The output is reproducible
byte by byte."""

import base64
import io
import re
from collections.abc import Sequence
from html import unescape
from typing import Any

import cv2
import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogFormatterSciNotation, MaxNLocator
from PIL import Image

from station.drawing.colours import FAINT, INK

CONFIDENT = 1.96
"""Standard uncertainties on either side of a 95 % interval."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
STYLE: dict[Any, Any] = {
    "font.size": 8.5, "axes.edgecolor": FAINT, "axes.labelcolor": INK, "axes.linewidth": 0.7,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 9, "axes.titlecolor": INK,
    "xtick.color": INK, "ytick.color": INK, "xtick.major.width": 0.7, "ytick.major.width": 0.7,
    "legend.frameon": False, "image.composite_image": False, "svg.fonttype": "none",
}  # fmt: skip


def svg(figure: Figure, name: str, description: str) -> Markup:
    """A figure as an SVG element as wide as its container, with identifiers that are unique in the page.

    name : unique in the page; description : alternative text.
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
    drawn = re.sub(
        r"(?<=data:image/png;base64,)[^\"]+",
        lambda m: base64.b64encode(smaller(base64.b64decode(m[0]))).decode(),
        drawn,
    )
    drawn = re.sub(r' xmlns(?::xlink)?="[^"]*"', "", drawn).replace("xlink:href", "href")
    return Markup(drawn.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1))


class Powers(LogFormatter):
    """Powers of ten in plain characters: as formulas, matplotlib's default, they take half the time of a figure."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label of a tick: 100, 2·10⁵, 10⁻³; empty where the axis has enough of them."""
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


def axes_grid(
    width_in: float, height_in: float, rows: int = 1, columns: int = 1, *, rim_in: Sequence[float], **grid: Any
) -> tuple[Figure, Any]:
    """A figure and its axes, with a margin (left, right, bottom, top), as matplotlib's own takes as long as drawing."""
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
    return [float(tick) for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high] or [low]


COLOURS = 256


def smaller(png: bytes) -> bytes:
    """The picture with a palette, if it has few enough colours and becomes smaller; else unchanged."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 4:
        return png
    flat = np.ascontiguousarray(picture[..., [2, 1, 0, 3]]).view(np.uint32)[..., 0]
    colours, index = np.unique(flat, return_inverse=True)
    if len(colours) > COLOURS:
        return png
    image, encoded = Image.fromarray(index.reshape(flat.shape).astype(np.uint8)), io.BytesIO()
    image.putpalette(colours.tobytes(), "RGBA")
    image.save(encoded, "PNG", optimize=True)
    return min(encoded.getvalue(), png, key=len)


# `style.svg` gives each strip a <title> element, which browsers show and screen readers read.

MAX_STRIPS = 40
"""Strips of an axes: a pointer does not resolve more."""
POINT_MARK = "hover-"


def title_along(axes: Axes, x: npt.NDArray[np.float64], words: Sequence[str]) -> None:
    """Give an axes titles at places along x, each as far as halfway to the next; at most `MAX_STRIPS` of them."""
    chosen = np.unique(np.linspace(0, len(x) - 1, min(MAX_STRIPS, len(x))).round().astype(int))
    middles = (x[chosen][1:] + x[chosen][:-1]) / 2
    ends = np.concatenate([[x[chosen[0]]], middles, [x[chosen[-1]]]])
    for number, at in enumerate(chosen):
        strip = axes.axvspan(ends[number], ends[number + 1], fc="none", ec="none", lw=0, zorder=9)
        strip.set_gid(f"{POINT_MARK}{words[at]}")


def with_titles(svg: str) -> str:
    """An SVG in which every strip has its text as <title>."""
    return re.sub(
        rf'<g id="{POINT_MARK}([^"]*)">', lambda m: f'<g class="hover"><title>{escape(unescape(m[1]))}</title>', svg
    )
