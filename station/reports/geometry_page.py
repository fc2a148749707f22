"""The page of a geometry: uncertainty of the projection, lens, residuals, chart and views."""

from procedures.geometry.estimate import Geometry
from procedures.geometry.next_view import next_view_words
from station.common.sanitise import stated
from station.drawing.plots import Figure
from station.reports import geometry_figures as figures
from station.reports.page import Block, Figures, Heading, Table, quantity
from station.reports.report import Report
from station.reports.report_page import report_page
from station.results.plane_result import PlaneResult

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
    )  # fmt: skip


def _plane_blocks(plane: PlaneResult, prefix: str) -> list[Block]:
    """The blocks of a plane; `prefix` distinguishes its figures from those of other planes."""
    geometry: Geometry | None = plane.estimate
    if geometry is None:
        return []
    maps = [
        figures.uncertainty_figure(geometry, one, f"{prefix}uncertainty{i}") for i, one in enumerate(geometry.maps)
    ]  # fmt: skip
    blocks: list[Block] = [
        f"{geometry.camera.model} from {len(geometry.views)} views, "
        f"{geometry.points // len(geometry.views)} points each on average.",
        Heading("Uncertainty of the projection: of a point fixed to the charts, from the points’ own errors"),
        Figures([figures.coverage_figure(geometry, f"{prefix}coverage"), *maps], wide=True, summary=True),
    ]
    if geometry.shutter is not None:
        blocks.append(f"The frames show a {geometry.shutter.words}.")
    if (proposed := geometry.next_view) is not None:
        blocks.append(
            f"The most useful next photograph shows the chart in {next_view_words(proposed)}: the uncertainty "
            f"({proposed.of}) would fall from {proposed.before:.4f} to {proposed.after:.4f}."
        )
    drawn = [
        figures.distortion_figure(geometry, f"{prefix}distortion"),
        figures.misfit_figure(geometry, f"{prefix}misfit"),
    ]
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
    if not geometry.formulas:
        return []
    rows = [
        [one.camera.model, str(len(one.camera.params)), f"{one.difference.rms_px:.3g}", f"{one.difference.max_px:.3g}",
         f"{one.share:.0%}"]
        for one in geometry.formulas
    ]  # fmt: skip
    trials = [[trial.model, f"{trial.roughness_px:.3g}", f"{trial.left_over:.5g}"] for trial in geometry.trials]
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
    return [figures.chart_figure(geometry, f"{prefix}chart"), Figure(Table(rows, style="plain"), caption)]


def _views(geometry: Geometry, prefix: str) -> list[Block]:
    rows = [
        [view.view.source, str(len(view.view)), stated(view.distance.value, view.distance.uncertainty),
         f"{view.tilt_deg:.1f}", f"{view.rms_px:.4f}"]
        for view in geometry.views
    ]  # fmt: skip
    worst = sorted(range(len(rows)), key=lambda i: -geometry.views[i].rms_px)[:MAX_RESIDUAL_VIEWS]
    drawn = [figures.residual_figure(geometry, geometry.views[i], f"{prefix}residual{i}") for i in sorted(worst)]
    head = ["photograph", "points", "distance, mm", "tilt, °", "residual, pixel rms"]
    return [Table(rows, head), Figures(drawn, wide=True)]
