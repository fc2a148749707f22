"""Intrinsics, distortion and poses from views of the chart, start to end: numbers with error bars, or a refusal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.display import summary
from procedures.geometry.adjustment import POSE, Adjustment, AdjustmentState, adjust, residual
from procedures.geometry.cameras import MODELS, Camera, parameter_names
from procedures.geometry.choice import LEAST_VIEWS, ModelTrial, choose_model, first_state, fit_model, with_splines
from procedures.geometry.misfit import Misfit, find_misfit
from procedures.geometry.next_view import NextView, next_views
from procedures.geometry.shape import NAMES, ShapeModel, own_errors, scale_spread, shape_model
from procedures.geometry.uncertainty import enclosed, projection_uncertainty, seen_region
from procedures.geometry.views import ChartView, Pose, chart_nodes, greatest_tilt
from procedures.numbers import FOCAL, projection_at
from procedures.outcome import SYMPTOM, Check, Outcome, Quantity, Refused, Verdict, verdict_of

Array = npt.NDArray[np.float64]

SQUARE_ON_DEG = 20.0
"""Charts of which none is turned by more may be why the views tell no camera; distortion alone looks like 15."""
FEWEST_VIEWS = 3
"""Under which a plane chart does not determine five pinhole numbers and its own shape."""
ROUNDS = 2
"""How often the nodes' own errors are estimated again from what was found of them."""
SMALL_SHARE = 0.6
"""Of the frame: charts that enclose less leave too much of it to the model."""
LOOSE_FOCAL = 0.005
"""Standard uncertainty of the focal length over it from which the views are said to be too much alike."""
NEGLIGIBLE_PX = 0.005
"""A field that a model leaves undrawn is told, but makes no doubt, below this or what is stated anyway."""
LARGE_RESIDUAL = 2.0
"""In units of the points' covariances: something beside camera, chart and noise is in the photographs."""
MAP = (31, 21)
"""Columns and rows of the maps over the frame."""


