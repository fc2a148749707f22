"""The PSF over the whole frame: measured at nodes, told with its error anywhere, applied to images.

Every parameter of the PSF, a sample of its support or an amplitude of its tail, is a smooth function of the place.
What varies is described by a few components, A a(x), found from the nodes' PSFs z_i; a model predicts their
coefficients from those of the nodes, B z_i, and the rest is the mean:

    h(x) = Q z + A (o + sum_i T_i(x) (B z_i - o)),    P = A B,  Q = I - P,  z = sum_i m_i z_i

It is linear in the nodes' PSFs, so their covariances give that of h(x). How far the model itself may be off is drawn
from the nodes left out of a fit (`procedures.field.interpolate`), and added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import DIFFERS, LEAST_TAIL, tail_kernels, tail_sums
from procedures.numerics.scattered import Hull
from procedures.psf import Psf

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Node:
    """One measured PSF and where in the frame it was measured.

    Attributes
    ----------
    position : (2,) float64
        (x, y) in pixels of the plane where the PSF's centre lies.
    position_covariance : (2, 2) float64
        Of that, in squared pixels of the plane.
    sensor_position : (2,) float64
        The same place in pixels of the sensor.
    source : str
        The photograph it comes from.
    number : int
        Of the chart in that photograph: the planes' nodes of one chart have the same source and number.
    doubt, remedy : str
        Why its PSF is doubtful, and what to do; empty where it is not, and of a field that was read from a file.
    """

    position: Array
    position_covariance: Array
    sensor_position: Array
    psf: Psf
    source: str = ""
    number: int = 0
    doubt: str = ""
    remedy: str = ""


class CoefficientModel(Protocol):
    """Predicts r coefficients at points from those of N nodes, linearly; points are in half diagonals."""

    @property
    def name(self) -> str:
        """What it is, for people."""
        ...

    def predict(self, points: Array, values: Array) -> Array:
        """Coefficients (n, r) at points (n, 2), from the nodes' (N, r)."""
        ...

    def transfer(self, points: Array, r: int) -> Array:
        """The same as weights (n, r, N, r)."""
        ...

    @property
    def reach(self) -> float:
        """How far beyond that the PSF may be told to go on changing as it did on the way there, in half diagonals."""
        ...

    def carried(self, held: Array, points: Array) -> Array:
        """How far the model holds on the way from `held`, where the nodes end, to points (n, 2) beyond; (n, 2)."""
        ...


