"""Sagittal and meridional MTF over image height, as a figure of a field's page and as a table beside it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes

from procedures.field.image_height import HeightCurve
from station.drawing.hover import title_along
from station.drawing.style import CONFIDENT, STYLE, axes_grid, svg
from station.reports.otf_figures import LONGEST_NAME, FrequencyAxis
from station.results.exports import csv_bytes

FREQUENCIES = (0.125, 0.25)
"""Cycles per pixel of the plane: a quarter and half of the Nyquist frequency."""
HEIGHTS, WITHOUT_PHOTOSITE = "heights", "without_photosite"
"""Stems of the tables' names: of the camera, and of what comes before its photosites."""
COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a")
KINDS = (("sagittal", "-"), ("meridional", (0, (4, 2))))
MARKERS = "os^vD"
"""Of other fields, one after the other."""
SAME = 0.01
"""Difference of two frequencies, over one of them, that is none."""
HeightColumns = Mapping[str, npt.NDArray[np.float64]]


def heights_figure(
    curves: Sequence[HeightCurve],
    name: str,
    axis: FrequencyAxis,
    mm_per_pixel: float | None,
    others: Mapping[str, HeightColumns] | None = None,
) -> Markup:
    """The MTF at each frequency over image height with its 95 % band: sagittal solid, meridional dashed.

    Without mm_per_pixel heights are told in pixels. `others` are columns of other fields by their names, in the same
    units, drawn thin, with a mark at each height.
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
        title_along(axes, heights, [f"{h:.3g}: {'; '.join(one)}" for h, one in zip(heights, told, strict=True)])
    own = [curve.frequency * axis.factor for curve in curves]
    for (other, columns), marker in zip((others or {}).items(), itertools.cycle(MARKERS), strict=False):
        _draw_other(axes, other, columns, marker, own, str(axis.unit))
    axes.set(ylim=(0, 1.04), xlim=(0, max(float(heights[-1]), 1e-9)), xlabel=words, ylabel="MTF")
    with matplotlib.rc_context(STYLE):
        axes.legend(loc="lower left", handlelength=2.4, fontsize=7.5)
    return svg(figure, name, "sagittal and meridional MTF over image height with their 95 % bands")


def _draw_other(axes: Axes, name: str, columns: HeightColumns, marker: str, own: Sequence[float], unit: str) -> None:
    """Another field's curves in the colours of this one's, named once, with their frequencies where they are others."""
    frequencies = np.unique(columns["frequency"])
    same = len(frequencies) == len(own) and np.allclose(frequencies, own, rtol=SAME)
    at = "" if same else f", at {', '.join(f'{one:.3g}' for one in frequencies)} {unit}"
    label = f"{name[:LONGEST_NAME]}{at}"
    for frequency, colour in zip(frequencies, COLOURS, strict=False):
        rows = columns["frequency"] == frequency
        for kind, dashes in KINDS:
            axes.plot(
                columns["image_height"][rows], columns[kind][rows], color=colour, ls=dashes, lw=0.7, marker=marker,
                ms=2.5, mfc="none", mew=0.7, label=label,
            )  # fmt: skip
            label = "_"  # named once


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
