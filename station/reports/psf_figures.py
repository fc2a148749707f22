"""Figures of PSFs and of the photographs they come from; those of transfer functions are in `otf_figures`."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from procedures.pattern import BLOCK, BLOCKS, CELLS
from procedures.pattern_psf.estimate import PatternPsf
from procedures.pattern_psf.registration import Registration
from procedures.psf import Psf
from procedures.raw import Plane
from procedures.transfer_function import RadialProfile
from station.drawing.colours import ALONG, FAINT, INK, MARK, PLANE_COLOURS
from station.drawing.plots import (
    DASHED,
    Figure,
    bare,
    curve,
    drawn,
    finished,
    frame_axes,
    legend,
    picture,
    pixel_extent,
    plot_axes,
)
from station.drawing.style import CONFIDENT, STYLE, axes_grid

Array = npt.NDArray[np.float64]

SURROUND_CELLS = 20
RESIDUAL_LIMIT = 4.0
"""Residuals are drawn from minus to plus this many standard deviations of the noise."""
ODD_COLOURS = matplotlib.colormaps["RdBu_r"].resampled(255)
"""An odd number of colours: zero has one of its own."""
MAX_SIDE_PX = 480
MIN_POWER = -5.0
"""Lowest power of ten of its peak to which a PSF is drawn."""
BELOW = (0, -0.27, 1, 0.045)


def _square(registration: Registration, low: float, high: float) -> Array:
    """A square of the chart on the plane, its sides subdivided, closed, (n, 2)."""
    t = np.linspace(low, high, 17)
    a, b = np.full_like(t, low), np.full_like(t, high)
    sides = [(t, a), (b, t), (t[::-1], b), (a, t[::-1])]
    return registration.to_sensor(np.concatenate([np.column_stack(side) for side in sides]))


def chart_outline(estimate: PatternPsf) -> Array:
    """The outline of the chart's frame, closed, (n, 2), in pixels of the plane."""
    return _square(estimate.registration, -BLOCK, BLOCK * (BLOCKS - 1))


def photograph_figure(plane: Plane, estimate: PatternPsf, name: str) -> Figure:
    """The chart as photographed, with the detected marks and the outline of the noise."""
    around = _square(estimate.registration, -BLOCK - SURROUND_CELLS, BLOCK * (BLOCKS - 1) + SURROUND_CELLS)
    limit = np.array(plane.samples.shape[::-1])
    (x0, y0), (x1, y1) = (np.clip(v.astype(int), 0, limit) for v in (around.min(axis=0), around.max(axis=0)))
    crop, axes = plane.samples[y0:y1, x0:x1], plot_axes(3.2, 3.2, (0.42, 0.1, 0.42, 0.1))
    white = float(np.quantile(crop, 0.995))
    picture(axes, crop, extent=pixel_extent(crop.shape, (x0, y0)), colours="gray", limits=(0, white))
    axes.locator_params(nbins=4)
    axes.plot(*_square(estimate.registration, 0, CELLS).T, color=MARK, lw=1)
    axes.plot(*estimate.marks.T, "+", color=MARK, ms=8, mew=1.2)
    caption = f"The chart as photographed in {plane.name}: the detected x-corners (+), and the noise region."
    return finished(axes, name, caption, xlabel=f"pixels of {plane.name}")


def residual_figure(plane: str, estimate: PatternPsf, name: str) -> Figure:
    """Residual of the noise region, in units of the noise."""
    axes = plot_axes(3.2, 3.2, (0.42, 0.42, 0.42, 0.1))
    extent = pixel_extent(estimate.residual.shape, estimate.residual_origin)
    limits = (-RESIDUAL_LIMIT, RESIDUAL_LIMIT)
    picture(axes, estimate.residual, extent=extent, colours=ODD_COLOURS, limits=limits, bar=(1.03, 0.2, 0.035, 0.6))
    axes.locator_params(nbins=4)
    caption = (
        f"Residual of the noise region in {plane}, in standard deviations of the noise: no pattern should be visible."
    )
    return finished(axes, name, caption, xlabel=f"pixels of {plane}; colours in σ of the noise")


