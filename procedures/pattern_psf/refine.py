"""Geometry, light and response refined against the noise cells themselves, jointly with the PSF.

The marks give a map good to a few tenths of a pixel when the chart is tilted or the lens distorts; sixty-five
thousand cells give it to a few thousandths. Every Gauss-Newton step linearises

    y = A h + sum a_i q_i + sum b_i q_i m + beta (m^2 - m) + delta o + tau v,   m = A h + sum(h)/2,

about the current map, PSF and light, with y the sample between the black and white levels, A the chart of values
-1/2 and 1/2 (a_0 holds the mean), q_i the quadratics of place, o the cells' outlines seen through the PSF, v the chart
seen through the PSF's far tail, and eliminates everything but h (variable projection, Kaufman's form). delta is the
spread of the ink, in cells: the printer makes black cells larger than white ones, which darkens the noise region just
as a curved response would; only the picture of the outlines tells the two apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from procedures.numerics.warps import cubic_monomials
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.printed_edges import Edges, edge_columns
from procedures.pattern_psf.radiometry import Light, quadratic
from procedures.pattern_psf.rasterise import Raster, Window, band_limited_chart, whole_chart
from procedures.pattern_psf.registration import Registration, map_distance
from procedures.pattern_psf.solve import (
    NormalEquations,
    convolve_at,
    eliminate,
    gram,
    products,
    sample_convolution,
    solve,
)
from procedures.pattern_psf.tail import tail_column

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

GEOMETRY = 18  # nuisance columns of the displacement: nine cubics each for x and y
RESPONSE, SPREAD, TAIL = 11, 12, 13  # places of beta, delta and tau among the light's numbers
MAX_STEPS = 6
LOST = 0.1  # agreement by the marks' map under which these are other cells, or none can be seen
PRINT_TELLS = 1.06  # residual over noise from which the printed edges are worth estimating
NEAR_PX = 0.15  # below this a step's system is that of the answer, to the noise
STILL_PX = 0.015  # the step itself is accounted for to first order: what is left of it is a hundredth


@dataclass(frozen=True)
class Observation:
    """The samples used: where they lie, and their value between black (0) and white (1).

    Attributes
    ----------
    rows, columns : (m,) int64
        Pixels, relative to the window.
    points : (m, 2) float64
        The same as (x, y) of the plane.
    y : (m,) float64
        Samples, black 0, white 1.
    weight : (m,) float64
        One over the noise of y.
    """

    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]
    points: Array
    y: Array
    weight: Array


@dataclass(frozen=True)
class Fit:
    """The state of the refinement: the map, the PSF, the light's corrections, and what is left over.

    Attributes
    ----------
    registration : Registration
    h : (k^2,) float64
        The PSF, not yet normalised: its sum is the contrast's correction.
    light : (14,) float64
        a (6), b without its constant (5), beta, delta, tau.
    tail : (m,) float64
        The chart seen through the tail outside the support.
    edges : (514,) or (0,) float64
        Offsets of the printed edges, in cells: vertical lines, then horizontal ones; empty where they do not tell.
    edge_rms : float
        Their root mean square, in cells.
    observation : Observation
    equations : NormalEquations
        Of the last step, for unit noise.
    AA : (k^2, k^2) float64
        Gram matrix of the last system built afresh.
    prediction : (m,) float64
        The model at the samples.
    steps : int
    still : bool
        Whether the map came to rest.
    """

    registration: Registration
    h: Array
    light: Array
    tail: Array
    edges: Array
    edge_rms: float
    observation: Observation
    equations: NormalEquations
    AA: Array
    prediction: Array
    steps: int
    still: bool

    @property
    def residual(self) -> Array:
        """Samples minus prediction, in units of the noise expected from the blocks, (m,)."""
        return (self.observation.y - self.prediction) * self.observation.weight

    @property
    def freedom(self) -> int:
        """Samples minus parameters; the edges' count by half, as the prior holds them."""
        return len(self.observation.y) - len(self.h) - GEOMETRY - len(self.light) - len(self.edges) // 2

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
        outside = float(self.light[TAIL])
        return outside / (float(self.h.sum()) + outside)


