"""Figures of the rows: curves over one axis, and pictures side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from station.drawing.colours import FAINT, SERIES
from station.drawing.style import axes_grid, svg

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """y over x, both (n,); `band` is the half-width of its error band; `style` is matplotlib's."""

    label: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    style: str = "-"
    band: Array | None = None


def curves(
    name: str, curves: Sequence[Curve], *, x: str, y: str, log: str = "", published: Curve | None = None, **limits: Any
) -> Markup:
    """Curves in one plot.

    log : "x", "y" or "xy": the axes that are logarithmic
    published : drawn faint, below the others
    limits
        `xlim`, `ylim`.
    """
    figure, ((axes,),) = axes_grid(3.6, 2.7, rim_in=(0.62, 0.12, 0.45, 0.12))
    if published is not None:
        axes.plot(published.x, published.y, published.style, color=FAINT, lw=2.5, label=published.label)
    for curve, colour in zip(curves, SERIES, strict=False):
        if curve.band is not None:
            centre = np.asarray(curve.y)
            axes.fill_between(curve.x, centre - curve.band, centre + curve.band, color=colour, alpha=0.2, lw=0)
        axes.plot(curve.x, curve.y, curve.style, color=colour, lw=1.3, ms=4, label=curve.label)
    axes.set(xlabel=x, ylabel=y, **limits)
    if "x" in log:
        axes.set_xscale("log")
    if "y" in log:
        axes.set_yscale("log")
    axes.legend(fontsize=7)
    return svg(figure, name, f"{y} over {x}: {', '.join(curve.label for curve in curves)}")


def pictures(
    name: str, shown: Sequence[tuple[str, npt.NDArray[np.floating]]], *, columns: int = 4, cmap: str = "gray"
) -> Markup:
    """Grey pictures side by side, each from its least to its greatest value."""
    columns = min(columns, len(shown))
    rows = -(-len(shown) // columns)
    size = 3.6 / columns
    figure, places = axes_grid(3.6, rows * (size + 0.18), rows, columns, rim_in=(0.03, 0.03, 0.03, 0.2), hspace=0.28)
    for axes in places.flat:
        axes.axis("off")
    for axes, (title, picture) in zip(places.flat, shown, strict=False):
        axes.imshow(picture, cmap=cmap, interpolation="none")
        axes.set_title(title, fontsize=7)
    return svg(figure, name, ", ".join(title for title, _ in shown))
