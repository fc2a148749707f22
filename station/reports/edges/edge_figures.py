"""Figures of slanted edges: their places, the light across them, their MTF."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from procedures.numerics.arrays import Array
from procedures.quality import Diffraction
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome
from station.drawing.colours import MARK
from station.drawing.plots import Figure, curve, finished, picture, pixel_extent, plot_axes
from station.reports.otf_figures import FrequencyAxis, finish_mtf, mtf_caption

COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a", "#8a6d1b", "#444444")
MAX_SIDE_PX = 480


def places_figure(plane: Plane, edges: Sequence[EdgeOutcome], name: str) -> Figure:
    """The photograph with every edge's region and its number."""
    step = max(1, round(max(plane.samples.shape) / MAX_SIDE_PX))
    axes, shown = plot_axes(rim_in=(0.4, 0.1, 0.4, 0.1)), plane.samples[::step, ::step]
    white = float(np.percentile(shown, 99.5))
    picture(axes, shown, extent=pixel_extent(plane.samples.shape), colours="gray", limits=(0, white))
    for number, edge in enumerate(edges, 1):
        if edge.roi is not None:
            x, y = edge.roi.x - 0.5, edge.roi.y - 0.5
            axes.add_patch(Rectangle((x, y), edge.roi.width, edge.roi.height, fill=False, ec=MARK, lw=1))
            axes.annotate(f"{number}", (x, y), (2, -2), textcoords="offset points", va="top", color=MARK)
    axes.locator_params(nbins=5)
    caption = "Where the edges were measured, the best first."
    return finished(axes, name, caption, xlabel=f"pixels of {plane.name}")


def spread_figure(edges: Sequence[tuple[int, EdgeMtf]], name: str) -> Figure:
    """The edge spread functions, each from its dark to its bright side."""
    axes = plot_axes()
    for number, edge in edges:
        axes.plot(edge.distances, edge.esf, ".", ms=1.5, color=COLOURS[(number - 1) % len(COLOURS)])
    caption = "Light over the distance from the edge, from which the MTF is computed."
    return finished(axes, name, caption, xlim=(-8, 8), xlabel="pixels from the edge", ylabel="light, dark to bright")


def edges_mtf_figure(
    edges: Sequence[tuple[int, EdgeMtf]], axis: FrequencyAxis, name: str, limit: Diffraction | None = None,
    others: Mapping[str, Mapping[str, Array]] | None = None, words: str = "the edges",
) -> Figure:  # fmt: skip
    """The MTF of the edges, which the caption calls `words`, with the diffraction limit and other results."""
    axes, f = plot_axes(), edges[0][1].frequencies
    for number, edge in edges:
        colour = COLOURS[(number - 1) % len(COLOURS)]
        looks: dict[str, Any] = {"colour": colour, "shade": 0.2, "width": 1.2, "label": f"edge {number}"}
        curve(axes, edge.frequencies * axis.factor, edge.mtf, edge.uncertainty, **looks)
    curves = {f"edge {number}": (edge.mtf, edge.uncertainty) for number, edge in edges}
    finish_mtf(axes, curves, f, axis, limit, others)
    end = float(f[-1] * axis.factor)
    caption = f"MTF across {words}; {mtf_caption(axis, limit, others)}"
    return finished(axes, name, caption, xlim=(0, end), xlabel=axis.unit)
