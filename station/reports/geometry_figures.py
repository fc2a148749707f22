"""The figures of a geometry's page: what is known of the frame, what the lens does, what is left over, the chart."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon, Rectangle
from matplotlib.path import Path

from procedures.geometry.cameras import Camera
from procedures.geometry.estimate import Geometry, PosedView, UncertaintyMap
from procedures.geometry.views import chart_nodes
from procedures.pattern_psf.correspondences import BINS
from station.drawing.colours import ALONG, FAINT, INK, MARK
from station.drawing.style import STYLE, axes_grid, colour_bar, svg

Array = npt.NDArray[np.float64]

WIDTH_IN = 4.4
ARROWS = (19, 13)
"""Columns and rows of arrows over the frame."""
LONGEST = 0.05
"""Of the frame's width: the longest arrow."""


def _frame(camera: Camera, below_in: float = 0.42, right_in: float = 0.08) -> tuple[Figure, Axes]:
    """Axes over the frame, as the photograph shows it."""
    height = WIDTH_IN * min(camera.rows / camera.columns, 1.5)
    figure, ((axes,),) = axes_grid(WIDTH_IN + right_in, height + below_in, rim_in=(0.08, right_in, below_in, 0.08))
    axes.add_patch(Rectangle((-0.5, -0.5), camera.columns, camera.rows, fill=False, ec=FAINT, lw=0.8))
    w, h = camera.columns, camera.rows
    axes.set(xlim=(-0.01 * w, 1.01 * w), ylim=(1.01 * h, -0.01 * h), xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    return figure, axes


def coverage_figure(found: Geometry, name: str) -> Markup:
    """Where the charts were seen, and the outline of what they covered."""
    figure, axes = _frame(found.camera)
    for i, one in enumerate(found.views):
        axes.add_artist(_dots(one.view.points, ec=f"C{i}", lw=0.8, alpha=0.6))
    axes.add_patch(Polygon(found.region, fill=False, ec=INK, lw=1.0))
    axes.plot(*found.camera.centre, "+", color=MARK, ms=10, mew=1.4)
    axes.set_xlabel(f"{found.points} points of {len(found.views)} views; + the principal point")
    return svg(figure, name, "where the charts were seen in the frame")


def _dots(points: Array, **looks: Any) -> PathPatch:
    """Points (n, 2) as one path of lines without length and with round ends: markers take four times the page."""
    path = Path(np.repeat(points, 2, axis=0), np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    return PathPatch(path, fill=False, capstyle="round", **looks)


def uncertainty_figure(found: Geometry, one: UncertaintyMap, name: str) -> Markup:
    """The projection's uncertainty over the frame at one distance."""
    figure, axes = _frame(found.camera, right_in=0.75)
    top = float(np.nanpercentile(one.value, 98)) if np.isfinite(one.value).any() else 1.0
    half_x, half_y = (one.x[1] - one.x[0]) / 2, (one.y[1] - one.y[0]) / 2
    extent = (one.x[0] - half_x, one.x[-1] + half_x, one.y[-1] + half_y, one.y[0] - half_y)
    image = axes.imshow(one.value, cmap="YlOrBr", vmin=0, vmax=top, extent=extent, interpolation="bilinear", zorder=0)
    axes.add_patch(Polygon(found.region, fill=False, ec=INK, lw=0.8, ls="--"))
    colour_bar(figure, axes, image, (1.02, 0.05, 0.03, 0.9))
    axes.set_xlabel("pixels, root mean square; dashed: covered by charts")
    return svg(figure, name, "uncertainty of the projection over the frame")


def _arrows(camera: Camera, places: Array, moves: Array, name: str, words: str, unit: str, colour: str) -> Markup:
    """Arrows at places of the frame, their longest one told."""
    figure, axes = _frame(camera)
    longest = float(np.nanmax(np.linalg.norm(moves, axis=1)))
    scale = longest / (LONGEST * camera.columns) if longest > 0 else 1.0
    axes.quiver(
        *places.T, *moves.T, angles="xy", scale_units="xy", scale=scale, width=0.0025, color=colour, headwidth=4
    )
    axes.set_xlabel(f"longest arrow: {longest:.3g} {unit}")
    return svg(figure, name, words)


def distortion_figure(found: Geometry, places: Array, moved: Array, name: str) -> Markup:
    """Where the lens puts things, from where a pinhole would."""
    words = "distortion: from where a pinhole would have things to where the lens has them"
    return _arrows(found.camera, places - moved, moved, name, words, "pixel", INK)


def misfit_figure(found: Geometry, name: str) -> Markup:
    """Systematic residual of the model, within the covered part of the frame."""
    places = found.camera.frame_grid(*ARROWS)
    path = matplotlib.path.Path(found.region)
    places = places[path.contains_points(places)]
    words = "systematic residual of the camera model"
    return _arrows(found.camera, places, found.misfit.at(places), name, words, "pixel", ALONG["vertical"])


def residual_figure(found: Geometry, one: PosedView, name: str) -> Markup:
    """What a view's points leave over."""
    words = f"residuals of {one.view.source}"
    return _arrows(found.camera, one.view.points, one.residual_px, name, words, "pixel", INK)


def chart_figure(found: Geometry, name: str) -> Markup:
    """The chart's own errors in its plane as arrows, its bending as colours."""
    figure, ((axes,),) = axes_grid(4.4, 4.2, rim_in=(0.08, 0.75, 0.42, 0.08))
    deviations = found.shape.deviations_mm
    plan = chart_nodes(1.0)[:, :2]
    half = float(plan.max()) * (1 + 1 / BINS)
    bend = deviations[:, 2].reshape(BINS, BINS)
    most = max(float(np.abs(bend).max()), 1e-6)
    image = axes.imshow(
        bend, cmap="RdBu_r", vmin=-most, vmax=most, extent=(-half, half, half, -half), interpolation="none"
    )
    longest = float(np.linalg.norm(deviations[:, :2], axis=1).max())
    options: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "width": 0.003, "color": INK}
    axes.quiver(*plan.T, *deviations[:, :2].T, scale=max(longest, 1e-9) / (0.12 * half), **options)
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    with matplotlib.rc_context(STYLE):
        colour_bar(figure, axes, image, (1.03, 0.05, 0.04, 0.9))
    axes.set_xlabel(f"longest arrow {longest:.3f} mm; colours: away from the camera, mm")
    return svg(figure, name, "the chart's deviation from its plan")
