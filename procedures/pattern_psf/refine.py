"""Joint refinement of geometry, light, response and PSF on the noise cells.

The map from the marks is accurate to a few tenths of a pixel where the chart is tilted or the lens distorts; that from
the 65,536 cells to a few thousandths. Every Gauss-Newton step linearises

    y = A h + sum a_i q_i + sum b_i q_i m + beta (m^2 - m) + delta o + sum tau_j v_j

about the current map, PSF and light, and eliminates everything but h (variable projection, Kaufman's form). y is the
sample between the black and white levels, A the chart of values -1/2 and 1/2 (a_0 contains the mean), q_i the
quadratics of position, m the image of the chart through the whole PSF, o that of the cells' outlines, v_j those of the
chart through the shapes of the PSF's far tail. delta is the ink spread, in cells: the printer makes black cells larger
than white ones, which darkens the noise region as a curved response does; the image of the outlines distinguishes the
two.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32
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
from procedures.numerics.transforms import sample_convolution
from procedures.numerics.warps import displacement_columns
from procedures.pattern import Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.observation import Observation
from procedures.pattern_psf.printed_edges import EdgeColumns, edge_columns
from procedures.pattern_psf.rasterise import Raster, Window, band_limited_chart, whole_chart
from procedures.pattern_psf.registration import Registration, map_distance

GEOMETRY = 18  # nuisance columns of the displacement: nine cubics each for x and y
RESPONSE, SPREAD, TAIL = 11, 12, 13  # indices of beta, delta and the tail's first amplitude in the light parameters
NUISANCE = GEOMETRY + TAIL + len(SHAPES)
MIN_AGREEMENT = 0.1  # agreement by the marks' map below which the cells are others, or not resolved
EDGES_RESIDUAL = 1.06  # residual over noise above which the printed edges are estimated
COARSE_STEPS, FINE_STEPS, SWEEPS = 4, 4, 2
TILES = 6  # along each side of the noise region: wider than the PSF, narrower than curl, shading or defocus
COARSE_SAMPLES = 9  # samples per PSF value in the coarse steps
NEAR_PX = 0.15  # step below which the next linearisation agrees with that of the solution, to the noise
ROWS_PER_BLOCK = 256  # rows of a system that fit the processor's cache
TOLERANCE_PX = 0.015  # convergence tolerance: the step is applied to first order, and its remainder is a hundredth


@dataclass(frozen=True)
class ChartFit:
    """State of the refinement: map, PSF, light parameters, and residual.

    h : (k^2,) PSF before normalisation; its sum is the contrast's correction
    light : (19,) a (6), b without its constant (5), beta, delta, the tail's amplitudes (6)
    prediction : (m,) the model at the samples
    equations : normal equations of the last step, for unit noise
    edges : (514,) or (0,) float64; offsets of the printed edges, in cells: vertical lines, then horizontal ones; empty
        where not estimated
    edge_rms : root mean square of the offsets, in cells
    scores : (TILES^2, k^2 + p) contribution of each tile of the noise region, row by row, to the normal equations'
        right side at the solution. Their sum is 0, and their scatter gives that of the solution, whatever the cause of
        the residual.
    converged : whether the map converged
    slopes : (m, 2) derivative of the prediction, in units of the noise, by a shift of the map along x and y in pixels
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
    converged: bool = False
    slopes: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def residual(self) -> Array:
        """Samples minus prediction, in units of the noise expected from the blocks, (m,)."""
        return (self.observation.y - self.prediction) * self.observation.weight

    @property
    def residual_image(self) -> Array:
        """The residual over the window (rows, columns), NaN where there is no sample."""
        o = self.observation
        image = np.full((o.rows.max() + 1, o.columns.max() + 1), np.nan)
        image[o.rows, o.columns] = self.residual
        return image

    @property
    def freedom(self) -> int:
        """Degrees of freedom; the edges count by half and the tail's shapes not at all, because of their priors."""
        return len(self.observation) - len(self.h) - GEOMETRY - TAIL - 1 - len(self.edges) // 2

    @property
    def residual_std(self) -> float:
        """Standard deviation of the residual in units of the blocks' noise, corrected for the degrees of freedom."""
        return float(np.sqrt(self.residual @ self.residual / self.freedom))

    @property
    def variance(self) -> float:
        """Variance of the samples, more than 0."""
        return max(float(np.var(self.observation.y)), 1e-30)

    @property
    def agreement(self) -> float:
        """Share of the samples' variance that the prediction explains, corrected for the degrees of freedom."""
        residual = self.observation.y - self.prediction
        return 1 - float(residual @ residual) / self.freedom / self.variance

    @property
    def neighbour_correlation(self) -> float:
        """Largest correlation of the residual at lag one, along rows or columns."""
        grid, variance = self.residual_image, float(np.var(self.residual))
        products = grid[1:] * grid[:-1], grid[:, 1:] * grid[:, :-1]
        lags = [float(np.nansum(product)) / max(int(np.isfinite(product).sum()), 1) / variance for product in products]
        return max(lags, key=abs)

    @property
    def cut(self) -> float:
        """Share of the PSF's energy outside its support, by the tail's amplitude."""
        outside = float(self.light[TAIL:] @ tail_sums(round(len(self.h) ** 0.5)))
        return outside / (float(self.h.sum()) + outside)


