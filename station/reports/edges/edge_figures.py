"""The figures of slanted edges: where they lie, the light across them, their MTF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.patches import Rectangle

from procedures.quality import Diffraction
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome
from station.drawing.colours import MARK
from station.drawing.hover import title_along
from station.drawing.style import CONFIDENT, axes_grid, svg
from station.reports.otf_figures import FrequencyAxis, draw_diffraction, draw_others, finish_mtf

Array = npt.NDArray[np.float64]

COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a", "#8a6d1b", "#444444")
WIDEST_PX = 480
"""Larger photographs are drawn smaller."""


def places_figure(plane: Plane, edges: Sequence[EdgeOutcome], name: str) -> Markup:
    """The photograph with every edge's region and its number."""
    rows, columns = plane.samples.shape
    step = max(1, round(max(rows, columns) / WIDEST_PX))
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.4, 0.1, 0.4, 0.1))
    white = float(np.percentile(plane.samples[::step, ::step], 99.5))
    extent = (-0.5, columns - 0.5, rows - 0.5, -0.5)
    axes.imshow(plane.samples[::step, ::step], cmap="gray", vmin=0, vmax=white, extent=extent, interpolation="none")
    for number, one in enumerate(edges, 1):
        if one.roi is not None:
            x, y = one.roi.x - 0.5, one.roi.y - 0.5
            axes.add_patch(Rectangle((x, y), one.roi.width, one.roi.height, fill=False, ec=MARK, lw=1))
            axes.annotate(f"{number}", (x, y), (2, -2), textcoords="offset points", va="top", color=MARK)
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=5)
    axes.set_xlabel(f"pixels of {plane.name}")
    return svg(figure, name, "the photograph, and where its edges were measured")


def spread_figure(edges: Sequence[tuple[int, EdgeMtf]], name: str) -> Markup:
    """The edge spread functions, each between its dark and its bright plain."""
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.55, 0.14, 0.4, 0.08))
    for number, edge in edges:
        axes.plot(edge.distances, edge.esf, ".", ms=1.5, color=COLOURS[(number - 1) % len(COLOURS)])
    axes.set(xlim=(-8, 8), xlabel="pixels from the edge", ylabel="light, dark to bright")
    return svg(figure, name, "light across the edges, of every pixel beside them")


def edges_mtf_figure(
    edges: Sequence[tuple[int, EdgeMtf]], axis: FrequencyAxis, name: str, limit: Diffraction | None = None,
    others: Mapping[str, Mapping[str, Array]] | None = None,
) -> Markup:  # fmt: skip
    """The MTF of each edge with its 95 % band, in one unit; the diffraction limit and other results beside them."""
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.55, 0.14, 0.4, 0.08))
    for number, edge in edges:
        f, colour, band = edge.frequencies * axis.factor, COLOURS[(number - 1) % len(COLOURS)], CONFIDENT
        low, high = (edge.mtf + side * band * edge.uncertainty for side in (-1, 1))
        axes.fill_between(f, low, high, color=colour, alpha=0.2, lw=0)
        axes.plot(f, edge.mtf, color=colour, lw=1.2, label=f"edge {number}")
    first = edges[0][1]
    f = first.frequencies * axis.factor
    if limit is not None:
        draw_diffraction(axes, f, limit.otf(first.frequencies))
    draw_others(axes, others or {})
    title_along(axes, f, [_told(edges, i, at, axis.unit) for i, at in enumerate(f)])
    finish_mtf(axes, axis)
    axes.set(xlim=(0, float(f[-1])), xlabel=axis.unit)
    return svg(figure, name, "MTF across the edges with its 95 % bands")


def _told(edges: Sequence[tuple[int, EdgeMtf]], i: int, at: float, unit: str) -> str:
    words = (f"edge {number} {edge.mtf[i]:.3f} ± {edge.uncertainty[i]:.3f}" for number, edge in edges)
    return f"{at:.3g} {unit}: {', '.join(words)}"