def noise_window(registration: Registration, shape: tuple[int, ...]) -> Window:
    """The pixels that can lie in the noise region, inside the plane."""
    rim = registration.to_sensor(np.array([[0.0, 0.0], [CELLS, 0.0], [CELLS, CELLS], [0.0, CELLS]]))
    limit = np.array(shape[::-1]) - 1
    low = np.clip(np.floor(rim.min(axis=0)), 0, limit).astype(int)
    high = np.clip(np.ceil(rim.max(axis=0)), 0, limit).astype(int)
    return Window(int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1))


def observe(
    samples: Array32, registration: Registration, light: Light, window: Window, *, margin_px: float = 0.0
) -> Observation:
    """The samples of the noise region, scaled between black and white, with their weights.

    Parameters
    ----------
    margin_px : float
        Pixels nearer than this to the region's rim are left out: the PSF's radius, when marks are hidden and what
        lies beyond the rim is not known.
    """
    x, y = np.meshgrid(np.arange(window.columns), np.arange(window.rows))
    columns, rows = x.ravel(), y.ravel()
    points = np.column_stack([columns + window.x, rows + window.y]).astype(np.float64)
    cells = registration.to_pattern(points)
    margin = margin_px * np.abs(registration.jacobian()).sum(axis=1).max()
    inside = ((cells >= margin) & (cells <= CELLS - margin)).all(axis=1)
    rows, columns, points = rows[inside], columns[inside], points[inside]
    place = quadratic(*((points - registration.centre) / registration.radius).T)
    contrast = place @ (light.white - light.black)
    value = (window.cut(samples)[rows, columns] - place @ light.black) / contrast
    weight = contrast / np.sqrt(light.variance_at(value))
    return Observation(rows, columns, points, value, weight)


def without_outliers(fit: Fit, limit: float = 6.0) -> Observation:
    """The observation without the samples that no noise explains: specks, scratches, a wire before the chart."""
    scale = 1.4826 * np.median(np.abs(fit.residual))
    kept = np.abs(fit.residual) < limit * scale
    o = fit.observation
    return Observation(o.rows[kept], o.columns[kept], o.points[kept], o.y[kept], o.weight[kept])


def refine(observation: Observation, chart: Chart, registration: Registration, window: Window, s: int, k: int) -> Fit:
    """The joint estimate of PSF, map and light, from the marks' map on; of the printed edges where they tell.

    Parameters
    ----------
    observation : Observation
    chart : Chart
    registration : Registration
        The marks' map.
    window : Window
    s, k : int
        Samples per pixel, and their number along the PSF's side.
    """
    raster = band_limited_chart(chart, registration, s)
    fit = _first_fit(observation, raster, registration, window, k)
    if fit.agreement < LOST:
        return fit
    moved = np.inf
    for step in range(1, MAX_STEPS + 1):
        # far from rest the first step's Gram matrix serves; at rest the system must be the map's own
        fresh = moved < NEAR_PX or step == MAX_STEPS
        last, fit = fit, _step(_centred(fit, s, k), raster, window, k, whole_chart(chart), fresh=fresh)
        moved = map_distance(last.registration, fit.registration, observation.points[::29])
        if fresh and moved < STILL_PX:
            break
    return replace(fit, steps=step, still=bool(moved < 10 * STILL_PX))