def pair_figure(near: Plane, outline: Array, name: str) -> Figure:
    """The near photograph of a wall, and the outline (n, 2) of the far one in its pixels."""
    samples = near.samples
    step = -(-max(samples.shape) // MAX_SIDE_PX)
    rows, columns = (n // step * step for n in samples.shape)
    small = samples[:rows, :columns].reshape(rows // step, step, columns // step, step).mean(axis=(1, 3))
    axes = plot_axes(3.2, 0.6 + 2.6 * rows / columns, (0.42, 0.1, 0.42, 0.1))
    white = float(np.quantile(small, 0.995))
    picture(axes, small, extent=pixel_extent((rows, columns)), colours="gray", limits=(0, white))
    axes.plot(*outline.T, color=MARK, lw=1)
    axes.locator_params(nbins=4)
    caption = "The near photograph, and the outline of the far one."
    return finished(axes, name, caption, xlabel=f"pixels of {near.name}")


def _draw_psf(axes: Axes, psf: Psf, samples: Array, title: str, **looks: Any) -> Any:
    """Samples of a PSF over pixels of the plane, with a colour bar below, which is returned."""
    half = (psf.k / 2) / psf.s
    ticks = (-2, 0, 2) if half >= 2 else (-1, 0, 1)
    bar = picture(axes, samples, extent=(-half, half, half, -half), bar=BELOW, **looks)
    axes.set_title(title, fontsize=9)
    axes.set(xticks=ticks, yticks=ticks)
    return bar


def psf_figure(psf: Psf, truth: Array | None, name: str) -> Figure:
    """The PSF, and its difference from the true one if that is known, each with its scale."""
    panels = [("PSF", psf.h, "viridis", (min(0.0, float(psf.h.min())), float(psf.h.max())))]
    if truth is not None:
        limit = float(np.abs(psf.h - truth).max())
        panels.append(("less the truth", psf.h - truth, "RdBu_r", (-limit, limit)))
    figure, places = axes_grid(3.2, 2.05, 1, len(panels), rim_in=(0.28, 0.12, 0.58, 0.22), wspace=0.24)
    for axes, (title, samples, colours, limits) in zip(places[0], panels, strict=True):
        options = {"orientation": "horizontal", "ticks": limits}
        bar = _draw_psf(axes, psf, samples, title, colours=colours, limits=limits, bar_options=options)
        labels = bar.ax.set_xticklabels([f"{value:.2g}".replace("-", "−") for value in limits])
        for label, end in zip(labels, ("left", "right"), strict=True):
            label.set_horizontalalignment(end)
    share, _ = psf.energy_outside
    caption = (
        f"The PSF’s support, {psf.k} × {psf.k} samples, {psf.s} to a pixel; axes in pixels of the plane. "
        f"{100 * share:.2f} % of all light lies outside it."
    )
    return drawn(figure, name, caption)


def log_psf_figure(psf: Psf, name: str) -> Figure:
    """The PSF in powers of ten of its peak, down to the standard uncertainty of a sample."""
    peak = float(psf.h.max())
    noise = float(np.sqrt(np.median(np.diagonal(psf.covariance)[: psf.h.size])))
    floor = float(np.clip(np.log10(max(noise / peak, 10**MIN_POWER)), MIN_POWER, -1.0))
    axes, ticks = plot_axes(3.2, 2.05, (0.28, 0.12, 0.58, 0.22)), np.arange(np.ceil(floor), 0.5)
    powers = np.log10(np.maximum(psf.h / peak, 10**floor))
    options = {"orientation": "horizontal", "ticks": ticks}
    bar = _draw_psf(axes, psf, powers, "PSF over its peak", limits=(floor, 0.0), bar_options=options)
    bar.ax.set_xticklabels(["1" if tick == 0 else f"{10.0**tick:g}" for tick in ticks])
    return finished(
        axes, name,
        "The same in powers of ten of its peak, down to the standard uncertainty of a sample, below which nothing is "
        "known.",
    )  # fmt: skip


def energy_figure(profile: RadialProfile, name: str) -> Figure:
    """Encircled energy over the radius, with its 95 % band and a line at the edge of the support."""
    axes, end = plot_axes(), min(float(profile.radius[-1]), 2 * profile.support)
    curve(axes, profile.radius, profile.energy, profile.energy_uncertainty, shade=0.2)
    axes.axvline(profile.support, color=FAINT, lw=0.5)
    axes.axhline(0.8, color=FAINT, lw=0.5, ls=(0, (1, 2)))
    return finished(
        axes, name,
        "Encircled energy: share of all light inside circles about the centre; the band holds 95 %, the line is the "
        "edge of the support.",
        xlim=(0, end), ylim=(0, 1.06), xlabel="radius, pixels", ylabel="share of all light inside",
    )  # fmt: skip


def kernel_figure(kernel: Array, name: str) -> Figure:
    """The kernel between two photographs, from its least to its greatest value."""
    axes = plot_axes(3.2, 2.05, (0.28, 0.12, 0.3, 0.1))
    picture(axes, kernel, bar=(1.05, 0.1, 0.05, 0.8))
    return finished(axes, name, "The kernel that turns the near photograph into the far one.", xticks=[], yticks=[])


def places_figure(outlines: Sequence[Array], name: str) -> Figure:
    """Outlines (n, 2) of the charts, in fractions of the frame."""
    axes = frame_axes(3.4, (1000, 1500), (0.05, 0.05, 0.1, 0.1))
    for number, outline in enumerate(outlines, 1):
        x, y = (outline * (1500, 1000)).T
        axes.fill(x, y, fc=MARK, alpha=0.12, lw=0)
        axes.plot(x, y, color=MARK, lw=1)
        axes.annotate(f"{number}", (x[0], y[0]), (-3, 3), textcoords="offset points", ha="right", color=INK)
    return finished(
        axes, name, "Places of the chart. Towards the corners the lens has coma, astigmatism and a curved field."
    )


Rows = Sequence[tuple[str, Mapping[str, Sequence[float]]]]
"""Title of each photograph, and its numbers by plane."""


def ratios_figure(rows: Rows, name: str) -> Figure:
    """Every plane's error over the error expected."""
    axes = _rows_axes(rows)
    axes.axvline(1, color=INK, lw=0.8, ls=DASHED, zorder=0)
    handles = [Line2D([], [], color=PLANE_COLOURS[plane], marker="o", ms=4, ls="") for plane in rows[0][1]]
    legend(axes, "center right", handles=handles, labels=list(rows[0][1]), handletextpad=0.1, borderaxespad=0)
    return finished(
        axes,
        name,
        "Error of each PSF over the error expected from its uncertainty.",
        xlim=(0, 2),
        xlabel="error / expected",
    )


def sigmas_figure(rows: Rows, name: str) -> Figure:
    """Every plane's MTF50, measured less true, in standard uncertainties: along rows a dot, along columns a diamond."""
    axes = _rows_axes(rows)
    axes.axvspan(-CONFIDENT, CONFIDENT, color=FAINT, alpha=0.2, lw=0, zorder=0)
    axes.axvline(0, color=INK, lw=0.8, ls=DASHED, zorder=0)
    caption = "MTF50 along rows (●) and columns (◆) against the truth; 95 % belong in the band."
    return finished(axes, name, caption, xlim=(-4.2, 4.2), xlabel="(measured − true) / σ")


def _rows_axes(rows: Rows) -> Axes:
    """A line for each photograph, the first on top, its planes one below the other."""
    axes = plot_axes(3.4, 2.5, (1.42, 0.1, 0.42, 0.05))
    for number, (_, by_plane) in enumerate(rows):
        for i, (plane, values) in enumerate(by_plane.items()):
            y = number + 0.17 * (i - (len(by_plane) - 1) / 2)
            for value, marker in zip(values, "oD", strict=False):
                axes.plot(value, y, marker, color=PLANE_COLOURS[plane], ms=4 if marker == "o" else 3.2)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [f"{number}  {title}" for number, (title, _) in enumerate(rows, 1)])
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)
    return axes


def map_figure(
    values: npt.NDArray[np.floating[Any]], unit: str, name: str, caption: str, *, limits: tuple[float, float],
    colours: str = "viridis",
) -> Figure:  # fmt: skip
    """A map over the frame, (rows, columns), with its scale."""
    rows, columns = values.shape
    axes = plot_axes(3.6, 2.95 * min(rows / columns, 1.5) + 0.3, (0.05, 0.6, 0.25, 0.05))
    picture(axes, values, colours=colours, limits=limits, bar=(1.03, 0.1, 0.04, 0.8))
    bare(axes)
    return finished(axes, name, caption, xlabel=unit)


def course_figure(n: Sequence[int], cost: Sequence[float], residual: Sequence[float], name: str) -> Figure:
    """Cost and residual (grey levels of 255) after each round of a restoration."""
    left = plot_axes(3.6, 3.0, (0.6, 0.6, 0.42, 0.1))
    left.semilogy(n, cost, color=ALONG["horizontal"], lw=1.4)
    left.set_ylabel("cost (6.1)", color=ALONG["horizontal"])
    with matplotlib.rc_context(STYLE):
        right = left.twinx()
    right.plot(n, residual, color=ALONG["vertical"], ls="--", lw=1.4)
    right.set_ylabel("residual, levels of 255 (dashed)", color=ALONG["vertical"])
    right.set_ylim(0, None)
    return finished(left, name, "Cost and residual after each round.", xlabel="round")
