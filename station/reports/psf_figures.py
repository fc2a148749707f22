"""The figures of a PSF's report; those of its transfer function are in `otf_figures`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from procedures.pattern import BLOCK, BLOCKS, CELLS
from procedures.pattern_psf.estimate import PatternPsf
from procedures.pattern_psf.registration import Registration
from procedures.psf import Psf
from procedures.radial_profile import Profile
from procedures.raw import Plane
from station.drawing.colours import ALONG, FAINT, INK, MARK, PLANE_COLOURS
from station.drawing.style import CONFIDENT, STYLE, axes_grid, colour_bar, svg

Array = npt.NDArray[np.float64]

SURROUND_CELLS = 20
"""What is shown around the chart's frame."""
RESIDUAL_LIMIT = 4.0
"""Residuals are drawn from minus to plus this many standard deviations of the noise."""
FEWER_COLOURS = matplotlib.colormaps["RdBu_r"].resampled(255)
"""One colour is left for where there is nothing."""
WIDEST_PX = 480
"""Larger photographs are drawn smaller."""

# --- the photograph ----------------------------------------------------------------------------------------------


def _square(registration: Registration, low: float, high: float) -> Array:
    """A square of the chart on the plane, its sides subdivided, closed, (n, 2)."""
    t = np.linspace(low, high, 17)
    a, b = np.full_like(t, low), np.full_like(t, high)
    sides = [(t, a), (b, t), (t[::-1], b), (a, t[::-1])]
    return registration.to_sensor(np.concatenate([np.column_stack(side) for side in sides]))


def chart_outline(found: PatternPsf) -> Array:
    """The outline of the chart's frame, closed, (n, 2), in pixels of the plane."""
    return _square(found.registration, -BLOCK, BLOCK * (BLOCKS - 1))


def photograph_figure(plane: Plane, found: PatternPsf, name: str) -> Markup:
    """The chart as photographed, with the marks that were found and the outline of the noise."""
    figure, ((axes,),) = axes_grid(3.2, 3.2, rim_in=(0.42, 0.1, 0.42, 0.1))
    around = _square(found.registration, -BLOCK - SURROUND_CELLS, BLOCK * (BLOCKS - 1) + SURROUND_CELLS)
    limit = np.array(plane.samples.shape[::-1])
    (x0, y0), (x1, y1) = (
        np.clip(v, 0, limit) for v in (around.min(axis=0).astype(int), around.max(axis=0).astype(int))
    )
    crop = plane.samples[y0:y1, x0:x1]
    _image(axes, crop, (x0, y0), cmap="gray", vmin=0, vmax=float(np.quantile(crop, 0.995)))
    axes.plot(*_square(found.registration, 0, CELLS).T, color=MARK, lw=1)
    axes.plot(*found.marks.T, "+", color=MARK, ms=8, mew=1.2)
    axes.set_xlabel(f"pixels of {plane.name}")
    return svg(figure, name, f"the chart in plane {plane.name}, with the marks found")


def residual_figure(plane: str, found: PatternPsf, name: str) -> Markup:
    """What is left of the noise region when the prediction is taken away, in units of the noise."""
    figure, ((axes,),) = axes_grid(3.2, 3.2, rim_in=(0.42, 0.42, 0.42, 0.1))
    image = _image(
        axes, found.residual, found.residual_origin, cmap=FEWER_COLOURS, vmin=-RESIDUAL_LIMIT, vmax=RESIDUAL_LIMIT
    )
    colour_bar(figure, axes, image, (1.03, 0.2, 0.035, 0.6))
    axes.set_xlabel(f"pixels of {plane}; colours in σ of the noise")
    return svg(figure, name, f"photograph less prediction in plane {plane}, in standard deviations of the noise")


