"""How the coefficients of a PSF field may depend on the place: each for itself, or all by the lens's symmetry."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.optimize import minimize

from procedures.numerics.kernel_tail import SHAPES
from procedures.numerics.scattered import Smoother

Array = npt.NDArray[np.float64]

RING = 1.3
"""Samples from one to the next of the functions of the distance from the PSF's centre that each harmonic is made of:
closer ones the samples do not tell apart."""
RIDGE = 1e-5
"""One over the variance that a ring's amplitude is expected to have, in units of the noise: what the components hardly
show of a ring is not blown up."""
ROUNDED = 1e-12
"""The same over the sum of what the nodes tell: less is lost in rounding, where places and rings differ very much."""
FARTHEST_CENTRE = 0.7
"""A lens's axis is looked for this far from the frame's centre, in half diagonals."""
FURTHER = 0.25
"""Half diagonals beyond its nodes over which a symmetric lens is told to change on as on as long a way before: from the
usual tour's charts to the frame's corners."""
OUTERMOST = 4
"""Nodes that must lie as far from the axis as a place beyond all of them for which a symmetric lens is believed."""


@dataclass(frozen=True, eq=False)
class Separate:
    """Every coefficient by the same smoother."""

    name: str
    smoother: Smoother

    def predict(self, points: Array, values: Array) -> Array:
        """(n, r)."""
        return np.asarray(self.smoother.weights(points) @ values)

    def transfer(self, points: Array, r: int) -> Array:
        """(n, r, N, r)."""
        return np.asarray(np.einsum("ni,ab->naib", self.smoother.weights(points), np.eye(r)))

    @property
    def reach(self) -> float:
        """None."""
        return 0.0

    def carried(self, held: Array, points: Array) -> Array:
        """(n, 2): a surface tells nothing beyond its nodes."""
        return held


@dataclass(frozen=True, eq=False)
class Optic:
    """What the symmetric model must know of the components.

    Attributes
    ----------
    analysis, components : (r, p) float64
        As in `PsfField`.
    whiten : (p, p) float64
        From a PSF's parameters to units of their noise.
    norms : dict of int to (rings,) float64
        Of each harmonic's rings in these units, as they become known: whoever has several of one noise shares them.
    """

    analysis: Array
    components: Array
    whiten: Array
    k: int
    norms: dict[int, Array] = field(default_factory=dict)

    @cached_property
    def even(self) -> Array:
        """(r, r): a combination of components, made symmetric about its centre, analysed again."""
        both = (self.components + mirrored(self.components, self.k)) / 2
        return np.asarray(self.analysis @ both.T)

    def harmonics(self, m: int) -> tuple[Array, Array]:
        """Rings and tail times cos(m theta), and times sin(m theta), analysed: (r, rings) each, or one or two more."""
        kept: dict[int, tuple[Array, Array]] = self.__dict__.setdefault("_kept", {})
        if m not in kept:
            cos, sin = _waves(m, self.k, self.analysis.shape[1] - self.k**2)
            if m not in self.norms:
                size = np.linalg.norm(self.whiten @ cos, axis=0)
                self.norms[m] = np.where(size > 0, size, 1.0)  # a ring of few samples holds no wave of many periods
            size = self.norms[m]
            kept[m] = self.analysis @ (cos / size), self.analysis @ (sin / size)
        return kept[m]


def mirrored(parameters: Array, k: int) -> Array:
    """Parameters (..., p) of PSFs that are turned by half a turn: every shape of the tail is symmetric so."""
    n = k * k
    return np.concatenate([parameters[..., :n][..., ::-1], parameters[..., n:]], axis=-1)


@lru_cache(maxsize=64)
def _waves(m: int, k: int, q: int) -> tuple[Array, Array]:
    """Rings and tail times cos(m theta), and times sin(m theta), of PSFs of k * k samples and q amplitudes."""
    v, u = np.mgrid[:k, :k] - k // 2
    rho, theta = np.hypot(u, v).ravel(), np.arctan2(v, u).ravel()
    rings = _rings(rho, 1.001 * rho.max()) * ((rho > 0) | (m == 0))[:, None]
    cos, sin = (rings * f(m * theta)[:, None] for f in (np.cos, np.sin))
    return block_diag(cos, _tail_harmonic(m, q, "cos")), block_diag(sin, _tail_harmonic(m, q, "sin"))


def _tail_harmonic(m: int, q: int, wave: str) -> Array:
    """The amplitudes (q, 0 to 2) of the tail's shapes that vary as cos or sin of m times the direction; the sine of 0
    times it is zero, as many columns as its cosine has."""
    names = SHAPES[:q]
    cos = [j for j, name in enumerate(names) if name == f"cos {m}" or (m == 0 and name.startswith("1/"))]
    found = np.zeros((q, len(cos)))
    for column, j in enumerate(cos):
        at = j if wave == "cos" else names.index(f"sin {m}") if f"sin {m}" in names else None
        if at is not None:
            found[at, column] = 1
    return found


def _rings(rho: Array, end: float) -> Array:
    """Cubic B-splines over [0, end], (n, rings)."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, end, max(round(end / RING), 1) + 1), np.full(3, end)])
    return np.asarray(BSpline.design_matrix(rho, knots, 3).toarray())


