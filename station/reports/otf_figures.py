"""The figures of a transfer function: MTF along the axes, phase, MTF in two dimensions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes

from procedures.psf import Psf
from procedures.quality import Diffraction, Quality, frequencies
from procedures.transfer_function import Otf, mtf_map, phase_along
from procedures.two_photo.diagnostics import CLEAR
from station.drawing.colours import ALONG, FAINT, INK, LIMIT_COLOUR
from station.drawing.hover import title_along
from station.drawing.style import CONFIDENT, STYLE, axes_grid, colour_bar, svg

Array = npt.NDArray[np.float64]

PHASE_KNOWN_DEG = 5.0
"""Standard uncertainty of the phase beyond which it is not drawn."""
DASHES = ((5, 2), (3, 1, 1, 1), (1, 1.5))
"""Of other results, in turn."""
LONGEST_NAME = 24
"""Letters of another result's name in the legend."""
MAP_SIZE = 81
CONTOURS = (0.1, 0.5)


@dataclass(frozen=True)
class FrequencyAxis:
    """The unit of an axis of frequencies, and what one cycle per pixel of the plane is in it."""

    unit: str = "cycles/pixel"
    factor: float = 1.0

    @property
    def nyquist(self) -> float:
        """Half a cycle per pixel of the plane."""
        return 0.5 * self.factor


PER_PIXEL = FrequencyAxis()


@dataclass(frozen=True)
class _Curve:
    """A measured MTF along one direction, and the true one."""

    value: Array
    uncertainty: Array
    true: Array | None


# --- MTF along the axes ------------------------------------------------------------------------------------------


def mtf_figure(
    quality: Quality, truth: Otf | None, name: str, limit: Diffraction | None = None, axis: FrequencyAxis = PER_PIXEL,
    others: Mapping[str, Mapping[str, Array]] | None = None,
) -> Markup:  # fmt: skip
    """MTF along both axes over frequency with 95 % bands; below, where the truth is known, how far it is off.

    Parameters
    ----------
    truth : callable, optional
        The true transfer function.
    limit : Diffraction, optional
        Where it is known, its MTF is drawn too.
    axis : FrequencyAxis
        In what frequencies are told.
    others : mapping of name to columns, optional
        Curves of other results over frequencies told alike: horizontal and vertical, or mtf across an edge.
    """
    f = quality.frequencies
    shown = f * axis.factor
    curves = {
        "horizontal": _Curve(quality.mtf_horizontal, quality.mtf_horizontal_uncertainty, _true_mtf(truth, f, 0 * f)),
        "vertical": _Curve(quality.mtf_vertical, quality.mtf_vertical_uncertainty, _true_mtf(truth, 0 * f, f)),
    }
    rows = 1 if truth is None else 2
    figure, places = axes_grid(
        3.2, 1.4 + 1.1 * rows, rows, 1, rim_in=(0.55, 0.14, 0.4, 0.08), height_ratios=[2.1, 1][:rows], hspace=0.12
    )
    for direction, curve in curves.items():
        _draw_mtf(places[0, 0], shown, curve, direction)
    for curve in curves.values():
        if curve.true is not None:
            (true,) = places[0, 0].plot(shown, curve.true, color=INK, lw=0.8, ls=(0, (3, 2)))
            true.set_label("true" if curve is curves["vertical"] else None)
    if limit is not None:
        draw_diffraction(places[0, 0], shown, limit.otf(f))
    draw_others(places[0, 0], others or {})
    title_along(places[0, 0], shown, list(_told_along(shown, curves, axis)))
    finish_mtf(places[0, 0], axis)
    _draw_undetermined(places[0, 0], shown, np.maximum(*(curve.uncertainty for curve in curves.values())))
    if truth is not None:
        for direction, curve in curves.items():
            _draw_difference(places[1, 0], shown, curve, direction)
        places[1, 0].axhline(0, color=INK, lw=0.7, ls=(0, (3, 2)))
        places[1, 0].set_ylabel("less true")
    for axes in places[:, 0]:
        _frequency_axis(axes, shown, axis, bottom=axes is places[-1, 0])
    described = "MTF along rows and columns with its 95 % bands" + (", against the true MTF" if truth else "")
    return svg(figure, name, described + (", and the diffraction limit" if limit else ""))


