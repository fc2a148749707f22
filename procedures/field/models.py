"""Models of the coefficients of a PSF field: separate smooth functions, or all coupled by the lens's symmetry."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.optimize import minimize

from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import SHAPES
from procedures.numerics.scattered import Smoother

RING_SPACING = 1.3  # samples between the radial functions of each harmonic: closer ones are not resolved by the samples
RIDGE = 1e-5
"""Inverse prior variance of a ring's amplitude, in units of the noise: limits rings that the components hardly
contain."""
ROUNDING_RIDGE = 1e-12
"""Weight relative to the trace of the normal equations; bounds rounding if positions and rings differ greatly."""
FARTHEST_CENTRE = 0.7  # the axis is searched for within this distance of the frame's centre, in half diagonals
EXTRAPOLATION = 0.25
"""Half diagonals beyond its nodes over which the change of a symmetric lens is extrapolated linearly: from the usual
tour's charts to the frame's corners."""
OUTERMOST = 4  # A symmetric lens is trusted up to the distance from its axis that this many nodes reach


@dataclass(frozen=True, eq=False)
class Separate:
    """Every coefficient by the same smoother; constant outside the nodes."""

    name: str
    smoother: Smoother
    reach: float = 0.0

    def predict(self, points: Array, values: Array) -> Array:
        return np.asarray(self.smoother.weights(points) @ values)

    def transfer(self, points: Array, r: int) -> Array:
        return np.asarray(np.einsum("ni,ab->naib", self.smoother.weights(points), np.eye(r)))

    def carried(self, held: Array, points: Array) -> Array:
        """(n, 2): a surface is not extrapolated."""
        return held


@dataclass(frozen=True, eq=False)
class Optic:
    """The components as required by the symmetric model.

    analysis, components : (r, p), as in `PsfField`
    whiten : (p, p), from a PSF's parameters to units of their noise
    norms : cache of the norms of each harmonic's rings in these units, shared by optics of one noise
    """

    analysis: Array
    components: Array
    whiten: Array
    k: int
    norms: dict[int, Array] = field(default_factory=dict)
    _harmonics: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    @cached_property
    def even(self) -> Array:
        """(r, r): a combination of components, symmetrised about its centre, and analysed again."""
        both = (self.components + mirrored(self.components, self.k)) / 2
        return np.asarray(self.analysis @ both.T)

    def harmonics(self, m: int) -> tuple[Array, Array]:
        """Rings and tail times cos(m theta), and times sin(m theta), analysed: (r, rings) each, or one or two more."""
        if m not in self._harmonics:
            cos, sin = _waves(m, self.k, self.analysis.shape[1] - self.k**2)
            if m not in self.norms:
                size = np.linalg.norm(self.whiten @ cos, axis=0)
                self.norms[m] = np.where(size > 0, size, 1.0)  # a ring of few samples holds no wave of many periods
            size = self.norms[m]
            self._harmonics[m] = self.analysis @ (cos / size), self.analysis @ (sin / size)
        return self._harmonics[m]


def mirrored(parameters: Array, k: int) -> Array:
    """Parameters (..., p) of PSFs rotated by half a turn, under which every shape of the tail is symmetric."""
    n = k * k
    return np.concatenate([parameters[..., :n][..., ::-1], parameters[..., n:]], axis=-1)


@lru_cache(maxsize=64)
def _waves(m: int, k: int, q: int) -> tuple[Array, Array]:
    """Rings and tail times cos(m theta), and times sin(m theta), of PSFs of k * k samples and q amplitudes."""
    v, u = np.mgrid[:k, :k] - k // 2
    rho, theta = np.hypot(u, v).ravel(), np.arctan2(v, u).ravel()
    end = 1.001 * rho.max()
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, end, max(round(end / RING_SPACING), 1) + 1), np.full(3, end)])
    rings = BSpline.design_matrix(rho, knots, 3).toarray() * ((rho > 0) | (m == 0))[:, None]
    cos, sin = (rings * f(m * theta)[:, None] for f in (np.cos, np.sin))
    return block_diag(cos, _tail_harmonic(m, q, "cos")), block_diag(sin, _tail_harmonic(m, q, "sin"))


def _tail_harmonic(m: int, q: int, wave: str) -> Array:
    """Amplitudes (q, 0 to 2) of the tail's shapes that vary as cos or sin of m times the direction; for m = 0 the sine
    is zero."""
    names = SHAPES[:q]
    cos = [j for j, name in enumerate(names) if name == f"cos {m}" or (m == 0 and name.startswith("1/"))]
    amplitudes = np.zeros((q, len(cos)))
    for column, j in enumerate(cos):
        at = j if wave == "cos" else names.index(f"sin {m}") if f"sin {m}" in names else None
        if at is not None:
            amplitudes[at, column] = 1
    return amplitudes


@dataclass(frozen=True, eq=False)
class AxialSymmetry:
    """A lens symmetric about an axis: its PSF rotates with the direction of the position about the axis.

    h(x; s) = b(s) + sum over j <= degree and m = j, j - 2, ... >= 0 of r^j f_jm(|s|) cos(m (angle of s - angle of x)),
    r and the angle of x about the axis: the smooth functions with the symmetry of equation (4.20). b, the PSF on the
    axis, is free except for b(-s) = b(s): it contains what is fixed to the sensor (photosites, low-pass filter).

    places : (N, 2), trust : (N,); as in `numerics.scattered`
    axis : (x, y), intersection of the axis with the frame, in the units of `places`

    Source: Sorel's thesis, 2007, section 4.4, equation (4.20).
    """

    places: Array
    trust: Array
    optic: Optic
    degree: int
    axis: tuple[float, float]
    reach: float = EXTRAPOLATION

    @property
    def name(self) -> str:
        return f"symmetric lens, degree {self.degree}"

    def predict(self, points: Array, values: Array) -> Array:
        return np.asarray(self.design(points) @ self._solved(values))

    def parts(self, values: Array) -> Array:
        """Coefficients (n, r) that span its PSFs, for values (N, r) at the nodes: b, then terms times cos m and sin m
        of the angle, at the farthest node."""
        solved = self._solved(values)
        farthest = float(np.hypot(*self._offsets(self.places).T).max())
        first = values.shape[1]
        parts = [self.optic.even @ solved[:first]]
        for j, m in self._terms:
            waves = self.optic.harmonics(m)
            last = first + waves[0].shape[1]
            parts += [farthest**j * wave @ solved[first:last] for wave in (waves if m else waves[:1])]
            first = last
        return np.array(parts)

    @property
    def _terms(self) -> list[tuple[int, int]]:
        """Powers j of the distance, and orders m of the harmonics."""
        return [(j, m) for j in range(1, self.degree + 1) for m in range(j, -1, -2)]

    def _offsets(self, points: Array) -> Array:
        return np.asarray(points - np.array(self.axis))

    def transfer(self, points: Array, r: int) -> Array:
        D, weight, factor = self._normal
        design = self.design(points)
        solved = cho_solve(factor, design.reshape(-1, design.shape[2]).T).T
        return np.asarray((solved @ (D.T * weight)).reshape(len(points), r, -1, r))

    def carried(self, held: Array, points: Array) -> Array:
        """(n, 2): in all directions to the distance from the axis that nodes reach in some."""
        start, way = self._offsets(held), points - held
        far = np.sort(np.hypot(*self._offsets(self.places).T))[-min(OUTERMOST, len(self.places))]
        # the share t of the way at which |start + t way| = far
        a, b = np.sum(way**2, axis=1), np.sum(start * way, axis=1)
        short = np.maximum(far**2 - np.sum(start**2, axis=1), 0.0)
        t = (np.sqrt(b**2 + a * short) - b) / np.maximum(a, 1e-12)
        return np.asarray(held + np.clip(t, 0.0, 1.0)[:, None] * way)

    def design(self, points: Array) -> Array:
        """Derivatives of the coefficients at points (n, 2) by the unknowns: (n, r, unknowns)."""
        offset = self._offsets(points)
        radius, angle = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
        rotated = {m: self._rotated(m, angle) for m in {m for _, m in self._terms}}
        blocks = [np.broadcast_to(self.optic.even, (len(offset), *self.optic.even.shape))]
        blocks += [(radius**j)[:, None, None] * rotated[m] for j, m in self._terms]
        return np.concatenate(blocks, axis=2)

    def _rotated(self, m: int, angle: Array) -> Array:
        """The harmonics of order m rotated by angles (n,): (n, r, rings)."""
        cos, sin = self.optic.harmonics(m)
        return np.asarray(np.cos(m * angle)[:, None, None] * cos + np.sin(m * angle)[:, None, None] * sin)

    @cached_property
    def _normal(self) -> tuple[Array, Array, tuple[Array, bool]]:
        """Design of the nodes (N r, unknowns), weights of its rows, and the factorised normal equations."""
        design = self.design(self.places)
        D = design.reshape(-1, design.shape[2])
        weight = np.repeat(self.trust, design.shape[1])
        normal = D.T @ (weight[:, None] * D)
        normal[np.diag_indices_from(normal)] += RIDGE + ROUNDING_RIDGE * np.trace(normal)
        return D, weight, cho_factor(normal)

    def _solved(self, values: Array) -> Array:
        """Least-squares unknowns from the nodes' coefficients (N, r)."""
        D, weight, factor = self._normal
        return np.asarray(cho_solve(factor, D.T @ (weight * values.ravel())))

    def residual(self, values: Array) -> Array:
        """Residuals (N r,) of the nodes' coefficients (N, r), in standard deviations."""
        D, weight, _ = self._normal
        return np.asarray(np.sqrt(weight) * (values.ravel() - D @ self._solved(values)))


