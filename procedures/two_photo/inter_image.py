"""The kernel between the two photographs, fitted jointly with map and light: the near photograph serves as the chart.

Every Gauss-Newton step linearises

    y = A k + sum tau_j T_j + sum a_i q_i + sum b_i q_i A k

about the current map, kernel and light, with y the far photograph's samples, A the near photograph on the s grid of
the far one as a convolution, T_j its convolution with the shapes of the tail beyond the support of k, q_i the
quadratics of position, and eliminates everything but k and the tail (variable projection, Kaufman's form). The map is a
homography followed by a cubic displacement; its constant is equivalent to a shift of k, and is set so that k stays
centred.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from procedures.numerics import loops
from procedures.numerics.arrays import Array, Array32, Indices, Mask
from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL, SHAPES, tail_border, tail_columns
from procedures.numerics.normal_equations import NormalEquations, Products, eliminate, gram, products
from procedures.numerics.splines import photograph_spline, read_spline
from procedures.numerics.transforms import sample_convolution
from procedures.numerics.warps import CubicWarp, apply_homography, displacement_columns, homography_jacobian
from procedures.outcome import Refused

GEOMETRY, LIGHT = 18, 11
"""Nuisance parameters: nine cubics each for x and y; six additive quadratics, five multiplicative."""
TAIL = len(SHAPES)
TILES = 6
"""Tiles along each side of the region: larger than the kernel, smaller than shading, motion and defocus vary over."""
MAX_ITERATIONS = 8
ALL_SAMPLES_PX = 0.02  # move of the map below which all samples are used
CONVERGED_PX = 0.04  # the step is exact to first order: at most a tenth of it remains
OUTLIER_SIGMAS = 6.0  # standard deviations of the residual from which a sample is excluded
COARSE_SAMPLES = 20  # samples per unknown of the first iterations
MOST_SAMPLES = 150_000  # a PSF is local: the middle of a larger common region is used


@dataclass(frozen=True)
class FarSamples:
    """Samples of the far photograph.

    rows, columns : (m,), pixels, relative to the window's corner
    points : (m, 2), the same as (x, y) of the far photograph
    y : (m,) float64
    """

    rows: Indices
    columns: Indices
    points: Array
    y: Array

    def kept(self, mask: Mask) -> "FarSamples":
        """The selected samples."""
        return FarSamples(self.rows[mask], self.columns[mask], self.points[mask], self.y[mask])


@dataclass(frozen=True)
class NearImage:
    """The near photograph, band-limited to the s grid of the far one.

    coefficients : (rows, columns), cubic spline about the photograph's mean
    grid : (3, 3), near pixels (x, y) -> grid points
    corner : (x, y), first pixel of the window on the far photograph
    shape : (rows, columns), pixels of the window
    """

    coefficients: Array32
    grid: Array
    s: int
    corner: tuple[int, int]
    shape: tuple[int, int]

    def read(self, warp: CubicWarp, border: int) -> Array32:
        """The near photograph, mapped to the s grid over the window and `border` samples around it."""
        rows, columns = self.shape
        return np.asarray(
            read_spline(
                self.coefficients,
                self.grid @ warp.H,
                warp.centre,
                warp.radius,
                warp.displacement,
                np.array(self.corner, dtype=np.float64) - border / self.s,
                1 / self.s,
                (self.s * (rows - 1) + 1 + 2 * border, self.s * (columns - 1) + 1 + 2 * border),
            )
        )


@dataclass(frozen=True)
class PairFit:
    """State of the estimate: map, kernel, light, and residual.

    warp : far pixels -> near pixels
    kernel : (k^2,), inter-image kernel by plain least squares
    tail : (q,), tau_j, the kernel beyond its support; the sum of both is the gain from near to far photograph
    light : (11,), a (6), b without its constant (5)
    equations : of the last iteration, for kernel and tail
    slopes : (m, 2), change of the prediction per far pixel along x and y
    prediction : (m,) float64
    moved_px : largest move of the map in the last iteration, in far pixels
    travelled_px : sum of these moves, without translations
    outliers : share of the common region's samples that were excluded
    scores : (TILES^2, k^2 + q + p) float64
        Contribution of every tile to A'r, the tail's columns and Z'r, for kernel, tail and nuisance parameters.
    counts : (TILES^2,), samples of every tile
    """

    warp: CubicWarp
    kernel: Array
    tail: Array
    light: Array
    samples: FarSamples
    near: NearImage
    equations: NormalEquations
    slopes: Array
    prediction: Array
    moved_px: float
    travelled_px: float
    outliers: float = 0.0
    scores: Array = field(default_factory=lambda: np.zeros((0, 0)))
    counts: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def residual(self) -> Array:
        """Samples minus prediction, (m,)."""
        return self.samples.y - self.prediction

    @property
    def variance(self) -> float:
        """Variance of the residual per degree of freedom."""
        freedom = len(self.samples.y) - len(self.kernel) - TAIL - GEOMETRY - LIGHT
        return float(self.residual @ self.residual / freedom)

    def scale(self) -> Array:
        """d(near pixels) / d(far pixels) (2, 2), its mean over the samples, like the kernel."""
        return np.asarray(self.warp.derivative(self.samples.points[::29]).mean(axis=0))

    @property
    def agreement(self) -> float:
        """Share of the samples' variance that the near photograph explains."""
        return 1 - self.variance / float(np.var(self.samples.y))

    def as_image(self, values: Array, background: float) -> Array:
        """Values (m,) of the samples as an image of the window."""
        image = np.full(self.near.shape, background)
        image[self.samples.rows, self.samples.columns] = values
        return image

    def common_part(self, near: Array32) -> Array32:
        """The part of the near photograph inside the window."""
        (x, y), (rows, columns) = self.near.corner, self.near.shape
        corners = [[x, y], [x + columns, y], [x + columns, y + rows], [x, y + rows]]
        rim = self.warp.forward(np.array(corners, dtype=float))
        low, high = np.maximum(rim.min(axis=0), 0).astype(int), rim.max(axis=0).astype(int)
        return near[low[1] : high[1], low[0] : high[0]]


