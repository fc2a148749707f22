"""The radial formulas of all planes with their joint covariance, due to the common slope of the flats' light."""

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
    """Centre, relative to the frame's, and coefficients of every plane.

    Attributes
    ----------
    planes : tuple of str
    values : (5 planes,), in the order of `NAMES`, plane by plane
    covariance : (5 planes, 5 planes) float64
    """

    planes: tuple[str, ...]
    values: Array
    covariance: Array


def joint_formula(planes: Mapping[str, PlaneVignetting]) -> JointFormula:
    """The formulas of the planes.

    The noise of different planes is independent, but the slope of the light, with an uncertainty by the scatter of the
    flats, is common to all.
    """
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
    count = len(a.surface.slopes)
    if count < 2 or len(b.surface.slopes) != count:
        return np.zeros((2, 2))
    return np.asarray(a.surface.slopes.T @ b.surface.slopes / ((count - 1) * count))
