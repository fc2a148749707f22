"""Vignetting and colour shading from flats: verdict, numbers and maps of each plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

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
from procedures.outcome import Check, Outcome, Quantity, Refused, Verdict, verdict_of
from procedures.raw import FrameLike, Plane, as_frame
from procedures.vignetting.cells import Cells, cells_of
from procedures.vignetting.surface import Falloff, RadialFalloff, fit_falloff, fit_radial

Array = npt.NDArray[np.float64]

REFERENCE = "G1"
GRID = (33, 25)
"""Columns and rows of the places at which maps are told and formulas compared."""
LARGE_STRUCTURE = 0.005
"""Of the light: what flats show beside a smooth surface, and no lens makes."""
LARGE_SLOPE = 0.02
"""Of the light over half a diagonal: a slope of one flat's light that is doubted."""


@dataclass(frozen=True, eq=False)
class PlaneVignetting:
    """What the flats say of one plane.

    Attributes
    ----------
    surface : Falloff
    radial : RadialFalloff
    numbers : mapping of name to Quantity
    places : (n, 2), value : (n,), uncertainty : (n,) float64
        The map: light over that at the plane's centre.
    middle : (2,) float64
        (x, y) of the frame's centre in pixels of the plane: the planes of a mosaic lie half a pixel apart.
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
    def centre(self) -> Array:
        """Centre (2,) of the radial formula from the frame's, in pixels of the plane."""
        return np.asarray(self.radial.centre - self.middle)


def estimate_vignetting(
    flats: Sequence[tuple[str, Mapping[str, Plane]] | FrameLike],
) -> dict[str, Outcome[PlaneVignetting]]:
    """Vignetting of every plane, and colour shading against green.

    Parameters
    ----------
    flats : sequence of (name of the photograph, its planes), of RawFrame, or of (rows, columns) arrays
        One camera, lens, aperture and focus; camera or light turned between them.

    Returns
    -------
    dict of plane to Outcome[PlaneVignetting]

    Raises
    ------
    Refused
        If there is none.
    """
    if not flats:
        raise Refused("vignetting needs photographs of even light; there is none", "give one flat, better four")
    named = [one if isinstance(one, tuple) else _named(one, n) for n, one in enumerate(flats, 1)]
    found: dict[str, Outcome[PlaneVignetting]] = {}
    for name, first in named[0][1].items():
        try:
            cells = [cells_of(planes[name], source) for source, planes in named]
            found[name] = _plane(cells, first)
        except Refused as refusal:
            found[name] = Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    return _with_colour(found)


def _named(flat: FrameLike, number: int) -> tuple[str, Mapping[str, Plane]]:
    frame = as_frame(flat, f"flat {number}")
    return frame.path.name, frame.planes


def _plane(cells: Sequence[Cells], plane: Plane) -> Outcome[PlaneVignetting]:
    rows, columns = plane.samples.shape
    shape, size = (rows, columns), np.array([columns, rows], dtype=np.float64)
    middle = ((plane.pitch * size - 1) / 2 - plane.origin) / plane.pitch
    surface = fit_falloff(cells, shape)
    places = frame_places(shape)
    radial = fit_radial(surface, places)
    answer = PlaneVignetting(
        surface,
        radial,
        _numbers(surface, radial, middle, len(cells)),
        places,
        surface.light.at(places),
        surface.uncertainty(places),
        middle,
    )
    return verdict_of(_checks(surface, len(cells)), answer)


def frame_places(shape: tuple[int, int]) -> Array:
    """Places (n, 2) spread over a plane, rims included, row by row."""
    rows, columns = shape
    x, y = np.meshgrid(np.linspace(0, columns - 1, GRID[0]), np.linspace(0, rows - 1, GRID[1]))
    return np.column_stack([x.ravel(), y.ravel()])


def _numbers(surface: Falloff, radial: RadialFalloff, middle: Array, count: int) -> dict[str, Quantity]:
    rows, columns = surface.light.shape
    corners = np.array([[x, y] for x in (0, columns - 1) for y in (0, rows - 1)], dtype=np.float64)
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
    """What makes vignetting doubtful."""
    doubtful, steepest = Verdict.DOUBTFUL, float(np.linalg.norm(surface.slopes, axis=1).max())
    return [
        Check("flats", count, 2, doubtful,
              "one flat cannot tell a slope of the light from the lens: the centre and the difference of the corners "
              "may be the light's",
              "photograph a second flat with the camera or the light turned by 180 degrees about the axis, better four",
              least=True),
        Check("structure", surface.structure, LARGE_STRUCTURE, doubtful,
              f"the flats show structure of {surface.structure:.1%} rms that no lens makes",
              "photograph evenly lit, structureless light: a diffuser before the lens, out of focus"),
        Check("slope", steepest, LARGE_SLOPE, doubtful,
              f"the flats' light differs by {steepest:.1%} over half a diagonal from one to the next",
              "make the light more even: it is known no better than its slopes average out", given=count >= 2),
    ]  # fmt: skip


def _with_colour(found: dict[str, Outcome[PlaneVignetting]]) -> dict[str, Outcome[PlaneVignetting]]:
    """Colour shading beside the numbers: how far a plane's light over green's is from that at the centre."""
    green = found[REFERENCE].value if REFERENCE in found else None
    if green is None:
        return found
    told = {}
    for name, outcome in found.items():
        one = outcome.value
        if one is not None and name != REFERENCE:
            light = [which.surface.light.at(one.places + (which.middle - one.middle)) for which in (one, green)]
            ratio = light[0] / light[1] - 1
            # the light's slope is common to the planes and drops out
            spread = float(np.sqrt(np.mean(_noise(one) ** 2 + _noise(green) ** 2)))
            value = float(np.sqrt(np.mean(ratio**2)))
            method = f"rms over the frame of light over that of {REFERENCE}, less 1"
            colour = Quantity(value, "1", spread, method, one.numbers[CORNER_LIGHT].n)
            answer = replace(one, numbers={**one.numbers, COLOUR_SHADING: colour})
            told[name] = outcome.of_value(answer)
        else:
            told[name] = outcome
    return told


def _noise(one: PlaneVignetting) -> Array:
    return replace(one.surface, slope_covariance=np.zeros((2, 2))).uncertainty(one.places) / one.value
