"""Best focus over the frame from a bracket: field curvature, tilt of the sensor, and astigmatism as a distance.

The MTF of every chart at one frequency is followed through the focus positions. The vertex of a polynomial through its
logarithm is the best focus there, separately for sagittal and meridional detail. The vertices' errors derive from one
chart's noise each, so a quadratic surface through them has a simple covariance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyder, polyroots, polyval

from procedures.field.maps import COLUMNS, FieldMap, radius_direction, surface_maps
from procedures.field.surfaces import Surface, fit_surface
from procedures.numbers import FIELD_CURVATURE, FOCUS
from procedures.numerics.arrays import Array
from procedures.outcome import Quantity, Refused
from procedures.psf_field import Node, in_half_diagonals
from procedures.quality import mtf_along

Bracket = Mapping[float, Sequence[Node]]  # nodes of one plane by focus position
FocusSeries = list[tuple[float, Node]]  # focus position and node, at one place of the frame

FREQUENCY = 0.25  # frequency of the followed MTF, in cycles per pixel
FEWEST_POSITIONS = 3
FEWEST_PLACES = 7  # A quadratic surface has six coefficients
NEAR_TOP = 0.5  # positions whose MTF is at least this share of the best are fitted
SAME_PLACE = 0.1  # charts at different focus positions nearer than this, in half diagonals, are at the same place
MEAN, DIFFERENCE = (0.5, 0.5), (1.0, -1.0)
COMBINATIONS = {"sagittal": (1.0, 0.0), "meridional": (0.0, 1.0), "mean": MEAN, "astigmatism": DIFFERENCE}
"""Mapped combinations of sagittal and meridional focus."""


@dataclass(frozen=True, eq=False)
class FocusSurface:
    """Best focus over the frame, in the unit of the bracket's positions.

    shape : (int, int)
    positions : (N, 2), measured places, in pixels of the plane
    best : (N, 2), measured sagittal and meridional focus
    surface : both as quadratic functions of the position in half diagonals
    """

    shape: tuple[int, int]
    positions: Array
    best: Array
    surface: Surface
    unit: str

    def numbers(self) -> dict[str, Quantity]:
        """Tilt and curvature of the mean of sagittal and meridional focus at one half diagonal, averaged over all
        directions, and the difference of their curvatures."""
        bend, mean, difference = np.array([0, 0, 0, 0.5, 0, 0.5]), *map(np.array, (MEAN, DIFFERENCE))
        rows = {
            "focus_centre": (np.eye(6)[0], mean, "best focus at the frame's centre"),
            "focus_tilt_x": (np.eye(6)[1], mean, "slope along x, per half diagonal"),
            "focus_tilt_y": (np.eye(6)[2], mean, "slope along y, per half diagonal"),
            FIELD_CURVATURE: (bend, mean, "mean quadratic, at one half diagonal"),
            "astigmatic_difference": (bend, difference, "sagittal less meridional curvature, at one half diagonal"),
        }
        numbers = {}
        for name, (row, combination, method) in rows.items():
            values, covariance = self.surface.coefficients(combination)
            spread = float(np.sqrt(row @ covariance @ row))
            numbers[name] = Quantity(float(row @ values), self.unit, spread, method, len(self.best))
        return numbers

    def maps(self, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
        """Sagittal focus, meridional focus, their mean, and their difference."""
        combinations = [(FOCUS[name], FOCUS[name].label, np.array(u)) for name, u in COMBINATIONS.items()]
        return surface_maps(self.surface, self.positions, self.shape, columns, self.unit, combinations)


@dataclass(frozen=True)
class FocusOptimum:
    """Focus position of the greatest MTF along one direction; sensitivities : derivatives of `at` by the photographs'
    positions, of sum 1; gradients : by the parameters of the PSF at each focus position."""

    at: float
    sensitivities: Mapping[str, float]
    gradients: Mapping[float, Array]


@dataclass(frozen=True, eq=False)
class PlaceFocus:
    """Best sagittal and meridional focus at one position (x, y) of the plane; covariance : (2, 2) of both, which are of
    the same photographs."""

    position: Array
    optima: tuple[FocusOptimum, FocusOptimum]
    covariance: Array


def focus_surface(bracket: Bracket, shape: tuple[int, int], *, unit: str = "mm") -> FocusSurface:
    """Best focus from nodes at three or more focus positions. Raises Refused for fewer than seven places with their
    best focus within the bracket."""
    if len(bracket) < FEWEST_POSITIONS:
        raise Refused(
            f"best focus needs {FEWEST_POSITIONS} focus positions or more; there are {len(bracket)}",
            "photograph the same charts on both sides of the best focus",
        )
    places = best_focus(bracket, shape)
    positions = np.array([place.position for place in places])
    best = np.array([[optimum.at for optimum in place.optima] for place in places])
    covariances = np.stack([place.covariance for place in places])
    surface = fit_surface(in_half_diagonals(positions, shape), best, covariances, (2,))
    return FocusSurface(shape, positions, best, surface, unit)


def best_focus(bracket: Bracket, shape: tuple[int, int], *, frequency: float = FREQUENCY) -> list[PlaceFocus]:
    """Best focus at every place whose greatest MTF is within the bracket. Raises Refused for fewer than seven."""
    places = []
    for series in _series(bracket, shape):
        x, y = np.mean([node.position for _, node in series], axis=0)
        radius = radius_direction(shape, x, y)
        sagittal, meridional = (_optimum(series, angle, frequency) for angle in (radius + np.pi / 2, radius))
        if sagittal is not None and meridional is not None:
            optima = sagittal, meridional
            # covariance of optima at one place by the noise of their common PSFs
            total = np.zeros((len(optima), len(optima)))
            for z, node in series:
                noise = node.psf.parameter_covariance
                J = np.stack([optimum.gradients.get(z, np.zeros(len(noise))) for optimum in optima])
                total += J @ noise @ J.T
            places.append(PlaceFocus(np.array([x, y]), optima, total))
    if len(places) < FEWEST_PLACES:
        raise Refused(
            f"best focus lies within the bracket at {len(places)} places; {FEWEST_PLACES} are needed",
            "extend the bracket on both sides, and photograph more charts",
        )
    return places


def _series(bracket: Bracket, shape: tuple[int, int]) -> list[FocusSeries]:
    """Available nodes of each place at all focus positions, collected from the middle one outwards, as
    a chart may be too blurred at one."""
    reach = SAME_PLACE * np.hypot(*shape) / 2
    positions = sorted(bracket)
    middle = len(positions) // 2
    places: list[Array] = []
    for i in sorted(range(len(positions)), key=lambda i: abs(i - middle)):
        known = list(places)
        new = [node.position for node in bracket[positions[i]]]
        places += [at for at in new if all(np.linalg.norm(at - other) >= reach for other in known)]
    return [
        [(z, nearest) for z in positions if (nearest := _nearest(bracket[z], place, reach)) is not None]
        for place in places
    ]


def _nearest(nodes: Sequence[Node], place: Array, reach: float) -> Node | None:
    nearest = min(nodes, key=lambda node: float(np.linalg.norm(node.position - place)), default=None)
    return nearest if nearest is not None and np.linalg.norm(nearest.position - place) < reach else None


def _optimum(series: FocusSeries, angle: float, frequency: float) -> FocusOptimum | None:
    """The focus of the greatest MTF along a direction; None where it is not within the bracket."""
    if len(series) < FEWEST_POSITIONS:
        return None
    z = np.array([position for position, _ in series])
    values, slopes = zip(*(_mtf(node, angle, frequency) for _, node in series), strict=True)
    mtf = np.array(values)
    variance = np.array([d @ node.psf.parameter_covariance @ d for d, (_, node) in zip(slopes, series, strict=True)])
    used = np.flatnonzero(mtf > NEAR_TOP * mtf.max())
    if len(used) < FEWEST_POSITIONS:
        used = np.argsort(-mtf)[:FEWEST_POSITIONS]
    middle, span = z[used].mean(), np.ptp(z[used])
    t, weight = (z[used] - middle) / span, mtf[used] / np.sqrt(variance[used])
    D = t[:, None] ** np.arange(3 if len(t) < 5 else 5)
    solution = np.linalg.pinv(D * weight[:, None]) * weight
    c = solution @ np.log(mtf[used])
    # position of a polynomial's maximum in an interval; None at its ends
    low = float(t.min())
    high = float(t.max())
    roots = polyroots(polyder(c))
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real > low) & (real < high)]
    best = int(np.argmax(polyval(np.concatenate([inside, [low, high]]), c)))
    top = float(inside[best]) if best < len(inside) else None
    if top is None:
        return None
    # derivative of the maximum by each logarithm; a position acts through the slope of the curve
    by_logarithm = polyval(top, polyder(np.eye(len(c)))) @ solution / float(polyval(top, polyder(c, 2)))
    sensitivities: dict[str, float] = {}
    for i, by_position in zip(used, by_logarithm * polyval(t, polyder(c)), strict=True):
        source = series[i][1].source
        sensitivities[source] = sensitivities.get(source, 0.0) + float(by_position)
    gradients = {series[i][0]: span * by / mtf[i] * slopes[i] for i, by in zip(used, by_logarithm, strict=True)}
    return FocusOptimum(float(middle + span * top), sensitivities, gradients)


def _mtf(node: Node, angle: float, frequency: float) -> tuple[float, Array]:
    """The MTF along a direction, and its derivative by the PSF's parameters."""
    value, slope = mtf_along(node.psf, np.array([frequency]), angle)
    return float(value[0]), slope[0]


def sharpest(bracket: Bracket) -> float:
    """The focus position of the greatest mean MTF along rows and columns."""

    def mean_mtf(position: float) -> float:
        return float(np.mean([_mtf(node, a, FREQUENCY)[0] for node in bracket[position] for a in (0.0, np.pi / 2)]))

    return max(bracket, key=mean_mtf)
