"""Geometry, light and response refined against the noise cells themselves, jointly with the PSF.

The marks give a map good to a few tenths of a pixel when the chart is tilted or the lens distorts; sixty-five
thousand cells give it to a few thousandths. Every Gauss-Newton step linearises

    y = A h + sum a_i q_i + sum b_i q_i m + beta (m^2 - m) + delta o + sum tau_j v_j

about the current map, PSF and light, and eliminates everything but h (variable projection, Kaufman's form). y is the
sample between the black and white levels, A the chart of values -1/2 and 1/2 (a_0 holds the mean), q_i the quadratics
of place, m what the whole PSF shows of the chart, o the cells' outlines seen through the PSF, v_j the chart seen
through the shapes of the PSF's far tail. delta is the spread of the ink, in cells: the printer makes black cells larger
than white ones, which darkens the noise region just as a curved response would; only the picture of the outlines tells
the two apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import (
    DIFFERS,
    LEAST_TAIL,
    SHAPES,
    tail_border,
    tail_columns,
    tail_density,
    tail_sums,
)
from procedures.numerics.normal_equations import NormalEquations, Products, eliminate, gram, products, products_within
from procedures.numerics.sampled_convolution import convolve_at, sample_convolution, sums_of_groups
from procedures.numerics.warps import displacement_columns
from procedures.pattern import Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.observation import Observation
from procedures.pattern_psf.printed_edges import Edges, edge_columns
from procedures.pattern_psf.rasterise import Raster, Window, band_limited_chart, whole_chart
from procedures.pattern_psf.registration import Registration, map_distance

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

GEOMETRY = 18  # nuisance columns of the displacement: nine cubics each for x and y
RESPONSE, SPREAD, TAIL = 11, 12, 13  # places of beta, delta and the tail's first amplitude among the light's numbers
NUISANCE = GEOMETRY + TAIL + len(SHAPES)
LOST = 0.1  # agreement by the marks' map under which these are other cells, or none can be seen
PRINT_TELLS = 1.06  # residual over noise from which the printed edges are worth estimating
COARSE_STEPS, FINE_STEPS, SWEEPS = 4, 4, 2
TILES = 6  # along each side of the noise region: large beside the PSF, small beside what curls, shades or defocuses
COARSE_SAMPLES = 9  # samples per PSF value that the coarse steps make do with
NEAR_PX = 0.15  # below this a step's system is that of the answer, to the noise
AT_ONCE = 256  # rows of a system that stay in the processor's cache
STILL_PX = 0.015  # the step itself is accounted for to first order: what is left of it is a hundredth


@dataclass(frozen=True)
class ChartFit:
    """The state of the refinement: the map, the PSF, the light's corrections, and what is left over.

    Attributes
    ----------
    registration : Registration
    h : (k^2,) float64
        The PSF, not yet normalised: its sum is the contrast's correction.
    light : (19,) float64
        a (6), b without its constant (5), beta, delta, the tail's amplitudes (6).
    observation : Observation
    prediction : (m,) float64
        The model at the samples.
    equations : NormalEquations
        Of the last step, for unit noise.
    edges : (514,) or (0,) float64
        Offsets of the printed edges, in cells: vertical lines, then horizontal ones; empty where they do not tell.
    edge_rms : float
        Their root mean square, in cells.
    scores : (TILES^2, k^2 + p) float64
        What each tile of the noise region, row by row, adds to the normal equations' right side at the answer: their
        sum is 0, and their scatter is that of the answer, whatever the residual is made of.
    still : bool
        Whether the map came to rest.
    slopes : (m, 2) float64
        Change of the prediction, in units of the noise, per pixel by which the map is moved along x and y.
    """

    registration: Registration
    h: Array
    light: Array
    observation: Observation
    prediction: Array
    equations: NormalEquations
    edges: Array
    edge_rms: float = 0.0
    scores: Array = field(default_factory=lambda: np.zeros((0, 0)))
    still: bool = False
    slopes: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def residual(self) -> Array:
        """Samples minus prediction, in units of the noise expected from the blocks, (m,)."""
        return (self.observation.y - self.prediction) * self.observation.weight

    @property
    def freedom(self) -> int:
        """Samples minus parameters; the edges' count by half and the tail's shapes not, as priors hold them."""
        return len(self.observation) - len(self.h) - GEOMETRY - TAIL - 1 - len(self.edges) // 2

    @property
    def residual_std(self) -> float:
        """Standard deviation of the residual, freedoms allowed for: 1 when only the blocks' noise is left."""
        return float(np.sqrt(self.residual @ self.residual / self.freedom))

    @property
    def agreement(self) -> float:
        """Share of the samples' variance that the prediction explains, freedoms allowed for."""
        left = self.observation.y - self.prediction
        return 1 - float(left @ left) / self.freedom / float(np.var(self.observation.y))

    @property
    def cut(self) -> float:
        """Share of the PSF's energy outside its support, by the tail's amplitude."""
        outside = float(self.light[TAIL:] @ tail_sums(round(len(self.h) ** 0.5)))
        return outside / (float(self.h.sum()) + outside)


