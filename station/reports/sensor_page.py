"""The page of a sensor: the plots of EMVA 1288, periodic patterns and defect pixels."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from procedures.numbers import QUANTUM_EFFICIENCY
from procedures.sensor.estimate import FixedPattern, SensorResult
from procedures.sensor.information import input_snr, linear_snr, total_snr
from procedures.sensor.spectrograms import Period
from station.common.sanitise import stated
from station.drawing.colours import ALONG, FAINT, INK, MARK
from station.drawing.plots import DASHED, DOTTED, Figure, curve, finished, legend, plot_axes, points
from station.reports.page import Block, Figures, Heading, Items, Note, Table, quantity
from station.reports.report import Report
from station.reports.report_page import SUMMARY_FIGURES, report_page
from station.results.plane_result import PlaneResult

BLUE, ORANGE = ALONG["horizontal"], ALONG["vertical"]
MIN_COUNT = 0.5
"""Pixels below which a logarithmic histogram ends."""


def _axes() -> Axes:
    return plot_axes(3.6, 2.6, (0.78, 0.14, 0.42, 0.12))


def _light_label(result: SensorResult) -> dict[str, Any]:
    return {"xlabel": "photons per pixel" if QUANTUM_EFFICIENCY in result.numbers else "light (exposure)"}


def _transfer(result: SensorResult, plane: str) -> Figure:
    axes, transfer = _axes(), result.transfer
    signal, excess, used = result.curves.signal[0], result.curves.excess[0], transfer.fitted
    end = np.array([0, signal[transfer.saturation]])
    axes.plot(signal[used], excess[used], "o", ms=3, color=BLUE, label="fitted")
    axes.plot(signal[~used], excess[~used], "o", ms=3, mfc="none", color=FAINT, label="not fitted")
    curve(axes, end, transfer.gain[0] * end, width=1, label="K times signal")
    axes.axvline(end[1], color=MARK, lw=1, ls=DASHED, label="saturation")
    legend(axes)
    caption = "Photon transfer: variance over signal, each less that in the dark; the slope is K."
    return finished(axes, f"transfer-{plane}", caption, xlabel="signal less dark, DN", ylabel="variance less dark, DN²")


def _response(result: SensorResult, plane: str) -> Figure:
    """Signal over light, and the line through the levels of the linearity fit."""
    axes, light, signal, line = _axes(), result.curves.light[0], result.curves.signal[0], result.linearity
    axes.plot(light, signal, "o", ms=3, color=BLUE, label="levels")
    curve(axes, light, line.slope[0] * light + line.offset[0], width=1, label="line")
    legend(axes)
    settings = {"ylabel": "signal less dark, DN", "ylim": (0, 1.1 * signal.max()), **_light_label(result)}
    caption = "Characteristic curve: signal over light."
    return finished(axes, f"response-{plane}", caption, **settings)


def _linearity(result: SensorResult, plane: str) -> Figure:
    axes, line = _axes(), result.linearity
    at, deviation = result.curves.light[0][line.used], 100 * line.deviation[:, line.used]
    points(axes, at, deviation[0], np.std(deviation[1:], axis=0), colour=BLUE, lw=0.8, ls="none")
    axes.axhline(0, color=INK, lw=0.7, ls=DASHED)
    caption = "Deviation from the line, 5 % to 95 % of saturation, with 95 % bars."
    return finished(axes, f"linearity-{plane}", caption, ylabel="deviation, %", **_light_label(result))


def _snr(result: SensorResult, plane: str) -> Figure:
    """SNR measured, of the linear model, with non-uniformity, and of photons alone; both axes logarithmic."""
    axes, light = _axes(), result.curves.light[0]
    used = slice(0, result.transfer.saturation + 1)
    model = np.geomspace(max(light[0] / 30, 1e-12), light[used][-1], 120)
    total = total_snr(result.transfer, result.numbers, model)
    axes.loglog(light[used], input_snr(result.curves)[0][used], "o", ms=3, color=BLUE, label="measured")
    curve(axes, model, linear_snr(result.transfer, model), width=1, label="linear model")
    if np.isfinite(total).all():
        curve(axes, model, total, colour=ORANGE, width=1, label="with DSNU and PRNU")
    if QUANTUM_EFFICIENCY in result.numbers:
        curve(axes, model, np.sqrt(model), colour=FAINT, width=1, ls=DOTTED, label="ideal sensor")
    axes.axhline(1, color=FAINT, lw=0.6)
    legend(axes)
    caption = "Signal-to-noise ratio."
    return finished(axes, f"snr-{plane}", caption, ylabel="SNR", **_light_label(result))


def _dark(result: SensorResult, plane: str) -> Figure:
    axes, curves = _axes(), result.curves
    for values, words, colour in (
        (curves.dark_mean, "mean, DN", BLUE),
        (curves.dark_variance, "variance, DN²", ORANGE),
    ):
        more, uncertainty = values[0] - values[0, 0], np.std(values[1:], axis=0)
        points(axes, curves.dark_exposure_s, more, uncertainty, colour=colour, ls="-", label=words)
    legend(axes)
    caption = "Mean and variance in the dark over exposure, less those of the shortest, with 95 % bars."
    return finished(axes, f"dark-{plane}", caption, xlabel="exposure, s", ylabel="more than at the shortest")


def _spectrogram(pattern: FixedPattern, place: str, words: str) -> Figure:
    """Spectrograms along rows and columns, the floor of temporal noise, and significant periods."""
    axes = _axes()
    for one in pattern.spectrograms:
        axes.semilogy(one.frequencies[1:], one.amplitude[1:], lw=0.8, color=ALONG[one.direction], label=one.direction)
    axes.axhline(pattern.spectrograms[0].floor, color=FAINT, lw=0.9, ls=DASHED, label="temporal noise left")
    for period in pattern.periods:
        axes.axvline(period.frequency.value, color=MARK, lw=0.8, ls=DOTTED)
    top = 4 * max(float(spectrogram.amplitude[1:].max()) for spectrogram in pattern.spectrograms)  # room for the legend
    legend(axes, "upper right")
    settings = {"xlabel": "cycles/pixel", "ylabel": f"amplitude, {pattern.unit}"}
    caption = f"{words}: spectrograms along rows and columns; dotted, periods."
    return finished(axes, f"spectrogram-{place}", caption, xlim=(0, 0.5), ylim=(None, top), **settings)


def _histogram(pattern: FixedPattern, place: str, words: str) -> Figure:
    axes, shown = _axes(), pattern.defects.histogram
    counts, model = (np.maximum(one, MIN_COUNT) for one in (shown.counts, shown.model))
    axes.step(shown.centres, counts, where="mid", color=BLUE, lw=0.9, label="pixels")
    curve(axes, shown.centres, model, width=0.8, ls=DASHED, label="normal")
    for limit in (-shown.limit, shown.limit):
        if shown.centres[0] <= limit <= shown.centres[-1]:
            axes.axvline(limit, color=MARK, lw=0.9)
    axes.set_yscale("log")
    legend(axes, "upper right")
    settings = {"xlabel": f"deviation, {pattern.unit}", "ylabel": "pixels", "ylim": (MIN_COUNT, None)}
    caption = f"{words}: histogram of deviations; orange, limit of defects."
    return finished(axes, f"histogram-{place}", caption, **settings)


def _accumulated(pattern: FixedPattern, place: str, words: str) -> Figure:
    axes, shown = _axes(), pattern.defects.histogram
    order, all_pixels = np.argsort(np.abs(shown.centres)), shown.counts.sum()
    share = 100 * np.cumsum(shown.counts[order][::-1])[::-1] / all_pixels
    axes.semilogy(np.abs(shown.centres)[order], np.maximum(share, 1e-9), color=BLUE, lw=0.9)
    axes.axvline(shown.limit, color=MARK, lw=0.9)
    settings = {"xlabel": f"deviation, {pattern.unit}", "ylabel": "pixels, %"}
    caption = f"{words}: accumulated histogram: share of the pixels that deviate at least so far."
    return finished(axes, f"accumulated-{place}", caption, ylim=(50 / all_pixels, 130), **settings)


MAX_DEFECTS = 40
INTERVALS = Note(
    "95 % intervals of temporal numbers: draws of every level’s mean and variance; of spatial numbers: residual "
    "temporal noise of the mean pictures. They are this sensor’s, not its model’s. By the standard’s sections: "
    "`emva1288.xml`."
)


def sensor_page(report: Report) -> str:
    """The page of all planes."""
    return report_page(report, plane_blocks=_plane_blocks)


def _plane_blocks(plane: PlaneResult) -> list[Block]:
    result: SensorResult | None = plane.estimate
    if result is None:
        return []
    patterns = {which: one for which, one in (("dark", result.dark), ("light", result.light)) if one is not None}
    figures = [draw(result, plane.name) for draw in (_transfer, _response, _linearity, _snr)]
    figures += [_dark(result, plane.name)] if len(result.curves.dark_exposure_s) > 1 else []
    for which, pattern in patterns.items():
        words = {"dark": "Dark", "light": "Response"}[which]
        figures += [draw(pattern, f"{which}-{plane.name}", words) for draw in (_spectrogram, _histogram, _accumulated)]
    blocks: list[Block] = [Figures(figures[:SUMMARY_FIGURES], summary=True), Figures(figures[SUMMARY_FIGURES:])]
    if periods := [_period_words(period) for pattern in patterns.values() for period in pattern.periods]:
        blocks += [Heading("Periodic patterns"), Items(periods)]
    defects = [
        [which, str(row), str(column), f"{deviation:.4g} {pattern.unit}".replace("-", "−")]
        for which, pattern in patterns.items()
        for (row, column), deviation in zip(pattern.defects.places, pattern.defects.deviation, strict=True)
    ]
    if defects:
        blocks += [Heading("Defect pixels"), Table(defects[:MAX_DEFECTS], ["picture", "row", "column", "deviation"])]
        if (rest := len(defects) - MAX_DEFECTS) > 0:
            blocks.append(Note(f"and {rest} more: `defects_{plane.name}.csv`."))
    return [*blocks, INTERVALS]


def _period_words(period: Period) -> str:
    kind = "Rows" if period.pattern == "row" else "Columns"
    frequency = stated(period.frequency.value, period.frequency.uncertainty)
    return (
        f"{kind} differ with a period of {1 / period.frequency.value:.3f} pixels. Frequency {frequency} cycles/pixel, "
        f"amplitude {quantity(period.amplitude)}."
    )