def draw_others(axes: Axes, others: Mapping[str, Mapping[str, Array]]) -> None:
    """The curves of other results, dashed, each named once."""
    for number, (name, columns) in enumerate(others.items()):
        dashes, label = (0, DASHES[number % len(DASHES)]), name[:LONGEST_NAME]
        for direction in ("horizontal", "vertical", "mtf"):
            if direction in columns:
                colour = ALONG.get(direction, INK)
                axes.plot(columns["frequency"], columns[direction], color=colour, lw=1, ls=dashes, label=label)
                label = "_"  # named once


def _told_along(f: Array, curves: Mapping[str, _Curve], axis: FrequencyAxis) -> Iterator[str]:
    """What the curves are at every frequency, in words."""
    for i, at in enumerate(f):
        both = (f"{name} {one.value[i]:.3f} ± {one.uncertainty[i]:.3f}" for name, one in curves.items())
        yield f"{at:.3g} {axis.unit}: {', '.join(both)}"


def _true_mtf(truth: Otf | None, fx: Array, fy: Array) -> Array | None:
    return None if truth is None else np.abs(truth(fx, fy))


def _frequency_axis(axes: Axes, f: Array, axis: FrequencyAxis, *, bottom: bool = True) -> None:
    axes.set_xlim(0, f[-1])
    if axis.factor == 1:
        axes.set_xticks(np.arange(0, f[-1] + 0.01, 0.5), None if bottom else [])
    else:
        axes.tick_params(labelbottom=bottom)
    axes.yaxis.set_label_coords(-0.165, 0.5)
    if bottom:
        axes.set_xlabel(axis.unit)


def _legend(axes: Axes) -> None:
    with matplotlib.rc_context(STYLE):
        box = {"frameon": True, "framealpha": 0.8, "edgecolor": "none"}  # readable over the diffraction limit
        axes.legend(loc="upper right", bbox_to_anchor=(1, 0.94), handlelength=1.4, **box)


def _draw_mtf(axes: Axes, f: Array, curve: _Curve, direction: str) -> None:
    spread = CONFIDENT * curve.uncertainty
    axes.fill_between(f, curve.value - spread, curve.value + spread, color=ALONG[direction], alpha=0.25, lw=0)
    axes.plot(f, curve.value, color=ALONG[direction], lw=1.4, label=direction)


def _draw_undetermined(axes: Axes, f: Array, uncertainty: Array) -> None:
    """Hatches the frequencies that the photographs do not determine."""
    unclear = uncertainty > CLEAR
    if unclear.any():
        axes.fill_between(f, 0, 1, unclear, step="mid", fc="none", ec=FAINT, hatch="////", lw=0, label="not determined")
        _legend(axes)


def draw_diffraction(axes: Axes, f: Array, mtf: Array) -> None:
    """What diffraction alone passes, dotted."""
    axes.plot(f, mtf, color=LIMIT_COLOUR, lw=1.3, ls=(0, (1, 1)), label="diffraction")


def finish_mtf(axes: Axes, axis: FrequencyAxis) -> None:
    """Nyquist, a half, the axis of the MTF and the legend."""
    axes.axvline(axis.nyquist, color=FAINT, lw=0.7)
    axes.text(axis.nyquist, 1.0, " Nyquist", color=FAINT, va="top", fontsize=7.5)
    axes.axhline(0.5, color=FAINT, lw=0.5, ls=(0, (1, 2)))
    axes.set_ylim(0, 1.04)
    axes.set_ylabel("MTF")
    _legend(axes)