@dataclass(frozen=True)
class TailPrior:
    """What optics tell of the mean far tail before it is fitted.

    Attributes
    ----------
    density_px : float
        a of the tail a / r^3 per square pixel of a PSF of sum 1, r in pixels.
    share : float
        Its standard uncertainty over it.
    """

    density_px: float
    share: float

    def energy(self, s: int, k: int) -> float:
        """The first amplitude, beside light of 1."""
        return self.density_px * s / tail_density(k)


@dataclass(frozen=True)
class _Model:
    """The chart as it can be seen: what does not change while the map is refined."""

    chart: Array32
    raster: Raster
    window: Window
    k: int
    far_light: Array32
    tail: TailPrior | None = None
    bend: float | None = None

    def read(self, registration: Registration, border: int) -> Array32:
        """The chart on the s grid of the window, with a border."""
        return self.raster.read(registration, self.window, border)

    def system(self, o: Observation, u: Array32, more: int = 0) -> Array32:
        """The weighted convolution matrix, for the chart `u` with a border of the support's or more; and more columns
        that are to be filled."""
        extra = (u.shape[0] - (self.raster.s * (self.window.rows - 1) + self.k)) // 2
        inner = u[extra : len(u) - extra, extra : u.shape[1] - extra]
        weight = o.weight.astype(np.float32)
        return np.asarray(sample_convolution(inner, o.rows, o.columns, weight, self.raster.s, self.k, more))

    def far(self, fit: ChartFit, u: Array32) -> Array:
        """What is no part of h: the outlines seen through the PSF, the chart `u` seen through the tail, (m, 7)."""
        o, s = fit.observation, self.raster.s
        outline = self.raster.read_outline(fit.registration, self.window, self.k // 2)
        h = fit.h.reshape(self.k, self.k).astype(np.float32)
        spread = convolve_at(outline, o.rows, o.columns, h, s)
        tail = tail_columns(u, o.rows, o.columns, s, self.k)
        tail[:, 0] += self.far_light[o.rows, o.columns]
        return np.column_stack([spread, tail])

    def edges(self, fit: ChartFit) -> Edges:
        """How the samples change with the printed edges."""
        o, h = fit.observation, fit.h.reshape(self.k, self.k)
        return Edges.of(edge_columns(self.chart, fit.registration, o.points, h, self.raster.s, o.weight))


def refine(
    observation: Observation,
    chart: Chart,
    registration: Registration,
    window: Window,
    s: int,
    k: int,
    far: Array32,
    tail: TailPrior | None = None,
    bend: float | None = None,
) -> ChartFit:
    """The joint estimate of PSF, map and light, from the marks' map on; of the printed edges where they tell.

    Some of the samples bring the map near, all of them bring it to rest.

    Parameters
    ----------
    observation : Observation
    chart : Chart
    registration : Registration
        The marks' map, or that of another fit.
    window : Window
    s, k : int
        Samples per pixel, and their number along the PSF's side.
    far : (rows, columns) float32
        What comes into the window from beyond the tail's reach, black -1/2 and white 1/2, from `far_light`.
    tail : TailPrior, optional
        What is known of the far tail.
    bend : float, optional
        Standard uncertainty of beta, where the response was straightened by the sensor's own calibration.
    """
    model = _Model(whole_chart(chart), band_limited_chart(chart, registration, s), window, k, far, tail, bend)
    stride = max(2, len(observation) // (COARSE_SAMPLES * k * k))
    enough = len(observation) // stride >= COARSE_SAMPLES * k * k
    coarse = observation.where(slice(None, None, stride)) if enough else observation
    A = model.system(coarse, model.read(registration, k // 2))
    AA = gram(A)
    fit = _first_fit(coarse, A, AA, registration)
    if fit.agreement < LOST:
        return fit
    for step in range(COARSE_STEPS):
        if step > 0:
            fit = _centred(fit, model)
            A = model.system(coarse, model.read(fit.registration, k // 2))
            AA = gram(A)
        last, fit = fit, _coarse_step(fit, model, A, AA)
        if map_distance(last.registration, fit.registration, coarse.points[::29]) < NEAR_PX:
            break
    fit = replace(fit, observation=observation)
    for _ in range(FINE_STEPS):
        start = _centred(fit, model)
        fit, whole = _fine_step(start, model)
        moved = map_distance(start.registration, fit.registration, coarse.points[::29])
        if moved < STILL_PX:
            break
    slopes = _seen(whole[:, : k * k], fit.h, s, k)[1]
    return replace(fit, still=bool(moved < 10 * STILL_PX), scores=_scores(fit, whole), slopes=slopes)


def first_look(
    observation: Observation, chart: Chart, registration: Registration, window: Window, s: int, k: int
) -> ChartFit:
    """The PSF by the marks' map as it stands, which nothing before the chart can lead astray."""
    model = _Model(
        whole_chart(chart), band_limited_chart(chart, registration, s), window, k, np.zeros((0, 0), np.float32)
    )
    A = model.system(observation, model.read(registration, k // 2))
    return _first_fit(observation, A, gram(A), registration)


def _scores(fit: ChartFit, whole: Array32) -> Array:
    """The share of every tile in A'r and Z'r, (TILES^2, k^2 + p); A and Z are the system's columns but the last."""
    o = fit.observation
    row, column = (np.minimum(place * TILES // (place.max() + 1), TILES - 1) for place in (o.rows, o.columns))
    sums = sums_of_groups(whole, row * TILES + column, fit.residual.astype(np.float32), TILES * TILES)
    return np.asarray(sums[:, :-1], dtype=np.float64)


def _first_fit(o: Observation, A: Array32, AA: Array, registration: Registration) -> ChartFit:
    """The PSF by the marks' map with the light's quadratics free."""
    equations = eliminate(products(AA, A, o.quadratics * o.weight[:, None], o.y * o.weight))
    h = equations.kernel
    light = np.zeros(TAIL + len(SHAPES))
    light[:6] = equations.nuisance(h)
    prediction = (A @ h.astype(np.float32)) / o.weight + o.quadratics @ light[:6]
    return ChartFit(registration, h, light, o, prediction, equations, np.zeros(0))


def _centred(fit: ChartFit, model: _Model) -> ChartFit:
    """The same fit with the map shifted to where the marks are seen through its PSF; the next step moves the PSF."""
    h = fit.h.reshape(model.k, model.k)
    return replace(
        fit, registration=fit.registration.translated(-mark_offset(h, model.raster.s, fit.registration.jacobian()))
    )


def _coarse_step(fit: ChartFit, model: _Model, A: Array32, AA: Array) -> ChartFit:
    """A Gauss-Newton step of geometry, light and response by the map's system A, with its Gram matrix."""
    start, Z = _linearised(fit, A, model, np.zeros((len(fit.observation), 0)))
    return _advanced(start, A, Z, eliminate(products(AA, A, Z * fit.observation.weight[:, None], start.residual)))


def _fine_step(fit: ChartFit, model: _Model) -> tuple[ChartFit, Array32]:
    """A Gauss-Newton step of everything, with the printed edges where it leaves more than noise; and its system."""
    n, u = model.k**2, model.read(fit.registration, tail_border(model.k))
    whole = model.system(fit.observation, u, NUISANCE + 1)
    A = whole[:, :n]
    start, Z = _linearised(fit, A, model, model.far(fit, u))
    weighted = Z * fit.observation.weight[:, None]
    parts = _with_known(products_within(whole, n, weighted, start.residual), start, model)
    found = _advanced(start, A, Z, eliminate(parts))
    if found.residual_std < PRINT_TELLS:
        return found, whole
    edges = model.edges(fit)
    rms, noise = edges.widths(found.residual)
    estimator, moved = edges.estimator(rms, noise), np.zeros(len(found.residual))
    for _ in range(SWEEPS):  # edges and PSF have little in common: the sweeps close in by a factor of ten each
        offsets = estimator(found.residual + moved)
        moved = edges.C.seen(offsets)
        shifted = replace(start, prediction=start.prediction + moved / start.observation.weight)
        parts = parts.with_right_side(A, weighted, shifted.residual)
        found = _advanced(shifted, A, Z, found.equations.with_right_side(parts))
    return replace(found, edges=offsets, edge_rms=rms), whole


def _with_known(parts: Products, fit: ChartFit, model: _Model) -> Products:
    """The products with what is known of the response and of the tail's amplitudes before they are fitted."""
    first, known = GEOMETRY + TAIL, model.tail
    precision, pull = np.zeros((2, len(parts.ZZ)))
    if model.bend is not None:
        precision[GEOMETRY + RESPONSE] = 1 / model.bend**2
        pull[GEOMETRY + RESPONSE] = -fit.light[RESPONSE]
    if known is not None:
        expected = known.energy(model.raster.s, model.k)
        precision[first] = 1 / (known.share * expected) ** 2
        pull[first] = expected - fit.light[TAIL]
    precision[first + 1 :] = 1e12
    tail = fit.light[TAIL]
    if tail == 0:  # not fitted yet
        equations = eliminate(parts.with_prior(precision, pull))
        tail = equations.nuisance(equations.kernel)[first]
    precision[first + 1 :] = 1 / (DIFFERS * max(abs(tail), LEAST_TAIL)) ** 2
    pull[first + 1 :] = -fit.light[TAIL + 1 :]
    return parts.with_prior(precision, pull)


def _advanced(start: ChartFit, A: Array32, Z: Array, equations: NormalEquations) -> ChartFit:
    """The fit with the increments that solve the equations, and the prediction they make, to first order."""
    o, n = start.observation, Z.shape[1]
    dh = equations.kernel
    t = equations.nuisance(dh)
    light = start.light.copy()
    light[: n - GEOMETRY] += t[GEOMETRY:]
    return replace(
        start,
        registration=start.registration.displaced(t[:GEOMETRY].reshape(2, 9), o.cubics),
        h=start.h + dh,
        light=light,
        prediction=start.prediction + (A @ dh.astype(np.float32)) / o.weight + Z @ t,
        equations=equations,
    )


def _linearised(fit: ChartFit, A: Array32, model: _Model, far: Array) -> tuple[ChartFit, Array]:
    """The fit with its prediction by the system A, and the columns of geometry, light, response and `far`."""
    o, k = fit.observation, model.k
    seen, slopes = _seen(A, fit.h, model.raster.s, k)
    seen, slopes = seen / o.weight, slopes / o.weight[:, None]
    tail = fit.light[TAIL:] if far.shape[1] else np.zeros(0)
    m = (seen + far[:, 1:] @ tail + (fit.h.sum() + tail_sums(k)[: len(tail)] @ tail) / 2)[:, None]
    geometry = displacement_columns(slopes, o.cubics)
    Z = np.hstack([geometry, o.quadratics, o.quadratics[:, 1:] * m, m * m - m, far])
    return replace(fit, prediction=seen + Z[:, GEOMETRY:] @ fit.light[: Z.shape[1] - GEOMETRY]), Z


def _seen(A: Array32, h: Array, s: int, k: int) -> tuple[Array, Array]:
    """The weighted prediction (m,) of a PSF, and its change per pixel of displacement along x and y, (m, 2)."""
    slope_y, slope_x = np.gradient(h.reshape(k, k))
    columns = [one.ravel().astype(np.float32) for one in (h, slope_x, slope_y)]
    found = np.empty((len(A), 3))
    for first in range(0, len(A), AT_ONCE):
        part = A[first : first + AT_ONCE]
        for j, column in enumerate(columns):  # a product each: one of a matrix and three columns takes longer
            found[first : first + AT_ONCE, j] = part @ column
    return found[:, 0], found[:, 1:] * s
