"""Vignetting and colour shading from flats: verdict, numbers and maps of each plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.display import summary
from procedures.numbers import (
    COLOUR_SHADING,
    CORNER_LIGHT,
    DARKEST_CORNER,
    VIGNETTING_CENTRE_X,
    VIGNETTING_CENTRE_Y,
    VIGNETTING_K,
    VIGNETTING_NOT_RADIAL,
)
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, Check, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.raw import FrameLike, Plane, as_frame
from procedures.vignetting.surface import Falloff, RadialFalloff, cells_of, fit_falloff, fit_radial

REFERENCE = "G1"
GRID = (33, 25)  # columns and rows of maps, and of the comparison of formulas
LARGE_STRUCTURE = 0.005  # structure of the flats beyond a smooth surface, relative to the light, that no lens causes
LARGE_SLOPE = 0.02  # relative slope of one flat's light over half a diagonal above which it is doubtful
NAMES = ("centre_x", "centre_y", "k1", "k2", "k3")
UNITS = ("pixel of the plane", "pixel of the plane", "1", "1", "1")


@dataclass(frozen=True, eq=False)
class PlaneVignetting:
    """Vignetting of one plane.

    numbers : mapping of name to Quantity
    places : (n, 2), value : (n,), uncertainty : (n,); map of the light relative to the plane's centre
    middle : (2,), (x, y) of the frame's centre in pixels of the plane: the planes of a mosaic are half a pixel apart
    """

    surface: Falloff
    radial: RadialFalloff
    numbers: Mapping[str, Quantity]
    places: Array
    value: Array
    uncertainty: Array
    middle: Array

    __repr__ = summary

    @property
    def corner_budget(self) -> dict[str, float]:
        """Standard uncertainty of the light in the corners, by noise and by the slope of the flats' light."""
        whole = self.numbers[CORNER_LIGHT].uncertainty
        noise = min(float(self.surface.parts(corners_of(self.surface.light.shape))[0].mean()), whole)
        return {"noise": noise, "slope": float(np.sqrt(whole**2 - noise**2))}

    @property
    def centre(self) -> Array:
        """Centre (2,) of the radial formula relative to the frame's, in pixels of the plane."""
        return np.asarray(self.radial.centre - self.middle)


def estimate_vignetting(
    flats: Sequence[tuple[str, Mapping[str, Plane]] | FrameLike],
) -> dict[str, Outcome[PlaneVignetting]]:
    """Vignetting of every plane, and colour shading relative to green.

    flats : sequence of (name of the photograph, its planes), of RawFrame, or of (rows, columns) arrays
        From one camera, lens, aperture and focus, with camera or light rotated between them.

    Returns
    -------
    dict of plane to Outcome[PlaneVignetting]

    Raises Refused if there is none, BadInput if they differ in planes or sizes.
    """
    named = [flat if isinstance(flat, tuple) else _named(flat, n) for n, flat in enumerate(flats, 1)]
    if not named:
        raise Refused("vignetting needs photographs of even light; there is none", "give one flat, better four")
    sizes = {tuple((one, plane.samples.shape) for one, plane in planes.items()): name for name, planes in named}
    if len(sizes) > 1:
        raise BadInput(
            f"flats must have the same planes and sizes; {' and '.join(sizes.values())} differ",
            "give photographs of one camera, in one format",
        )
    outcomes: dict[str, Outcome[PlaneVignetting]] = {}
    for name, first in named[0][1].items():
        try:
            cells = [cells_of(planes[name], source) for source, planes in named]
            rows, columns = first.samples.shape
            shape, size = (rows, columns), np.array([columns, rows], dtype=np.float64)
            middle = ((first.pitch * size - 1) / 2 - first.origin) / first.pitch
            surface = fit_falloff(cells, shape)
            places = frame_places(shape)
            radial = fit_radial(surface, places)
            numbers = _numbers(surface, radial, middle, len(cells))
            light, uncertainty = surface.light.at(places), surface.uncertainty(places)
            result = PlaneVignetting(surface, radial, numbers, places, light, uncertainty, middle)
            outcomes[name] = verdict_of(_checks(surface, len(cells)), result)
        except Refused as refusal:
            outcomes[name] = Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    green = outcomes[REFERENCE].value if REFERENCE in outcomes else None
    if green is None:
        return outcomes
    return {name: outcome if name == REFERENCE else _with_colour(outcome, green) for name, outcome in outcomes.items()}


def _named(flat: FrameLike, number: int) -> tuple[str, Mapping[str, Plane]]:
    frame = as_frame(flat, f"flat {number}")
    return frame.path.name, frame.planes


def frame_places(shape: tuple[int, int]) -> Array:
    """Places (n, 2) of a grid over a plane, including its rim, row by row."""
    rows, columns = shape
    x, y = np.meshgrid(np.linspace(0, columns - 1, GRID[0]), np.linspace(0, rows - 1, GRID[1]))
    return np.column_stack([x.ravel(), y.ravel()])


def corners_of(shape: tuple[int, int]) -> Array:
    """The corners (4, 2) of a plane."""
    rows, columns = shape
    return np.array([[x, y] for x in (0, columns - 1) for y in (0, rows - 1)], dtype=np.float64)


