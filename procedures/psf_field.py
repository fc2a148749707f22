"""PSF over the whole frame: measured at nodes, interpolated with its uncertainty.

Every parameter of the PSF, a sample of its support or an amplitude of its tail, is a smooth function of position. Its
variation is described by a few components, A a(x), derived from the nodes' PSFs z_i. A model predicts the coefficients
from those of the nodes, B z_i; the remainder is the mean:

    h(x) = Q z + A (o + sum_i T_i(x) (B z_i - o)),    P = A B,  Q = I - P,  z = sum_i m_i z_i

The interpolation is linear in the nodes' PSFs, so their covariances give that of h(x). The model error is estimated by
cross-validation (`procedures.field.interpolate`), and added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from procedures.display import axes_of, html, summary
from procedures.numerics.arrays import Array, Mask
from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL, tail_kernels, tail_sums
from procedures.numerics.scattered import Hull
from procedures.outcome import BadParameter
from procedures.psf import Psf, extended

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Node:
    """A measured PSF and its position in the frame.

    position : (2,) (x, y) of the PSF's centre in pixels of the plane
    position_covariance : (2, 2) covariance of `position`, in squared pixels of the plane
    sensor_position : (2,) position in pixels of the sensor
    source : name of the photograph
    number : number of the chart in that photograph: the planes' nodes of one chart have the same source and number
    caveat, remedy : reason and remedy of a doubtful PSF; empty for others, and for a field that was read from a file
    """

    position: Array
    position_covariance: Array
    sensor_position: Array
    psf: Psf
    source: str = ""
    number: int = 0
    caveat: str = ""
    remedy: str = ""

    __repr__ = summary


class CoefficientModel(Protocol):
    """Linear prediction of r coefficients at points from those of N nodes; points are in half diagonals."""

    @property
    def name(self) -> str:
        """Description for reports."""

    def predict(self, points: Array, values: Array) -> Array:
        """Coefficients (n, r) at points (n, 2), from the nodes' (N, r)."""

    def transfer(self, points: Array, r: int) -> Array:
        """Weights (n, r, N, r) of the prediction."""

    @property
    def reach(self) -> float:
        """Distance beyond `carried` to which the change of the PSF is extrapolated, in half diagonals."""

    def carried(self, held: Array, points: Array) -> Array:
        """Last positions (n, 2) where the model is valid between `held`, on the nodes' hull, and points beyond it."""