@dataclass(frozen=True, eq=False)
class PsfField:
    """The PSF of one plane as a function of the place in its frame; h, A, B and so on as above.

    A vector of a PSF is its `parameters`: k^2 samples and q amplitudes of the tail, p = k^2 + q numbers in all.

    Attributes
    ----------
    plane : str
    shape : (int, int)
        Rows and columns of the plane.
    nodes : tuple of Node
    share : (N,) float64
        What each node counts in the mean, m; of sum 1.
    components : (r, p) float64, analysis : (r, p) float64
        A^T and B.
    origin : (r,) float64
        The coefficients o that the model's predictions are about.
    model : CoefficientModel
    lack : (r, r) float64
        Variance of what the model leaves out of the coefficients.
    lack_rest : (p, p) float64
        Variance of what varies over the frame and is in none of the components.
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
        """Amplitudes of the tail; 0 where the nodes' PSFs end with their supports."""
        return len(self.nodes[0].psf.tail.amplitudes)

    @cached_property
    def positions(self) -> Array:
        """Where the nodes lie, (N, 2), in pixels of the plane."""
        return np.array([node.position for node in self.nodes])

    @cached_property
    def hull(self) -> Hull:
        """What the nodes enclose: beyond it the PSF is that of the nearest place that they tell of."""
        return Hull(self.positions)

    @cached_property
    def base(self) -> Array:
        """What does not vary, Q z, (p,)."""
        mean = self.share @ self._measured
        return np.asarray(mean - (self.analysis @ mean) @ self.components)

    @cached_property
    def coefficients_at_nodes(self) -> Array:
        """B z_i, (N, r)."""
        return np.asarray(self._measured @ self.analysis.T)

    def inside(self, points: Array) -> npt.NDArray[np.bool_]:
        """Which points (n, 2) of the plane the nodes enclose."""
        return self.hull.holds(np.asarray(points, dtype=np.float64))

    def coefficients(self, points: Array) -> Array:
        """What the components are multiplied by at points (n, 2) of the plane, (n, r)."""
        values = self.coefficients_at_nodes - self.origin
        placed, before = self._placed(points)
        found = self.model.predict(placed, values)
        beyond = np.flatnonzero(np.any(placed != before, axis=1))
        if len(beyond):
            found[beyond] += found[beyond] - self.model.predict(before[beyond], values)
        return np.asarray(found + self.origin)

    def parameters(self, points: Array) -> Array:
        """The PSFs' parameters at points (n, 2) of the plane, (n, p)."""
        return np.asarray(self.base + self.coefficients(points) @ self.components)

    def samples(self, points: Array) -> Array:
        """The supports of the PSFs at points (n, 2) of the plane, (n, k, k), each of sum 1."""
        return self.parameters(points)[:, : self.k**2].reshape(-1, self.k, self.k)

    def energy_outside(self, points: Array) -> Array:
        """Share of the light outside the PSFs' supports at points (n, 2) of the plane, (n,)."""
        outside = self.parameters(points)[:, self.k**2 :] @ tail_sums(self.k)[: self.q]
        return np.asarray(outside / (1 + outside))

    def at(self, x: float, y: float) -> Psf:
        """The whole PSF at a place of the plane, with the covariance of its error: noise and interpolation.

        Beyond the nodes (`inside`) it is that of the nearest place that they tell of, with a larger error; where a lens
        is known to be symmetric it changes on from there as much as on as short a way before.
        """
        p = self.parameters(np.array([[x, y]], dtype=np.float64))[0]
        noise, lacking = self.covariances(x, y)
        return Psf.of(p, noise + lacking, self.k, self.s, lacking)

    def covariances(self, x: float, y: float) -> tuple[Array, Array]:
        """`noise` and `interpolation` at a place, (p, p) each."""
        T, beyond = self._transfer(x, y), self._beyond(x, y)
        return self._noise(T), self._interpolation(T, beyond)

    def noise(self, x: float, y: float) -> Array:
        """Covariance (p, p) of h(x, y) that comes from the nodes' own.

        What the tail's priors leave is the same at every node: as many nodes as there are do not make it smaller.
        """
        return self._noise(self._transfer(x, y))

    def _noise(self, T: Array) -> Array:
        rest, cross, inner = self._covariances
        by_node = T.transpose(1, 0, 2)
        coefficients = np.sum(by_node @ inner @ by_node.transpose(0, 2, 1), axis=0)
        # A'cA + mixed + mixed' as one product and its mirror image
        half = (cross @ T.reshape(len(T), -1).T + self.components.T @ (coefficients / 2)) @ self.components
        return np.asarray(rest + (half + half.T))

    def interpolation(self, x: float, y: float) -> Array:
        """Covariance (p, p) of what the model leaves out.

        It is taken for random from node to node: with variance there, and as much as the nodes' share of it brings.
        Where the nodes tell nothing, as much may be wrong as the PSF changed on as long a way before.
        """
        return self._interpolation(self._transfer(x, y), self._beyond(x, y))

    def _interpolation(self, T: Array, beyond: Array) -> Array:
        random = (1 + float(np.sum(T**2)) / len(T)) * self._lack_of_components + self.lack_rest
        change = beyond @ self.components
        return np.asarray(random + np.outer(change, change) if change.any() else random)

    def _beyond(self, x: float, y: float) -> Array:
        """Change of the coefficients (r,) on the way to the farthest place that the nodes tell of, as long as from
        there to this one."""
        placed, _ = self._placed(np.array([[x, y]], dtype=np.float64))
        wanted = in_half_diagonals(np.array([[x, y]]), self.shape)
        if np.array_equal(placed, wanted):
            return np.zeros(len(self.components))
        before = 2 * placed - wanted
        values = self.coefficients_at_nodes - self.origin
        return np.asarray(self.model.predict(placed, values)[0] - self.model.predict(before, values)[0])

    def error(self, points: Array) -> tuple[Array, Array]:
        """Norms (n,) of the errors predicted at points (n, 2): of the noise, and of the interpolation."""
        noise = [self.norm_of_error(self.noise(x, y)) for x, y in points]
        lack = [self.norm_of_error(self.interpolation(x, y)) for x, y in points]
        return np.array(noise), np.array(lack)

    def norm_of_error(self, covariance: Array) -> float:
        """Root mean square of the norm over support and tail of an error with that covariance (p, p)."""
        n = self.k**2
        of_tail = float(np.sum(covariance[n:, n:] * self._tail_products)) if self.q else 0.0
        return float(np.sqrt(max(np.trace(covariance[:n, :n]) + of_tail, 0.0)))

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
        """sum m^2 Q C Q^T (p, p); m_i Q C_i B^T side by side (p, N r); B C_i B^T (N, r, r); all without what is common
        to the nodes, whose mean is added to the first."""
        n, (r, size) = len(self.nodes), self.components.shape
        rest, cross, inner = np.zeros((size, size)), np.zeros((n, size, r)), np.zeros((n, r, r))
        common = np.zeros((size, size))
        A, B = self.components.T, self.analysis
        for i, (node, m) in enumerate(zip(self.nodes, self.share, strict=True)):
            of_priors = held_by_priors(node.psf)
            common += m * of_priors
            C = node.psf.parameter_covariance - of_priors
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
        placed, before = self._placed(point)
        T = self.model.transfer(placed, len(self.components))[0]
        if np.any(placed != before):
            T = 2 * T - self.model.transfer(before, len(self.components))[0]
        return np.asarray(T)

    def _placed(self, points: Array) -> tuple[Array, Array]:
        """Points of the plane as the model takes them, for those beyond the nodes as far out as it holds; and as far
        before these as it goes on beyond them; (n, 2) each."""
        points = np.asarray(points, dtype=np.float64)
        wanted, held = (in_half_diagonals(some, self.shape) for some in (points, self.hull.nearest(points)))
        placed = self.model.carried(held, wanted)
        way = wanted - placed
        length = np.linalg.norm(way, axis=1, keepdims=True)
        return placed, placed - way * np.minimum(self.model.reach / np.maximum(length, 1e-12), 1.0)