@dataclass(frozen=True)
class GeometryParameters:
    """What is known and asked for.

    Attributes
    ----------
    cell_mm : float
        Side of a printed cell, as measured.
    scale_uncertainty : float
        Standard uncertainty of that over it: all distances share it.
    model : str or None
        One of COLMAP's camera models, or a spline over it, OPENCV+SPLINE_12X9; None: chosen from the views.
    distances_mm : tuple of float
        At which the projection's uncertainty is reported, besides the charts' own and infinity.
    """

    cell_mm: float
    scale_uncertainty: float = 0.003
    model: str | None = None
    distances_mm: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PosedView:
    """A photograph's part of the answer.

    Attributes
    ----------
    view : ChartView
    pose : Pose
    pose_covariance : (6, 6) float64
        Of its change in the camera's frame: rotation in radians, translation in mm, the chart's scale taken as known.
    distance : Quantity
        Of the chart's centre from the centre of projection; the print's scale is in its uncertainty.
    tilt_deg : float
        Between the chart's normal and the line of sight to its centre.
    residual_px : (n, 2) float64
        Where its points are seen less where the model puts them.
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
    """Root mean square length, in pixels, of the projection's error over the frame, of what lies at a distance.

    `value` (rows, columns) at x (columns,) and y (rows,) in pixels; NaN where the model has no ray.
    """

    distance_mm: float
    x: Array
    y: Array
    value: Array


@dataclass(frozen=True, eq=False)
class ChartShape:
    """The chart as it is.

    Attributes
    ----------
    terms : mapping of name to Quantity
        Stretch, shear, uneven print and bending, each at the chart's rim, in mm.
    deviations_mm : (N, 3) float64
        How far every node lies from its plan: right, down, away from the camera.
    node_mm : (x, y, z)
        Standard deviation of the nodes' own errors, beside the terms, as found.
    scale_uncertainty : float
        Standard uncertainty of the whole chart's scale over it, which all distances share: what is known of a cell, and
        what the nodes' own errors make of it.
    """

    terms: dict[str, Quantity]
    deviations_mm: Array
    node_mm: tuple[float, float, float]
    scale_uncertainty: float


@dataclass(frozen=True, eq=False)
class Geometry:
    """The calibrated camera.

    Attributes
    ----------
    camera : Camera
    covariance : (p, p) float64
        Of its parameters, poses and the chart's shape allowed for.
    views : tuple of PosedView
    shape : ChartShape
    trials : tuple of ModelTrial
        Models that were tried, the chosen one first.
    misfit : Misfit
        What the model leaves undrawn.
    residual_scale : float
        Residual in units of the points' covariances; all covariances are multiplied by its square.
    maps : tuple of UncertaintyMap
        At the charts' median distance, at infinity, then as asked for.
    region : (m, 2) float64
        Outline of the part of the frame that the charts covered, in pixels.
    covered : float
        Its share of the frame.
    next_view : NextView or None
        The pose whose photograph would lower the projection's uncertainty most; None where none fits into the frame.
    adjustment : Adjustment
        What everything else was drawn from.
    """

    camera: Camera
    covariance: Array
    views: tuple[PosedView, ...]
    shape: ChartShape
    trials: tuple[ModelTrial, ...]
    misfit: Misfit
    residual_scale: float
    maps: tuple[UncertaintyMap, ...]
    region: Array
    covered: float
    next_view: NextView | None
    adjustment: Adjustment

    __repr__ = summary

    @property
    def points(self) -> int:
        """Number of correspondences."""
        return sum(len(one.view) for one in self.views)

    def numbers(self) -> dict[str, Quantity]:
        """The camera's parameters with their uncertainties, and the projection's."""
        sigma = np.sqrt(np.diag(self.covariance))
        method = f"bundle adjustment of {len(self.views)} views, {self.camera.model}"
        found = {
            name: Quantity(float(value), unit, float(spread), method, self.points)
            for name, value, unit, spread in zip(
                self.camera.names, self.camera.params, self.camera.units, sigma, strict=True
            )
            if not name.startswith("spline")  # control points are in the record, and mean nothing one by one
        }
        return found | {projection_at(one.distance_mm): self._of_map(one) for one in self.maps}

    def _of_map(self, one: UncertaintyMap) -> Quantity:
        x, y = np.meshgrid(one.x, one.y)
        inside = enclosed(self.region, np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
        values = one.value[inside & np.isfinite(one.value)]
        method = "root mean square over the part of the frame that the charts covered"
        value = float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
        return Quantity(value, "pixel", value / np.sqrt(2 * self.adjustment.freedom), method, self.points)


def calibrate_geometry(
    views: Sequence[ChartView], size: tuple[int, int], parameters: GeometryParameters, nodes: Array | None = None
) -> Outcome[Geometry]:
    """The camera that took the views, or the reason why they do not tell it.

    Parameters
    ----------
    views : sequence of ChartView
        Of one chart, by one camera at one focus.
    size : (columns, rows)
        Of the frame, in sensor pixels.
    parameters : GeometryParameters
    nodes : (N, 3) float64, optional
        The plan of another board, in mm, that the views' indices are of; None: the noise chart's bins.

    Raises
    ------
    BadParameter
        If the model is not known.
    """
    models = MODELS if parameters.model is None else (parameters.model,)
    for model in models:
        parameter_names(model)
    nodes = chart_nodes(parameters.cell_mm) if nodes is None else nodes
    try:
        if len(views) < FEWEST_VIEWS:
            raise Refused(
                f"a camera's geometry needs {FEWEST_VIEWS} views of the chart and better 12; there are {len(views)}",
                "photograph the chart again, tilted by 20 to 40 degrees to other sides, and elsewhere in the frame",
            )
        shape = shape_model(nodes)
        start = first_state(nodes, views, size, shape)
        trials = choose_model(models, start, nodes, views, shape)
        geometry = _settled(trials, start, nodes, views, shape, parameters)
        if parameters.model is None and too_poor(geometry) and len(views) >= LEAST_VIEWS:
            trials = with_splines(trials, size, start, nodes, views, shape)
            same = trials[0].model == geometry.camera.model
            geometry = (
                replace(geometry, trials=trials) if same else _settled(trials, start, nodes, views, shape, parameters)
            )
    except Refused as refusal:
        refusal = _if_square_on(refusal, nodes, views)
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return verdict_of(_checks(geometry, parameters), geometry)


def _if_square_on(refusal: Refused, nodes: Array, views: Sequence[ChartView]) -> Refused:
    """The same refusal, or its cause where no chart is turned: focal length and distance then look alike."""
    if len(views) < FEWEST_VIEWS or greatest_tilt(nodes, views) > SQUARE_ON_DEG:
        return refusal
    return Refused(
        f"the chart stands square to the camera, or nearly, in all {len(views)} views: a longer lens from farther away "
        "would show the same",
        f"geometry needs {FEWEST_VIEWS} views, better 12, of the chart turned by 20 to 40 degrees to different sides",
    )


def _settled(
    trials: tuple[ModelTrial, ...], start: AdjustmentState, nodes: Array, views: Sequence[ChartView], shape: ShapeModel,
    parameters: GeometryParameters,
) -> Geometry:  # fmt: skip
    """The first model fitted, with the nodes' own errors as large beforehand as they are found."""
    found = fit_model(trials[0].model, start, nodes, views, shape)
    for _ in range(ROUNDS):
        shape = replace(shape, node_mm=own_errors(found.state.errors_mm, found.errors_variance))
        found = adjust(found.state, nodes, views, shape)
    return _geometry(found, nodes, views, shape, trials, parameters)