@dataclass(frozen=True)
class SymmetryAxis:
    """Intersection of a lens's axis of symmetry with the frame, in half diagonals from its centre, and covariance."""

    position: Array
    covariance: Array


def fit_axis(
    places: Array, trust: Array, optic: Optic, degree: int, values: Array, start: tuple[float, float] | None = None
) -> SymmetryAxis:
    """The axis about which the nodes' coefficients (N, r) are most symmetric; the search begins near `start`, or covers
    the frame."""

    def residual(axis: Array) -> Array:
        return AxialSymmetry(places, trust, optic, degree, (float(axis[0]), float(axis[1]))).residual(values)

    def cost(axis: Array) -> float:
        beyond = max(float(np.hypot(*axis)) - FARTHEST_CENTRE, 0.0)
        return float(np.sum(residual(axis) ** 2)) * (1 + beyond)

    step, start = (0.15, (0.0, 0.0)) if start is None else (0.02, start)
    simplex = np.array(start) + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-2, "maxfev": 80}
    best = np.asarray(minimize(cost, simplex[0], method="Nelder-Mead", options=options).x)
    step = 0.01
    J = np.stack([(residual(best + d) - residual(best - d)) / (2 * step) for d in np.eye(2) * step], axis=1)
    remainder = residual(best)
    # number of determined unknowns: each harmonic contributes at most as many as there are components
    r = len(optic.analysis)
    columns = (optic.harmonics(m)[0].shape[1] for j in range(1, degree + 1) for m in range(j, -1, -2))
    unknowns = int(r + sum(min(r, n) for n in columns) // 2)
    excess = max(float(remainder @ remainder) / max(len(remainder) - unknowns, 1), 1.0)
    return SymmetryAxis(best, np.asarray(excess * np.linalg.inv(J.T @ J + 1e-9 * np.eye(2)), dtype=np.float64))
