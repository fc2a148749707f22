"""The report's figures, as SVG that stands inside a page: the same bytes for the same numbers."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from procedures.pattern import BLOCK, BLOCKS, CELLS
from procedures.pattern_psf.estimate import PatternPsf
from procedures.pattern_psf.registration import Registration
from procedures.psf import Psf
from procedures.quality import Quality, otf
from procedures.raw import Plane

Array = npt.NDArray[np.float64]

INK, FAINT = "#2b3036", "#9aa3ad"
ALONG = {"horizontal": "#1f5fa8", "vertical": "#c4541a"}
PLANE_COLOURS = {"R": "#c0392b", "G1": "#1e8449", "G2": "#7dbb42", "B": "#2e6fbf", "Y": "#444444"}
MARK = "#ff8c1a"
CONFIDENT = 1.96
"""Standard uncertainties on either side that hold 95 %."""
SURROUND_CELLS = 20
"""What is shown around the chart's frame."""
RESIDUAL_LIMIT = 4.0
"""Residuals are drawn from minus to plus this many standard deviations of the noise."""
STYLE = {
    "font.size": 8.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "image.composite_image": False,
    "svg.fonttype": "none",
}


def svg(figure: Figure, name: str, description: str) -> Markup:
    """A figure as an SVG element as wide as its place, its parts named so that no other figure's are mistaken for them.

    Parameters
    ----------
    name : str
        Unique in the page.
    description : str
        What it shows, for those who do not see it.
    """
    text = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata=nothing, transparent=True)
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.S)
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', drawn))
    drawn = re.sub(r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", drawn)
    drawn = re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", drawn)
    drawn = re.sub(r' (?:width|height)="[\d.]+pt"', "", drawn, count=2)
    drawn = re.sub(r' xmlns(?::xlink)?="[^"]*"', "", drawn).replace("xlink:href", "href")
    return Markup(drawn.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1))


def _figure(width_in: float, height_in: float, rows: int = 1, columns: int = 1, **grid: Any) -> tuple[Figure, Any]:
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        return figure, figure.subplots(rows, columns, **grid)


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
    figure, axes = _figure(3.2, 3.2)
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
    figure, axes = _figure(3.2, 3.2)
    image = _image(
        axes, found.residual, found.residual_origin, cmap="RdBu_r", vmin=-RESIDUAL_LIMIT, vmax=RESIDUAL_LIMIT
    )
    bar = figure.colorbar(image, ax=axes, shrink=0.6, aspect=24, pad=0.02)
    bar.outline.set_visible(False)  # type: ignore[operator]  # matplotlib types it as a subplot's spines
    axes.set_xlabel(f"pixels of {plane}; colours in σ of the noise")
    return svg(figure, name, f"photograph less prediction in plane {plane}, in standard deviations of the noise")


def _image(axes: Axes, picture: npt.NDArray[np.floating], origin: tuple[int, int], **colours: Any) -> Any:
    """A picture whose first pixel is the plane's pixel `origin` (x, y), every pixel a square."""
    (rows, columns), (x, y) = picture.shape, origin
    extent = (x - 0.5, x + columns - 0.5, y + rows - 0.5, y - 0.5)
    image = axes.imshow(picture, extent=extent, interpolation="none", **colours)
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=4)
    return image


# --- the PSF -----------------------------------------------------------------------------------------------------


def psf_figure(psf: Psf, truth: Psf | None, name: str) -> Markup:
    """The PSF, and how far it is from the true one where that is known, each with its scale."""
    pictures = [("PSF", psf.h, "viridis", (min(0.0, float(psf.h.min())), float(psf.h.max())))]
    if truth is not None:
        difference = psf.h - truth.h
        limit = float(np.abs(difference).max())
        pictures.append(("less the truth", difference, "RdBu_r", (-limit, limit)))
    figure, places = _figure(3.2, 1.95, 1, len(pictures), squeeze=False)
    reach = (psf.k / 2) / psf.s
    for axes, (title, picture, colours, (low, high)) in zip(places[0], pictures, strict=True):
        image = axes.imshow(
            picture, extent=(-reach, reach, reach, -reach), interpolation="none", cmap=colours, vmin=low, vmax=high
        )
        axes.spines[:].set_visible(False)
        axes.set_title(title)
        axes.set_xticks((-2, 0, 2) if reach >= 2 else (-1, 0, 1))
        axes.set_yticks(axes.get_xticks())
        bar = figure.colorbar(image, ax=axes, location="bottom", aspect=18, pad=0.02, ticks=(low, high))
        bar.ax.set_xticklabels([f"{low:.2g}", f"{high:.2g}"])
        bar.outline.set_visible(False)
    return svg(figure, name, "the point spread function, and its difference from the true one")


@dataclass(frozen=True)
class _Curve:
    """A measured MTF along one direction, and the true one."""

    value: Array
    uncertainty: Array
    true: Array | None