def _numbers(surface: Falloff, radial: RadialFalloff, middle: Array, count: int) -> dict[str, Quantity]:
    corners = corners_of(surface.light.shape)
    light, spread = surface.light.at(corners), surface.uncertainty(corners)
    darkest = int(np.argmin(light))
    sigma = np.sqrt(np.diag(radial.covariance))
    method = f"{count} flats, polynomial of degree {surface.light.degree} in log light"
    fitted = "radial formula next to the surface, 1 + k1 r^2 + k2 r^4 + k3 r^6"
    where = f"{fitted}; from the frame's"
    centre = radial.centre - middle
    return {
        CORNER_LIGHT: Quantity(float(light.mean()), "1", float(spread.mean()), f"{method}; mean of corners", count),
        DARKEST_CORNER: Quantity(float(light[darkest]), "1", float(spread[darkest]), method, count),
        VIGNETTING_CENTRE_X: Quantity(float(centre[0]), "pixel", float(sigma[0]), where, count),
        VIGNETTING_CENTRE_Y: Quantity(float(centre[1]), "pixel", float(sigma[1]), where, count),
        **{VIGNETTING_K[i]: Quantity(float(radial.coefficients[i]), "1", float(sigma[i + 2]), fitted, count)
           for i in range(3)},
        VIGNETTING_NOT_RADIAL: Quantity(radial.lost, "1", 0.0, "rms over the frame of the formula's error", count),
    }  # fmt: skip


def _checks(surface: Falloff, count: int) -> list[Check]:
    doubtful, steepest = Verdict.DOUBTFUL, float(np.linalg.norm(surface.slope_errors, axis=1).max())
    return [
        Check("flats", count, 2, doubtful,
              "one flat does not separate a slope of the light from the lens: the centre and the difference of the "
              "corners may be due to the light",
              "photograph a second flat with camera or light rotated by 180 degrees about the axis, better four",
              least=True),
        Check("structure", surface.structure, LARGE_STRUCTURE, doubtful,
              f"the flats show structure of {surface.structure:.1%} rms that no lens causes",
              "photograph evenly lit, structureless light: a diffuser before the lens, out of focus"),
        Check("slope", steepest, LARGE_SLOPE, doubtful,
              f"the flats' light differs by {steepest:.1%} over half a diagonal from one to the next",
              "make the light more even: its slopes average out only in part", given=count >= 2),
    ]  # fmt: skip


def _with_colour(outcome: Outcome[PlaneVignetting], green: PlaneVignetting) -> Outcome[PlaneVignetting]:
    """Add colour shading: variation of a plane's light over green's, relative to the centre."""
    one = outcome.value
    if one is None:
        return outcome
    own, reference = (plane.surface.light.at(one.places + (plane.middle - one.middle)) for plane in (one, green))
    value = float(np.sqrt(np.mean((own / reference - 1) ** 2)))
    # the slope of the light is common to the planes and cancels
    spread = float(np.sqrt(np.mean(_noise(one) ** 2 + _noise(green) ** 2)))
    method = f"rms over the frame of light over that of {REFERENCE}, less 1"
    colour = Quantity(value, "1", spread, method, one.numbers[CORNER_LIGHT].n)
    return outcome.of_value(replace(one, numbers={**one.numbers, COLOUR_SHADING: colour}))


def _noise(one: PlaneVignetting) -> Array:
    return replace(one.surface, slope_covariance=np.zeros((2, 2))).uncertainty(one.places) / one.value


# --- the formulas of all planes ---


@dataclass(frozen=True, eq=False)
class JointFormula:
    """Centre, relative to the frame's, and coefficients of every plane.

    values : (5 planes,), in the order of `NAMES`, plane by plane; covariance : (5 planes, 5 planes) float64.
    """

    planes: tuple[str, ...]
    values: Array
    covariance: Array


def joint_formula(planes: Mapping[str, PlaneVignetting]) -> JointFormula:
    """The formulas of the planes, whose noise is independent, but not the slope of the light, of an uncertainty by the
    flats' scatter."""
    size = len(NAMES)
    values = np.concatenate([np.zeros(0), *(np.append(one.centre, one.radial.coefficients) for one in planes.values())])
    covariance = np.zeros((len(values), len(values)))
    for i, a in enumerate(planes.values()):
        for j, b in enumerate(planes.values()):
            block = a.radial.covariance if i == j else a.radial.by_slope @ _common(a, b) @ b.radial.by_slope.T
            covariance[i * size : (i + 1) * size, j * size : (j + 1) * size] = block
    return JointFormula(tuple(planes), values, covariance)


def _common(a: PlaneVignetting, b: PlaneVignetting) -> Array:
    """Covariance (2, 2) of the mean slopes of two planes' flats."""
    first, second = a.surface, b.surface
    count, freedom = len(first.slope_errors), np.sqrt(first.slope_freedom * second.slope_freedom)
    if count < 2 or len(second.slope_errors) != count:
        return np.zeros((2, 2))
    return np.asarray(first.slope_errors.T @ second.slope_errors / (freedom * count))