def held_by_priors(psf: Psf) -> Array:
    """The part of a PSF's covariance (p, p) that the priors of its tail's shapes leave, not noise: C L C.

    C is the covariance, the inverse of the samples' information F and the priors' L together: noise alone makes C F C.
    """
    root, most = _root_of_priors(psf)
    return np.asarray(root @ root.T) / most


def moved_by_priors(psf: Psf) -> Array:
    """How a PSF's parameters (p, q - 1) follow what its tail's shapes are off by, in standard deviations of the priors.

    A lens is off by about the same at every place: the product of two places' is what their errors have in common.
    """
    root, most = _root_of_priors(psf)
    return np.asarray(root / np.sqrt(most))


def _root_of_priors(psf: Psf) -> tuple[Array, float]:
    """A root (p, q - 1) of C L C, and the factor over which its square is taken."""
    C, n, q = psf.parameter_covariance, psf.k**2, len(psf.tail.amplitudes)
    if q < 2:
        return np.zeros((len(C), 0)), 1.0
    expected = DIFFERS[: q - 1] * max(abs(float(psf.tail.amplitudes[0])), LEAST_TAIL)
    root = C[:, n + 1 :] / expected
    # as shares of what was expected the shapes' variances are 1 at the most, but for what residuals widen C by
    return root, max(float(np.linalg.eigvalsh(root[n + 1 :] / expected[:, None])[-1]), 1.0)


def in_half_diagonals(points: Array, shape: tuple[int, int]) -> Array:
    """Points (n, 2) of a plane of that shape, from the frame's centre in half its diagonal."""
    rows, columns = shape
    return np.asarray((points - np.array([columns - 1, rows - 1]) / 2) / (np.hypot(rows, columns) / 2))