def mtf_figure(quality: Quality, truth: Psf | None, name: str) -> Markup:
    """MTF along both axes over frequency with 95 % bands; below, where the truth is known, how far it is off."""
    f = quality.frequencies
    curves = {
        "horizontal": _Curve(quality.mtf_horizontal, quality.mtf_horizontal_uncertainty, _true_mtf(truth, f, 0 * f)),
        "vertical": _Curve(quality.mtf_vertical, quality.mtf_vertical_uncertainty, _true_mtf(truth, 0 * f, f)),
    }
    rows = 1 if truth is None else 2
    figure, places = _figure(3.2, 1.5 + 1.2 * rows, rows, 1, sharex=True, squeeze=False, height_ratios=[2.2, 1][:rows])
    for direction, curve in curves.items():
        _draw_mtf(places[0, 0], f, curve, direction)
    _finish_mtf(places[0, 0])
    if truth is not None:
        for direction, curve in curves.items():
            _draw_difference(places[1, 0], f, curve, direction)
        places[1, 0].axhline(0, color=INK, lw=0.7, ls=(0, (3, 2)))
        places[1, 0].set_ylabel("less true")
    places[-1, 0].set_xlim(0, f[-1])
    places[-1, 0].set_xlabel("cycles/pixel")
    return svg(figure, name, "MTF along rows and columns with its 95 % bands, against the true MTF")


def _true_mtf(truth: Psf | None, fx: Array, fy: Array) -> Array | None:
    return None if truth is None else np.abs(otf(truth, fx, fy))


def _draw_mtf(axes: Axes, f: Array, curve: _Curve, direction: str) -> None:
    spread = CONFIDENT * curve.uncertainty
    axes.fill_between(f, curve.value - spread, curve.value + spread, color=ALONG[direction], alpha=0.25, lw=0)
    axes.plot(f, curve.value, color=ALONG[direction], lw=1.4, label=direction)
    if curve.true is not None:
        label = "true" if direction == "horizontal" else None
        axes.plot(f, curve.true, color=INK, lw=0.8, ls=(0, (3, 2)), label=label)


def _finish_mtf(axes: Axes) -> None:
    axes.axvline(0.5, color=FAINT, lw=0.7)
    axes.text(0.5, 1.0, " Nyquist", color=FAINT, va="top", fontsize=7.5)
    axes.axhline(0.5, color=FAINT, lw=0.5, ls=(0, (1, 2)))
    axes.set_ylim(0, 1.04)
    axes.set_ylabel("MTF")
    with matplotlib.rc_context(STYLE):
        axes.legend(loc="upper right", bbox_to_anchor=(1, 0.94), handlelength=1.4)


def _draw_difference(axes: Axes, f: Array, curve: _Curve, direction: str) -> None:
    if curve.true is None:
        return
    off, spread = curve.value - curve.true, CONFIDENT * curve.uncertainty
    axes.fill_between(f, off - spread, off + spread, color=ALONG[direction], alpha=0.25, lw=0)
    axes.plot(f, off, color=ALONG[direction], lw=1.1)


# --- all photographs together ------------------------------------------------------------------------------------


def places_figure(outlines: Sequence[Array], name: str) -> Markup:
    """Where the charts stood, the frames drawn over each other: outlines (n, 2) in fractions of the frame."""
    figure, axes = _figure(3.4, 2.5)
    axes.add_patch(matplotlib.patches.Rectangle((0, 0), 1, 1, fill=False, ec=FAINT, lw=0.8))
    for number, outline in enumerate(outlines, 1):
        axes.fill(*outline.T, fc=MARK, alpha=0.12, lw=0)
        axes.plot(*outline.T, color=MARK, lw=1)
        x, y = outline[0]
        axes.annotate(f"{number}", (x, y), (-3, 3), textcoords="offset points", ha="right", color=INK)
    axes.set(xlim=(-0.01, 1.01), ylim=(1.01, -0.01), aspect=2 / 3, xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    return svg(figure, name, "the frame, and where the chart stood in each photograph")


def agreement_figure(
    rows: Sequence[tuple[str, Mapping[str, float], Mapping[str, Sequence[float]]]], name: str
) -> Markup:
    """How well all planes agree with the truth: the PSFs' errors over the expected, and MTF50 in its uncertainties.

    Parameters
    ----------
    rows : sequence of (title, plane -> ratio, plane -> differences in sigma)
        One for each photograph.
    """
    figure, (ratios, sigmas) = _figure(6.4, 2.5, 1, 2, sharey=True)
    for number, (_, of_psf, of_mtf50) in enumerate(rows):
        for i, plane in enumerate(of_psf):
            y = number + 0.16 * (i - (len(of_psf) - 1) / 2)
            ratios.plot(of_psf[plane], y, "o", color=PLANE_COLOURS[plane], ms=4.5, label=None if number else plane)
            for shown, marker in zip(of_mtf50[plane], ("o", "D"), strict=False):
                sigmas.plot(shown, y, marker, color=PLANE_COLOURS[plane], ms=4 if marker == "o" else 3.2)
    ratios.axvline(1, color=INK, lw=0.8, ls=(0, (3, 2)))
    ratios.set(xlim=(0, 2), xlabel="error of the PSF / error expected", ylim=(len(rows) - 0.5, -0.5))
    ratios.set_yticks(range(len(rows)), [f"{number} {title}" for number, (title, *_) in enumerate(rows, 1)])
    sigmas.axvspan(-CONFIDENT, CONFIDENT, color=FAINT, alpha=0.2, lw=0)
    sigmas.axvline(0, color=INK, lw=0.8, ls=(0, (3, 2)))
    sigmas.set(xlim=(-4, 4), xlabel="MTF50, measured less true, in σ; 95 % belong in the band")
    for axes in (ratios, sigmas):
        axes.tick_params(left=False)
        axes.spines["left"].set_visible(False)
    with matplotlib.rc_context(STYLE):
        ratios.legend(loc="lower left", ncols=2, handletextpad=0.1, columnspacing=0.8)
    return svg(figure, name, "errors of the PSFs over the expected, and differences of MTF50 in standard uncertainties")
