"""The plots that EMVA 1288 asks for: transfer, response, linearity, SNR, spectrograms, histograms, dark current."""

from __future__ import annotations

from typing import Literal

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from procedures.numbers import QUANTUM_EFFICIENCY
from procedures.sensor.estimate import FixedPattern, SensorResult
from procedures.sensor.signal_to_noise import input_snr, linear_snr, total_snr
from procedures.sensor.spectrograms import Period
from station.drawing.colours import ALONG, FAINT, INK, MARK
from station.drawing.style import CONFIDENT, STYLE, axes_grid, svg

Corner = Literal["upper left", "upper right"]
Array = npt.NDArray[np.float64]

WIDTH_IN, HEIGHT_IN = 3.6, 2.6
RIM = (0.78, 0.14, 0.42, 0.12)


def _axes() -> tuple[Figure, Axes]:
    figure, ((axes,),) = axes_grid(WIDTH_IN, HEIGHT_IN, rim_in=RIM)
    return figure, axes


def _finish(
    figure: Figure, axes: Axes, x: str, y: str, name: str, words: str, *, legend: Corner | None = None
) -> Markup:
    axes.set(xlabel=x, ylabel=y)
    if legend:
        with matplotlib.rc_context(STYLE):
            axes.legend(loc=legend, handlelength=1.4)
    return svg(figure, name, words)


def light_unit(found: SensorResult) -> str:
    """What the light is told in."""
    return "photons per pixel" if QUANTUM_EFFICIENCY in found.numbers else "light (exposure)"


def transfer_figure(found: SensorResult, name: str) -> Markup:
    """Variance less dark over signal, the line whose slope is K, and saturation."""
    figure, axes = _axes()
    curves, transfer = found.curves, found.transfer
    signal, excess = curves.signal[0], curves.excess[0]
    inside = transfer.fitted
    axes.plot(signal[inside], excess[inside], "o", ms=3, color=ALONG["horizontal"], label="fitted")
    axes.plot(signal[~inside], excess[~inside], "o", ms=3, mfc="none", color=FAINT, label="not fitted")
    reach = np.array([0, signal[transfer.saturation]])
    axes.plot(reach, transfer.gain[0] * reach, color=INK, lw=1, label="K times signal")
    axes.axvline(signal[transfer.saturation], color=MARK, lw=1, ls=(0, (3, 2)), label="saturation")
    words = "temporal variance less that in the dark over the signal, with the line whose slope is the gain"
    return _finish(figure, axes, "signal less dark, DN", "variance less dark, DN²", name, words, legend="upper left")


def response_figure(found: SensorResult, name: str) -> Markup:
    """Signal over light, and the line through the levels of the linearity fit."""
    figure, axes = _axes()
    light, signal, line = found.curves.light[0], found.curves.signal[0], found.linearity
    axes.plot(light, signal, "o", ms=3, color=ALONG["horizontal"], label="levels")
    axes.plot(light, line.slope[0] * light + line.offset[0], color=INK, lw=1, label="line")
    axes.set_ylim(0, 1.1 * signal.max())
    return _finish(
        figure, axes, light_unit(found), "signal less dark, DN", name, "signal over light", legend="upper left"
    )


def linearity_figure(found: SensorResult, name: str) -> Markup:
    """Relative deviations from the line, with their 95 % bars."""
    figure, axes = _axes()
    line = found.linearity
    at, deviation = found.curves.light[0][line.used], 100 * line.deviation[:, line.used]
    spread = CONFIDENT * np.std(deviation[1:], axis=0)
    axes.errorbar(at, deviation[0], spread, fmt="o", ms=3, lw=0.8, color=ALONG["horizontal"])
    axes.axhline(0, color=INK, lw=0.7, ls=(0, (3, 2)))
    words = "relative deviation of the signal from the line, 5 % to 95 % of saturation, with 95 % bars"
    return _finish(figure, axes, light_unit(found), "deviation, %", name, words)


