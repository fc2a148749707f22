"""Geometric calibration from views of a chart: estimate, uncertainties and verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procedures.display import summary
from procedures.geometry.adjustment import POSE, Adjustment, AdjustmentProblem, adjust
from procedures.geometry.budget import VarianceParts, variance_parts
from procedures.geometry.cameras import SPLINE, CameraModel, parameter_names
from procedures.geometry.formulas import FittedFormula, fit_formulas, most_apt
from procedures.geometry.misfit import Misfit, find_misfit
from procedures.geometry.model_discrepancy import find_discrepancy
from procedures.geometry.next_view import NextView, next_views
from procedures.geometry.reference import SmoothnessTrial, first_state, fit_model
from procedures.geometry.shape import NAMES, estimated_node_errors, scale_spread, shape_model
from procedures.geometry.shutter import ShutterTiming, find_shutter, with_row_time
from procedures.geometry.uncertainty import covered_region, enclosed, projection_derivative, projection_uncertainty
from procedures.geometry.views import ChartView, Pose, chart_nodes, greatest_tilt, normals_spread_deg
from procedures.numbers import FOCAL, READOUT_TIME, ROW_TIME, projection_at
from procedures.numerics.arrays import Array
from procedures.outcome import SYMPTOM, BadParameter, Check, Outcome, Quantity, Refused, Verdict, verdict_of

FRONTAL_DEG = 20.0
"""If no chart is tilted by more, its frontal poses explain a refusal; distortion alone appears as 15 degrees."""
SAME_DEG = 5.0  # greatest angle between the charts' normals and their mean that explains a refusal
LEAST_VIEWS = 6  # with fewer, the shape of the chart and that of the lens are hardly distinguished
FEWEST_VIEWS = 3  # fewer do not determine five pinhole parameters and the shape of a plane chart
NODE_ERROR_ROUNDS = 2  # repetitions of the estimate of the node errors' standard deviation
RIM = 0.01  # share of the frame by which points may lie outside it
SMALL_SHARE = 0.6  # share of the frame covered by charts below which too much of it is extrapolated
LOOSE_FOCAL = 0.005  # relative standard uncertainty of the focal length above which the views are too similar
NEGLIGIBLE_PX = 0.005
"""A systematic residual below this, or below the stated uncertainty, is reported but does not affect the verdict."""
LARGE_RESIDUAL = 2.0
"""Residual, in units of the stated covariances, above which camera, chart and noise do not explain the photographs."""
MAP, COARSE = (31, 21), (15, 11)  # columns and rows of the maps over the frame, and of the grid of a budget


@dataclass(frozen=True)
class GeometryParameters:
    """Inputs of the calibration.

    cell_mm : float, side of a printed cell, as measured
    scale_uncertainty : float, its relative standard uncertainty, which all distances share
    model : str or None
        A formula, or a spline over it (OPENCV+SPLINE_12X9); None: the reference, a spline over STEREOGRAPHIC.
    distances_mm : tuple of float
        Distances for maps of the projection uncertainty, in addition to that of the charts and infinity.
    is_video : bool, whether the views are frames of a video, with their times: the row time of the shutter is estimated
    advise_px : (x, y) or None, pixel whose direction the next view shall improve; None: the whole frame
    """

    cell_mm: float
    scale_uncertainty: float = 0.003
    model: str | None = None
    distances_mm: tuple[float, ...] = ()
    is_video: bool = False
    advise_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.cell_mm < np.inf and 0 <= self.scale_uncertainty < np.inf):
            raise BadParameter(
                f"a cell and its uncertainty must be positive; got {self.cell_mm:g} mm, {self.scale_uncertainty:g}",
                "measure the printed chart with a ruler",
            )


@dataclass(frozen=True, eq=False)
class PosedView:
    """A view with its pose.

    pose_covariance : (6, 6) float64
        Of the change of pose in the camera's frame: rotation in radians, translation in mm, for the nominal scale.
    distance : Quantity, from the centre of projection to the chart's centre, including the uncertainty of the scale
    tilt_deg : float, between the chart's normal and the line of sight to its centre
    residual_px : (n, 2) float64, observed minus projected points
    """

    view: ChartView
    pose: Pose
    pose_covariance: Array
    distance: Quantity
    tilt_deg: float
    residual_px: Array

    @property
    def rms_px(self) -> float:
        """Root mean square of the residual's coordinates."""
        return float(np.sqrt(np.mean(self.residual_px**2)))


