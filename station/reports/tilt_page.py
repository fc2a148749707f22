"""The page of a sensor's tilt: the surface of best focus, the screws and their turns."""

from typing import Any

import numpy as np
from matplotlib.patches import Circle, Rectangle

from procedures.tilt.estimate import Tilt
from station.calibration.tilt import screw_lines
from station.drawing.colours import FAINT, INK, MARK
from station.drawing.plots import BAR_RIGHT, Figure, bare, finished, plot_axes
from station.drawing.style import colour_bar
from station.reports.page import Figures, Items, Note, sentence
from station.reports.report import Report
from station.reports.report_page import report_page

STEPS = 40


def tilt_page(report: Report) -> str:
    """The page of one plane."""
    tilt: Tilt | None = report.planes[0].estimate
    if tilt is None:
        return report_page(report)
    moves = Items([sentence(line.replace(" um", " µm")) for line in screw_lines(tilt)])
    note = Note("The direction in which a screw is turned for its move depends on the camera.")
    figures = [Figures([_surface_figure(tilt), _screws_figure(tilt)], summary=True)]
    return report_page(report, summary=[moves, note], plane_blocks=lambda plane: figures)


def _surface_figure(tilt: Tilt) -> Figure:
    sensor, (width, height) = tilt.sensor, tilt.sensor.size_mm
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, STEPS), np.linspace(-height / 2, height / 2, STEPS))
    mean, measured = float(sensor.plane[0]), sensor.heights_um - sensor.plane[0]
    fitted = sensor.height_at(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape) - mean
    most = max(float(np.abs(fitted).max()), float(np.abs(measured).max()), 1e-3)
    axes = plot_axes(4.4, 3.6 * min(height / width, 1.5) + 0.5, (0.08, 0.75, 0.42, 0.08))
    looks: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -most, "vmax": most}
    lines = axes.contour(x, y, fitted, 9, linewidths=1.0, **looks)
    axes.clabel(lines, fontsize=7, fmt="%.0f")
    dots: dict[str, Any] = {"s": 36, "edgecolors": INK, "linewidths": 0.5, "zorder": 3}
    x, y = sensor.places_mm.T
    heights = axes.scatter(x, y, c=measured, **dots, **looks)
    axes.add_patch(Rectangle((-width / 2, -height / 2), width, height, fill=False, ec=FAINT, lw=0.8))
    bare(axes, xlim=(-0.52 * width, 0.52 * width), ylim=(0.52 * height, -0.52 * height), aspect="equal")
    colour_bar(axes, heights, BAR_RIGHT)
    caption = (
        "Height of the sensor behind best focus less its mean, as the photograph shows the frame: dots are measured, "
        "their colour is the value; lines are the plane with the lens’s curvature."
    )
    return finished(axes, "surface", caption, xlabel="µm behind best focus")


def _screws_figure(tilt: Tilt) -> Figure:
    """The screws from behind the camera, with the move of the sensor at each."""
    radius, axes = tilt.screws.radius_mm, plot_axes(3.4, 3.4, (0.05, 0.05, 0.05, 0.05))
    (width, height), end = tilt.sensor.size_mm, 1.7 * radius
    axes.add_patch(Rectangle((-width / 2, -height / 2), width, height, fill=False, ec=FAINT, lw=0.8))
    axes.add_patch(Circle((0, 0), radius, fill=False, ec=FAINT, lw=0.6, ls=":"))
    for number, (angle, move) in enumerate(zip(np.radians(tilt.screws.angles_deg), tilt.turns.moves, strict=True), 1):
        x, y = radius * np.sin(angle), radius * np.cos(angle)
        axes.plot(x, y, "o", ms=9, mfc="white", mec=MARK, mew=1.4)
        axes.annotate(str(number), (x, y), ha="center", va="center", fontsize=7)
        axes.annotate(f"{move.value:+.0f} µm", (1.35 * x, 1.35 * y), ha="center", va="center", fontsize=8)
    bare(axes, xlim=(-end, end), ylim=(-end, end), aspect="equal")
    caption = (
        "The screws seen from behind the camera, and the move of the sensor at each; away from the lens is positive."
    )
    return finished(axes, "screws", caption)
