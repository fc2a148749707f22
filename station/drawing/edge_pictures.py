"""Picture of measured edges: position, edge spread function, MTF with a 95 % band."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt

from procedures.numbers import EDGE_MTF50
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome
from station.drawing.colours import FAINT, INK, MARK
from station.drawing.style import CONFIDENT, STYLE, axes_grid

SHOWN = 6
"""Edges drawn; record and table contain all."""
ROW_IN = 2.9
"""Height of a row, in inches."""


def edge_picture(plane: Plane, edges: Sequence[EdgeOutcome], unit: str = "cycles/pixel", factor: float = 1.0) -> bytes:
    """A PNG with a row for each measured edge, the best first; `factor` is one cycle per pixel in the unit."""
    shown = [(one.value, one.verdict) for one in edges if one.value is not None][:SHOWN]
    figure, axes = axes_grid(
        10, ROW_IN * len(shown), len(shown), 3, rim_in=(0.5, 0.15, 0.5, 0.3), wspace=0.22, hspace=0.8 / (ROW_IN - 0.8)
    )
    with matplotlib.rc_context(STYLE):
        for row, (edge, verdict) in zip(axes, shown, strict=True):
            _region(row[0], plane.samples, edge, str(verdict))
            _spread(row[1], edge)
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


def _spread(axes: Any, edge: EdgeMtf) -> None:
    axes.plot(edge.distances, edge.esf, ".", ms=2, color=INK)
    axes.set(xlabel="pixels from the edge", title="edge spread function")


def _transfer(axes: Any, edge: EdgeMtf, unit: str, factor: float) -> None:
    f = edge.frequencies * factor
    band = CONFIDENT * edge.uncertainty
    axes.fill_between(f, edge.mtf - band, edge.mtf + band, color=INK, alpha=0.25, lw=0)
    axes.plot(f, edge.mtf, color=INK, lw=1.2)
    axes.axvline(0.5 * factor, color=FAINT, lw=0.7)
    axes.set(xlim=(0, factor), ylim=(0, 1.05), xlabel=unit)
    if EDGE_MTF50 in edge.numbers:
        number = edge.numbers[EDGE_MTF50]
        value, spread = number.value * factor, number.uncertainty * factor
        axes.plot(value, 0.5, "o", ms=4, color=MARK)
        axes.set_title(f"MTF50 {value:.4g} ± {spread:.2g} {unit}")
