"""Vocabulary of figures: axes, curves with bands, points with error bars, pictures, arrows, legends."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from procedures.numbers import EDGE_MTF50
from procedures.numerics.arrays import Array
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome
from station.drawing.colours import FAINT, INK, MARK
from station.drawing.style import CONFIDENT, STYLE, axes_grid, colour_bar, svg

Extent = tuple[float, float, float, float]


@dataclass(frozen=True)
class Figure:
    """A drawing, an image or a table, with its caption."""

    drawing: Any
    caption: str = ""

    def __html__(self) -> str:
        """The drawing alone."""
        return str(self.drawing)


DASHED, DOTTED = (0, (3, 2)), (0, (1, 1))
BAR_RIGHT = (1.03, 0.05, 0.04, 0.9)
"""Place of a colour bar beside a picture, in fractions of the axes."""


def plot_axes(width_in: float = 3.2, height_in: float = 2.5, rim_in: Sequence[float] = (0.55, 0.14, 0.4, 0.08)) -> Axes:
    """The axes of a new figure; `rim_in` is the room for labels at the left, right, bottom and top."""
    _, ((axes,),) = axes_grid(width_in, height_in, rim_in=rim_in)
    return axes  # type: ignore[no-any-return]


def frame_axes(width_in: float, shape: tuple[int, int], rim_in: Sequence[float] = (0.08, 0.08, 0.42, 0.08)) -> Axes:
    """Axes over a frame of (rows, columns) pixels, with its outline and without ticks, y downwards."""
    rows, columns = shape
    left, right, bottom, top = rim_in
    height = (width_in - left - right) * min(rows / columns, 1.5) + bottom + top
    axes = plot_axes(width_in, height, rim_in)
    axes.add_patch(Rectangle((-0.5, -0.5), columns, rows, fill=False, ec=FAINT, lw=0.8))
    x, y = 0.01 * columns, 0.01 * rows
    bare(axes, xlim=(-x, columns + x), ylim=(rows + y, -y), aspect="equal")
    return axes


def bare(axes: Axes, **settings: Any) -> None:
    """Remove ticks and spines."""
    axes.set(xticks=[], yticks=[], **settings)
    axes.spines[:].set_visible(False)


def curve(
    axes: Axes, x: Array, y: Array, uncertainty: Array | None = None, *, colour: str = INK, shade: float = 0.25,
    width: float = 1.4, **looks: Any,
) -> None:  # fmt: skip
    """A curve with the band that holds 95 %, from its standard uncertainty."""
    if uncertainty is not None:
        low, high = y - CONFIDENT * uncertainty, y + CONFIDENT * uncertainty
        axes.fill_between(x, low, high, color=colour, alpha=shade, lw=0)
    axes.plot(x, y, color=colour, lw=width, **looks)


def points(
    axes: Axes, x: npt.ArrayLike, y: npt.ArrayLike, uncertainty: npt.ArrayLike | None = None, *, colour: str = INK,
    marker: str = "o", size: float = 3, **looks: Any,
) -> None:  # fmt: skip
    """Points with bars that hold 95 %, from their standard uncertainties."""
    bars = None if uncertainty is None else CONFIDENT * np.asarray(uncertainty, dtype=np.float64)
    axes.errorbar(x, y, bars, fmt=marker, ms=size, color=colour, **{"lw": 0.9, **looks})


def picture(
    axes: Axes, values: npt.NDArray[np.floating[Any]], *, extent: Extent | None = None, colours: Any = "viridis",
    limits: tuple[float | None, float | None] = (None, None), smooth: bool = False,
    bar: tuple[float, float, float, float] | None = None, bar_options: Mapping[str, Any] | None = None,
) -> Any:  # fmt: skip
    """A picture (rows, columns), with a colour bar at the place `bar`, which is returned."""
    image = axes.imshow(
        values, extent=extent, cmap=colours, vmin=limits[0], vmax=limits[1],
        interpolation="bilinear" if smooth else "none", zorder=0,
    )  # fmt: skip
    axes.spines[:].set_visible(False)
    return None if bar is None else colour_bar(axes, image, bar, **(bar_options or {}))


def pixel_extent(shape: tuple[int, ...], origin: tuple[float, float] = (0, 0)) -> Extent:
    """The extent of a picture (rows, columns) whose first pixel is at `origin` (x, y)."""
    (rows, columns), (x, y) = shape, origin
    return x - 0.5, x + columns - 0.5, y + rows - 0.5, y - 0.5


def arrows(axes: Axes, places: Array, moves: Array, *, longest: float, length: float, **looks: Any) -> None:
    """Arrows at places (n, 2): a move as long as `longest` is drawn `length` long, in units of the axes."""
    scale = longest / length if longest > 0 else 1.0
    axes.quiver(*places.T, *moves.T, angles="xy", scale_units="xy", scale=scale, **looks)


def legend(axes: Axes, place: Any = "upper left", **options: Any) -> None:
    """The legend of the curves with labels; none if the `handles` given are empty."""
    if not options.get("handles", True):
        return
    looks: Any = {"loc": place, "handlelength": 1.4, **options}
    with matplotlib.rc_context(STYLE):
        axes.legend(**looks)


def finished(axes: Axes, name: str, caption: str, **settings: Any) -> Figure:
    """The figure of the axes after `settings` of these; `name` is unique in the page."""
    axes.set(**settings)
    return drawn(axes.figure, name, caption)


def drawn(figure: Any, name: str, caption: str) -> Figure:
    """A figure of matplotlib as SVG, which its caption describes to those who do not see it."""
    return Figure(svg(figure, name, caption.replace("`", "")), caption)


SHOWN = 6
"""Edges drawn; record and table contain all."""
ROW_IN = 2.9


def edge_picture(plane: Plane, edges: Sequence[EdgeOutcome], unit: str = "cycles/pixel", factor: float = 1.0) -> bytes:
    """A PNG with a row for each measured edge, the best first; `factor` is one cycle per pixel in the unit."""
    shown = [(one.value, one.verdict) for one in edges if one.value is not None][:SHOWN]
    figure, axes = axes_grid(
        10, ROW_IN * len(shown), len(shown), 3, rim_in=(0.5, 0.15, 0.5, 0.3), wspace=0.22, hspace=0.8 / (ROW_IN - 0.8)
    )
    with matplotlib.rc_context(STYLE):
        for row, (edge, verdict) in zip(axes, shown, strict=True):
            _region(row[0], plane.samples, edge, str(verdict))
            row[1].plot(edge.distances, edge.esf, ".", ms=2, color=INK)
            row[1].set(xlabel="pixels from the edge", title="edge spread function")
            _transfer(row[2], edge, unit, factor)
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=100, metadata={"Software": None})
    return data.getvalue()


def _region(axes: Any, samples: npt.NDArray[np.float32], edge: EdgeMtf, verdict: str) -> None:
    roi = edge.roi
    part = samples[roi.y : roi.y + roi.height, roi.x : roi.x + roi.width]
    extent = (roi.x - 0.5, roi.x + roi.width - 0.5, roi.y + roi.height - 0.5, roi.y - 0.5)
    axes.imshow(part, cmap="gray", extent=extent, interpolation="none", vmin=0)
    x, y = edge.course.T
    axes.plot(x, y, color=MARK, lw=0.8)
    axes.set_title(f"{edge.orientation}, {edge.numbers['angle'].value:.2f} degrees: {verdict}")
    axes.locator_params(nbins=4)


def _transfer(axes: Any, edge: EdgeMtf, unit: str, factor: float) -> None:
    curve(axes, edge.frequencies * factor, edge.mtf, edge.uncertainty, width=1.2)
    axes.axvline(0.5 * factor, color=FAINT, lw=0.7)
    axes.set(xlim=(0, factor), ylim=(0, 1.05), xlabel=unit)
    if EDGE_MTF50 in edge.numbers:
        number = edge.numbers[EDGE_MTF50]
        value, spread = number.value * factor, number.uncertainty * factor
        axes.plot(value, 0.5, "o", ms=4, color=MARK)
        axes.set_title(f"MTF50 {value:.4g} ± {spread:.2g} {unit}")