def _system(o: Observation, raster: Raster, registration: Registration, window: Window, k: int) -> Array32:
    """The weighted convolution matrix for a map."""
    u = raster.read(registration, window, k // 2)
    return np.asarray(sample_convolution(u, o.rows, o.columns, o.weight.astype(np.float32), raster.s, k))


def _first_fit(o: Observation, raster: Raster, registration: Registration, window: Window, k: int) -> Fit:
    """The PSF by the marks' map, the light's quadratics free, the response from the region's mean."""
    A = _system(o, raster, registration, window, k)
    place = quadratic(*((o.points - registration.centre) / registration.radius).T)
    AA = gram(A)
    equations = eliminate(products(AA, A, place * o.weight[:, None], o.y * o.weight))
    h = solve(equations.G, equations.b, "ls")
    light = np.zeros(14)
    light[:6] = equations.nuisance(h)
    prediction = (A @ h.astype(np.float32)) / o.weight + place @ light[:6]
    tail = tail_column(raster, registration, window, o.rows, o.columns, k)
    return Fit(registration, h, light, tail, np.zeros(0), 0.0, o, equations, AA, prediction, 0, False)


def _centred(fit: Fit, s: int, k: int) -> Fit:
    """The same fit with the map shifted to where the marks are seen through its PSF; the next step moves the PSF."""
    offset = mark_offset(fit.h.reshape(k, k), s, fit.registration.jacobian())
    return replace(fit, registration=fit.registration.translated(-offset))


def _step(fit: Fit, raster: Raster, window: Window, k: int, chart: Array32, *, fresh: bool) -> Fit:
    """One Gauss-Newton step: a new system for the current map, increments of everything.

    A fresh step that leaves more than noise is taken again with the offsets of the chart's printed edges.
    """
    o, registration = fit.observation, fit.registration
    A = _system(o, raster, registration, window, k)
    Z, prediction = _linearised(fit, A, raster, window, k)
    start = replace(fit, AA=gram(A) if fresh else fit.AA, prediction=prediction)
    parts = products(start.AA, A, Z * o.weight[:, None], start.residual)
    equations = eliminate(parts)
    plain = _advanced(start, A, Z, equations)
    if not fresh or plain.residual_std < PRINT_TELLS:
        return plain
    edges = Edges.of(edge_columns(chart, registration, o.points, fit.h.reshape(k, k), raster.s, o.weight))
    rms = edges.rms(plain.residual)
    joint = edges.join(parts, A, Z * o.weight[:, None], start.residual, rms)
    return _advanced(start, A, Z, eliminate(joint), edges.C, rms)


def _advanced(
    start: Fit, A: Array32, Z: Array, equations: NormalEquations, C: csr_array | None = None, rms: float = 0.0
) -> Fit:
    """The fit with the increments that solve the equations, and the prediction they make, to first order."""
    o, n = start.observation, Z.shape[1]
    dh = solve(equations.G, equations.b, "ls")
    t = equations.nuisance(dh)
    change = (A @ dh.astype(np.float32)) / o.weight + Z @ t[:n]
    if C is not None:
        change += (C @ t[n:]) / o.weight
    return replace(
        start,
        registration=_displaced(start.registration, t[:GEOMETRY].reshape(2, 9), o),
        h=start.h + dh,
        light=start.light + t[GEOMETRY:n],
        edges=t[n:],
        edge_rms=rms,
        equations=equations,
        prediction=start.prediction + change,
    )


def _linearised(fit: Fit, A: Array32, raster: Raster, window: Window, k: int) -> tuple[Array, Array]:
    """Nuisance columns (m, 32) of geometry, light, response, spread and tail, and the current prediction (m,)."""
    o, registration = fit.observation, fit.registration
    seen = (A @ fit.h.astype(np.float32)).astype(np.float64) / o.weight
    m = seen + fit.h.sum() / 2
    place = quadratic(*((o.points - registration.centre) / registration.radius).T)
    outline = raster.read_outline(registration, window, k // 2)
    spread = convolve_at(outline, o.rows, o.columns, fit.h.reshape(k, k).astype(np.float32), raster.s)
    geometry = _geometry_columns(A, fit.h, o, registration, raster.s, k)
    Z = np.column_stack([geometry, place, place[:, 1:] * m[:, None], m * m - m, spread, fit.tail])
    return Z, seen + Z[:, GEOMETRY:] @ fit.light


def _geometry_columns(A: Array32, h: Array, o: Observation, registration: Registration, s: int, k: int) -> Array:
    """Change of the prediction with the displacement's coefficients, (m, 18): cubic monomials times its gradient.

    The monomials lose their mean, so that the columns move no centre.
    """
    slope_y, slope_x = np.gradient(h.reshape(k, k))
    slopes = A @ np.column_stack([slope_x.ravel(), slope_y.ravel()]).astype(np.float32)
    gradient = slopes.astype(np.float64) * (s / o.weight)[:, None]
    monomials = _monomials(o, registration)
    monomials -= monomials.mean(axis=0)
    return np.hstack([monomials * gradient[:, :1], monomials * gradient[:, 1:]])


def _monomials(o: Observation, registration: Registration) -> Array:
    """The displacement's cubic monomials at the samples, (m, 9)."""
    return cubic_monomials(*((o.points - registration.centre) / registration.radius).T)


def _displaced(registration: Registration, change: Array, o: Observation) -> Registration:
    """The map with its displacement's coefficients (2, 9) changed, its mean over the samples left where it was."""
    drift = change @ _monomials(o, registration).mean(axis=0)
    return replace(registration, displacement=registration.displacement + change).translated(-drift)