@dataclass(frozen=True, eq=False)
class PsfField:
    """PSF of one plane as a function of position; symbols as in the module's docstring.

    The vector of a PSF is its `parameters`: k^2 samples and q amplitudes of the tail, p = k^2 + q numbers.

    shape : (int, int) rows and columns of the plane
    share : (N,) float64, weights m of the nodes in the mean, of sum 1
    components : (r, p) float64, analysis : (r, p) float64, A^T and B
    origin : (r,) float64, coefficients o about which the model predicts
    lack : (r, r) float64, covariance of the model error of the coefficients
    lack_rest : (p, p) float64, covariance of the variation outside the components
    """

    plane: str
    shape: tuple[int, int]
    nodes: tuple[Node, ...]
    share: Array
    components: Array
    analysis: Array
    origin: Array
    model: CoefficientModel
    lack: Array
    lack_rest: Array

    __repr__ = summary
    _repr_html_ = html

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw PSFs over the frame, each relative to its maximum, and the nodes' places."""
        ax, (rows, columns) = axes_of(ax), self.shape
        down, across = 5, max(1, round(5 * columns / rows))
        x, y = ((np.arange(n) + 0.5) / n * size - 0.5 for n, size in ((across, columns), (down, rows)))
        psfs = self.samples(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).clip(0)
        psfs = (psfs / psfs.max(axis=(1, 2), keepdims=True)).reshape(down, across, self.k, self.k)
        tiles = psfs.swapaxes(1, 2).reshape(down * self.k, across * self.k)
        ax.imshow(tiles, cmap="gray", extent=(-0.5, columns - 0.5, rows - 0.5, -0.5))
        ax.plot(*self.positions.T, "+", color="tab:orange", label="measured")
        ax.set(xlabel="x / pixel", ylabel="y / pixel", title=f"PSFs of plane {self.plane}")
        return ax

    @property
    def s(self) -> int:
        """Samples per pixel of the plane."""
        return self.nodes[0].psf.s

    @property
    def k(self) -> int:
        """Samples along one side."""
        return self.nodes[0].psf.k

    @property
    def q(self) -> int:
        """Number of amplitudes of the tail; 0 where the nodes' PSFs end with their supports."""
        return len(self.nodes[0].psf.tail.amplitudes)

    @cached_property
    def positions(self) -> Array:
        """Positions of the nodes (N, 2), in pixels of the plane."""
        return np.array([node.position for node in self.nodes])

    @cached_property
    def hull(self) -> Hull:
        """Convex hull of the nodes: beyond it the PSF is extrapolated from the nearest position inside."""
        return Hull(self.positions)

    @cached_property
    def base(self) -> Array:
        """Constant part Q z, (p,)."""
        mean = self.share @ self._measured
        return np.asarray(mean - (self.analysis @ mean) @ self.components)

    @cached_property
    def coefficients_at_nodes(self) -> Array:
        """Coefficients B z_i at the nodes, (N, r)."""
        return np.asarray(self._measured @ self.analysis.T)

    def inside(self, points: Array) -> Mask:
        """Mask of the points (n, 2) of the plane inside the hull."""
        return self.hull.holds(np.asarray(points, dtype=np.float64))

    def coefficients(self, points: Array) -> Array:
        """Coefficients (n, r) of the components at points (n, 2) of the plane."""
        values = self.coefficients_at_nodes - self.origin
        limited, before = self._limited(points)
        predicted = self.model.predict(limited, values)
        beyond = np.flatnonzero(np.any(limited != before, axis=1))
        if len(beyond):
            predicted[beyond] += predicted[beyond] - self.model.predict(before[beyond], values)
        return np.asarray(predicted + self.origin)

    def parameters(self, points: Array) -> Array:
        """Parameters (n, p) of the PSFs at points (n, 2) of the plane."""
        return np.asarray(self.base + self.coefficients(points) @ self.components)

    def samples(self, points: Array) -> Array:
        """Supports (n, k, k) of the PSFs at points (n, 2) of the plane, each of sum 1."""
        return self.parameters(points)[:, : self.k**2].reshape(-1, self.k, self.k)

    def energy_outside(self, points: Array) -> Array:
        """Share (n,) of the energy outside the PSFs' supports at points (n, 2) of the plane."""
        outside = self.parameters(points)[:, self.k**2 :] @ tail_sums(self.k)[: self.q]
        return np.asarray(outside / (1 + outside))

    def at(self, x: float, y: float) -> Psf:
        """PSF at a position of the plane, with the covariance of its error by noise and interpolation.

        Outside the hull (`inside`) it is extrapolated from the nearest position inside, with a larger uncertainty: as a
        constant, or linearly over a short distance where the lens is known to be symmetric. Raises BadParameter if the
        position lies outside the frame.
        """
        rows, columns = self.shape
        if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
            raise BadParameter(
                f"a position lies within the frame of {columns} x {rows} pixels; got ({x:g}, {y:g})",
                f"give x from 0 to {columns - 1} and y from 0 to {rows - 1}, in pixels of plane {self.plane}",
            )
        p = self.parameters(np.array([[x, y]], dtype=np.float64))[0]
        noise, lacking = self.covariances(x, y)
        return Psf.of(p, noise + lacking, self.k, self.s, lacking)

    def covariances(self, x: float, y: float) -> tuple[Array, Array]:
        """`noise` and `interpolation` at a position, (p, p) each."""
        T, beyond = self._transfer(x, y), self._beyond(x, y)
        return self._noise(T), self._interpolation(T, beyond)

    def noise(self, x: float, y: float) -> Array:
        """Covariance (p, p) of h(x, y) by that of the nodes; the part by the tail's priors is common to them."""
        return self._noise(self._transfer(x, y))

    def _noise(self, T: Array) -> Array:
        rest, cross, inner = self._covariances
        by_node = T.transpose(1, 0, 2)
        coefficients = np.sum(by_node @ inner @ by_node.transpose(0, 2, 1), axis=0)
        # A'cA + mixed + mixed' as one product and its mirror image
        half = (cross @ T.reshape(len(T), -1).T + self.components.T @ (coefficients / 2)) @ self.components
        return np.asarray(rest + (half + half.T))

    def interpolation(self, x: float, y: float) -> Array:
        """Covariance (p, p) of the model error, independent between nodes: at the position and through the nodes, and
        outside the hull the change over the same distance inside."""
        return self._interpolation(self._transfer(x, y), self._beyond(x, y))

    def _interpolation(self, T: Array, beyond: Array) -> Array:
        random = (1 + float(np.sum(T**2)) / len(T)) * self._lack_of_components + self.lack_rest
        change = beyond @ self.components
        return np.asarray(random + np.outer(change, change) if change.any() else random)

    def _beyond(self, x: float, y: float) -> Array:
        """Change of the coefficients (r,) over the distance of extrapolation, measured inside the model's range."""
        limited, _ = self._limited(np.array([[x, y]], dtype=np.float64))
        wanted = in_half_diagonals(np.array([[x, y]]), self.shape)
        if np.array_equal(limited, wanted):
            return np.zeros(len(self.components))
        before = 2 * limited - wanted
        values = self.coefficients_at_nodes - self.origin
        return np.asarray(self.model.predict(limited, values)[0] - self.model.predict(before, values)[0])

    def error(self, points: Array) -> tuple[Array, Array]:
        """Norms (n,) of the predicted errors at points (n, 2), by noise and by interpolation."""
        noise = [self.norm_of_error(self.noise(x, y)) for x, y in points]
        lack = [self.norm_of_error(self.interpolation(x, y)) for x, y in points]
        return np.array(noise), np.array(lack)

    def norm_of_error(self, covariance: Array) -> float:
        """Rms norm over support and tail of an error with that covariance (p, p)."""
        n = self.k**2
        tail_part = float(np.sum(covariance[n:, n:] * self._tail_products)) if self.q else 0.0
        return float(np.sqrt(max(np.trace(covariance[:n, :n]) + tail_part, 0.0)))

    @cached_property
    def _tail_products(self) -> Array:
        """Inner products of the tail's shapes, (q, q)."""
        kernels = tail_kernels(self.k)[: self.q]
        return np.asarray(np.tensordot(kernels, kernels, axes=([1, 2], [1, 2])))

    @cached_property
    def _measured(self) -> Array:
        return np.array([node.psf.parameters for node in self.nodes])

    @cached_property
    def _lack_of_components(self) -> Array:
        return np.asarray(self.components.T @ self.lack @ self.components)

    @cached_property
    def _covariances(self) -> tuple[Array, Array, Array]:
        """sum m^2 Q C Q^T (p, p); m_i Q C_i B^T side by side (p, N r); B C_i B^T (N, r, r); all without the part common
        to the nodes, whose mean is added to the first."""
        n, (r, size) = len(self.nodes), self.components.shape
        rest, cross, inner = np.zeros((size, size)), np.zeros((n, size, r)), np.zeros((n, r, r))
        common = np.zeros((size, size))
        A, B = self.components.T, self.analysis
        for i, (node, m) in enumerate(zip(self.nodes, self.share, strict=True)):
            prior_part = prior_covariance_part(node.psf)
            common += m * prior_part
            C = node.psf.parameter_covariance - prior_part
            half = C @ B.T
            inner[i] = B @ half
            cross[i] = m * (half - A @ inner[i])
            rest += m * m * C
        rest = rest - A @ (B @ rest)
        rest = rest - (rest @ B.T) @ A.T + common
        return rest, cross.transpose(1, 0, 2).reshape(size, n * r), inner

    def _transfer(self, x: float, y: float) -> Array:
        """T at one place, (r, N, r)."""
        point = np.array([[x, y]], dtype=np.float64)
        limited, before = self._limited(point)
        T = self.model.transfer(limited, len(self.components))[0]
        if np.any(limited != before):
            T = 2 * T - self.model.transfer(before, len(self.components))[0]
        return np.asarray(T)

    def _limited(self, points: Array) -> tuple[Array, Array]:
        """Points of the plane limited to the model's range, and the base points of the linear extrapolation, in half
        diagonals, (n, 2) each."""
        points = np.asarray(points, dtype=np.float64)
        wanted, held = (in_half_diagonals(some, self.shape) for some in (points, self.hull.nearest(points)))
        limited = self.model.carried(held, wanted)
        extrapolation = wanted - limited
        length = np.linalg.norm(extrapolation, axis=1, keepdims=True)
        return limited, limited - extrapolation * np.minimum(self.model.reach / np.maximum(length, 1e-12), 1.0)