def fit_kernel(
    near: Array32, far: Array32, H_near_far: Array, s: int, k: int, start: CubicWarp | None = None
) -> PairFit:
    """The inter-image kernel with the map refined to a few thousandths of a pixel.

    Raises Refused if the common region is too small for the kernel.

    near, far : (rows, columns) float32
    H_near_far : (3, 3), far -> near pixels, to about half a far pixel
    s, k : samples per far pixel, and their number along the kernel's side
    start : map of an earlier fit with other s and k
    """
    samples, corner, shape = common_region(near, far, H_near_far, s, k)
    centre = samples.points.mean(axis=0)
    warp = start or CubicWarp(H_near_far, centre, float(np.abs(samples.points - centre).max()), np.zeros((2, 9)))
    # the required part of the near photograph, as a spline
    mapped = warp.forward(samples.points)
    scale = np.abs(homography_jacobian(warp.H, warp.centre)).sum(axis=1)
    margin = scale * tail_border(k) / s + 8
    low = np.maximum(np.floor(mapped.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(mapped.max(axis=0) + margin) + 1, near.shape[::-1]).astype(int)
    part = near[low[1] : high[1], low[0] : high[0]]
    coefficients, grid = photograph_spline(part - part.mean(), warp.jacobian(), s / 2)
    shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1]])
    image = NearImage(coefficients, grid @ shift, s, corner, shape)
    stride = int(np.clip(np.sqrt(len(samples.y) / (COARSE_SAMPLES * k * k)), 1, 3))
    coarse = samples.kept((samples.rows % stride == 0) & (samples.columns % stride == 0)) if stride > 1 else samples
    fit = _iterated(_first_fit(coarse, image, warp, k), samples, k)
    away = np.abs(fit.residual)  # beyond noise: hot pixels, or an object in front of the wall in one of the photographs
    clean = fit.samples.kept(away < OUTLIER_SIGMAS * 1.4826 * float(np.median(away)))
    if len(clean.y) < len(samples.y):
        fit = replace(_iterated(fit, clean, k), outliers=1 - len(clean.y) / len(samples.y))
    return fit