@dataclass(frozen=True, eq=False)
class UncertaintyMap:
    """Projection uncertainty over the frame for objects at a distance: root mean square length of the error in pixels.

    `value` (rows, columns) at x (columns,) and y (rows,) in pixels; NaN where the model has no ray.
    """

    distance_mm: float
    x: Array
    y: Array
    value: Array


@dataclass(frozen=True, eq=False)
class ChartShape:
    """The actual shape of the chart.

    terms : mapping of name to Quantity, stretch, shear, uneven print and bending, each at the chart's edge, in mm
    deviations_mm : (N, 3) float64, deviation of every node from the plan: right, down, away from the camera
    node_mm : (x, y, z) estimated standard deviation of the node errors in addition to the terms
    scale_uncertainty : float
        Relative standard uncertainty of the scale, which all distances share: from the cell and from the node errors.
    """

    terms: dict[str, Quantity]
    deviations_mm: Array
    node_mm: tuple[float, float, float]
    scale_uncertainty: float


@dataclass(frozen=True, eq=False)
class Geometry:
    """The calibrated camera.

    covariance : (p, p) float64, of the camera parameters, marginalised over poses and chart shape
    trials : tuple of SmoothnessTrial, of a spline: the compared degrees of smoothness, the chosen one first
    formulas : tuple of FittedFormula, of a spline: parametric models fitted to it, the simplest first
    misfit : Misfit, systematic residual of the model
    residual_scale : float
        Residual in units of the points' standard deviations; all covariances are scaled by its square.
    noise_px : float, projection uncertainty at the charts by noise alone, without the model discrepancy
    maps : tuple of UncertaintyMap, at the charts' median distance, at infinity, then as requested
    region : (m, 2) float64, outline of the part of the frame covered by charts, in pixels
    covered : float, its share of the frame
    next_view : NextView or None
        The pose whose photograph would reduce the projection uncertainty most; None where none fits into the frame.
    adjustment : Adjustment, the adjustment from which the other values derive
    shutter : ShutterTiming or None, of a video: the row time
    """

    camera: CameraModel
    covariance: Array
    views: tuple[PosedView, ...]
    shape: ChartShape
    trials: tuple[SmoothnessTrial, ...]
    formulas: tuple[FittedFormula, ...]
    misfit: Misfit
    residual_scale: float
    noise_px: float
    maps: tuple[UncertaintyMap, ...]
    region: Array
    covered: float
    next_view: NextView | None
    adjustment: Adjustment
    shutter: ShutterTiming | None = None

    __repr__ = summary

    @property
    def points(self) -> int:
        """Number of correspondences."""
        return sum(len(view.view) for view in self.views)

    @property
    def formula(self) -> FittedFormula | None:
        """For a spline, the formula whose parameters are reported; single control points have no meaning."""
        return most_apt(self.formulas, max(self.noise_px, NEGLIGIBLE_PX)) if self.formulas else None

    def numbers(self) -> dict[str, Quantity]:
        """The camera parameters and the projection uncertainties."""
        formula, camera, covariance = self.formula, self.camera, self.covariance
        method = f"bundle adjustment of {len(self.views)} views, {camera.model}"
        if formula is not None:
            camera, covariance = formula.camera, formula.covariance
            method += f"; {camera.model} fitted to it, {formula.difference.rms_px:.2g} pixel rms apart"
        sigma = np.sqrt(np.diag(covariance))
        parameters = {
            "k1" if name == "k" else name: Quantity(float(value), unit, float(spread), method, self.points)
            for name, value, unit, spread in zip(camera.names, camera.params, camera.units, sigma, strict=True)
        }
        return (
            parameters
            | self._row_times()
            | {projection_at(one.distance_mm): self._mean_uncertainty(one) for one in self.maps}
        )

    def _row_times(self) -> dict[str, Quantity]:
        if self.shutter is None:
            return {}
        method = f"displacement of the rows in {len(self.views)} frames of a moving chart"
        row, sigma, rows = self.shutter.row_s, self.shutter.uncertainty_s, self.shutter.rows
        return {
            ROW_TIME: Quantity(1e6 * row, "us", 1e6 * sigma, method, self.points),
            READOUT_TIME: Quantity(1e3 * rows * row, "ms", 1e3 * rows * sigma, method, self.points),
        }

    @cached_property
    def _variances(self) -> VarianceParts:
        return variance_parts(self.adjustment, with_shutter=self.shutter is not None)

    def budgets(self) -> dict[str, dict[str, float]]:
        """Terms of the uncertainty of each number."""
        numbers, parts, formula = self.numbers(), self._variances, self.formula
        p, known = len(self.camera.params), len(self.adjustment.covariance)
        response = np.zeros((p if formula is None else len(formula.camera.names), known))
        response[:, :p] = np.eye(p) if formula is None else formula.response
        budgets = {  # the parameters are the first numbers
            name: parts.budget(one.uncertainty, row[None])
            for (name, one), row in zip(numbers.items(), response, strict=False)
        }
        pixels = self.camera.frame_grid(*COARSE)
        pixels = pixels[enclosed(self.region, pixels)]
        for one in self.maps:
            J = projection_derivative(self.adjustment, pixels, one.distance_mm)
            J = J[np.isfinite(J).all(axis=(1, 2))]
            name = projection_at(one.distance_mm)
            budgets[name] = parts.budget(numbers[name].value, J.reshape(-1, known), len(J))
        return budgets

    def distance_budget(self, i: int) -> dict[str, float]:
        """Terms of the uncertainty of a view's distance."""
        one, first = self.views[i], self.adjustment.shared + POSE * i + 3
        sight = np.zeros((1, len(self.adjustment.covariance)))
        sight[0, first : first + 3] = one.pose.t / one.distance.value
        scale = self.shape.scale_uncertainty * one.distance.value
        return self._variances.budget(one.distance.uncertainty, sight, scale=scale)

    def _mean_uncertainty(self, one: UncertaintyMap) -> Quantity:
        method = "root mean square over the part of the frame that the charts covered"
        value = _mean_over(self.region, one)
        return Quantity(value, "pixel", value / np.sqrt(2 * self.adjustment.freedom), method, self.points)


