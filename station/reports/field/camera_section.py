"""What a field's page shows of the whole camera: geometry, vignetting, and what all numbers share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from procedures.field.maps import COLUMNS, FieldMap, grid
from procedures.geometry.cameras import distortion
from procedures.numbers import COLOUR_SHADING
from procedures.vignetting.formula import LightSurface
from procedures.whole_camera.from_field import WholeCamera
from procedures.whole_camera.joint import JointNumbers
from station.drawing.colours import INK
from station.drawing.style import axes_grid, colour_bar, svg
from station.reports.field.field_figures import field_map_figure
from station.reports.geometry_figures import distortion_figure, uncertainty_figure

Array = npt.NDArray[np.float64]

ARROWS = (19, 13)
"""Columns and rows of the distortion's arrows."""
REFERENCE = "G1"
NOWHERE: Array = np.zeros((0, 2))
"""No dots on a map: light is not measured at the charts."""


def camera_section(camera: WholeCamera) -> dict[str, Any]:
    """What the template shows."""
    geometry = camera.geometry
    return {
        "geometry": geometry,
        "numbers": {} if geometry.value is None else geometry.value.numbers(),
        "figures": [] if geometry.value is None else _figures(camera),
        "count": len(camera.numbers.values),
        "blocks": camera.numbers.blocks,
        "correlations": correlations_figure(camera.numbers) if len(camera.numbers.parts) > 1 else None,
    }


def _figures(camera: WholeCamera) -> list[tuple[Markup, str]]:
    found = camera.geometry.value
    assert found is not None
    places = found.camera.frame_grid(*ARROWS)
    near, moved = found.maps[0], distortion(found.camera, places)
    return [
        (distortion_figure(found, places, moved, "distortion"), "What distortion does, not to scale."),
        (uncertainty_figure(found, near, "uncertainty0"), f"How well the frame is known at {near.distance_mm:.0f} mm."),
    ]


def correlations_figure(numbers: JointNumbers) -> Markup:
    """The correlations of all numbers, part by part."""
    spread = np.sqrt(np.diag(numbers.covariance))
    scale = np.where(spread > 0, spread, 1.0)
    figure, ((axes,),) = axes_grid(4.6, 4.2, rim_in=(1.25, 0.75, 0.1, 0.1))
    image = axes.imshow(numbers.covariance / np.outer(scale, scale), cmap="RdBu_r", vmin=-1, vmax=1,
                        interpolation="none")  # fmt: skip
    ends = np.cumsum([0, *(len(part.values) for part in numbers.parts)])
    for end in ends[1:-1]:
        axes.axhline(end - 0.5, color=INK, lw=0.4)
        axes.axvline(end - 0.5, color=INK, lw=0.4)
    axes.set_yticks((ends[1:] + ends[:-1] - 1) / 2, [part.name.replace("_", " ") for part in numbers.parts])
    axes.set_xticks([])
    axes.tick_params(length=0, labelsize=7)
    colour_bar(figure, axes, image, (1.03, 0.05, 0.04, 0.9))
    return svg(figure, "correlations", "correlations of all numbers of the camera")


def light_figures(lights: Mapping[str, LightSurface]) -> list[tuple[str, Markup]]:
    """The light of every plane over the frame, and how far its colour is from that at the centre."""
    figures = []
    for name, light in lights.items():
        figures.append((f"Light of {name} over that at the frame’s centre.", _light_figure(name, light)))
    green = lights.get(REFERENCE)
    for name, light in lights.items():
        if green is not None and name != REFERENCE and light.shape == green.shape:
            words = f"Colour shading: light of {name} over that of {REFERENCE}, less 1."
            figures.append((words, _light_figure(name, light, green)))
    return figures


def _light_figure(name: str, light: LightSurface, over: LightSurface | None = None) -> Markup:
    x, y = grid(light.shape, COLUMNS)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    value = light.at(places) if over is None else light.at(places) / over.at(places) - 1
    title = f"light of {name}" if over is None else f"colour of {name}"
    what = "vignetting" if over is None else COLOUR_SHADING
    one = FieldMap(what, title, "1", x, y, value.reshape(len(y), len(x)), None)
    return field_map_figure(one, NOWHERE, light.shape, f"{name}-{what}")