def _draw_difference(axes: Axes, f: Array, curve: _Curve, direction: str) -> None:
    if curve.true is None:
        return
    off, spread = curve.value - curve.true, CONFIDENT * curve.uncertainty
    axes.fill_between(f, off - spread, off + spread, color=ALONG[direction], alpha=0.25, lw=0)
    axes.plot(f, off, color=ALONG[direction], lw=1.1)


# --- phase -------------------------------------------------------------------------------------------------------


def phase_figure(psf: Psf, name: str, axis: FrequencyAxis = PER_PIXEL) -> Markup:
    """The OTF's phase along both axes with 95 % bands, as far as it is known."""
    f = frequencies(psf)
    shown = f * axis.factor
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.55, 0.14, 0.4, 0.08))
    reach = 10.0
    for direction, angle in (("horizontal", 0.0), ("vertical", np.pi / 2)):
        phase, uncertainty = phase_along(psf, f, angle)
        unknown = np.flatnonzero(uncertainty > PHASE_KNOWN_DEG)
        known = slice(0, unknown[0] if len(unknown) else len(f))
        spread = CONFIDENT * uncertainty[known]
        low, high = phase[known] - spread, phase[known] + spread
        axes.fill_between(shown[known], low, high, color=ALONG[direction], alpha=0.25, lw=0)
        axes.plot(shown[known], phase[known], color=ALONG[direction], lw=1.4, label=direction)
        reach = max(reach, float(np.abs(phase[known]).max(initial=0)) + float(spread.max(initial=0)))
    axes.axhline(0, color=INK, lw=0.7, ls=(0, (3, 2)))
    axes.axvline(axis.nyquist, color=FAINT, lw=0.7)
    axes.set(ylim=(-1.05 * reach, 1.05 * reach), ylabel="phase, degrees")
    _frequency_axis(axes, shown, axis)
    with matplotlib.rc_context(STYLE):
        axes.legend(loc="upper left", handlelength=1.4, ncols=2)
    return svg(figure, name, "phase of the transfer function along rows and columns with its 95 % bands")


# --- two dimensions ----------------------------------------------------------------------------------------------


def mtf_map_figure(psf: Psf, name: str, limit: Diffraction | None = None, axis: FrequencyAxis = PER_PIXEL) -> Markup:
    """The MTF over the whole band as a picture, lines at 0.5 and 0.1, the Nyquist square, the end of diffraction."""
    f, mtf = mtf_map(psf, MAP_SIZE)
    f, square = f * axis.factor, axis.nyquist * np.array([-1, 1, 1, -1, -1])
    figure, ((axes,),) = axes_grid(3.2, 2.5, rim_in=(0.55, 0.75, 0.42, 0.1))
    edge = f[-1] + (f[1] - f[0]) / 2
    image = axes.imshow(
        np.clip(mtf, 0, 1), extent=(-edge, edge, edge, -edge), interpolation="none", cmap="viridis", vmin=0, vmax=1
    )
    axes.contour(f, f, mtf, CONTOURS, colors="white", linewidths=(0.7, 1.1))
    axes.plot(square, np.roll(square, 1), color="white", lw=0.7, ls=(0, (3, 2)))
    end = 0.0 if limit is None else limit.cutoff * axis.factor
    if 0 < end < edge * np.sqrt(2):
        turn = np.linspace(0, 2 * np.pi, 121)
        axes.plot(end * np.cos(turn), end * np.sin(turn), color=FAINT, lw=1, ls=(0, (1, 1.2)))
    axes.set(xlim=(-edge, edge), ylim=(edge, -edge), xlabel=f"{axis.unit} along rows", ylabel="along columns")
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=5)
    colour_bar(figure, axes, image, (1.05, 0.1, 0.05, 0.8))
    return svg(figure, name, "MTF over the frequencies along rows and columns, with lines at 0.5 and 0.1")
