"""Sections of a field's page for the whole camera: geometry, vignetting, and the covariance of all numbers."""

from collections.abc import Mapping

import numpy as np

from procedures.field.maps import COLUMNS, FieldMap, grid
from procedures.numbers import COLOUR_SHADING
from procedures.numerics.arrays import Array
from procedures.vignetting.surface import LightSurface
from procedures.whole_camera.from_field import JointNumbers, WholeCamera
from station.drawing.colours import INK
from station.drawing.plots import BAR_RIGHT, Figure, finished, picture, plot_axes
from station.reports.field.field_figures import field_map_figure
from station.reports.geometry_page import distortion_figure, uncertainty_figure
from station.reports.page import Block, Figures, Section, Table, causes, html, number_rows, tag
from station.reports.report import Report
from station.reports.report_page import report_page


def vignetting_page(report: Report) -> str:
    """The page of all planes."""
    lights = {plane.name: plane.estimate.surface.light for plane in report.planes if plane.estimate is not None}
    return report_page(report, summary=[Figures(light_figures(lights), wide=True)] if lights else [])


REFERENCE = "G1"
NOWHERE: Array = np.zeros((0, 2))
"""No dots on a map: light is not measured at the charts."""


def camera_section(camera: WholeCamera) -> Section:
    """Geometry, correlations, and the covariances between the parts."""
    geometry, numbers = camera.geometry.value, camera.numbers
    figures = []
    if geometry is not None:
        table = number_rows(geometry.numbers())
        figures += [distortion_figure(geometry, "distortion"),
                    uncertainty_figure(geometry, geometry.maps[0], "uncertainty0"),
                    Figure(table, f"{geometry.camera.model}.")]  # fmt: skip
    if len(numbers.parts) > 1:
        figures.append(_correlations_figure(numbers))
    words = (
        f"The charts’ {len(numbers.values)} numbers (geometry, lateral colour, PSF at every place, and those of other "
        "photographs) are in `camera.h5` with one covariance."
    )
    rows = [[f"{one.first}, {one.second}".replace("_", " "), f"{one.how}: {one.why}"] for one in numbers.blocks]
    shared = Table(rows, ["parts", "common contributions"], "wr")
    blocks: list[Block] = [words, *causes(camera.geometry, "Geometry: ")]
    blocks += [Figures(figures, wide=True)] if figures else []
    blocks += [shared] if rows else []
    return Section(html("The whole camera {}", tag(camera.geometry.verdict)), blocks)


def _correlations_figure(numbers: JointNumbers) -> Figure:
    spread = np.sqrt(np.diag(numbers.covariance))
    scale = np.where(spread > 0, spread, 1.0)
    axes = plot_axes(4.6, 4.2, (1.25, 0.75, 0.1, 0.1))
    picture(axes, numbers.covariance / np.outer(scale, scale), colours="RdBu_r", limits=(-1, 1), bar=BAR_RIGHT)
    ends = np.cumsum([0, *(len(part.values) for part in numbers.parts)])
    for end in ends[1:-1]:
        axes.axhline(end - 0.5, color=INK, lw=0.4)
        axes.axvline(end - 0.5, color=INK, lw=0.4)
    axes.set_yticks((ends[1:] + ends[:-1] - 1) / 2, [part.name.replace("_", " ") for part in numbers.parts])
    axes.tick_params(length=0, labelsize=7)
    return finished(axes, "correlations", "Correlations of all numbers, part by part.", xticks=[])


def light_figures(lights: Mapping[str, LightSurface]) -> list[Figure]:
    """The light of every plane over the frame, and its colour relative to that at the centre."""
    figures = [_light_figure(name, light) for name, light in lights.items()]
    green = lights.get(REFERENCE)
    for name, light in lights.items():
        if green is not None and name != REFERENCE and light.shape == green.shape:
            figures.append(_light_figure(name, light, green))
    return figures


def _light_figure(name: str, light: LightSurface, over: LightSurface | None = None) -> Figure:
    x, y = grid(light.shape, COLUMNS)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    value = light.at(places) if over is None else light.at(places) / over.at(places) - 1
    title = f"light of {name}" if over is None else f"colour of {name}"
    what = "vignetting" if over is None else COLOUR_SHADING
    caption = f"Light of {name} over that at the frame’s centre."
    if over is not None:
        caption = f"Colour shading: light of {name} over that of {REFERENCE}, less 1."
    one = FieldMap(what, title, "1", x, y, value.reshape(len(y), len(x)), None)
    return field_map_figure(one, NOWHERE, light.shape, f"{name}-{what}", caption)