def snr_figure(found: SensorResult, name: str) -> Markup:
    """Measured SNR, the linear model's, that with non-uniformity, and of photons alone; both axes logarithmic."""
    figure, axes = _axes()
    light = found.curves.light[0]
    inside = slice(0, found.transfer.saturation + 1)
    model = np.geomspace(max(light[0] / 30, 1e-12), light[inside][-1], 120)
    axes.loglog(
        light[inside], input_snr(found.curves)[0][inside], "o", ms=3, color=ALONG["horizontal"], label="measured"
    )
    axes.loglog(model, linear_snr(found.transfer, model), color=INK, lw=1, label="linear model")
    total = total_snr(found.transfer, found.numbers, model)
    if np.isfinite(total).all():
        axes.loglog(model, total, color=ALONG["vertical"], lw=1, label="with DSNU and PRNU")
    if QUANTUM_EFFICIENCY in found.numbers:
        axes.loglog(model, np.sqrt(model), color=FAINT, lw=1, ls=(0, (1, 1)), label="ideal sensor")
    axes.axhline(1, color=FAINT, lw=0.6)
    words = "signal-to-noise ratio over light: measured, by the linear model, with non-uniformity"
    return _finish(figure, axes, light_unit(found), "SNR", name, words, legend="upper left")


def dark_figure(found: SensorResult, name: str) -> Markup | None:
    """Mean and variance in the dark over exposure; None where there is one exposure."""
    curves = found.curves
    if len(curves.dark_exposure_s) < 2:
        return None
    figure, axes = _axes()
    for values, words, key in (
        (curves.dark_mean, "mean, DN", "horizontal"),
        (curves.dark_variance, "variance, DN²", "vertical"),
    ):
        shown = values[0] - values[0, 0]
        spread = CONFIDENT * np.std(values[1:], axis=0)
        axes.errorbar(curves.dark_exposure_s, shown, spread, fmt="o-", ms=3, lw=0.9, color=ALONG[key], label=words)
    words = "mean and variance in the dark over exposure time, each less that of the shortest"
    return _finish(figure, axes, "exposure, s", "more than at the shortest", name, words, legend="upper left")


def spectrogram_figure(pattern: FixedPattern, name: str) -> Markup:
    """Spectrograms along rows and columns, the floor of temporal noise, and the periods that stand out."""
    figure, axes = _axes()
    for one in pattern.spectrograms:
        axes.semilogy(one.frequencies[1:], one.amplitude[1:], lw=0.8, color=ALONG[one.direction], label=one.direction)
    axes.axhline(pattern.spectrograms[0].floor, color=FAINT, lw=0.9, ls=(0, (3, 2)), label="temporal noise left")
    for period in pattern.periods:
        axes.axvline(period.frequency.value, color=MARK, lw=0.8, ls=(0, (1, 1)))
    axes.set_xlim(0, 0.5)
    axes.set_ylim(None, 4 * max(float(one.amplitude[1:].max()) for one in pattern.spectrograms))  # room for the legend
    words = "root of the power over frequency, along rows and along columns"
    return _finish(figure, axes, "cycles/pixel", f"amplitude, {pattern.unit}", name, words, legend="upper right")


def histogram_figure(pattern: FixedPattern, name: str) -> Markup:
    """How many pixels deviate how far, the normal distribution beside it, and the limit of defects."""
    figure, axes = _axes()
    shown = pattern.defects.histogram
    axes.step(
        shown.centres, np.maximum(shown.counts, 0.5), where="mid", color=ALONG["horizontal"], lw=0.9, label="pixels"
    )
    axes.plot(shown.centres, np.maximum(shown.model, 0.5), color=INK, lw=0.8, ls=(0, (3, 2)), label="normal")
    for side in (-1, 1):
        if shown.centres[0] <= side * shown.limit <= shown.centres[-1]:
            axes.axvline(side * shown.limit, color=MARK, lw=0.9)
    axes.set_yscale("log")
    axes.set_ylim(0.5, None)
    words = "logarithmic histogram of the pixels' deviations with the limit from which they are defects"
    return _finish(figure, axes, f"deviation, {pattern.unit}", "pixels", name, words, legend="upper right")


def accumulated_figure(pattern: FixedPattern, name: str) -> Markup:
    """Share of the pixels that deviate at least so far."""
    figure, axes = _axes()
    shown = pattern.defects.histogram
    size = np.abs(shown.centres)
    order = np.argsort(size)
    share = 100 * np.cumsum(shown.counts[order][::-1])[::-1] / shown.counts.sum()
    axes.semilogy(size[order], np.maximum(share, 1e-9), color=ALONG["horizontal"], lw=0.9)
    axes.axvline(shown.limit, color=MARK, lw=0.9)
    axes.set_ylim(100 / shown.counts.sum() / 2, 130)
    words = "share of the pixels that deviate at least so far from the mean"
    return _finish(figure, axes, f"deviation, {pattern.unit}", "pixels, %", name, words)


def period_words(period: Period) -> str:
    """A period for people."""
    kind = "rows" if period.pattern == "row" else "columns"
    return f"{kind} differ with a period of {1 / period.frequency.value:.3f} pixels"