def _mean_over(region: Array, one: UncertaintyMap) -> float:
    """Root mean square of a map within an outline; NaN where there is no value."""
    x, y = np.meshgrid(one.x, one.y)
    inside = enclosed(region, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    values = one.value[inside & np.isfinite(one.value)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def calibrate_geometry(
    views: Sequence[ChartView], size: tuple[int, int], parameters: GeometryParameters, nodes: Array | None = None
) -> Outcome[Geometry]:
    """The camera that took the views, or the reason why they do not determine it.

    views : sequence of ChartView, of one chart, by one camera at one focus
    size : (columns, rows) of the frame, in sensor pixels
    nodes : (N, 3) float64, optional
        The plan of another board, in mm, to which the views' indices refer; None: the bins of the noise chart.

    Raises BadParameter if the model is not known, or points lie outside the frame or the plan.
    """
    if parameters.model is not None:
        parameter_names(parameters.model)
    if parameters.advise_px is not None and not all(
        0 <= at <= side - 1 for at, side in zip(parameters.advise_px, size, strict=True)
    ):
        x, y = parameters.advise_px
        raise BadParameter(
            f"a pixel of a frame of {size[0]} x {size[1]} must lie in it; got {x:g}, {y:g}", "name another"
        )
    nodes = chart_nodes(parameters.cell_mm) if nodes is None else nodes
    for view in views:
        inside = np.abs(view.points / np.array(size) - 0.5) < 0.5 + RIM
        if not (inside.all() and np.isin(view.index, np.arange(len(nodes))).all()):
            raise BadParameter(
                f"points must lie in the frame of {size[0]} x {size[1]} and be nodes of the plan; one of {view.source} "
                "is not",
                "give the size of the frame in sensor pixels, and the plan of this chart",
            )
    start = None
    try:
        if len(views) < FEWEST_VIEWS:
            raise Refused(
                f"a camera's geometry needs {FEWEST_VIEWS} views of the chart and better 12; there are {len(views)}",
                "photograph the chart again, tilted by 20 to 40 degrees to other sides, and elsewhere in the frame",
            )
        problem = AdjustmentProblem(nodes, views, shape_model(nodes))
        start, shutter = first_state(problem, size), None
        if parameters.is_video:
            shutter, problem = find_shutter(start, problem)
        fit, trials = fit_model(parameters.model, start, problem)
        fit = concluded(fit)
        if shutter is not None:
            shutter, fit = with_row_time(fit, shutter)
        geometry = _geometry(fit, trials, parameters, shutter)
    except Refused as error:
        refusal = error
        if len(views) >= FEWEST_VIEWS and greatest_tilt(nodes, views) <= FRONTAL_DEG:
            refusal = _undetermined("stands square to the camera, or nearly,", len(views))
        elif start is not None and normals_spread_deg(start.poses) <= SAME_DEG:
            refusal = _undetermined(f"is tilted the same way, within {SAME_DEG:.0f} degrees,", len(views))
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return verdict_of(_checks(geometry, parameters), geometry)


def _undetermined(pose: str, views: int) -> Refused:
    """Refusal of charts whose poses do not separate focal length and distance."""
    return Refused(
        f"the chart {pose} in all {views} views: a longer lens from farther away would show the same",
        f"geometry needs {FEWEST_VIEWS} views, better 12, of the chart turned by 20 to 40 degrees to different sides",
    )


def concluded(fit: Adjustment) -> Adjustment:
    """The adjustment with a prior of the node errors that is estimated from them, and the model discrepancy."""
    for _ in range(NODE_ERROR_ROUNDS):
        node_mm = estimated_node_errors(fit.state.errors_mm, fit.errors_variance)
        fit = adjust(fit.state, replace(fit.problem, shape=replace(fit.problem.shape, node_mm=node_mm)))
    return replace(fit, discrepancy=find_discrepancy(fit))


def _geometry(
    fit: Adjustment, trials: tuple[SmoothnessTrial, ...], parameters: GeometryParameters, shutter: ShutterTiming | None
) -> Geometry:
    camera, views = fit.state.camera, fit.problem.views
    p = len(camera.params)
    share = float(np.hypot(parameters.scale_uncertainty, scale_spread(fit.problem.nodes, fit.problem.shape.node_mm)))
    posed = tuple(_posed(fit, i, share) for i in range(len(views)))
    region = covered_region(np.concatenate([view.points for view in views]))
    grid = camera.frame_grid(*MAP)
    covariance = fit.full_covariance[:p, :p]
    usual = float(np.median([one.distance.value for one in posed]))
    distances = dict.fromkeys((usual, float("inf"), *parameters.distances_mm))
    return Geometry(
        camera=camera,
        covariance=covariance,
        views=posed,
        shape=_chart_shape(fit, share),
        trials=trials,
        formulas=fit_formulas(camera, covariance, region) if SPLINE in camera.model else (),
        misfit=find_misfit(fit),
        residual_scale=fit.scale,
        noise_px=_mean_over(region, _map(fit, grid, usual, noise_only=True)),
        maps=tuple(_map(fit, grid, distance) for distance in distances),
        region=region,
        covered=float(enclosed(region, grid).mean()),
        next_view=next(iter(next_views(fit, parameters.advise_px)), None),
        adjustment=fit,
        shutter=shutter,
    )


def _posed(fit: Adjustment, i: int, share: float) -> PosedView:
    pose, view, first = fit.state.poses[i], fit.problem.still(fit.state, i), fit.shared + POSE * i
    covariance = fit.full_covariance[first : first + POSE, first : first + POSE]
    distance = float(np.linalg.norm(pose.t))
    sight = pose.t / distance  # a rotation about the camera does not change the distance
    spread = np.hypot(np.sqrt(sight @ covariance[3:, 3:] @ sight), share * distance)
    method = "pose of the chart; the print's scale is in the uncertainty"
    whitened = fit.problem.view_residual(fit.state, i)
    residual = np.einsum("nab,nb->na", np.linalg.inv(view.whitening), whitened)
    tilt = float(np.degrees(np.arccos(np.clip(sight @ pose.R[:, 2], -1, 1))))
    return PosedView(view, pose, covariance, Quantity(distance, "mm", float(spread), method, len(view)), tilt, residual)


def _chart_shape(fit: Adjustment, share: float) -> ChartShape:
    shape, views = fit.problem.shape, len(fit.problem.views)
    sigma = np.sqrt(np.diag(fit.full_covariance)[len(fit.state.camera.params) : fit.shared])
    method = f"common to {views} views, at the chart's rim"
    terms = {
        name: Quantity(float(value), "mm", float(spread), method, views)
        for name, value, spread in zip(NAMES, fit.state.terms_mm, sigma, strict=True)
    }
    x, y, z = (float(one) for one in shape.node_mm)
    return ChartShape(terms, fit.state.deviations_mm(shape), (x, y, z), share)


def _map(fit: Adjustment, grid: Array, distance_mm: float, *, noise_only: bool = False) -> UncertaintyMap:
    value = projection_uncertainty(fit, grid, distance_mm, noise_only=noise_only).reshape(MAP[1], MAP[0])
    return UncertaintyMap(distance_mm, grid[: MAP[0], 0], grid[:: MAP[0], 1], value)


def _checks(geometry: Geometry, parameters: GeometryParameters) -> list[Check]:
    doubtful, numbers = Verdict.DOUBTFUL, geometry.numbers()
    focal = next(numbers[name] for name in (FOCAL[0], FOCAL[1]) if name in numbers)
    model, misfit = geometry.camera.model, geometry.misfit
    better = "" if parameters.model is None else "; leave the model to be chosen"
    return [
        Check("model", misfit.rms_px, max(geometry.noise_px, NEGLIGIBLE_PX), doubtful,
              f"{model} is too simple for this lens: its systematic residual is {misfit.rms_px:.3f} pixel rms, the "
              f"uncertainty by noise at the charts {geometry.noise_px:.3f}",
              f"take a more flexible model{better}, or allow for this error", given=misfit.significant),
        Check("views", len(geometry.views), LEAST_VIEWS, doubtful,
              f"{len(geometry.views)} views are too few to distinguish the lens from the chart's shape",
              f"photograph at least {LEAST_VIEWS} views, better 12", least=True),
        Check("coverage", geometry.covered, SMALL_SHARE, doubtful,
              f"the charts covered {geometry.covered:.0%} of the frame; beyond them the model is extrapolated",
              "photograph the chart in the corners and along the sides too", least=True),
        Check("focal length", focal.uncertainty / focal.value, LOOSE_FOCAL, doubtful,
              f"the focal length is known to {focal.uncertainty / focal.value:.1%} only: the views are too similar",
              "tilt the chart by 20 to 40 degrees to all sides, or change its distance"),
        Check("residual", geometry.residual_scale, LARGE_RESIDUAL, doubtful,
              f"the points scatter {geometry.residual_scale:.1f} times as much as their covariances state",
              "check the residuals of the views: the chart moved or bent between photographs, or the focus changed",
              prior=SYMPTOM),
    ]  # fmt: skip