@dataclass(frozen=True)
class TailPrior:
    """Prior of the mean far tail from diffraction.

    density_px : a of the tail a / r^3 per square pixel of a PSF of sum 1, r in pixels; share : relative standard
    uncertainty.
    """

    density_px: float
    share: float

    def energy(self, s: int, k: int) -> float:
        """First amplitude of the tail of a PSF of sum 1."""
        return self.density_px * s / tail_density(k)


@dataclass(frozen=True)
class _Model:
    """Chart model: everything that stays constant during the refinement."""

    chart: Array32
    raster: Raster
    window: Window
    k: int
    far_light: Array32
    tail: TailPrior | None = None
    bend: float | None = None

    def read(self, registration: Registration, border: int) -> Array32:
        """Chart on the s grid of the window, with a border."""
        return self.raster.read(registration, self.window, border)

    def system(self, o: Observation, u: Array32, more: int = 0) -> Array32:
        """Weighted convolution matrix of the chart `u`, whose border is at least the support's, and `more` columns to
        be filled."""
        extra = (u.shape[0] - (self.raster.s * (self.window.rows - 1) + self.k)) // 2
        inner = u[extra : len(u) - extra, extra : u.shape[1] - extra]
        weight = o.weight.astype(np.float32)
        return np.asarray(sample_convolution(inner, o.rows, o.columns, weight, self.raster.s, self.k, more))

    def far(self, fit: ChartFit, u: Array32) -> Array:
        """Columns outside h (m, 7): the outlines through the PSF, the chart `u` through the tail's shapes."""
        o, s = fit.observation, self.raster.s
        outline = self.raster.read(fit.registration, self.window, self.k // 2, outline=True)
        h = fit.h.reshape(self.k, self.k).astype(np.float32)
        spread = loops.convolve_at(outline, o.rows, o.columns, h, s)
        tail = tail_columns(u, o.rows, o.columns, s, self.k)
        tail[:, 0] += self.far_light[o.rows, o.columns]
        return np.column_stack([spread, tail])

    def edges(self, fit: ChartFit) -> EdgeColumns:
        """Derivative of the samples by the printed edges."""
        o, h = fit.observation, fit.h.reshape(self.k, self.k)
        return edge_columns(self.chart, fit.registration, o.points, h, self.raster.s, o.weight)


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
    """Estimate PSF, map and light jointly, starting from the marks' map; and the printed edges where significant.

    Coarse steps use a subset of the samples, fine steps all of them.

    registration : map by the marks, or by another fit
    s, k : samples per pixel, and their number along the PSF's side
    far : (rows, columns) float32 light in the window from beyond the range of the tail's shapes, black -1/2 and white
        1/2, from `far_light`
    tail : prior of the far tail
    bend : standard uncertainty of beta, where the response was linearised by the sensor's calibration
    """
    model = _Model(whole_chart(chart), band_limited_chart(chart, registration, s), window, k, far, tail, bend)
    stride = max(2, len(observation) // (COARSE_SAMPLES * k * k))
    enough = len(observation) // stride >= COARSE_SAMPLES * k * k
    coarse = observation.where(slice(None, None, stride)) if enough else observation
    A = model.system(coarse, model.read(registration, k // 2))
    AA = gram(A)
    fit = _first_fit(coarse, A, AA, registration)
    if fit.agreement < MIN_AGREEMENT:
        return fit
    for step in range(COARSE_STEPS):
        if step > 0:
            fit = _centred(fit, model)
            A = model.system(coarse, model.read(fit.registration, k // 2))
            AA = gram(A)
        start, Z = _linearised(fit, A, model, np.zeros((len(fit.observation), 0)))
        system = eliminate(products(AA, A, Z * fit.observation.weight[:, None], start.residual))
        last, fit = fit, _advanced(start, A, Z, system)
        if map_distance(last.registration, fit.registration, coarse.points[::29]) < NEAR_PX:
            break
    fit = replace(fit, observation=observation)
    for _ in range(FINE_STEPS):
        start = _centred(fit, model)
        fit, system_matrix = _fine_step(start, model)
        step_px = map_distance(start.registration, fit.registration, coarse.points[::29])
        if step_px < TOLERANCE_PX:
            break
    slopes = _predict(system_matrix[:, : k * k], fit.h, s, k)[1]
    return replace(fit, converged=bool(step_px < 10 * TOLERANCE_PX), scores=_scores(fit, system_matrix), slopes=slopes)


def linear_system(
    fit: ChartFit, chart: Chart, raster: Raster, window: Window, k: int, far: Array32
) -> tuple[Array32, Array, Array]:
    """The columns of a fit at its solution, divided by the noise.

    Returns
    -------
    shared : (m, k^2 + q) float32
        Of the PSF and the tail.
    own : (m, p - q) float64
        Of the other nuisance parameters.
    gram : (k^2 + q, k^2 + q) float64
        Gram matrix of the first without the second, with the tail's priors.
    """
    q, n, o, equations = len(SHAPES), k * k, fit.observation, fit.equations
    model = _Model(whole_chart(chart), raster, window, k, far)
    u = model.read(fit.registration, tail_border(k))
    shared = model.system(o, u, q)
    _, Z = _linearised(fit, shared[:, :n], model, model.far(fit, u))
    Z = Z * o.weight[:, None]
    shared[:, n:] = Z[:, -q:]
    AZ, ZZ = equations.AZ, equations.ZZ
    AA = equations.G + AZ @ equations.E
    joined = np.block([[AA, AZ[:, -q:]], [AZ[:, -q:].T, ZZ[-q:, -q:]]])
    others = np.vstack([AZ[:, :-q], ZZ[-q:, :-q]])
    return shared, Z[:, :-q], joined - others @ np.linalg.solve(ZZ[:-q, :-q], others.T)


def fit_by_marks(
    observation: Observation, chart: Chart, registration: Registration, window: Window, s: int, k: int
) -> ChartFit:
    """Fit the PSF with the unrefined map of the marks, which is robust to partly hidden cells."""
    model = _Model(
        whole_chart(chart), band_limited_chart(chart, registration, s), window, k, np.zeros((0, 0), np.float32)
    )
    A = model.system(observation, model.read(registration, k // 2))
    return _first_fit(observation, A, gram(A), registration)


def _scores(fit: ChartFit, system_matrix: Array32) -> Array:
    """Contribution of every tile to A'r and Z'r, (TILES^2, k^2 + p); A and Z are the system's columns but the last."""
    o = fit.observation
    row, column = (np.minimum(place * TILES // (place.max() + 1), TILES - 1) for place in (o.rows, o.columns))
    sums = loops.sums_of_groups(system_matrix, row * TILES + column, fit.residual.astype(np.float32), TILES * TILES)
    return np.asarray(sums[:, :-1], dtype=np.float64)


def _first_fit(o: Observation, A: Array32, AA: Array, registration: Registration) -> ChartFit:
    """Fit the PSF and the light's quadratics with the map of the marks."""
    equations = eliminate(products(AA, A, o.quadratics * o.weight[:, None], o.y * o.weight))
    h = equations.kernel
    light = np.zeros(TAIL + len(SHAPES))
    light[:6] = equations.nuisance(h)
    prediction = (A @ h.astype(np.float32)) / o.weight + o.quadratics @ light[:6]
    return ChartFit(registration, h, light, o, prediction, equations, np.zeros(0))


def _centred(fit: ChartFit, model: _Model) -> ChartFit:
    """Shift the map of a fit by the mark offset of its PSF; the next step moves the PSF."""
    h = fit.h.reshape(model.k, model.k)
    return replace(
        fit, registration=fit.registration.translated(-mark_offset(h, model.raster.s, fit.registration.jacobian()))
    )


def _fine_step(fit: ChartFit, model: _Model) -> tuple[ChartFit, Array32]:
    """One Gauss-Newton step of all parameters, with the printed edges where the residual exceeds the noise."""
    n, u = model.k**2, model.read(fit.registration, tail_border(model.k))
    system_matrix = model.system(fit.observation, u, NUISANCE + 1)
    A = system_matrix[:, :n]
    start, Z = _linearised(fit, A, model, model.far(fit, u))
    weighted = Z * fit.observation.weight[:, None]
    parts = _with_priors(products_within(system_matrix, n, weighted, start.residual), start, model)
    result = _advanced(start, A, Z, eliminate(parts))
    if result.residual_std < EDGES_RESIDUAL:
        return result, system_matrix
    edges = model.edges(fit)
    rms, noise = edges.widths(result.residual)
    estimator, step_px = edges.estimator(rms, noise), np.zeros(len(result.residual))
    for _ in range(SWEEPS):  # weakly coupled: the error falls tenfold each time
        offsets = estimator(result.residual + step_px)
        step_px = edges.apply(offsets)
        shifted = replace(start, prediction=start.prediction + step_px / start.observation.weight)
        parts = parts.with_right_side(A, weighted, shifted.residual)
        result = _advanced(shifted, A, Z, result.equations.with_right_side(parts))
    return replace(result, edges=offsets, edge_rms=rms), system_matrix


def _with_priors(parts: Products, fit: ChartFit, model: _Model) -> Products:
    """Add the priors of the response and of the tail's amplitudes to the products."""
    first, tail_prior = GEOMETRY + TAIL, model.tail
    precision, pull = np.zeros((2, len(parts.ZZ)))
    if model.bend is not None:
        precision[GEOMETRY + RESPONSE] = 1 / model.bend**2
        pull[GEOMETRY + RESPONSE] = -fit.light[RESPONSE]
    if tail_prior is not None:
        expected = tail_prior.energy(model.raster.s, model.k)
        precision[first] = 1 / (tail_prior.share * expected) ** 2
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
    """Apply the increments that solve the equations, with the prediction to first order."""
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
    """Linearise a fit: its prediction by the system A, and the columns of geometry, light, response and `far`."""
    o, k = fit.observation, model.k
    predicted, slopes = _predict(A, fit.h, model.raster.s, k)
    predicted, slopes = predicted / o.weight, slopes / o.weight[:, None]
    tail = fit.light[TAIL:] if far.shape[1] else np.zeros(0)
    m = (predicted + far[:, 1:] @ tail + (fit.h.sum() + tail_sums(k)[: len(tail)] @ tail) / 2)[:, None]
    geometry = displacement_columns(slopes, o.cubics)
    Z = np.hstack([geometry, o.quadratics, o.quadratics[:, 1:] * m, m * m - m, far])
    return replace(fit, prediction=predicted + Z[:, GEOMETRY:] @ fit.light[: Z.shape[1] - GEOMETRY]), Z


def _predict(A: Array32, h: Array, s: int, k: int) -> tuple[Array, Array]:
    """Weighted prediction (m,) of a PSF, and its derivative (m, 2) by a displacement along x and y in pixels."""
    slope_y, slope_x = np.gradient(h.reshape(k, k))
    columns = [one.ravel().astype(np.float32) for one in (h, slope_x, slope_y)]
    result = np.empty((len(A), 3))
    for first in range(0, len(A), ROWS_PER_BLOCK):
        part = A[first : first + ROWS_PER_BLOCK]
        for j, column in enumerate(columns):  # faster than one product with three columns
            result[first : first + ROWS_PER_BLOCK, j] = part @ column
    return result[:, 0], result[:, 1:] * s
