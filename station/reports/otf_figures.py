"""Figures of a transfer function: MTF along the axes and across edges, phase, MTF in two dimensions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from procedures.numerics.arrays import Array
from procedures.psf import Psf
from procedures.quality import Diffraction, Quality, frequencies
from procedures.transfer_function import Otf, mtf_map, phase_along
from procedures.two_photo.diagnostics import CLEAR
from station.drawing.colours import ALONG, FAINT, INK, LIMIT_COLOUR
from station.drawing.plots import DASHED, DOTTED, Figure, curve, drawn, finished, legend, picture, plot_axes
from station.drawing.style import axes_grid, title_along

MAX_PHASE_ERROR_DEG = 5.0
"""Standard uncertainty of the phase up to which it is drawn."""
DASHES = ((5, 2), (3, 1, 1, 1), (1, 1.5))
MAX_NAME = 24
MAP_SIZE = 81
CONTOURS = (0.1, 0.5)


@dataclass(frozen=True)
class FrequencyAxis:
    """The unit of an axis of frequencies, and one cycle per pixel of the plane in it."""

    unit: str = "cycles/pixel"
    factor: float = 1.0

    @property
    def nyquist(self) -> float:
        """Half a cycle per pixel of the plane."""
        return 0.5 * self.factor


PER_PIXEL = FrequencyAxis()


def mtf_figure(
    quality: Quality, truth: Otf | None, name: str, limit: Diffraction | None = None, axis: FrequencyAxis = PER_PIXEL,
    others: Mapping[str, Mapping[str, Array]] | None = None,
) -> Figure:  # fmt: skip
    """MTF along both axes with 95 % bands; with the true transfer function, the difference below.

    limit : the diffraction limit, which is drawn too
    others : curves of other results in the same unit: horizontal and vertical, or mtf across an edge
    """
    f, shown = quality.frequencies, quality.frequencies * axis.factor
    curves = {
        "horizontal": (quality.mtf_horizontal, quality.uncertainty("horizontal")),
        "vertical": (quality.mtf_vertical, quality.uncertainty("vertical")),
    }
    true = {} if truth is None else {"horizontal": np.abs(truth(f, 0 * f)), "vertical": np.abs(truth(0 * f, f))}
    rows = 2 if true else 1
    figure, places = axes_grid(
        3.2, 1.4 + 1.1 * rows, rows, 1, rim_in=(0.55, 0.14, 0.4, 0.08), height_ratios=[2.1, 1][:rows], hspace=0.12
    )
    upper, lower = places[0, 0], places[-1, 0]
    for direction, (value, uncertainty) in curves.items():
        curve(upper, shown, value, uncertainty, colour=ALONG[direction], label=direction)
    for direction, value in true.items():
        curve(upper, shown, value, width=0.8, ls=DASHED, label="true" if direction == "vertical" else None)
    finish_mtf(upper, curves, f, axis, limit, others)
    largest = np.maximum(quality.uncertainty("horizontal"), quality.uncertainty("vertical"))
    if (unknown := largest > CLEAR).any():
        hatched = {"fc": "none", "ec": FAINT, "hatch": "////", "lw": 0, "label": "not determined"}
        upper.fill_between(shown, 0, 1, unknown, step="mid", **hatched)
        _mtf_legend(upper)
    for direction, value in true.items():
        measured, uncertainty = curves[direction]
        curve(lower, shown, measured - value, uncertainty, colour=ALONG[direction], width=1.1)
    if true:
        lower.axhline(0, color=INK, lw=0.7, ls=DASHED)
        lower.set_ylabel("less true")
    for axes in places[:, 0]:
        _frequency_axis(axes, shown, axis, bottom=axes is lower)
    caption = "MTF of the whole PSF along rows and columns; " + mtf_caption(axis, limit, others)
    return drawn(figure, name, caption)


def mtf_caption(
    axis: FrequencyAxis, limit: Diffraction | None, others: Mapping[str, Mapping[str, Array]] | None
) -> str:  # fmt: skip
    """Legend of the bands and lines of an MTF."""
    caption = "the bands hold 95 %; where the pointer rests the values are shown."
    if others:
        caption += f" Dashed: {', '.join(others)}."
    if limit is not None:
        cutoff = f"{limit.cutoff * axis.factor:.3g} {axis.unit}"
        caption += f" Dotted: diffraction limit at f/{limit.f_number:g}, {limit.wavelength_nm:g} nm, up to {cutoff}."
    return caption


def finish_mtf(
    axes: Axes, curves: Mapping[str, tuple[Array, Array]], f: Array, axis: FrequencyAxis, limit: Diffraction | None,
    others: Mapping[str, Mapping[str, Array]] | None,
) -> None:  # fmt: skip
    """Diffraction limit, curves of other results, the values as titles, Nyquist frequency, and legend.

    curves : MTF and its standard uncertainty by label
    f : (n,) frequencies in cycles per pixel
    """
    shown = f * axis.factor
    if limit is not None:
        curve(axes, shown, limit.otf(f), colour=LIMIT_COLOUR, width=1.3, ls=DOTTED, label="diffraction")
    for number, (name, columns) in enumerate((others or {}).items()):
        dashes, label = (0, DASHES[number % len(DASHES)]), name[:MAX_NAME]
        for direction in ("horizontal", "vertical", "mtf"):
            if direction in columns:
                colour = ALONG.get(direction, INK)
                curve(axes, columns["frequency"], columns[direction], colour=colour, width=1, ls=dashes, label=label)
                label = "_"  # the legend names each result once
    values = [", ".join(f"{label} {y[i]:.3f} ± {u[i]:.3f}" for label, (y, u) in curves.items()) for i in range(len(f))]
    title_along(axes, shown, [f"{at:.3g} {axis.unit}: {words}" for at, words in zip(shown, values, strict=True)])
    axes.axvline(axis.nyquist, color=FAINT, lw=0.7)
    axes.text(axis.nyquist, 1.0, " Nyquist", color=FAINT, va="top", fontsize=7.5)
    axes.axhline(0.5, color=FAINT, lw=0.5, ls=(0, (1, 2)))
    axes.set(ylim=(0, 1.04), ylabel="MTF")
    _mtf_legend(axes)


def _mtf_legend(axes: Axes) -> None:
    box = {"frameon": True, "framealpha": 0.8, "edgecolor": "none"}  # legible over the diffraction limit
    legend(axes, "upper right", bbox_to_anchor=(1, 0.94), **box)


def _frequency_axis(axes: Axes, f: Array, axis: FrequencyAxis, *, bottom: bool = True) -> None:
    axes.set_xlim(0, f[-1])
    if axis.factor == 1:
        axes.set_xticks(np.arange(0, f[-1] + 0.01, 0.5), None if bottom else [])
    else:
        axes.tick_params(labelbottom=bottom)
    axes.yaxis.set_label_coords(-0.165, 0.5)
    if bottom:
        axes.set_xlabel(axis.unit)


def phase_figure(psf: Psf, name: str, axis: FrequencyAxis = PER_PIXEL) -> Figure:
    """Phase of the OTF along both axes with 95 % bands, up to `MAX_PHASE_ERROR_DEG`."""
    f = frequencies(psf)
    shown, axes, limit = f * axis.factor, plot_axes(), 10.0
    for direction, angle in (("horizontal", 0.0), ("vertical", np.pi / 2)):
        phase, uncertainty = phase_along(psf, f, angle)
        unknown = np.flatnonzero(uncertainty > MAX_PHASE_ERROR_DEG)
        known = slice(0, unknown[0] if len(unknown) else len(f))
        curve(axes, shown[known], phase[known], uncertainty[known], colour=ALONG[direction], label=direction)
        limit = max(limit, float((np.abs(phase) + 2 * uncertainty)[known].max(initial=0)))
    axes.axhline(0, color=INK, lw=0.7, ls=DASHED)
    axes.axvline(axis.nyquist, color=FAINT, lw=0.7)
    axes.set(ylim=(-1.05 * limit, 1.05 * limit), ylabel="phase, degrees")
    _frequency_axis(axes, shown, axis)
    legend(axes, ncols=2)
    return finished(
        axes, name,
        f"Phase of the OTF about the PSF’s centre, where its uncertainty is below {MAX_PHASE_ERROR_DEG:g}°. A straight "
        "line is a shift of the light from the centre; bends are asymmetry, as of coma.",
    )  # fmt: skip


def mtf_map_figure(psf: Psf, name: str, limit: Diffraction | None = None, axis: FrequencyAxis = PER_PIXEL) -> Figure:
    """The MTF over both frequencies, with contours, the Nyquist square and the diffraction cutoff."""
    f, mtf = mtf_map(psf, MAP_SIZE)
    f, square = f * axis.factor, axis.nyquist * np.array([-1, 1, 1, -1, -1])
    axes, edge = plot_axes(rim_in=(0.55, 0.75, 0.42, 0.1)), f[-1] + (f[1] - f[0]) / 2
    picture(axes, np.clip(mtf, 0, 1), extent=(-edge, edge, edge, -edge), limits=(0, 1), bar=(1.05, 0.1, 0.05, 0.8))
    axes.contour(f, f, mtf, CONTOURS, colors="white", linewidths=(0.7, 1.1))
    axes.plot(square, np.roll(square, 1), color="white", lw=0.7, ls=DASHED)
    end = 0.0 if limit is None else limit.cutoff * axis.factor
    if 0 < end < edge * np.sqrt(2):
        turn = np.linspace(0, 2 * np.pi, 121)
        axes.plot(end * np.cos(turn), end * np.sin(turn), color=FAINT, lw=1, ls=(0, (1, 1.2)))
    axes.locator_params(nbins=5)
    caption = "MTF of the whole PSF over both frequencies, with lines at 0.5 and 0.1; dashed: the Nyquist square."
    return finished(
        axes, name, caption + (" Dotted, where visible: the diffraction cutoff." if limit else ""),
        xlim=(-edge, edge), ylim=(edge, -edge), xlabel=f"{axis.unit} along rows", ylabel="along columns",
    )  # fmt: skip