def too_poor(found: Geometry) -> bool:
    """Whether the model leaves more undrawn than what is stated anyway."""
    stated = found.numbers()[projection_at(found.maps[0].distance_mm)].value
    return found.misfit.significant and found.misfit.rms_px > max(stated, NEGLIGIBLE_PX)


def _geometry(
    found: Adjustment, nodes: Array, views: Sequence[ChartView], shape: ShapeModel, trials: tuple[ModelTrial, ...],
    parameters: GeometryParameters,
) -> Geometry:  # fmt: skip
    camera = found.state.camera
    p = len(camera.params)
    share = float(np.hypot(parameters.scale_uncertainty, scale_spread(nodes, shape.node_mm)))
    posed = tuple(_posed(found, nodes, view, shape, i, share) for i, view in enumerate(views))
    region = seen_region(np.concatenate([view.points for view in views]))
    grid = camera.frame_grid(*MAP)
    usual = float(np.median([one.distance.value for one in posed]))
    distances = dict.fromkeys((usual, float("inf"), *parameters.distances_mm))
    return Geometry(
        camera=camera,
        covariance=found.covariance[:p, :p] * found.scale**2,
        views=posed,
        shape=_chart_shape(found, shape, len(views), share),
        trials=trials,
        misfit=find_misfit(found, nodes, views, shape),
        residual_scale=found.scale,
        maps=tuple(_map(found, grid, distance) for distance in distances),
        region=region,
        covered=float(enclosed(region, grid).mean()),
        next_view=next(iter(next_views(found, nodes, tuple(views), shape)), None),
        adjustment=found,
    )


