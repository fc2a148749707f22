"""Sagittal and meridional MTF over image height, as a figure of a field's page and as a table beside it."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from procedures.field.maps import HeightCurve
from station.drawing.plots import Figure, curve, finished, legend, plot_axes
from station.drawing.style import title_along
from station.reports.otf_figures import MAX_NAME, FrequencyAxis
from station.results.exports import csv_bytes

FREQUENCIES = (0.125, 0.25)
"""Cycles per pixel of the plane: a quarter and half of the Nyquist frequency."""
HEIGHTS, WITHOUT_PHOTOSITE = "heights", "without_photosite"
"""Stems of the tables' names: with and without the photosite."""
COLOURS = ("#1f5fa8", "#c4541a", "#1e8449", "#6b4c9a")
KINDS = (("sagittal", "-"), ("meridional", (0, (4, 2))))
MARKERS = "os^vD"
SAME = 0.01
"""Relative difference up to which two frequencies are the same."""
HeightColumns = Mapping[str, npt.NDArray[np.float64]]


def heights_figure(
    curves: Sequence[HeightCurve],
    name: str,
    axis: FrequencyAxis,
    mm_per_pixel: float | None,
    others: Mapping[str, HeightColumns] | None = None,
    caption: str = "",
) -> Figure:
    """The MTF at each frequency over image height with its 95 % band: sagittal solid, meridional dashed.

    Without mm_per_pixel heights are in pixels. `others` are columns of other fields by name in the same units, drawn
    thin with markers.
    """
    axes, scale = plot_axes(4.4, 3.0, (0.55, 0.14, 0.42, 0.1)), mm_per_pixel or 1.0
    heights, unit = curves[0].heights * scale, "mm" if mm_per_pixel else "pixels of the plane"
    values: list[list[str]] = [[] for _ in heights]
    for one, colour in zip(curves, COLOURS, strict=False):
        at = f"{one.frequency * axis.factor:.3g} {axis.unit}"
        for kind, dashes in KINDS:
            y, uncertainty, label = getattr(one, kind), getattr(one, f"{kind}_uncertainty"), f"{kind}, {at}"
            curve(axes, one.heights * scale, y, uncertainty, colour=colour, shade=0.15, ls=dashes, label=label)
            for i, words in enumerate(values):
                words.append(f"{kind} at {at} {y[i]:.3f} ± {uncertainty[i]:.3f}")
    if len(heights) > 1:
        title_along(axes, heights, [f"{h:.3g}: {'; '.join(value)}" for h, value in zip(heights, values, strict=True)])
    shown = {other: columns for other, columns in (others or {}).items() if columns}
    own = [one.frequency * axis.factor for one in curves]
    for (other, columns), marker in zip(shown.items(), itertools.cycle(MARKERS), strict=False):
        _draw_other(axes, other, columns, marker, own, str(axis.unit))
    legend(axes, "lower left", handlelength=2.4, fontsize=7.5)
    directions = max(int(one.directions.max()) for one in curves)
    usual = (
        f"Sagittal (solid) and meridional MTF (dashed) over image height, means over up to {directions} directions "
        "from the centre; the bands hold 95 % of one place; where the pointer rests the values are shown."
    )
    usual += f" Thin, with markers: {', '.join(shown)}." if shown else ""
    if hidden := [other for other in others or {} if other not in shown]:
        usual += f" Not drawn, for lack of this plane or of heights in the same unit: {', '.join(hidden)}."
    return finished(
        axes, name, caption or usual, ylim=(0, 1.04),
        xlim=(0, max(float(heights[-1]), 1e-9)), xlabel=f"image height, {unit}", ylabel="MTF",
    )  # fmt: skip


def _draw_other(axes: Axes, name: str, columns: HeightColumns, marker: str, own: Sequence[float], unit: str) -> None:
    """Curves of another field, named once, with their frequencies if they differ."""
    frequencies = np.unique(columns["frequency"])
    same = len(frequencies) == len(own) and np.allclose(frequencies, own, rtol=SAME)
    at = "" if same else f", at {', '.join(f'{one:.3g}' for one in frequencies)} {unit}"
    label = f"{name[:MAX_NAME]}{at}"
    for frequency, colour in zip(frequencies, COLOURS, strict=False):
        rows = columns["frequency"] == frequency
        for kind, dashes in KINDS:
            axes.plot(
                columns["image_height"][rows], columns[kind][rows], color=colour, ls=dashes, lw=0.7, marker=marker,
                ms=2.5, mfc="none", mew=0.7, label=label,
            )  # fmt: skip
            label = "_"  # named once


def heights_table(curves: Sequence[HeightCurve], axis: FrequencyAxis, mm_per_pixel: float | None) -> bytes:
    """The curves as CSV: a row for each height and frequency."""
    length = "mm" if mm_per_pixel else "pixel"
    head = [f"image_height [{length}]", f"frequency [{axis.unit}]"]
    head += [f"{kind}{what}" for kind, _ in KINDS for what in ("", "_uncertainty", "_spread")] + ["directions"]
    rows = []
    for one in curves:
        columns = [getattr(one, f"{kind}{what}") for kind, _ in KINDS for what in ("", "_uncertainty", "_spread")]
        heights = one.heights * (mm_per_pixel or 1.0)
        for height, count, *row in zip(heights, one.directions, *columns, strict=True):
            rows.append(
                [f"{height:.6g}", f"{one.frequency * axis.factor:.6g}", *(f"{value:.6g}" for value in row), str(count)]
            )
    return csv_bytes([head, *rows])
