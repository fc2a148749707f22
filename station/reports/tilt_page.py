"""The page of a sensor's tilt: the surface of best focus, the screws and their turns."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from matplotlib.patches import Circle, Rectangle

from procedures.outcome import Outcome
from procedures.tilt.estimate import Tilt, shim_words
from procedures.tilt.screws import SURE, Screws
from station.drawing.colours import FAINT, INK, MARK
from station.drawing.style import axes_grid, colour_bar, svg
from station.reports.page import render

STEPS = 40
"""Along each side of the drawn surface."""


def tilt_page(plane: str, count: int, outcome: Outcome[Tilt]) -> str:
    """The page of one plane, of so many photographs."""
    found = outcome.value
    if found is None:
        return render("tilt.html", plane=plane, count=count, outcome=outcome, found=None)
    return render(
        "tilt.html",
        plane=plane,
        count=count,
        outcome=outcome,
        found=found,
        advised=found.turns.helps >= SURE,
        shim=shim_words(found),
        surface=surface_figure(found),
        screws=screws_figure(found),
        turns=list(zip(found.screws.angles_deg, found.turns.moves, found.turns.turns, strict=True)),
    )


def surface_figure(found: Tilt) -> Markup:
    """Heights over the frame: what was measured, and the surface through it."""
    sensor, (width, height) = found.sensor, found.sensor.size_mm
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, STEPS), np.linspace(-height / 2, height / 2, STEPS))
    fitted = sensor.height_at(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    most = max(float(np.abs(fitted).max()), float(np.abs(sensor.heights_um).max()), 1e-3)
    figure, ((axes,),) = axes_grid(4.4, 3.6 * min(height / width, 1.5) + 0.5, rim_in=(0.08, 0.75, 0.42, 0.08))
    lines = axes.contour(x, y, fitted, 9, cmap="RdBu_r", vmin=-most, vmax=most, linewidths=1.0)
    axes.clabel(lines, fontsize=7, fmt="%.0f")
    dots = axes.scatter(*sensor.places_mm.T, c=sensor.heights_um, cmap="RdBu_r", vmin=-most, vmax=most, s=36,
                        edgecolors=INK, linewidths=0.5, zorder=3)  # fmt: skip
    axes.add_patch(Rectangle((-width / 2, -height / 2), width, height, fill=False, ec=FAINT, lw=0.8))
    axes.set(xlim=(-0.52 * width, 0.52 * width), ylim=(0.52 * height, -0.52 * height), xticks=[], yticks=[],
             aspect="equal")  # fmt: skip
    axes.spines[:].set_visible(False)
    colour_bar(figure, axes, dots, (1.03, 0.05, 0.04, 0.9))
    axes.set_xlabel("µm behind best focus")
    return svg(figure, "surface", "height of the sensor behind the surface of best focus")


def screws_figure(found: Tilt) -> Markup:
    """The screws from behind the camera, the move of the sensor beside each."""
    screws: Screws = found.screws
    reach = 1.7 * screws.radius_mm
    figure, ((axes,),) = axes_grid(3.4, 3.4, rim_in=(0.05, 0.05, 0.05, 0.05))
    width, height = found.sensor.size_mm
    axes.add_patch(Rectangle((-width / 2, -height / 2), width, height, fill=False, ec=FAINT, lw=0.8))
    axes.add_patch(Circle((0, 0), screws.radius_mm, fill=False, ec=FAINT, lw=0.6, ls=":"))
    for number, (angle, move) in enumerate(zip(np.radians(screws.angles_deg), found.turns.moves, strict=True), 1):
        towards = np.array([np.sin(angle), np.cos(angle)])
        axes.plot(*(screws.radius_mm * towards), "o", ms=9, mfc="white", mec=MARK, mew=1.4)
        axes.annotate(str(number), screws.radius_mm * towards, ha="center", va="center", fontsize=7)
        axes.annotate(f"{move.value:+.0f} µm", 1.35 * screws.radius_mm * towards, ha="center", va="center", fontsize=8)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    return svg(figure, "screws", "the screws from behind the camera; positive moves are away from the lens")
