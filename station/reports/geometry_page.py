"""The page of a geometry: uncertainty of the projection, lens, residuals, chart and views."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path

from procedures.geometry.cameras import CameraModel, distortion
from procedures.geometry.estimate import Geometry, PosedView, UncertaintyMap
from procedures.geometry.next_view import next_view_words
from procedures.geometry.views import chart_nodes
from procedures.numerics.arrays import Array
from procedures.pattern_psf.correspondences import BINS
from station.common.sanitise import stated
from station.drawing.colours import ALONG, INK, MARK
from station.drawing.plots import BAR_RIGHT, Figure, arrows, bare, finished, frame_axes, picture, plot_axes
from station.reports.page import Block, Figures, Heading, Table, quantity
from station.reports.report import Report
from station.reports.report_page import report_page
from station.results.plane_result import PlaneResult

WIDTH_IN = 4.4
ARROWS = (19, 13)
MAX_LENGTH = 0.05


def _frame(camera: CameraModel, right_in: float = 0.08) -> Axes:

    return frame_axes(WIDTH_IN + right_in, (camera.rows, camera.columns), (0.08, right_in, 0.42, 0.08))


def coverage_figure(geometry: Geometry, name: str) -> Figure:
    """Points of the charts, and the outline of the covered region."""
    axes = _frame(geometry.camera)
    for i, view in enumerate(geometry.views):
        axes.add_artist(_dots(view.view.points, ec=f"C{i}", lw=0.8, alpha=0.6))
    axes.add_patch(Polygon(geometry.region, fill=False, ec=INK, lw=1.0))
    axes.plot(*geometry.camera.centre, "+", color=MARK, ms=10, mew=1.4)
    words = f"{geometry.points} points of {len(geometry.views)} views; + the principal point"
    caption = "What the camera was measured from. Beyond the outline its model is an extrapolation."
    return finished(axes, name, caption, xlabel=words)


def _dots(points: Array, **looks: Any) -> PathPatch:
    """Points (n, 2) as one path of lines without length and with round ends: markers take four times the page."""
    path = Path(np.repeat(points, 2, axis=0), np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    return PathPatch(path, fill=False, capstyle="round", **looks)


def uncertainty_figure(geometry: Geometry, one: UncertaintyMap, name: str) -> Figure:
    """Uncertainty of the projection over the frame at one distance."""
    axes = _frame(geometry.camera, right_in=0.75)
    top = float(np.nanpercentile(one.value, 98)) if np.isfinite(one.value).any() else 1.0
    half_x, half_y = (one.x[1] - one.x[0]) / 2, (one.y[1] - one.y[0]) / 2
    extent = (one.x[0] - half_x, one.x[-1] + half_x, one.y[-1] + half_y, one.y[0] - half_y)
    picture(axes, one.value, extent=extent, colours="YlOrBr", limits=(0, top), smooth=True, bar=(1.02, 0.05, 0.03, 0.9))
    axes.add_patch(Polygon(geometry.region, fill=False, ec=INK, lw=0.8, ls="--"))
    far = f"{one.distance_mm:.0f} mm away" if np.isfinite(one.distance_mm) else "at infinity"
    words = "pixels, root mean square; dashed: covered by charts"
    return finished(axes, name, f"Uncertainty of the projection {far}.", xlabel=words)


def _arrows(camera: CameraModel, places: Array, moves: Array, name: str, caption: str, colour: str = INK) -> Figure:
    axes, longest = _frame(camera), float(np.nanmax(np.linalg.norm(moves, axis=1)))
    looks = {"width": 0.0025, "color": colour, "headwidth": 4}
    arrows(axes, places, moves, longest=longest, length=MAX_LENGTH * camera.columns, **looks)
    return finished(axes, name, caption, xlabel=f"longest arrow: {longest:.3g} pixel")


def distortion_figure(geometry: Geometry, name: str) -> Figure:
    """Arrows from the positions of a pinhole camera to those of the lens."""
    places = geometry.camera.frame_grid(*ARROWS)
    moved = distortion(geometry.camera, places)
    known = np.isfinite(moved).all(axis=1)
    caption = "Distortion: from the image of a pinhole of this focal length to the image of the lens."
    return _arrows(geometry.camera, (places - moved)[known], moved[known], name, caption)


def misfit_figure(geometry: Geometry, name: str) -> Figure:
    """The smooth field that the model does not describe, inside the covered region."""
    places = geometry.camera.frame_grid(*ARROWS)
    places = places[Path(geometry.region).contains_points(places)]
    misfit = geometry.misfit
    caption = (
        f"The smooth residual field that all views have in common: {misfit.rms_px:.4f} pixel rms beyond its noise; "
        f"noise alone makes as much with probability {misfit.probability:.2g}."
    )
    return _arrows(geometry.camera, places, misfit.at(places), name, caption, ALONG["vertical"])


def residual_figure(geometry: Geometry, view: PosedView, name: str) -> Figure:
    """Residuals of a view."""
    return _arrows(geometry.camera, view.view.points, view.residual_px, name, f"Residuals of {view.view.source}.")


def chart_figure(geometry: Geometry, name: str) -> Figure:
    """Deviations of the chart in its plane as arrows, out of it as colours."""
    axes = plot_axes(4.6, 4.2, (0.08, 0.95, 0.42, 0.08))
    deviations, plan = geometry.shape.deviations_mm, chart_nodes(1.0)[:, :2]
    half = float(plan.max()) * (1 + 1 / BINS)
    bend = deviations[:, 2].reshape(BINS, BINS)
    most = max(float(np.abs(bend).max()), 1e-6)
    picture(axes, bend, extent=(-half, half, half, -half), colours="RdBu_r", limits=(-most, most), bar=BAR_RIGHT)
    longest = float(np.linalg.norm(deviations[:, :2], axis=1).max())
    arrows(axes, plan, deviations[:, :2], longest=longest, length=0.12 * half, width=0.003, color=INK)
    bare(axes, xlabel=f"longest arrow {longest:.3f} mm; colours: away from the camera, mm")
    caption = (
        "What all views have in common: the print’s own errors, and the sheet’s bending. Scale is not among them: a "
        "larger chart farther away looks the same."
    )
    return finished(axes, name, caption)


MAX_RESIDUAL_VIEWS = 6
"""Views whose residuals are drawn: those with the largest."""


def geometry_page(report: Report) -> str:
    """The page of all planes."""
    summary = (
        "Camera, poses and the chart’s own shape are adjusted together to points with covariances, so that every "
        "number below includes the uncertainty of all. Pixel centres lie at integers."
    )
    prefix = "{}-" if len(report.planes) > 1 else ""
    return report_page(
        report, summary=[summary], plane_blocks=lambda plane: _plane_blocks(plane, prefix.format(plane.name))
    )


def _plane_blocks(plane: PlaneResult, prefix: str) -> list[Block]:
    """The blocks of a plane; `prefix` distinguishes its figures from those of other planes."""
    geometry: Geometry | None = plane.estimate
    if geometry is None:
        return []
    maps = [uncertainty_figure(geometry, one, f"{prefix}uncertainty{i}") for i, one in enumerate(geometry.maps)]
    blocks: list[Block] = [
        f"{geometry.camera.model} from {len(geometry.views)} views, "
        f"{geometry.points // len(geometry.views)} points each on average.",
        Heading("Uncertainty of the projection: of a point fixed to the charts, from the points’ own errors"),
        Figures([coverage_figure(geometry, f"{prefix}coverage"), *maps], wide=True, summary=True),
    ]
    if geometry.shutter is not None:
        blocks.append(f"The frames show a {geometry.shutter.words}.")
    if (proposed := geometry.next_view) is not None:
        blocks.append(
            f"The most useful next photograph shows the chart in {next_view_words(proposed)}: the uncertainty "
            f"({proposed.of}) would fall from {proposed.before:.4f} to {proposed.after:.4f}."
        )
    drawn = [distortion_figure(geometry, f"{prefix}distortion"), misfit_figure(geometry, f"{prefix}misfit")]
    return [
        *blocks,
        Heading("The lens, and the residuals of its model"),
        Figures([*drawn, *_formulas(geometry)], wide=True),
        Heading("The chart as it hangs"),
        Figures(_chart(geometry, prefix), wide=True),
        Heading("The views"),
        *_views(geometry, prefix),
    ]


def _formulas(geometry: Geometry) -> list[Figure]:
    """The parametric models fitted to a reference, and the compared degrees of its smoothness."""
    if not geometry.formulas:
        return []
    rows = [
        [one.camera.model, str(len(one.camera.params)), f"{one.difference.rms_px:.3g}", f"{one.difference.max_px:.3g}",
         f"{one.share:.0%}"]
        for one in geometry.formulas
    ]  # fmt: skip
    trials = [[trial.model, f"{trial.roughness_px:.3g}", f"{trial.residual:.5g}"] for trial in geometry.trials]
    return [
        Figure(
            Table(rows, ["formula", "parameters", "loss, pixel rms", "largest", "of the covered frame"], style="plain"),
            "Formulas fitted to the reference, as exports have them, with their loss over the covered frame.",
        ),
        Figure(
            Table(trials, ["spline", "roughness, pixel", "error at points not fitted"], style="plain"),
            "Splines fitted to half of the points and compared with the other half: mean square in units of the "
            "points’ covariances. The first is used.",
        ),
    ]


def _chart(geometry: Geometry, prefix: str) -> list[Figure]:
    shape = geometry.shape
    rows = [[name.replace("_", " "), quantity(term)] for name, term in shape.terms.items()]
    rows += [["own error of a node, in the plane", f"{shape.node_mm[0]:.4f} mm"],
             ["own error of a node, out of it", f"{shape.node_mm[2]:.4f} mm"]]  # fmt: skip
    caption = "Its smooth part, at the chart’s rim; and the scatter of single nodes."
    return [chart_figure(geometry, f"{prefix}chart"), Figure(Table(rows, style="plain"), caption)]


def _views(geometry: Geometry, prefix: str) -> list[Block]:
    rows = [
        [view.view.source, str(len(view.view)), stated(view.distance.value, view.distance.uncertainty),
         f"{view.tilt_deg:.1f}", f"{view.rms_px:.4f}"]
        for view in geometry.views
    ]  # fmt: skip
    worst = sorted(range(len(rows)), key=lambda i: -geometry.views[i].rms_px)[:MAX_RESIDUAL_VIEWS]
    drawn = [residual_figure(geometry, geometry.views[i], f"{prefix}residual{i}") for i in sorted(worst)]
    head = ["photograph", "points", "distance, mm", "tilt, °", "residual, pixel rms"]
    return [Table(rows, head), Figures(drawn, wide=True)]
