"""The figures of a field's page: maps over the frame, the mosaic of PSFs, the places and the lens's axis."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Polygon, Rectangle

from procedures.field.maps import FieldMap, LateralColour
from procedures.field.models import SymmetryAxis
from procedures.numbers import ASTIGMATISM, COLOUR_SHADING, FOCUS, without_photosite
from procedures.numerics.arrays import Array
from procedures.numerics.scattered import Hull
from procedures.psf_field import PsfField
from station.drawing.colours import FAINT, INK, MARK, PLANE_COLOURS
from station.drawing.plots import (
    BAR_RIGHT,
    Figure,
    arrows,
    bare,
    drawn,
    finished,
    frame_axes,
    legend,
    picture,
    plot_axes,
)
from station.drawing.style import axes_grid, few_ticks

MOSAIC = 7
NINETY_FIVE = 2.448
"""Radius of the ellipse that holds 95 % of a Gaussian in the plane, in standard deviations."""
ERRORS = "YlOrBr"
SIGNED = (ASTIGMATISM, without_photosite(ASTIGMATISM), FOCUS["astigmatism"], "lateral_colour_radial",
          "lateral_colour_tangential", COLOUR_SHADING)  # fmt: skip
"""Maps whose zero is the middle of the colours."""


@dataclass(frozen=True, eq=False)
class _Panel:
    """One picture of a map: its title, the values and their limits, colours, unit."""

    title: str
    values: Array
    limits: tuple[float, float]
    colours: str
    unit: str


def field_map_figure(
    one: FieldMap, nodes: Array, shape: tuple[int, int], name: str, caption: str, mm_per_pixel: float | None = None
) -> Figure:
    """A map and its standard uncertainty side by side, the nodes as dots; axes in mm of image height if known."""
    unit = "" if one.unit == "1" else one.unit
    panels = [_Panel(one.title, one.value, _limits(one), "RdBu_r" if one.name in SIGNED else "viridis", unit)]
    if one.uncertainty is not None:
        panels.append(_Panel("standard uncertainty", one.uncertainty, _from_zero(one.uncertainty), ERRORS, unit))
    return _panels(panels, one, nodes, shape, name, caption, mm_per_pixel)


def errors_figure(
    maps: Sequence[FieldMap], nodes: Array, shape: tuple[int, int], name: str, mm_per_pixel: float | None = None
) -> Figure:
    """The predicted errors side by side, each in its own scale."""
    panels = [_Panel(one.title, one.value, _from_zero(one.value), ERRORS, one.unit) for one in maps]
    caption = "Predicted error of the PSF over its norm: from noise, and from interpolation between the nodes."
    return _panels(panels, maps[0], nodes, shape, name, caption, mm_per_pixel)


def _panels(
    panels: Sequence[_Panel],
    places: FieldMap,
    nodes: Array,
    shape: tuple[int, int],
    name: str,
    caption: str,
    mm_per_pixel: float | None,
) -> Figure:
    (rows, columns), width = shape, 3.2
    top_in = 0.3 if not any("\n" in _title(one) for one in panels) else 0.45
    figure, axes_of = axes_grid(
        width * len(panels), width * 0.72 * min(rows / columns, 1.5) + 0.42 + top_in, 1, len(panels),
        rim_in=(0.42, 0.72, 0.44, top_in), wspace=0.5,
    )  # fmt: skip
    x, y = places.x, places.y
    extent = (x[0] - _step(x), x[-1] + _step(x), y[-1] + _step(y), y[0] - _step(y))
    for axes, panel in zip(axes_of[0], panels, strict=True):
        ticks = few_ticks(*panel.limits)
        bar = picture(
            axes, panel.values, extent=extent, colours=panel.colours, limits=panel.limits, bar=BAR_RIGHT,
            bar_options={"ticks": ticks},
        )  # fmt: skip
        bar.ax.set_yticklabels([f"{tick:.3g}".replace("-", "−") for tick in ticks])
        axes.plot(*nodes.T, ".", color=INK, ms=2)
        if places.enclosed is not None:
            axes.add_patch(Polygon(Hull(nodes).rim, fill=False, ec=INK, lw=0.5, ls=":"))
        axes.add_patch(Rectangle((-0.5, -0.5), columns, rows, fill=False, ec=FAINT, lw=0.8))
        axes.set(xlim=(-1, columns), ylim=(rows, -1))
        if panel is panels[0]:  # the others are as wide and high, and every tick takes time to draw
            _heights(axes, shape, mm_per_pixel)
        else:
            axes.set(xticks=[], yticks=[])
        axes.set_title(_title(panel), fontsize=9)
    return drawn(figure, name, caption)


def _title(panel: _Panel) -> str:
    """Title and unit, in two lines where one is wider than the panel."""
    words = f"{panel.title}, {panel.unit}" if panel.unit else panel.title
    return words.replace(", without", ",\nwithout")


def _heights(axes: Axes, shape: tuple[int, int], mm_per_pixel: float | None) -> None:
    """Ticks along both axes from the frame's centre: mm of image height where the pitch is known, else pixels."""
    scale = mm_per_pixel or 1.0
    for axis, size in ((axes.xaxis, shape[1]), (axes.yaxis, shape[0])):
        half = scale * size / 2
        step = next(one for power in range(-3, 6) for one in (10.0**power * n for n in (1, 2, 5)) if 3 * one >= half)
        ticks = [one * step for one in range(-3, 4) if abs(one * step) <= half]
        axis.set_ticks([(size - 1) / 2 + tick / scale for tick in ticks], [f"{abs(tick):g}" for tick in ticks])
    axes.tick_params(length=2)
    axes.set_xlabel(f"from the frame's centre, {'mm' if mm_per_pixel else 'pixels of the plane'}")


