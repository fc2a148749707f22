"""The radial formulas of all planes together, with one covariance: the flats' slopes are the same light in all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.vignetting.estimate import PlaneVignetting

Array = npt.NDArray[np.float64]

NAMES = ("centre_x", "centre_y", "k1", "k2", "k3")
UNITS = ("pixel of the plane", "pixel of the plane", "1", "1", "1")


@dataclass(frozen=True, eq=False)
class JointFormula:
    """Centre, from the frame's, and coefficients of every plane, side by side.

    Attributes
    ----------
    planes : tuple of str
    values : (5 planes,) float64
        In the order of `NAMES`, plane by plane.
    covariance : (5 planes, 5 planes) float64
    """

    planes: tuple[str, ...]
    values: Array
    covariance: Array


def joint_formula(found: Mapping[str, PlaneVignetting]) -> JointFormula:
    """The formulas of the planes.

    The noise of one plane's cells is not that of another's, but the light's slope, known as well as its flats agree
    on it, is in all planes alike: it is what they share.
    """
    size = len(NAMES)
    values = np.concatenate([_values(one) for one in found.values()]) if found else np.zeros(0)
    covariance = np.zeros((len(values), len(values)))
    for i, a in enumerate(found.values()):
        for j, b in enumerate(found.values()):
            block = a.radial.covariance if i == j else a.radial.by_slope @ _common(a, b) @ b.radial.by_slope.T
            covariance[i * size : (i + 1) * size, j * size : (j + 1) * size] = block
    return JointFormula(tuple(found), values, covariance)


def _values(one: PlaneVignetting) -> Array:
    return np.concatenate([one.centre, one.radial.coefficients])


def _common(a: PlaneVignetting, b: PlaneVignetting) -> Array:
    """Covariance (2, 2) of the mean slopes of two planes' flats."""
    count = len(a.surface.slopes)
    if count < 2 or len(b.surface.slopes) != count:
        return np.zeros((2, 2))
    return np.asarray(a.surface.slopes.T @ b.surface.slopes / ((count - 1) * count))