def pair_figure(near: Plane, outline: Array, name: str) -> Markup:
    """The near photograph of a wall, and the outline (n, 2) of the far one in its pixels."""
    samples = near.samples
    step = -(-max(samples.shape) // WIDEST_PX)
    rows, columns = (n // step * step for n in samples.shape)
    small = samples[:rows, :columns].reshape(rows // step, step, columns // step, step).mean(axis=(1, 3))
    figure, ((axes,),) = axes_grid(3.2, 0.6 + 2.6 * rows / columns, rim_in=(0.42, 0.1, 0.42, 0.1))
    extent = (-0.5, columns - 0.5, rows - 0.5, -0.5)
    axes.imshow(small, extent=extent, cmap="gray", vmin=0, vmax=float(np.quantile(small, 0.995)), interpolation="none")
    axes.plot(*outline.T, color=MARK, lw=1)
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=4)
    axes.set_xlabel(f"pixels of {near.name}")
    return svg(figure, name, f"the near photograph in plane {near.name}, with the outline of the far one")


def _image(axes: Axes, picture: npt.NDArray[np.floating], origin: tuple[int, int], **colours: Any) -> Any:
    """A picture whose first pixel is the plane's pixel `origin` (x, y), every pixel a square."""
    (rows, columns), (x, y) = picture.shape, origin
    extent = (x - 0.5, x + columns - 0.5, y + rows - 0.5, y - 0.5)
    image = axes.imshow(picture, extent=extent, interpolation="none", **colours)
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=4)
    return image


# --- the PSF -----------------------------------------------------------------------------------------------------


def psf_figure(psf: Psf, truth: Array | None, name: str) -> Markup:
    """The PSF, and how far it is from the true one where that is known, each with its scale."""
    pictures = [("PSF", psf.h, "viridis", (min(0.0, float(psf.h.min())), float(psf.h.max())))]
    if truth is not None:
        difference = psf.h - truth
        limit = float(np.abs(difference).max())
        pictures.append(("less the truth", difference, "RdBu_r", (-limit, limit)))
    figure, places = axes_grid(3.2, 2.05, 1, len(pictures), rim_in=(0.28, 0.12, 0.58, 0.22), wspace=0.24)
    reach = (psf.k / 2) / psf.s
    for axes, (title, picture, colours, (low, high)) in zip(places[0], pictures, strict=True):
        image = axes.imshow(
            picture, extent=(-reach, reach, reach, -reach), interpolation="none", cmap=colours, vmin=low, vmax=high
        )
        axes.spines[:].set_visible(False)
        axes.set_title(title, fontsize=9)
        axes.set_xticks((-2, 0, 2) if reach >= 2 else (-1, 0, 1))
        axes.set_yticks(axes.get_xticks())
        bar = colour_bar(figure, axes, image, (0, -0.27, 1, 0.045), orientation="horizontal", ticks=(low, high))
        labels = bar.ax.set_xticklabels([f"{value:.2g}".replace("-", "−") for value in (low, high)])
        for label, end in zip(labels, ("left", "right"), strict=True):
            label.set_horizontalalignment(end)
    return svg(figure, name, "the point spread function" + (", less the true one" if truth is not None else ""))


DEEPEST = -5.0
"""Powers of ten of its peak to which a PSF is drawn at most."""


def log_psf_figure(psf: Psf, name: str) -> Markup:
    """The PSF in powers of ten of its peak, down to the standard uncertainty of a sample: flare that is known."""
    peak = float(psf.h.max())
    noise = float(np.sqrt(np.median(np.diagonal(psf.covariance)[: psf.h.size])))
    floor = float(np.clip(np.log10(max(noise / peak, 10**DEEPEST)), DEEPEST, -1.0))
    figure, ((axes,),) = axes_grid(3.2, 2.05, rim_in=(0.28, 0.12, 0.58, 0.22))
    reach = (psf.k / 2) / psf.s
    image = axes.imshow(
        np.log10(np.maximum(psf.h / peak, 10**floor)), extent=(-reach, reach, reach, -reach), interpolation="none",
        cmap="viridis", vmin=floor, vmax=0.0,
    )  # fmt: skip
    axes.spines[:].set_visible(False)
    axes.set_title("PSF over its peak", fontsize=9)
    axes.set_xticks((-2, 0, 2) if reach >= 2 else (-1, 0, 1))
    axes.set_yticks(axes.get_xticks())
    ticks = np.arange(np.ceil(floor), 0.5)
    bar = colour_bar(figure, axes, image, (0, -0.27, 1, 0.045), orientation="horizontal", ticks=ticks)
    bar.ax.set_xticklabels(["1" if tick == 0 else f"{10.0**tick:g}" for tick in ticks])
    return svg(figure, name, "the point spread function in powers of ten of its peak")


def energy_figure(profile: Profile, name: str) -> Markup:
    """The energy inside circles over their radius, with its 95 % band; a line where they leave the support."""
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.55, 0.14, 0.4, 0.08))
    spread = CONFIDENT * profile.energy_uncertainty
    axes.fill_between(profile.radius, profile.energy - spread, profile.energy + spread, color=INK, alpha=0.2, lw=0)
    axes.plot(profile.radius, profile.energy, color=INK, lw=1.4)
    axes.axvline(profile.support, color=FAINT, lw=0.5)
    end = min(float(profile.radius[-1]), 2 * profile.support)
    axes.set(xlim=(0, end), ylim=(0, 1.06), xlabel="radius, pixels", ylabel="share of all light inside")
    axes.axhline(0.8, color=FAINT, lw=0.5, ls=(0, (1, 2)))
    return svg(figure, name, "the share of all light inside circles about the centre, with its 95 % band")


def kernel_figure(kernel: Array, name: str) -> Markup:
    """The kernel between two photographs, its own least to greatest value."""
    figure, ((axes,),) = axes_grid(3.2, 2.05, rim_in=(0.28, 0.12, 0.3, 0.1))
    image = axes.imshow(kernel, interpolation="none", cmap="viridis")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    colour_bar(figure, axes, image, (1.05, 0.1, 0.05, 0.8))
    return svg(figure, name, "the kernel between the two photographs")


