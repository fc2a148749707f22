"""Joint vector and covariance of a camera's parts.

The noise of a chart's samples propagates to all numbers derived from that chart. With S the covariance of a chart's PSF
and centre in a plane, two parts have the covariance

    Cov(a, b) = sum over charts of (da / dchart) S (db / dchart)',

and the geometry, which derives from the chart's bins, not from PSF and centre, has Cov(a, chart) (db / dchart)'.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ChartKey = tuple[str, str, int]  # plane, photograph and number of a chart in it

COMPUTED, ZERO = "computed", "zero"
ROUNDING = 1e-12  # eigenvalues below this, relative to the largest, are 0


@dataclass(frozen=True, eq=False)
class CameraPart:
    """Numbers of one estimate.

    name : str
    names, units : tuple of str
    values : (m,) float64
    covariance : (m, m) float64
    origin : the photographs used
    by_charts : mapping of ChartKey to (m, P + 2)
        Derivatives by the P parameters of a chart's PSF and by the position (x, y) of its centre in the plane.
    with_charts : mapping of ChartKey to (m, P + 2)
        Covariance with these, for numbers derived otherwise from the same samples.
    independent_of : names of parts from other photographs used in this estimate, and why their covariance is zero
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    origin: str
    by_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    with_charts: Mapping[ChartKey, Array] = field(default_factory=dict)
    independent_of: Mapping[str, str] = field(default_factory=dict)

    @property
    def charts(self) -> set[ChartKey]:
        """The charts used."""
        return set(self.by_charts) | set(self.with_charts)


@dataclass(frozen=True)
class CovarianceBlock:
    """Covariance of two parts: `how` is "computed" or "zero", `why` its source or reason."""

    first: str
    second: str
    how: str
    why: str


@dataclass(frozen=True, eq=False)
class JointNumbers:
    """All numbers of all parts.

    parts : tuple of CameraPart
    covariance : (n, n), of the concatenated values of the parts; symmetric, positive semidefinite within rounding
    blocks : one for each pair of parts
    """

    parts: tuple[CameraPart, ...]
    covariance: Array
    blocks: tuple[CovarianceBlock, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers: part, a dot, the name in it."""
        return tuple(f"{part.name}.{name}" for part in self.parts for name in part.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers."""
        return tuple(unit for part in self.parts for unit in part.units)

    @property
    def values(self) -> Array:
        """The numbers (n,)."""
        return np.concatenate([part.values for part in self.parts]) if self.parts else np.zeros(0)

    def block(self, first: str, second: str) -> Array:
        """Covariance of two parts. Raises KeyError for an unknown part."""
        return self.covariance[self._places(first), self._places(second)]

    def _places(self, name: str) -> slice:
        start = 0
        for part in self.parts:
            if part.name == name:
                return slice(start, start + len(part.values))
            start += len(part.values)
        raise KeyError(name)


def join(parts: Sequence[CameraPart], charts: Mapping[ChartKey, Array]) -> JointNumbers:
    """Joint numbers of the parts.

    charts : mapping of ChartKey to (P + 2, P + 2); covariance of every chart's PSF and centre
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
            blocks.append(_block(b, a, computed=shared is not None))
    return JointNumbers(tuple(parts), _positive((covariance + covariance.T) / 2), tuple(blocks))


def _shared(a: CameraPart, b: CameraPart, charts: Mapping[ChartKey, Array]) -> Array | None:
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


def _block(a: CameraPart, b: CameraPart, *, computed: bool) -> CovarianceBlock:
    if computed:
        return CovarianceBlock(
            a.name, b.name, COMPUTED, f"from the samples of {len(a.charts & b.charts)} charts in both"
        )
    if why := a.independent_of.get(b.name) or b.independent_of.get(a.name):
        return CovarianceBlock(a.name, b.name, ZERO, why)
    if a.origin != b.origin:
        return CovarianceBlock(a.name, b.name, ZERO, f"other photographs: {a.origin}, and {b.origin}")
    return CovarianceBlock(a.name, b.name, ZERO, "other photosites: the noise of different planes is independent")


def _positive(covariance: Array) -> Array:
    """The covariance without negative eigenvalues, which separate linearisations may cause, with the same variances."""
    spread = np.sqrt(np.diag(covariance))
    scale = np.where(spread > 0, spread, 1.0)
    correlation = covariance / np.outer(scale, scale)
    with contextlib.suppress(np.linalg.LinAlgError):  # usually definite: a tenth of the time of the eigenvalues
        np.linalg.cholesky(correlation + ROUNDING * np.eye(len(scale)))
        return covariance
    values, vectors = np.linalg.eigh(correlation)
    if not len(values) or values[0] >= -ROUNDING * values[-1]:
        return covariance
    lifted = (vectors * np.maximum(values, 0)) @ vectors.T
    again = scale * np.sqrt(np.diag(covariance) / scale**2 / np.maximum(np.diag(lifted), ROUNDING))
    lifted = lifted * np.outer(again, again)
    return np.asarray((lifted + lifted.T) / 2)
