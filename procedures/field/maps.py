"""Maps over the frame derived from a PSF field: numbers of the whole PSF with their standard uncertainties.

Sagittal and meridional refer to the frame's centre: meridional detail repeats along the radius, sagittal detail across
it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.field.photosite import WithoutPhotosite
from procedures.field.surfaces import Surface, fit_surface
from procedures.numbers import (
    ENERGY_ABOVE_NYQUIST,
    ENERGY_OUTSIDE_SUPPORT,
    ERROR_INTERPOLATION,
    ERROR_NOISE,
    OF_PLACES,
    without_photosite,
)
from procedures.numerics.arrays import Array, Indices, Mask
from procedures.numerics.scattered import Hull
from procedures.outcome import Refused
from procedures.psf import Psf, curve_model_error, tail_energy_uncertainty
from procedures.psf_field import Node, PsfField, in_half_diagonals
from procedures.quality import crossing_model_error, frequencies, mtf_along
from procedures.spatial_numbers import energy_above_nyquist
from procedures.transfer_function import first_crossing

COLUMNS = 21  # positions of a map along the frame's longer side
MAPS = (*OF_PLACES, ENERGY_ABOVE_NYQUIST, ENERGY_OUTSIDE_SUPPORT)  # maps of numbers derived from the PSF
BEFORE_PHOTOSITES = tuple(without_photosite(name) for name in OF_PLACES)
"""Optional maps without the photosites: lens, filters, and charge diffusion."""
ERRORS = (ERROR_NOISE, ERROR_INTERPOLATION)  # maps of the field's predicted error: its norm over that of the PSF


@dataclass(frozen=True, eq=False)
class FieldMap:
    """A number over the frame.

    x : (nx,), y : (ny,); positions in pixels of the plane
    value : (ny, nx), NaN where the number is undefined
    uncertainty : (ny, nx) or None; None where the value is itself an uncertainty
    enclosed : (ny, nx) bool or None; mask of the positions inside the hull of the nodes, where the others have a value
        too; None: the finite values
    """

    name: str
    title: str
    unit: str
    x: Array
    y: Array
    value: Array
    uncertainty: Array | None
    enclosed: Mask | None = None

    @property
    def share(self) -> float:
        """Share of the frame inside the hull of the nodes."""
        return float((np.isfinite(self.value) if self.enclosed is None else self.enclosed).mean())

    def median(self, values: Array) -> float:
        """Median of values (ny, nx) at the map's positions inside the hull; NaN where there are none."""
        inside = values if self.enclosed is None else values[self.enclosed]
        return float(np.nanmedian(inside)) if np.isfinite(inside).any() else np.nan


def grid(shape: tuple[int, int], columns: int = COLUMNS) -> tuple[Array, Array]:
    """x (nx,) and y (ny,) of equally spaced positions over a plane of that shape, half a step from its sides."""
    step = max(shape) / columns
    rows, columns = (max(round(size / step), 1) for size in shape)
    x, y = ((np.arange(n) + 0.5) * size / n - 0.5 for n, size in ((columns, shape[1]), (rows, shape[0])))
    return x, y


def mesh(x: Array, y: Array) -> Array:
    """Points (ny nx, 2) of a grid, row by row."""
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def radius_direction(shape: tuple[int, int], x: float, y: float) -> float:
    """Direction from the frame's centre to a position of the plane, radians from x towards y."""
    return float(np.arctan2(y - (shape[0] - 1) / 2, x - (shape[1] - 1) / 2))


