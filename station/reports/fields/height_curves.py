"""Sagittal and meridional MTF over image height, as a figure of a field's page and as a table beside it."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
from markupsafe import Markup

from procedures.field.image_height import HeightCurve
from station.drawing.hover import tell_along
from station.drawing.style import CONFIDENT, STYLE, axes_grid, svg
from station.reports.otf_figures import FrequencyAxis
from station.results.exports import csv_bytes

FREQUENCIES = (0.125, 0.25)
"""Cycles per pixel of the plane: a quarter and half of the Nyquist frequency."""
COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a")
KINDS = (("sagittal", "-"), ("meridional", (0, (4, 2))))


def heights_figure(curves: Sequence[HeightCurve], name: str, axis: FrequencyAxis, mm_per_pixel: float | None) -> Markup:
    """The MTF at each frequency over image height with its 95 % band: sagittal solid, meridional dashed.

    Without mm_per_pixel heights are told in pixels.
    """
    figure, ((axes,),) = axes_grid(4.4, 3.0, rim_in=(0.55, 0.14, 0.42, 0.1))
    scale, words = mm_per_pixel or 1.0, f"image height, {'mm' if mm_per_pixel else 'pixels of the plane'}"
    told: list[list[str]] = [[] for _ in curves[0].heights]
    for curve, colour in zip(curves, COLOURS, strict=False):
        at = f"{curve.frequency * axis.factor:.3g} {axis.unit}"
        for kind, dashes in KINDS:
            value, spread = getattr(curve, kind), CONFIDENT * getattr(curve, f"{kind}_uncertainty")
            axes.fill_between(curve.heights * scale, value - spread, value + spread, color=colour, alpha=0.15, lw=0)
            axes.plot(curve.heights * scale, value, color=colour, ls=dashes, lw=1.4, label=f"{kind}, {at}")
            for i, words_at in enumerate(told):
                words_at.append(f"{kind} at {at} {value[i]:.3f} ± {spread[i] / CONFIDENT:.3f}")
    heights = curves[0].heights * scale
    if len(heights) > 1:
        tell_along(axes, heights, [f"{h:.3g}: {'; '.join(one)}" for h, one in zip(heights, told, strict=True)])
    axes.set(ylim=(0, 1.04), xlim=(0, max(float(heights[-1]), 1e-9)), xlabel=words, ylabel="MTF")
    with matplotlib.rc_context(STYLE):
        axes.legend(loc="lower left", handlelength=2.4, fontsize=7.5)
    return svg(figure, name, "sagittal and meridional MTF over image height with their 95 % bands")


def heights_table(curves: Sequence[HeightCurve], axis: FrequencyAxis, mm_per_pixel: float | None) -> bytes:
    """The same as CSV: a row for each height and frequency."""
    length = "mm" if mm_per_pixel else "pixel"
    head = [f"image_height [{length}]", f"frequency [{axis.unit}]"]
    head += [f"{kind}{what}" for kind, _ in KINDS for what in ("", "_uncertainty", "_spread")] + ["directions"]
    rows = []
    for curve in curves:
        columns = [getattr(curve, f"{kind}{what}") for kind, _ in KINDS for what in ("", "_uncertainty", "_spread")]
        heights = curve.heights * (mm_per_pixel or 1.0)
        for height, count, *row in zip(heights, curve.directions, *columns, strict=True):
            rows.append(
                [f"{height:.6g}", f"{curve.frequency * axis.factor:.6g}", *(f"{one:.6g}" for one in row), str(count)]
            )
    return csv_bytes([head, *rows])