def common_region(
    near: Array32, far: Array32, H_near_far: Array, s: int, k: int
) -> tuple[FarSamples, tuple[int, int], tuple[int, int]]:
    """The far samples whose kernel lies entirely in the near photograph; corner (x, y) and shape of their window.

    Raises Refused if there are too few for k^2 unknowns.
    """
    rows, columns = np.indices(far.shape)
    points = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    reach = (k // 2 + 2) / s
    limit = np.array(near.shape[::-1]) - 3.0
    inside = np.ones(len(points), dtype=bool)
    for corner in ((-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)):
        mapped = apply_homography(H_near_far, points + corner)
        inside &= ((mapped >= 2) & (mapped <= limit)).all(axis=1)
    if inside.sum() > MOST_SAMPLES:  # a square about the middle
        away = np.abs(points - points[inside].mean(axis=0)).max(axis=1)
        inside &= away <= np.sort(away[inside])[MOST_SAMPLES]
    needed = int(1.5 * k * k + 100)
    if inside.sum() < needed:
        raise Refused(
            f"{k * k} kernel values need {needed} far samples of the common region; it has {int(inside.sum())}",
            "include more of the near photograph's wall in the far one, or lower k",
        )
    points = points[inside]
    low, high = points.min(axis=0).astype(int), points.max(axis=0).astype(int)
    x, y = points.astype(np.int64).T
    samples = FarSamples(y - low[1], x - low[0], points, far[y, x].astype(np.float64))
    return samples, (int(low[0]), int(low[1])), (int(high[1] - low[1] + 1), int(high[0] - low[0] + 1))


def _iterated(fit: PairFit, samples: FarSamples, k: int) -> PairFit:
    """Gauss-Newton iterations on the fit's own samples while the map moves, the last ones on all of `samples`."""
    for iteration in range(1, MAX_ITERATIONS + 1):
        if fit.moved_px < ALL_SAMPLES_PX or iteration >= MAX_ITERATIONS - 2:
            fit = replace(fit, samples=samples)
        # the fit with the map shifted so that the kernel is centred; the next step moves the kernel
        offset = centre_of(fit.kernel.reshape(k, k)) / fit.near.s
        centred = replace(fit, warp=fit.warp.translated(-offset))
        before, fit = fit, _step(centred, k, whole=fit.samples is samples)
        fit = replace(fit, travelled_px=before.travelled_px + fit.moved_px)
        if fit.samples is samples and fit.moved_px < CONVERGED_PX:
            break
    return fit


def _quadratics(samples: FarSamples, warp: CubicWarp) -> Array:
    """Quadratics of position at the samples, (m, 6): the light's terms."""
    x, y = ((samples.points - warp.centre) / warp.radius).T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _system(samples: FarSamples, u: Array32, s: int, k: int) -> Array32:
    """Convolution with the near photograph `u`, read with the tail's border, sampled at the far pixels."""
    unweighted = np.ones(len(samples.y), np.float32)
    extra = tail_border(k) - k // 2
    inner = u[extra:-extra, extra:-extra]
    return np.asarray(sample_convolution(inner, samples.rows, samples.columns, unweighted, s, k))


def _first_fit(samples: FarSamples, near: NearImage, warp: CubicWarp, k: int) -> PairFit:
    """The kernel with the initial map and free additive light."""
    A, quadratics = _system(samples, near.read(warp, tail_border(k)), near.s, k), _quadratics(samples, warp)
    equations = eliminate(products(gram(A), A, quadratics, samples.y))
    kernel = equations.kernel
    light = np.zeros(LIGHT)
    light[:6] = equations.nuisance(kernel)
    slopes = np.zeros((len(samples.y), 2))
    prediction = (A @ kernel.astype(np.float32)).astype(np.float64) + quadratics @ light[:6]
    return PairFit(warp, kernel, np.zeros(TAIL), light, samples, near, equations, slopes, prediction, np.inf, 0.0)


def centre_of(kernel: Array) -> Array:
    """Centroid (x, y) of a kernel (k, k), in samples from its middle, under a Gaussian window centred on it.

    The window, a quarter of the support wide, suppresses the noise of the outer samples; for a kernel with a centre of
    symmetry the centroid is that centre for any window.
    """
    k = len(kernel)
    x = np.arange(k) - k // 2
    centre = np.zeros(2)
    for _ in range(30):
        window = np.exp(-((x - centre[0]) ** 2 + (x[:, None] - centre[1]) ** 2) / (2 * (k / 4) ** 2))
        weighted = window * kernel
        centroid = np.array([weighted.sum(axis=0) @ x, weighted.sum(axis=1) @ x]) / weighted.sum()
        converged = np.abs(centroid - centre).max() < 1e-6
        centre = np.clip(centroid, -k / 4, k / 4)
        if converged:
            break
    return centre


def _step(fit: PairFit, k: int, *, whole: bool) -> PairFit:
    """One Gauss-Newton step from the current map; the tail is included in `whole` ones."""
    samples, warp = fit.samples, fit.warp
    u = fit.near.read(warp, tail_border(k))
    A = _system(samples, u, fit.near.s, k)
    kernel = fit.kernel.astype(np.float32)
    blurred, slopes = (A @ kernel).astype(np.float64), _slopes(samples, u, kernel.reshape(k, k), fit.near.s)
    quadratics, monomials = _quadratics(samples, warp), warp.monomials(samples.points)
    columns = [displacement_columns(slopes, monomials), quadratics, quadratics[:, 1:] * blurred[:, None]]
    known = fit.light
    if whole:
        columns.append(tail_columns(u, samples.rows, samples.columns, fit.near.s, k))
        known = np.concatenate([known, fit.tail])
    Z = np.hstack(columns)
    before = blurred + Z[:, GEOMETRY:] @ known
    residual = samples.y - before
    parts = products(gram(A), A, Z, residual)
    equations = _with_tail_prior(parts, fit, float(np.mean(residual**2))) if whole else eliminate(parts)
    change, tail = np.split(equations.kernel, [k * k])
    t = np.concatenate([equations.nuisance(np.append(change, tail)), tail])
    displacement = t[:GEOMETRY].reshape(2, 9)
    moves = (monomials[::29] - monomials.mean(axis=0)) @ displacement.T
    prediction = before + A @ change.astype(np.float32) + Z @ t
    counts, scores = _scores(fit, A, Z, samples.y - prediction) if whole else (fit.counts, fit.scores)
    return replace(
        fit,
        warp=warp.displaced(displacement, monomials),
        kernel=fit.kernel + change,
        tail=fit.tail + tail if whole else fit.tail,
        light=fit.light + t[GEOMETRY : GEOMETRY + LIGHT],
        equations=equations,
        slopes=slopes,
        prediction=prediction,
        moved_px=float(np.abs(moves).max()),
        scores=scores,
        counts=counts,
    )


def _slopes(samples: FarSamples, u: Array32, kernel: Array32, s: int) -> Array:
    """Change of the blurred near photograph per far pixel along x and y, (m, 2).

    The photograph is differentiated, not the kernel, which need not end at 0.
    """
    extra = tail_border(len(kernel)) - len(kernel) // 2
    by_axis = (np.asarray(np.gradient(u, axis=axis)) for axis in (1, 0))
    across, down = (np.ascontiguousarray(one[extra:-extra, extra:-extra]) for one in by_axis)
    both = [loops.convolve_at(one, samples.rows, samples.columns, kernel, s) for one in (across, down)]
    return np.stack(both, axis=-1).astype(np.float64) * s


def tiles_of(fit: PairFit) -> Indices:
    """Number of every sample's tile, row by row, (m,)."""
    rows, columns = (
        np.minimum(index * TILES // n, TILES - 1)
        for index, n in zip((fit.samples.rows, fit.samples.columns), fit.near.shape, strict=True)
    )
    return np.asarray(rows * TILES + columns)


def linear_system(fit: PairFit) -> tuple[Array32, Array]:
    """Columns of a fit at its solution: of kernel and tail (m, k^2 + q), of the other parameters (m, 29)."""
    samples, s, k = fit.samples, fit.near.s, round(len(fit.kernel) ** 0.5)
    u = fit.near.read(fit.warp, tail_border(k))
    A, quadratics = _system(samples, u, s, k), _quadratics(samples, fit.warp)
    blurred = (A @ fit.kernel.astype(np.float32)).astype(np.float64)
    moved = displacement_columns(fit.slopes, fit.warp.monomials(samples.points))
    tail = tail_columns(u, samples.rows, samples.columns, s, k)
    shared = np.hstack([A, tail.astype(np.float32)])
    return shared, np.hstack([moved, quadratics, quadratics[:, 1:] * blurred[:, None]])


def _scores(fit: PairFit, A: Array32, Z: Array, residual: Array) -> tuple[Indices, Array]:
    """Samples of every tile, and its contribution to the products with the residual: kernel, tail, nuisance."""
    tile = tiles_of(fit)
    shares = np.zeros((len(tile), TILES * TILES), dtype=np.float32)
    shares[np.arange(len(tile)), tile] = residual
    reordered = np.hstack([Z[:, -TAIL:], Z[:, :-TAIL]]).astype(np.float32)
    scores = np.hstack([shares.T @ A, shares.T @ reordered])
    return np.bincount(tile, minlength=TILES * TILES), np.asarray(scores, dtype=np.float64)


def _with_tail_prior(parts: Products, fit: PairFit, variance: float) -> NormalEquations:
    """Equations of kernel and tail, with priors of the tail's shapes weighted by the `variance` of the residual."""
    first = len(fit.kernel)
    mean = abs(float(fit.tail[0]))
    if mean == 0:  # first fit: the mean alone
        alone = eliminate(parts.with_joined(TAIL, np.full(TAIL - 1, 1e9 * np.trace(parts.ZZ)), np.zeros(TAIL - 1)))
        mean = abs(float(alone.kernel[first]))
    precision = variance / (DIFFERS * max(mean, LEAST_TAIL)) ** 2
    return eliminate(parts.with_joined(TAIL, precision, -fit.tail[1:]))