@dataclass(frozen=True, eq=False)
class AxialSymmetry:
    """A lens that is symmetric about an axis: every PSF turns with the direction to where the axis meets the frame.

    h(x; s) = b(s) + sum over j <= degree and m = j, j - 2, ... >= 0 of r^j f_jm(|s|) cos(m (angle of s - angle of x)),
    r and the angle of x about the axis: the smooth functions with the symmetry of equation (4.20). b, the PSF on the
    axis, is free but for b(-s) = b(s): it holds what turns with the sensor and not with the lens (photosites, low-pass
    filter).

    Attributes
    ----------
    places : (N, 2) float64, trust : (N,) float64
        As in `numerics.scattered`.
    axis : (x, y)
        Where the axis meets the frame, as the places.

    References
    ----------
    Sorel's thesis, 2007, section 4.4, equation (4.20).
    """

    places: Array
    trust: Array
    optic: Optic
    degree: int
    axis: tuple[float, float]

    @property
    def name(self) -> str:
        """With degree and axis."""
        return f"symmetric lens, degree {self.degree}"

    def predict(self, points: Array, values: Array) -> Array:
        """(n, r)."""
        D, weight, factor = self._normal
        return np.asarray(self.design(points) @ cho_solve(factor, D.T @ (weight * values.ravel())))

    def parts(self, values: Array) -> Array:
        """Coefficients (n, r) of what its PSFs are sums of at all places, for values (N, r) at the nodes.

        First b, then each term times cos m and sin m of the place's angle, at the farthest node.
        """
        D, weight, factor = self._normal
        solved = cho_solve(factor, D.T @ (weight * values.ravel()))
        farthest = float(np.hypot(*(self.places - np.array(self.axis)).T).max())
        first = values.shape[1]
        found = [self.optic.even @ solved[:first]]
        for j, m in self._terms:
            waves = self.optic.harmonics(m)
            last = first + waves[0].shape[1]
            found += [farthest**j * wave @ solved[first:last] for wave in (waves if m else waves[:1])]
            first = last
        return np.array(found)

    @property
    def _terms(self) -> list[tuple[int, int]]:
        """Powers j of the distance, and m of the waves that go with it."""
        return [(j, m) for j in range(1, self.degree + 1) for m in range(j, -1, -2)]

    def transfer(self, points: Array, r: int) -> Array:
        """(n, r, N, r)."""
        D, weight, factor = self._normal
        design = self.design(points)
        solved = cho_solve(factor, design.reshape(-1, design.shape[2]).T).T
        return np.asarray((solved @ (D.T * weight)).reshape(len(points), r, -1, r))

    @property
    def reach(self) -> float:
        """Some of the frame's rim."""
        return FURTHER

    def carried(self, held: Array, points: Array) -> Array:
        """(n, 2): to all sides as far from the axis as nodes lie to some."""
        start, way = held - np.array(self.axis), points - held
        far = np.sort(np.hypot(*(self.places - np.array(self.axis)).T))[-min(OUTERMOST, len(self.places))]
        # the share t of the way at which |start + t way| = far
        a, b = np.sum(way**2, axis=1), np.sum(start * way, axis=1)
        short = np.maximum(far**2 - np.sum(start**2, axis=1), 0.0)
        t = (np.sqrt(b**2 + a * short) - b) / np.maximum(a, 1e-12)
        return np.asarray(held + np.clip(t, 0.0, 1.0)[:, None] * way)

    def design(self, points: Array) -> Array:
        """What each unknown adds to the coefficients at points (n, 2): (n, r, unknowns)."""
        offset = np.asarray(points) - np.array(self.axis)
        radius, angle = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
        turned = {m: self._turned(m, angle) for m in {m for _, m in self._terms}}
        blocks = [np.broadcast_to(self.optic.even, (len(offset), *self.optic.even.shape))]
        blocks += [(radius**j)[:, None, None] * turned[m] for j, m in self._terms]
        return np.concatenate(blocks, axis=2)

    def _turned(self, m: int, angle: Array) -> Array:
        """The rings' harmonics m turned by angles (n,): (n, r, rings)."""
        cos, sin = self.optic.harmonics(m)
        return np.asarray(np.cos(m * angle)[:, None, None] * cos + np.sin(m * angle)[:, None, None] * sin)

    @cached_property
    def _normal(self) -> tuple[Array, Array, tuple[Array, bool]]:
        """The nodes' design (N r, unknowns), the weight of its rows, and the normal equations factorised."""
        design = self.design(self.places)
        D = design.reshape(-1, design.shape[2])
        weight = np.repeat(self.trust, design.shape[1])
        normal = D.T @ (weight[:, None] * D)
        normal[np.diag_indices_from(normal)] += RIDGE + ROUNDED * np.trace(normal)
        return D, weight, cho_factor(normal)

    def residual(self, values: Array) -> Array:
        """What is left of the nodes' coefficients (N, r), in standard deviations, (N r,)."""
        D, weight, factor = self._normal
        left = values.ravel() - D @ cho_solve(factor, D.T @ (weight * values.ravel()))
        return np.asarray(np.sqrt(weight) * left)