# --- all photographs together ------------------------------------------------------------------------------------


def places_figure(outlines: Sequence[Array], name: str) -> Markup:
    """Where the charts stood, the frames drawn over each other: outlines (n, 2) in fractions of the frame."""
    figure, ((axes,),) = axes_grid(3.4, 2.5, rim_in=(0.05, 0.05, 0.1, 0.1))
    axes.add_patch(Rectangle((0, 0), 1, 1, fill=False, ec=FAINT, lw=0.8))
    for number, outline in enumerate(outlines, 1):
        axes.fill(*outline.T, fc=MARK, alpha=0.12, lw=0)
        axes.plot(*outline.T, color=MARK, lw=1)
        x, y = outline[0]
        axes.annotate(f"{number}", (x, y), (-3, 3), textcoords="offset points", ha="right", color=INK)
    axes.set(xlim=(-0.01, 1.01), ylim=(1.01, -0.01), aspect=2 / 3, xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    return svg(figure, name, "the frame, and where the chart stood in each photograph")


Rows = Sequence[tuple[str, Mapping[str, Sequence[float]]]]
"""Of every photograph its title, and numbers by plane."""


def ratios_figure(rows: Rows, name: str) -> Markup:
    """Every plane's error over the error expected."""
    figure, ((axes,),) = axes_grid(3.4, 2.5, rim_in=(1.42, 0.1, 0.42, 0.05))
    _draw_rows(axes, rows)
    axes.set(xlim=(0, 2), xlabel="error / expected")
    axes.axvline(1, color=INK, lw=0.8, ls=(0, (3, 2)), zorder=0)
    handles = [Line2D([], [], color=PLANE_COLOURS[plane], marker="o", ms=4, ls="") for plane in rows[0][1]]
    with matplotlib.rc_context(STYLE):
        axes.legend(handles, rows[0][1], loc="center right", handletextpad=0.1, borderaxespad=0)
    return svg(figure, name, "errors of the PSFs over the errors expected")


def sigmas_figure(rows: Rows, name: str) -> Markup:
    """Every plane's MTF50, measured less true, in standard uncertainties: along rows a dot, along columns a diamond."""
    figure, ((axes,),) = axes_grid(3.4, 2.5, rim_in=(1.42, 0.1, 0.42, 0.05))
    _draw_rows(axes, rows)
    axes.axvspan(-CONFIDENT, CONFIDENT, color=FAINT, alpha=0.2, lw=0, zorder=0)
    axes.axvline(0, color=INK, lw=0.8, ls=(0, (3, 2)), zorder=0)
    axes.set(xlim=(-4.2, 4.2), xlabel="(measured − true) / σ")
    return svg(figure, name, "differences of MTF50 from the truth in standard uncertainties")


def _draw_rows(axes: Axes, rows: Rows) -> None:
    """A line for each photograph, the first on top, its planes one below the other."""
    for number, (_, by_plane) in enumerate(rows):
        for i, (plane, values) in enumerate(by_plane.items()):
            y = number + 0.17 * (i - (len(by_plane) - 1) / 2)
            for value, marker in zip(values, "oD", strict=False):
                axes.plot(value, y, marker, color=PLANE_COLOURS[plane], ms=4 if marker == "o" else 3.2)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [f"{number}  {title}" for number, (title, _) in enumerate(rows, 1)])
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)


# --- maps over the frame -----------------------------------------------------------------------------------------


def map_figure(
    values: npt.NDArray[np.floating[Any]], unit: str, name: str, *, colours: str, limits: tuple[float, float]
) -> Markup:
    """A map over the frame, (rows, columns), with its scale."""
    rows, columns = values.shape
    figure, ((axes,),) = axes_grid(3.6, 2.95 * min(rows / columns, 1.5) + 0.3, rim_in=(0.05, 0.6, 0.25, 0.05))
    image = axes.imshow(values, cmap=colours, vmin=limits[0], vmax=limits[1], interpolation="none")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.set_xlabel(unit)
    colour_bar(figure, axes, image, (1.03, 0.1, 0.04, 0.8))
    return svg(figure, name, f"{unit}, over the frame")


def course_figure(n: Sequence[int], cost: Sequence[float], residual: Sequence[float], name: str) -> Markup:
    """Cost and residual (grey levels of 255) after each round of a restoration."""
    figure, ((left,),) = axes_grid(3.6, 3.0, rim_in=(0.6, 0.6, 0.42, 0.1))
    left.semilogy(n, cost, color=ALONG["horizontal"], lw=1.4)
    left.set(xlabel="round")
    left.set_ylabel("cost (6.1)", color=ALONG["horizontal"])
    with matplotlib.rc_context(STYLE):
        right = left.twinx()
    right.plot(n, residual, color=ALONG["vertical"], lw=1.4, ls="--")
    right.set_ylabel("residual, levels of 255 (dashed)", color=ALONG["vertical"])
    right.set_ylim(0, None)
    return svg(figure, name, "cost and residual after each round")