def _posed(found: Adjustment, nodes: Array, view: ChartView, shape: ShapeModel, number: int, share: float) -> PosedView:
    pose = found.state.poses[number]
    first = len(found.state.camera.params) + len(found.state.terms_mm) + POSE * number
    covariance = found.covariance[first : first + POSE, first : first + POSE] * found.scale**2
    distance = float(np.linalg.norm(pose.t))
    sight = pose.t / distance  # a turn about the camera leaves the distance
    spread = np.hypot(np.sqrt(sight @ covariance[3:, 3:] @ sight), share * distance)
    method = "pose of the chart; the print's scale is in the uncertainty"
    whitened = residual(found.state, nodes, view, shape, number)
    left = np.einsum("nab,nb->na", np.linalg.inv(view.whitening), whitened)
    tilt = float(np.degrees(np.arccos(np.clip(sight @ pose.R[:, 2], -1, 1))))
    return PosedView(view, pose, covariance, Quantity(distance, "mm", float(spread), method, len(view)), tilt, left)


def _chart_shape(found: Adjustment, shape: ShapeModel, views: int, share: float) -> ChartShape:
    p = len(found.state.camera.params)
    sigma = np.sqrt(np.diag(found.covariance)[p : p + len(shape.prior_mm)]) * found.scale
    method = f"common to {views} views, at the chart's rim"
    terms = {
        name: Quantity(float(value), "mm", float(spread), method, views)
        for name, value, spread in zip(NAMES, found.state.terms_mm, sigma, strict=True)
    }
    x, y, z = (float(one) for one in shape.node_mm)
    return ChartShape(terms, found.state.deviations_mm(shape), (x, y, z), share)


def _map(found: Adjustment, grid: Array, distance_mm: float) -> UncertaintyMap:
    value = projection_uncertainty(found, grid, distance_mm).reshape(MAP[1], MAP[0])
    return UncertaintyMap(distance_mm, grid[: MAP[0], 0], grid[:: MAP[0], 1], value)


def _checks(found: Geometry, parameters: GeometryParameters) -> list[Check]:
    """What makes a camera doubtful."""
    doubtful, numbers = Verdict.DOUBTFUL, found.numbers()
    stated = numbers[projection_at(found.maps[0].distance_mm)].value
    focal = next(numbers[name] for name in (FOCAL[0], FOCAL[1]) if name in numbers)
    model, misfit = found.camera.model, found.misfit
    unknown = [one.model for one in found.trials if not one.converged and one.parameters > found.trials[0].parameters]
    better = "" if parameters.model is None else "; leave the model to be chosen"
    return [
        Check("model", misfit.rms_px, max(stated, NEGLIGIBLE_PX), doubtful,
              f"{model} is too poor a model for this lens: it leaves a field of {misfit.rms_px:.3f} pixel rms undrawn, "
              f"where {stated:.3f} are stated at the charts",
              f"take a more flexible model{better}, or allow for this error", given=misfit.significant),
        Check("models compared", len(unknown), 0, doubtful,
              f"{model} was chosen without a comparison with {' and '.join(unknown)}: the adjustment of half of the "
              "views did not converge",
              f"photograph more views, or compare the residuals with --model {' or '.join(unknown)}"),
        Check("views", len(found.views), LEAST_VIEWS, doubtful,
              f"{len(found.views)} views are too few for cross-validation",
              f"photograph at least {LEAST_VIEWS} views, better 12", least=True),
        Check("coverage", found.covered, SMALL_SHARE, doubtful,
              f"the charts covered {found.covered:.0%} of the frame; beyond them the model is extrapolated",
              "photograph the chart in the corners and along the sides too", least=True),
        Check("focal length", focal.uncertainty / focal.value, LOOSE_FOCAL, doubtful,
              f"the focal length is known to {focal.uncertainty / focal.value:.1%} only: the views are too similar",
              "tilt the chart by 20 to 40 degrees to all sides, or change its distance"),
        Check("residual", found.residual_scale, LARGE_RESIDUAL, doubtful,
              f"the points scatter {found.residual_scale:.1f} times as much as their own covariances say",
              "see the views' residuals: a chart that moved or changed its bend between photographs, or another focus",
              prior=SYMPTOM),
    ]  # fmt: skip