def surface_maps(
    surface: Surface,
    positions: Array,
    shape: tuple[int, int],
    columns: int,
    unit: str,
    combinations: Sequence[tuple[str, str, Array]],
) -> tuple[FieldMap, ...]:
    """Maps of linear combinations of a surface's components, inside the hull of its positions (N, 2) in the plane.

    `combinations` are names, titles, and weights of the components: (m,), or (n, m) by point of the map.
    """
    x, y = grid(shape, columns)
    points = mesh(x, y)
    inside = Hull(positions).holds(points)
    places = in_half_diagonals(points, shape)
    value, covariance = surface.at(places), surface.covariance(places)
    maps = []
    for name, title, weights in combinations:
        u = np.broadcast_to(weights, value.shape)
        spread = np.sqrt(np.einsum("na,nab,nb->n", u, covariance, u))
        images = (np.where(inside, v, np.nan).reshape(len(y), len(x)) for v in (np.sum(u * value, axis=1), spread))
        maps.append(FieldMap(name, title, unit, x, y, *images))
    return tuple(maps)


def derive(field: PsfField, columns: int = COLUMNS, without: WithoutPhotosite | None = None) -> tuple[FieldMap, ...]:
    """All maps of one plane: `MAPS`, those before the photosites where `without` is given, and `ERRORS`."""
    x, y = grid(field.shape, columns)
    names = (*MAPS, *BEFORE_PHOTOSITES) if without else MAPS
    value, uncertainty = np.full((2, len(names), len(y), len(x)), np.nan)
    errors = np.full((len(ERRORS), len(y), len(x)), np.nan)
    points = mesh(x, y)
    enclosed = field.inside(points).reshape(len(y), len(x))
    parameters = field.parameters(points).reshape(len(y), len(x), -1)
    for row, column in np.ndindex(enclosed.shape):
        at = float(x[column]), float(y[row])
        parts = field.covariances(*at)
        psf = Psf.of(parameters[row, column], parts[0] + parts[1], field.k, field.s, parts[1])
        norm = float(np.linalg.norm(psf.extended()))
        errors[:, row, column] = [field.norm_of_error(C) / norm for C in parts]
        radius = radius_direction(field.shape, *at)
        numbers = [numbers_of(psf, radius)] + ([mtf50_about(psf, radius, without)] if without else [])
        value[:, row, column], uncertainty[:, row, column] = np.hstack(numbers)
    images = zip((*names, *ERRORS), (*value, *errors), (*uncertainty, None, None), strict=True)
    return tuple(FieldMap(name, name.label, name.unit, x, y, v, u, enclosed) for name, v, u in images)


def numbers_of(psf: Psf, radius: float) -> tuple[Array, Array]:
    """The numbers of MAPS at one position, and their uncertainties with the tail's truncation; NaN where undefined.
    `radius` is the direction from the frame's centre, in radians."""
    values, uncertainties = mtf50_about(psf, radius)
    above, slope = energy_above_nyquist(psf)
    of_above = np.sqrt(max(float(slope @ psf.parameter_covariance @ slope), 0.0))
    outside, noise = psf.energy_outside if len(psf.tail.amplitudes) else (np.nan, np.nan)
    of_outside = np.hypot(noise, tail_energy_uncertainty(psf))
    return np.append(values, [above, outside]), np.append(uncertainties, [of_above, of_outside])


def mtf50_about(psf: Psf, radius: float, without: WithoutPhotosite | None = None) -> tuple[Array, Array]:
    """Sagittal and meridional MTF50 and their difference (3,), and uncertainties, of the camera or `without` the
    photosites; NaN where the MTF stays above 1/2."""
    two = [_mtf50(psf, angle, without) for angle in (radius + np.pi / 2, radius)]
    (sagittal, by_sagittal, stray_s), (meridional, by_meridional, stray_m) = two
    slopes = np.array([by_sagittal, by_meridional, by_sagittal - by_meridional])
    truncated = np.array([stray_s, stray_m, np.hypot(stray_s, stray_m)])
    values = np.array([sagittal, meridional, sagittal - meridional])
    return values, np.hypot(propagated(psf, slopes), truncated)


