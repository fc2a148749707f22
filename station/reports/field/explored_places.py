"""The places of a field that its page lets one explore: PSF, MTF along rows and columns, and MTF50 with its budget."""

import math

import numpy as np

from procedures.choice import unseen_change
from procedures.field.conclusion import PlaneField
from procedures.field.maps import grid, mesh, mtf50_about, propagated, radius_direction
from procedures.numbers import OF_PLACES
from procedures.outcome import Quantity
from procedures.psf import Psf
from procedures.quality import mtf_along
from station.calibration.field import shared_uncertainties
from station.reports.explore import ExploredPlace, ExploredPlaces
from station.results.plane_result import PlaneResult

COLUMNS = 7
POINTS = 41
DIRECTIONS = {"horizontal": 0.0, "vertical": math.pi / 2}


def explored_places(one: PlaneField, centre: PlaneResult) -> ExploredPlaces:
    """A grid of places over the frame, with what their uncertainties share with the result at the centre."""
    field = one.interpolation.field
    known = shared_uncertainties(field, centre)
    shared = np.array([known[name] / centre.factor for name in OF_PLACES])
    points = mesh(*grid(field.shape, COLUMNS))
    enclosed, parameters = field.inside(points), field.parameters(points)
    spots = [_spot(one, shared, *place) for place in zip(points, enclosed, parameters, strict=True)]
    return ExploredPlaces(field.shape, spots)


def _spot(
    one: PlaneField, shared: np.ndarray, place: np.ndarray, enclosed: bool, parameters: np.ndarray
) -> ExploredPlace:
    field, (x, y) = one.interpolation.field, map(float, place)
    noise, interpolation = field.covariances(x, y)
    psf = Psf.of(parameters, noise + interpolation, field.k, field.s, interpolation)
    only_noise = Psf.of(parameters, noise, field.k, field.s, interpolation)
    radius = radius_direction(field.shape, x, y)
    (values, total), (_, by_noise) = mtf50_about(psf, radius), mtf50_about(only_noise, radius)
    rest = np.sqrt(np.maximum(total**2 - by_noise**2, 0))
    total = np.hypot(total, shared)
    numbers = {str(name): Quantity(v, name.unit, u, "", 0) for name, v, u in zip(OF_PLACES, values, total, strict=True)}
    budgets = {
        str(name): {
            "noise and truncation": float(a),
            "interpolation between the charts": float(b),
            "common to all places": float(c),
        }
        for name, a, b, c in zip(OF_PLACES, by_noise, rest, shared, strict=True)
    }
    frequencies = np.linspace(0, min(field.s / 2, 1.0), POINTS)
    relative = unseen_change(one.quality, frequencies)
    curves = {"frequency": frequencies}
    for name, angle in DIRECTIONS.items():
        curves[name], slopes = mtf_along(psf, frequencies, angle)
        curves[f"{name}_uncertainty"] = np.hypot(propagated(psf, slopes), curves[name] * relative)
    return ExploredPlace(x, y, bool(enclosed), numbers, budgets, curves, psf.h, psf.s)