def _step(values: Array) -> float:
    return float(values[1] - values[0]) / 2 if len(values) > 1 else 0.5


def _most(values: Array) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else 1.0


def _from_zero(errors: Array) -> tuple[float, float]:
    """From none to a little over the greatest, so that an even error is no dark picture."""
    return 0.0, 1.3 * _most(errors)


def _limits(one: FieldMap) -> tuple[float, float]:
    """From the least value to the greatest; as far below zero as above it where the sign matters."""
    if not np.isfinite(one.value).any():
        return 0.0, 1.0
    if one.name in SIGNED:
        most = _most(np.abs(one.value))
        return -most, most
    return float(np.nanmin(one.value)), _most(one.value)


def mosaic_figure(field: PsfField, name: str) -> Figure:
    """The PSF at equally spaced places between the nodes, all in one scale."""
    (x0, y0), (x1, y1) = field.positions.min(axis=0), field.positions.max(axis=0)
    rows = int(np.clip(round(MOSAIC * (y1 - y0) / max(x1 - x0, 1e-9)), 2, 2 * MOSAIC))
    x, y = np.linspace(x0, x1, MOSAIC), np.linspace(y0, y1, rows)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    tiles = np.pad(field.samples(points), ((0, 0), (0, 1), (0, 1)), constant_values=np.nan)
    side = field.k + 1
    mosaic = tiles.reshape(rows, MOSAIC, side, side).transpose(0, 2, 1, 3).reshape(rows * side, MOSAIC * side)
    axes = plot_axes(6.0, 6.0 * rows / MOSAIC + 0.1, (0.05, 0.05, 0.05, 0.05))
    picture(axes, np.sqrt(np.maximum(mosaic, 0))[:-1, :-1])  # the root shows faint flare, which distinguishes coma
    bare(axes)
    caption = (
        f"The PSF of {field.plane} from the first nodes to the last: the square root of the samples, which shows faint "
        "flare, all in one scale. Maps and numbers are of the whole PSF, with the light outside the support."
    )
    return finished(axes, name, caption)


def places_figure(field: PsfField, axis: SymmetryAxis | None, name: str) -> Figure:
    """The frame, the nodes and their hull, and the axis of the lens with its 95 % ellipse."""
    (rows, columns), colour = field.shape, PLANE_COLOURS[field.plane]
    axes = frame_axes(4.4, field.shape, (0.08, 0.08, 0.4, 0.08))
    axes.fill(*field.hull.rim.T, fc=colour, alpha=0.1, lw=0)
    axes.plot(*field.positions.T, ".", color=colour, ms=5, label="nodes")
    centre = np.array([columns - 1, rows - 1]) / 2
    axes.plot(*centre, "+", color=FAINT, ms=10, label="frame's centre")
    if axis is not None:
        half = np.hypot(rows, columns) / 2
        at = centre + half * axis.position
        values, vectors = np.linalg.eigh(axis.covariance)
        width, height = 2 * NINETY_FIVE * half * np.sqrt(np.maximum(values, 0))
        turn = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        axes.add_patch(Ellipse((at[0], at[1]), width, height, angle=turn, fill=False, ec=MARK, lw=1.2))
        axes.plot(*at, "x", color=MARK, ms=6, label="lens's axis, 95 %")
    legend(axes, "upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, fontsize=7.5, handletextpad=0.3, handlelength=2)
    caption = (
        "Where it was measured. The axis is the centre of symmetry of the PSFs: off the frame’s centre if the lens is "
        "decentred."
    )
    return finished(axes, name, caption)


def colour_figure(colour: LateralColour, name: str) -> Figure:
    """Lateral colour as arrows at the charts: measured, and of the fitted surface in grey."""
    axes, (fitted, _) = frame_axes(3.6, colour.shape, (0.08, 0.08, 0.25, 0.08)), colour.at(colour.positions)
    longest = float(np.linalg.norm(colour.shift, axis=1).max())
    for moves, shade in ((fitted, FAINT), (colour.shift, PLANE_COLOURS[colour.plane])):
        length = 0.1 * colour.shape[1]
        arrows(axes, colour.positions, moves, longest=longest, length=length, width=0.006, color=shade)
    degree = colour.surface.degree
    caption = f"{colour.plane} against {colour.reference}: measured, and in grey the fitted surface of degree {degree}."
    return finished(axes, name, caption, xlabel=f"longest arrow: {longest:.3f} sensor pixel")