def propagated(psf: Psf, slopes: Array) -> Array:
    """Standard uncertainties (n,) by derivatives (n, p or more): by the PSF's parameters, and after them by further
    ones in their standard uncertainties."""
    own, other = np.split(slopes, [len(psf.parameters)], axis=1)
    variance = np.einsum("ij,ij->i", own @ psf.parameter_covariance, own) + np.sum(other**2, axis=1)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _mtf50(psf: Psf, angle: float, without: WithoutPhotosite | None) -> tuple[float, Array, float]:
    """MTF50 along a direction, its derivative, and its standard uncertainty by the model error of the tail."""
    f = without.frequencies(psf, angle) if without else frequencies(psf)
    curve = without.curve if without else mtf_along
    crossing = first_crossing(f, lambda some: curve(psf, some, angle))
    if crossing is None:
        return np.nan, np.full(len(psf.parameters) + (without is not None), np.nan), np.nan
    passed = float(without.passed(crossing[0], angle)) if without else 1.0
    return *crossing, crossing_model_error(psf, crossing[0], lambda some: curve(psf, some, angle), passed)


# --- Lateral colour: the displacement of one plane's image relative to another's, over the frame ---
# The marks centre each plane's PSF on that plane's own image, so the PSFs do not contain it. It is the difference of
# the planes' registrations at the charts' centres, in pixels of the sensor.

FEWEST = 6
DEGREES = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class LateralColour:
    """Displacement of a plane's image relative to a reference, in pixels of the sensor.

    shape : rows and columns of a plane
    positions : (N, 2), positions of the charts, in pixels of the plane
    shift : (N, 2), covariance : (N, 2, 2); measured (x, y)
    surface : the shift as a function of the position in half diagonals
    charts : source and number of the compared nodes; empty where read from a file
    """

    plane: str
    reference: str
    shape: tuple[int, int]
    positions: Array
    shift: Array
    covariance: Array
    surface: Surface
    charts: tuple[tuple[str, int], ...] = ()

    def at(self, points: Array) -> tuple[Array, Array]:
        """Shift (n, 2) and its covariance (n, 2, 2) at points (n, 2) of the plane."""
        places = in_half_diagonals(np.asarray(points, dtype=np.float64), self.shape)
        return self.surface.at(places), self.surface.covariance(places)

    def shift_at(self, points: Array) -> Array:
        """Shift (n, 2) at points (n, 2) of the plane; beyond the charts that of the nearest position among them."""
        return self.at(Hull(self.positions).nearest(np.asarray(points, dtype=np.float64)))[0]

    def maps(self, columns: int = COLUMNS) -> tuple[FieldMap, ...]:
        """Shift along the radius, positive outwards, and perpendicular to it, positive from x towards y."""
        angle = np.array([radius_direction(self.shape, *point) for point in mesh(*grid(self.shape, columns))])
        return surface_maps(
            self.surface, self.positions, self.shape, columns, "sensor pixel",
            [(f"lateral_colour_{name}", f"{self.plane} against {self.reference}, {name} shift",
              np.column_stack([np.cos(turned), np.sin(turned)]))
             for name, turned in (("radial", angle), ("tangential", angle + np.pi / 2))],
        )  # fmt: skip


def lateral_colour(
    plane: str, nodes: Sequence[Node], reference: str, against: Sequence[Node], shape: tuple[int, int], pitch: int
) -> LateralColour:
    """Lateral colour from two planes' nodes, matched by photograph and chart.

    pitch : sensor pixels per pixel of a plane. Raises Refused if fewer than six charts were measured in both planes.
    """
    known = {(node.source, node.number): node for node in against}
    pairs = [(node, known[node.source, node.number]) for node in nodes if (node.source, node.number) in known]
    if len(pairs) < FEWEST:
        raise Refused(
            f"lateral colour needs {FEWEST} charts measured in both planes; {plane} and {reference} have {len(pairs)}",
            "photograph the chart at more places",
        )
    positions = np.array([a.position for a, _ in pairs])
    shift = np.array([a.sensor_position - b.sensor_position for a, b in pairs])
    covariance = np.array([pitch**2 * (a.position_covariance + b.position_covariance) for a, b in pairs])
    try:
        surface = fit_surface(in_half_diagonals(positions, shape), shift, covariance, DEGREES)
    except ValueError as error:
        raise Refused(f"lateral colour of {plane}: {error}", "spread the places over the frame") from error
    charts = tuple((a.source, a.number) for a, _ in pairs)
    return LateralColour(plane, reference, shape, positions, shift, covariance, surface, charts)