def prior_covariance_part(psf: Psf) -> Array:
    """Part C L C of a PSF's covariance C = (F + L)^-1 due to the priors of its tail's shapes; noise alone contributes C
    F C."""
    root, most = _root_of_priors(psf)
    return np.asarray(root @ root.T) / most


def prior_sensitivity(psf: Psf) -> Array:
    """Derivative (p, q - 1) of a PSF's parameters by the errors of its tail's shapes, which are about the same
    everywhere in a lens, in prior standard deviations."""
    root, most = _root_of_priors(psf)
    return np.asarray(root / np.sqrt(most))


def _root_of_priors(psf: Psf) -> tuple[Array, float]:
    """Root (p, q - 1) of C L C, and the divisor of its square."""
    C, n, q = psf.parameter_covariance, psf.k**2, len(psf.tail.amplitudes)
    if q < 2:
        return np.zeros((len(C), 0)), 1.0
    expected = DIFFERS[: q - 1] * max(abs(float(psf.tail.amplitudes[0])), LEAST_TAIL)
    root = C[:, n + 1 :] / expected
    # relative to the prior the shapes' variances are at most 1, except where residuals enlarge C
    return root, max(float(np.linalg.eigvalsh(root[n + 1 :] / expected[:, None])[-1]), 1.0)