@dataclass(frozen=True)
class SymmetryAxis:
    """Where a lens's axis of symmetry meets the frame, in half diagonals from its centre, and the covariance."""

    position: Array
    covariance: Array


def fit_axis(
    places: Array, trust: Array, optic: Optic, degree: int, values: Array, start: tuple[float, float] | None = None
) -> SymmetryAxis:
    """The axis about which the nodes' coefficients (N, r) are most symmetric; `trust` is one over their variance.

    It is looked for near a start, or all over the frame.
    """

    def residual(axis: Array) -> Array:
        return AxialSymmetry(places, trust, optic, degree, (float(axis[0]), float(axis[1]))).residual(values)

    def badness(axis: Array) -> float:
        beyond = max(float(np.hypot(*axis)) - FARTHEST_CENTRE, 0.0)
        return float(np.sum(residual(axis) ** 2)) * (1 + beyond)

    step, start = (0.15, (0.0, 0.0)) if start is None else (0.02, start)
    simplex = np.array(start) + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-2, "maxfev": 80}
    best = np.asarray(minimize(badness, simplex[0], method="Nelder-Mead", options=options).x)
    step = 0.01
    J = np.stack([(residual(best + d) - residual(best - d)) / (2 * step) for d in np.eye(2) * step], axis=1)
    left = residual(best)
    excess = max(float(left @ left) / max(len(left) - _unknowns(optic, degree), 1), 1.0)
    return SymmetryAxis(best, np.asarray(excess * np.linalg.inv(J.T @ J + 1e-9 * np.eye(2)), dtype=np.float64))


def _unknowns(optic: Optic, degree: int) -> int:
    """Numbers that the nodes determine: no harmonic can have more than there are components."""
    r = len(optic.analysis)
    columns = (optic.harmonics(m)[0].shape[1] for j in range(1, degree + 1) for m in range(j, -1, -2))
    return int(r + sum(min(r, n) for n in columns) // 2)
