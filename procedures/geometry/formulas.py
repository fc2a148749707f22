"""Formulas fitted to a reference camera: parametric models with their loss over the frame, and their covariance.

A formula's parameters p minimise the distance of its projection from that of the reference over the covered frame.
Their errors come from those of the reference, and from terms that the lens has and the formula has not. With the
difference e of the reference from the fit at the places of a grid, and derivatives J by p,

    e = J d + M a + errors of the reference,    a ~ N(0, 1),

M being the missing terms of `model_discrepancy`, each scaled to its prior. Generalised least squares gives d, the
shift by which the missing terms displaced the fit, with covariance; the fit's covariance is cov(d) + d d'.
"""

from dataclasses import dataclass

import numpy as np

from procedures.geometry.cameras import FORMULAS, STEREOGRAPHIC, CameraModel
from procedures.geometry.conversion import Difference, as_model, covered_grid
from procedures.geometry.model_discrepancy import missing_terms
from procedures.numerics.arrays import Array

GRID = (15, 11)
UNMODELLED_PX = 1e-3  # standard deviation of differences that neither the reference's errors nor missing terms explain
ALMOST_ALL = 0.99  # share of the covered frame, up to which a formula describes all of it


@dataclass(frozen=True, eq=False)
class FittedFormula:
    """A formula fitted to the reference.

    covariance : (p, p) float64, of its parameters
    difference : Difference, its loss: distance from the reference over the covered frame
    response : (p, P) float64, change of its parameters by those of the reference
    share : float, share of the covered frame that it describes: formulas of pinholes end 90 degrees from the axis
    """

    camera: CameraModel
    covariance: Array
    difference: Difference
    response: Array
    share: float


def fit_formulas(camera: CameraModel, covariance: Array, region: Array) -> tuple[FittedFormula, ...]:
    """All formulas fitted to a camera with the covariance (p, p) of its parameters, the simplest first."""
    return tuple(_fitted(camera, covariance, region, model) for model in FORMULAS)


def most_apt(formulas: tuple[FittedFormula, ...], tolerance_px: float) -> FittedFormula:
    """The simplest formula whose loss over the whole covered frame is within a tolerance, or else least."""
    whole = [formula for formula in formulas if formula.share > ALMOST_ALL] or list(formulas)
    apt = (one for one in whole if one.difference.rms_px <= tolerance_px)
    return next(apt, min(whole, key=lambda one: one.difference.rms_px))


def _fitted(reference: CameraModel, covariance: Array, region: Array, model: str) -> FittedFormula:
    camera, difference = as_model(reference, region, model)
    pixels, rays = covered_grid(reference, region, GRID, behind=True)
    known = np.isfinite(camera.project(rays)).all(axis=1) & ((rays[:, 2] > 0) | (model == STEREOGRAPHIC))
    share = float(known.mean())
    pixels, rays = pixels[known], rays[known]
    J, M = (one.reshape(2 * len(pixels), -1) for one in (camera.by_params(rays), missing_terms(camera, pixels)))
    R = reference.by_params(rays).reshape(2 * len(pixels), -1)
    spread = R @ covariance @ R.T + M @ M.T + UNMODELLED_PX**2 * np.eye(len(R))
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0] = 1.0  # a term that no ray shows keeps its prior
    weighted = np.linalg.solve(spread, J / scale)
    prior = camera.information / np.outer(scale, scale)
    own = np.linalg.inv((J / scale).T @ weighted + prior) / np.outer(scale, scale)
    shift = own @ (scale * (weighted.T @ (pixels - camera.project(rays)).ravel()))
    response = np.linalg.lstsq(J / scale, R)[0] / scale[:, None]
    return FittedFormula(camera, own + np.outer(shift, shift), difference, response, share)