def in_half_diagonals(points: Array, shape: tuple[int, int]) -> Array:
    """Points (n, 2) of a plane of that shape, relative to the frame's centre in units of half its diagonal."""
    rows, columns = shape
    return np.asarray((points - np.array([columns - 1, rows - 1]) / 2) / (np.hypot(rows, columns) / 2))


# --- Space-variant blur and its adjoint: a sum of convolutions of the weighted image ---

CHUNK = 1 << 16  # number of samples whose coefficients are predicted at a time


@dataclass(frozen=True, eq=False)
class SpaceVariantBlur:
    """Blur of every point of an image by the PSF of its position; zero beyond the image.

    With h(x) = base + sum_c a_c(x) A_c, a point's light u(x) h(x) gives base * u + sum_c A_c * (a_c u). h is the whole
    PSF within the range of its tail's shapes, normalised to sum 1, which is exact where the image is flat.

    samples_per_px : samples of the image per pixel of the plane, 1 to the field's s. Its first sample lies on the first
    pixel.
    """

    field: PsfField
    samples_per_px: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.samples_per_px <= self.field.s:
            raise BadParameter(
                f"the image must have 1 to {self.field.s} samples per pixel; got {self.samples_per_px}",
                f"resample the image, or estimate the PSF with s = {self.samples_per_px}",
            )

    def blur(self, image: Array) -> Array:
        """Blurred image (rows, columns), of the same shape."""
        weight, coefficients = self._maps(np.shape(image))
        image = weight * np.asarray(image, dtype=np.float64)
        out = _convolved(image, self._kernels[0])
        for kernel, coefficient in zip(self._kernels[1:], coefficients, strict=True):
            out += _convolved(coefficient * image, kernel)
        return np.asarray(out)

    def blur_adjoint(self, image: Array) -> Array:
        """Adjoint of `blur`: sum v blur(u) = sum u blur_adjoint(v) for all images u, v of one shape."""
        image = np.asarray(image, dtype=np.float64)
        weight, coefficients = self._maps(image.shape)
        out = _convolved(image, self._kernels[0][::-1, ::-1])
        for kernel, coefficient in zip(self._kernels[1:], coefficients, strict=True):
            out += coefficient * _convolved(image, kernel[::-1, ::-1])
        return np.asarray(weight * out)

    def product_convolution(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """Filters (n, K, K) and multipliers for an image of that shape; `blur` sums each filter's convolution with
        multiplier times image."""
        weight, coefficients = self._maps(shape)
        return np.array(self._kernels), weight * np.concatenate([np.ones((1, *shape)), coefficients])

    def at(self, points: Array) -> Array:
        """PSFs (n, K, K) at points (n, 2) of the plane on the image's grid, each of sum 1."""
        coefficients = self.field.coefficients(points)
        psfs = self._kernels[0] + np.tensordot(coefficients, np.array(self._kernels[1:]), axes=1)
        return np.asarray(psfs / psfs.sum(axis=(1, 2), keepdims=True))

    def kernel(self, h: Array) -> Array:
        """Resample a PSF (K, K), K odd, to the image's grid with a low-pass filter; its sum is preserved."""
        ratio, half = self.samples_per_px / self.field.s, len(h) // 2
        if ratio == 1:
            return h
        reach = int(np.ceil(half * ratio)) + 2
        taps = np.sinc(np.arange(-reach, reach + 1)[:, None] - np.arange(-half, half + 1) * ratio)
        taps /= taps.sum(axis=0)
        return np.asarray(taps @ h @ taps.T)

    @cached_property
    def _images(self) -> list[Array]:
        """Base and components, support and tail, (K, K) each."""
        return [extended(p, self.field.k) for p in (self.field.base, *self.field.components)]

    @cached_property
    def _kernels(self) -> list[Array]:
        return [self.kernel(image) for image in self._images]

    def _maps(self, shape: tuple[int, ...]) -> tuple[Array, Array]:
        """Reciprocal of the PSF's sum at every position (rows, columns), and its coefficients (r, rows, columns);
        cached for the last shape."""
        kept: dict[tuple[int, ...], tuple[Array, Array]] = self.__dict__.setdefault("_kept", {})
        if shape not in kept:
            kept.clear()
            rows, columns = shape
            y, x = np.divmod(np.arange(rows * columns), columns)
            points = np.column_stack([x, y]) / self.samples_per_px
            parts = [self.field.coefficients(points[i : i + CHUNK]) for i in range(0, len(points), CHUNK)]
            coefficients = np.concatenate(parts).T.reshape(-1, rows, columns)
            sums = np.array([image.sum() for image in self._images])
            kept[shape] = 1 / (sums[0] + np.tensordot(sums[1:], coefficients, axes=1)), coefficients
        return kept[shape]


def _convolved(image: Array, kernel: Array) -> Array:
    from scipy.signal import oaconvolve  # here: slow to load

    return np.asarray(oaconvolve(image, kernel, mode="same"))
