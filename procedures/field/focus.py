"""Best focus over the frame from a bracket: the field's curvature, the sensor's tilt, and astigmatism as a distance.

At every chart the MTF at one frequency is followed through the focus positions; the top of a parabola through its
logarithm is the best focus there, sagittal and meridional apart. Tops are errors of one chart's noise alone, so a
quadratic surface through them has a plain covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyder, polyval

from procedures.field.maps import COLUMNS, FieldMap, grid, radius_direction
from procedures.field.surfaces import Surface, fit_surface
from procedures.numbers import FIELD_CURVATURE, FOCUS
from procedures.numerics.scattered import Hull
from procedures.outcome import Quantity, Refused
from procedures.psf_field import Node, in_half_diagonals
from procedures.quality import mtf_along

Array = npt.NDArray[np.float64]

FREQUENCY = 0.25
"""Cycles per pixel at which the MTF is followed."""
FEWEST_POSITIONS = 3
FEWEST_PLACES = 7
"""A quadratic surface has six coefficients."""
NEAR_TOP = 0.5
"""The parabola is laid through the positions whose MTF is at least this share of the best."""
SAME_PLACE = 0.1
"""Charts of different positions are one place when they are this near, in half diagonals."""


@dataclass(frozen=True, eq=False)
class FocusSurface:
    """Best focus over the frame, in the unit of the bracket's positions.

    Attributes
    ----------
    shape : (int, int)
    positions : (N, 2) float64
        Where it was measured, in pixels of the plane.
    best : (N, 2) float64, variance : (N, 2) float64
        Sagittal and meridional, as measured.
    surface : Surface
        Of both, over places in half diagonals; quadratic.
    """

    shape: tuple[int, int]
    positions: Array
    best: Array
    variance: Array
    surface: Surface
    unit: str

    def numbers(self) -> dict[str, Quantity]:
        """Tilt and curvature of the mean of sagittal and meridional focus, and of their difference.

        With the place (x, y) in half diagonals from the frame's centre, best focus is z + tilt . (x, y) + a quadratic;
        the curvature is the quadratic's mean over all directions, at one half diagonal.
        """
        c, C = self.surface.coefficients()
        rows: Mapping[str, tuple[Array, str]] = {
            "focus_centre": (np.array([1.0, 0, 0, 0, 0, 0]), "best focus at the frame's centre"),
            "focus_tilt_x": (np.array([0, 1.0, 0, 0, 0, 0]), "slope along x, per half diagonal"),
            "focus_tilt_y": (np.array([0, 0, 1.0, 0, 0, 0]), "slope along y, per half diagonal"),
            FIELD_CURVATURE: (np.array([0, 0, 0, 0.5, 0, 0.5]), "mean quadratic, at one half diagonal"),
        }
        numbers = {}
        for name, (row, method) in rows.items():
            error = float(np.sqrt(row @ (C[0] + C[1]) @ row) / 2)
            numbers[name] = Quantity(float(row @ c.mean(axis=1)), self.unit, error, method, len(self.best))
        row = rows[FIELD_CURVATURE][0]
        numbers["astigmatic_difference"] = Quantity(
            float(row @ (c[:, 0] - c[:, 1])),
            self.unit,
            float(np.sqrt(row @ (C[0] + C[1]) @ row)),
            "sagittal less meridional curvature, at one half diagonal",
            len(self.best),
        )
        return numbers

    def maps(self, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
        """Sagittal focus, meridional focus, their mean, and their difference."""
        x, y = grid(self.shape, columns)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = Hull(self.positions).holds(points)
        places = in_half_diagonals(points, self.shape)
        focus, covariance = self.surface.at(places), self.surface.covariance(places)
        maps = []
        for name, u in _COMBINATIONS:
            value = np.where(inside, focus @ u, np.nan).reshape(len(y), len(x))
            spread = np.where(inside, np.sqrt(np.einsum("a,nab,b->n", u, covariance, u)), np.nan)
            maps.append(FieldMap(name, name.label, self.unit, x, y, value, spread.reshape(len(y), len(x))))
        return tuple(maps)


_COMBINATIONS = (
    (FOCUS["sagittal"], np.array([1.0, 0.0])),
    (FOCUS["meridional"], np.array([0.0, 1.0])),
    (FOCUS["mean"], np.array([0.5, 0.5])),
    (FOCUS["astigmatism"], np.array([1.0, -1.0])),
)


def focus_surface(
    bracket: Mapping[float, Sequence[Node]], shape: tuple[int, int], *, unit: str = "mm", frequency: float = FREQUENCY
) -> FocusSurface:
    """Best focus from nodes at known focus positions.

    Parameters
    ----------
    bracket : mapping of focus position to nodes
        Of one plane; charts at about the same place of the frame belong together.

    Raises
    ------
    Refused
        If there are fewer than three positions, or fewer than seven places with their best focus within the bracket.
    """
    if len(bracket) < FEWEST_POSITIONS:
        raise Refused(
            f"best focus needs {FEWEST_POSITIONS} focus positions or more; there are {len(bracket)}",
            "photograph the same charts on both sides of the best focus",
        )
    found = best_focus(bracket, shape, frequency=frequency)
    positions = np.array([one.position for one in found])
    best = np.array([[top.at for top in one.tops] for one in found])
    variance = np.array([[top.variance for top in one.tops] for one in found])
    covariances = np.einsum("nm,ma->nma", variance, np.eye(2))
    surface = fit_surface(in_half_diagonals(positions, shape), best, covariances, (2,))
    return FocusSurface(shape, positions, best, variance, surface, unit)


@dataclass(frozen=True)
class Top:
    """Where the MTF along one direction is greatest.

    Attributes
    ----------
    at, variance : float
        Focus position, and the variance that the noise of the PSFs makes.
    sways : mapping of photograph to float
        How far it moves when the position of that photograph is told higher by one; their sum is 1.
    """

    at: float
    variance: float
    sways: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class PlaceFocus:
    """Best focus at one place (x, y) of the plane: of sagittal and of meridional detail."""

    position: Array
    tops: tuple[Top, Top]


def best_focus(
    bracket: Mapping[float, Sequence[Node]], shape: tuple[int, int], *, frequency: float = FREQUENCY
) -> list[PlaceFocus]:
    """Best focus at every place whose MTF has its top within the bracket.

    Raises
    ------
    Refused
        If these are fewer than seven.
    """
    found = []
    for series in _series(bracket, shape):
        x, y = np.mean([node.position for _, node in series], axis=0)
        radius = radius_direction(shape, x, y)
        sagittal, meridional = (_top(series, angle, frequency) for angle in (radius + np.pi / 2, radius))
        if sagittal is not None and meridional is not None:
            found.append(PlaceFocus(np.array([x, y]), (sagittal, meridional)))
    if len(found) < FEWEST_PLACES:
        raise Refused(
            f"best focus lies within the bracket at {len(found)} places; {FEWEST_PLACES} are needed",
            "extend the bracket on both sides, and photograph more charts",
        )
    return found


_Series = list[tuple[float, Node]]


def _series(bracket: Mapping[float, Sequence[Node]], shape: tuple[int, int]) -> list[_Series]:
    """The nodes of each place at all positions, as far as they are there."""
    positions = sorted(bracket)
    reach = SAME_PLACE * np.hypot(*shape) / 2
    found: list[_Series] = []
    for node in _places([bracket[z] for z in positions], reach):
        series: _Series = []
        for z in positions:
            near = min(bracket[z], key=lambda one: float(np.linalg.norm(one.position - node.position)), default=None)
            if near is not None and np.linalg.norm(near.position - node.position) < reach:
                series.append((z, near))
        found.append(series)
    return found


def _places(shots: Sequence[Sequence[Node]], reach: float) -> list[Node]:
    """One node of each place, from the middle outwards: a chart too blurred at one position is seen at another."""
    middle = len(shots) // 2
    found: list[Node] = []
    for i in sorted(range(len(shots)), key=lambda i: abs(i - middle)):
        seen = [one.position for one in found]
        found += [node for node in shots[i] if all(np.linalg.norm(node.position - at) >= reach for at in seen)]
    return found


def _top(series: _Series, angle: float, frequency: float) -> Top | None:
    """The greatest MTF along a direction; None where it is not within the bracket."""
    if len(series) < FEWEST_POSITIONS:
        return None
    z = np.array([position for position, _ in series])
    mtf, variance = np.array([_mtf(node, angle, frequency) for _, node in series]).T
    used = mtf > NEAR_TOP * mtf.max()
    if np.count_nonzero(used) < FEWEST_POSITIONS:
        used = np.argsort(-mtf)[:FEWEST_POSITIONS]
    middle, span = z[used].mean(), np.ptp(z[used])
    t, weight = (z[used] - middle) / span, mtf[used] / np.sqrt(variance[used])
    D = t[:, None] ** np.arange(3 if len(t) < 5 else 5)
    solution = np.linalg.pinv(D * weight[:, None]) * weight
    c = solution @ np.log(mtf[used])
    top = _highest(c, float(t.min()), float(t.max()))
    if top is None:
        return None
    slope, bend = polyder(c), float(polyval(top, polyder(c, 2)))
    # a logarithm that is greater by one moves the top by that; a position that is, its logarithm along the curve
    moves = polyval(top, polyder(np.eye(len(c)))) @ solution / bend
    sways: dict[str, float] = {}
    for i, sway in zip(np.arange(len(z))[used], moves * polyval(t, slope), strict=True):
        source = series[i][1].source
        sways[source] = sways.get(source, 0.0) + float(sway)
    spread = moves**2 @ (variance[used] / mtf[used] ** 2)
    return Top(float(middle + span * top), float(span**2 * spread), sways)


def _highest(c: Array, low: float, high: float) -> float | None:
    """Where a polynomial has its greatest value within an interval; None if that is at an end."""
    roots = np.roots((np.arange(1, len(c)) * c[1:])[::-1])
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real > low) & (real < high)]
    values = polyval(np.concatenate([inside, [low, high]]), c)
    best = int(np.argmax(values))
    return float(inside[best]) if best < len(inside) else None


def _mtf(node: Node, angle: float, frequency: float) -> tuple[float, float]:
    """The MTF of a node along a direction, and its variance."""
    value, slope = mtf_along(node.psf, np.array([frequency]), angle)
    return float(value[0]), float(slope[0] @ node.psf.parameter_covariance @ slope[0])


def sharpest(bracket: Mapping[float, Sequence[Node]], frequency: float = FREQUENCY) -> float:
    """The position whose charts have the greatest MTF at one frequency, along rows and columns, on average."""

    def mean_mtf(position: float) -> float:
        return float(np.mean([_mtf(node, a, frequency)[0] for node in bracket[position] for a in (0.0, np.pi / 2)]))

    return max(bracket, key=mean_mtf)
