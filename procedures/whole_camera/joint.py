"""Parts of a camera put together: one vector of numbers, one covariance, and for every pair of parts what they share.

The noise of a chart's samples reaches everything that was drawn from that chart, each through its own derivative. So
two parts share, with S the covariance of a chart's PSF and centre in a plane,

    Cov(a, b) = sum over charts of (da / dchart) S (db / dchart)',

and the geometry, which comes of the chart's bins and not of PSF and centre, Cov(a, chart) (db / dchart)'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ChartKey = tuple[str, str, int]
"""Plane, photograph and number of a chart in it."""

COMPUTED, ZERO = "computed", "zero"
ROUNDING = 1e-12
"""Of the largest eigenvalue: below it one is 0."""


@dataclass(frozen=True, eq=False)
class Part:
    """Numbers that belong together.

    Attributes
    ----------
    name : str
    names, units : tuple of str
    values : (m,) float64
    covariance : (m, m) float64
    origin : str
        The photographs that it comes of.
    by_charts : mapping of ChartKey to (m, P + 2)
        Derivative by the P parameters of a chart's PSF and by the place (x, y) of its centre in the plane.
    with_charts : mapping of ChartKey to (m, P + 2)
        Covariance with the same, of numbers that come of something else in the same samples.
    rests_on : mapping of str to str
        By the name of another part of other photographs that this one was estimated with: why nothing is shared.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    origin: str
    by_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    with_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    rests_on: Mapping[str, str] = field(default_factory=dict)

    @property
    def charts(self) -> set[ChartKey]:
        """The charts that it comes of."""
        return set(self.by_charts) | set(self.with_charts)


@dataclass(frozen=True)
class Block:
    """What two parts share: `how` is "computed" or "zero", `why` says from what, or for what reason."""

    first: str
    second: str
    how: str
    why: str


@dataclass(frozen=True, eq=False)
class JointNumbers:
    """All numbers of all parts.

    Attributes
    ----------
    parts : tuple of Part
    covariance : (n, n) float64
        Of the parts' values one after the other; symmetric, no eigenvalue below 0 but for rounding.
    blocks : tuple of Block
        One for each pair of parts.
    """

    parts: tuple[Part, ...]
    covariance: Array
    blocks: tuple[Block, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers: part, a dot, the name in it."""
        return tuple(f"{part.name}.{name}" for part in self.parts for name in part.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the numbers."""
        return tuple(unit for part in self.parts for unit in part.units)

    @property
    def values(self) -> Array:
        """The numbers (n,)."""
        return np.concatenate([part.values for part in self.parts]) if self.parts else np.zeros(0)

    def block(self, first: str, second: str) -> Array:
        """Covariance of two parts' numbers. Raises KeyError where there is no such part."""
        return self.covariance[self._places(first), self._places(second)]

    def _places(self, name: str) -> slice:
        start = 0
        for part in self.parts:
            if part.name == name:
                return slice(start, start + len(part.values))
            start += len(part.values)
        raise KeyError(name)


def join(parts: Sequence[Part], charts: Mapping[ChartKey, Array]) -> JointNumbers:
    """The parts with what they share.

    Parameters
    ----------
    charts : mapping of ChartKey to (P + 2, P + 2)
        Covariance of every chart's PSF and centre.
    """
    ends = np.cumsum([0, *(len(part.values) for part in parts)])
    covariance, blocks = np.zeros((ends[-1], ends[-1])), []
    for i, a in enumerate(parts):
        own = slice(ends[i], ends[i + 1])
        covariance[own, own] = a.covariance
        for j, b in enumerate(parts[:i]):
            other, shared = slice(ends[j], ends[j + 1]), _shared(a, b, charts)
            if shared is not None:
                covariance[own, other], covariance[other, own] = shared, shared.T
            blocks.append(_block(b, a, found=shared is not None))
    return JointNumbers(tuple(parts), _positive((covariance + covariance.T) / 2), tuple(blocks))


def _shared(a: Part, b: Part, charts: Mapping[ChartKey, Array]) -> Array | None:
    """Covariance of two parts; None where they have no chart in common."""
    if not a.charts & b.charts:
        return None
    shared = np.zeros((len(a.values), len(b.values)))
    for key in sorted(a.charts & b.charts):
        if key in a.by_charts and key in b.by_charts:
            shared += a.by_charts[key] @ charts[key] @ b.by_charts[key].T
        elif key in b.by_charts:
            shared += a.with_charts[key] @ b.by_charts[key].T
        elif key in a.by_charts:
            shared += a.by_charts[key] @ b.with_charts[key].T
    return shared


def _block(a: Part, b: Part, *, found: bool) -> Block:
    if found:
        return Block(a.name, b.name, COMPUTED, f"from the samples of {len(a.charts & b.charts)} charts in both")
    if why := a.rests_on.get(b.name) or b.rests_on.get(a.name):
        return Block(a.name, b.name, ZERO, why)
    if a.origin != b.origin:
        return Block(a.name, b.name, ZERO, f"other photographs: {a.origin}, and {b.origin}")
    return Block(a.name, b.name, ZERO, "other photosites: the noise of one plane's samples is not that of another's")


def _has_factor(matrix: Array) -> bool:
    """Whether a symmetric matrix has a Cholesky factor: no eigenvalue is below 0."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _positive(covariance: Array) -> Array:
    """The covariance without eigenvalues below 0, which blocks that were linearised apart may leave; mostly itself."""
    spread = np.sqrt(np.diag(covariance))
    scale = np.where(spread > 0, spread, 1.0)
    if _has_factor(covariance / np.outer(scale, scale) + ROUNDING * np.eye(len(scale))):
        return covariance  # as nearly always: a tenth of the work that the eigenvalues take
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    if not len(values) or values[0] >= -ROUNDING * values[-1]:
        return covariance
    lifted = (vectors * np.maximum(values, 0)) @ vectors.T
    again = scale * np.sqrt(np.diag(covariance) / scale**2 / np.maximum(np.diag(lifted), ROUNDING))
    lifted = lifted * np.outer(again, again)
    return np.asarray((lifted + lifted.T) / 2)