# --- Sagittal and meridional MTF as functions of the image height, the distance from the frame's centre ---
# Each value is the mean over the directions from the centre inside the nodes' hull, with the spread among them, by
# which a decentred lens shows. Meridional detail repeats along the radius, sagittal detail across it.

HEIGHTS = 9
DIRECTIONS = 8  # sampling of the curves, which are as smooth as the interpolated field


@dataclass(frozen=True, eq=False)
class HeightCurve:
    """MTF at one frequency as a function of the image height.

    frequency : cycles per pixel of the plane
    heights : (n,), pixels of the plane from the frame's centre
    sagittal, meridional : (n,), means over the directions
    sagittal_uncertainty, meridional_uncertainty : (n,) mean standard uncertainties of one position: the correlation
        between directions is unknown
    sagittal_spread, meridional_spread : (n,), standard deviations among the directions
    directions : (n,), number of directions inside the hull
    """

    frequency: float
    heights: Array
    sagittal: Array
    sagittal_uncertainty: Array
    sagittal_spread: Array
    meridional: Array
    meridional_uncertainty: Array
    meridional_spread: Array
    directions: Indices


def over_height(
    field: PsfField, frequencies: Sequence[float], without: WithoutPhotosite | None = None, common: Array | None = None
) -> list[HeightCurve]:
    """MTF of the camera, or `without` the photosites, at each frequency; empty where the hull excludes the centre.
    `common` are relative uncertainties (n,) at the frequencies that all places share."""
    centre = np.array([field.shape[1] - 1, field.shape[0] - 1]) / 2
    farthest = float(np.hypot(*centre))
    angles = (np.arange(DIRECTIONS) + 0.5) * 2 * np.pi / DIRECTIONS
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    heights, values = [], []
    for height in np.linspace(0, farthest, HEIGHTS):
        places = centre + height * directions if height else centre[None]
        enclosed = places[field.inside(places)]
        if len(enclosed):
            heights.append(height)
            values.append(np.array([_at(field, x, y, np.array(frequencies), without) for x, y in enclosed]))
    if not heights:
        return []
    means, spreads = (np.array([how(v, axis=0) for v in values]) for how in (np.mean, np.std))
    counts = np.array([len(v) for v in values], dtype=np.int64)
    curves = []
    for i, f in enumerate(frequencies):
        (s, us, m, um), (spread_s, _, spread_m, _) = means[..., i].T, spreads[..., i].T
        us, um = (np.hypot(u, v * (0.0 if common is None else common[i])) for u, v in ((us, s), (um, m)))
        curves.append(HeightCurve(f, np.array(heights), s, us, spread_s, m, um, spread_m, counts))
    return curves


def _at(field: PsfField, x: float, y: float, f: Array, without: WithoutPhotosite | None) -> Array:
    """Sagittal MTF, its standard uncertainty, and the same of meridional MTF at a position, (4, frequencies)."""
    psf, radius = field.at(x, y), radius_direction(field.shape, x, y)
    rows = []
    for angle in (radius + np.pi / 2, radius):
        value, slope = (without.curve if without else mtf_along)(psf, f, angle)
        passed = without.passed(f, angle) if without else np.ones(len(f))
        rows += [value, np.hypot(propagated(psf, slope), curve_model_error(psf, f, value * passed, slope, passed))]
    return np.array(rows)
