"""Refinement of an edge's course by least squares of all samples against one spread function.

Residuals of the mean spread function are regressed on the effect of a displacement of the edge, less the part that the
spread function absorbs. Unlike the row centroids of ISO 12233:2023, the result does not depend on the edge's phase on
the pixels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.slanted_edge.edge_line import Course
from procedures.slanted_edge.profile import BINS, EdgeProfile, edge_profile, rebinned, steepness, values_of
from procedures.slanted_edge.strip import Strip

HIGHEST_ORDER = 5
"""Highest degree of the polynomial, as in ISO 12233:2023."""
MAX_ITERATIONS = 4
BINNINGS = 2
"""Rounds of binning in each iteration."""
CONVERGED_PX = 1e-4


def refine_course(strip: Strip, course: Course) -> Course:
    """Course of the degree with the least Bayesian information criterion; two degrees without a gain end the search."""
    profile = edge_profile(strip, course)
    best, least = _converged(strip, profile, _with_degree(course, 1))
    for order in range(2, HIGHEST_ORDER + 1):
        candidate, criterion = _converged(strip, profile, _with_degree(best, order))
        if criterion < least:
            best, least = candidate, criterion
        elif order > best.order + 1:
            break
    return best


def _with_degree(course: Course, order: int) -> Course:
    """Nearest course of another degree."""
    t = np.linspace(-1, 1, 50)
    return replace(course, coefficients=np.polyfit(t, course.at(t * course.half), order))


def _converged(strip: Strip, profile: EdgeProfile, course: Course) -> tuple[Course, float]:
    """Converged course of this degree, and its Bayesian information criterion."""
    for _ in range(MAX_ITERATIONS):
        d = course.distances(strip)
        used = strip.usable & (np.abs(d) < profile.end_px + 1)
        profile, residual = rebinned(profile, values_of(profile.light, strip, d), d, used, BINNINGS)
        core = used & (np.abs(d) < profile.flat_px)
        change, covariance = _displacement(strip, profile, course, d, residual, core)
        course = replace(course, coefficients=course.coefficients + change)
        if np.abs(change).max() < CONVERGED_PX:
            break
    n, p = int(core.sum()), len(course.coefficients)
    square = float(np.sum(residual[core] ** 2)) + 1e-12
    # the chord's slope is that of the odd powers
    odd = np.arange(p)[::-1] % 2
    variance = float(odd @ covariance @ odd) * square / max(n - p, 1)
    course = replace(course, slope_uncertainty=max(variance, 0.0) ** 0.5 / course.half)
    return course, n * np.log(square) + p * np.log(n)


def _displacement(
    strip: Strip, profile: EdgeProfile, course: Course, d: Array, residual: Array, core: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Least-squares change of the coefficients (p,), and its covariance for unit noise (p, p)."""
    t = np.broadcast_to((strip.along / course.half)[:, None], d.shape)[core]
    normal = np.broadcast_to((1 / np.hypot(1, course.slope(strip.along)))[:, None], d.shape)[core]
    slope = -steepness(profile, d[core]) * normal * (1 if course.rising else -1)
    columns = slope[:, None] * np.vander(t, len(course.coefficients))
    bins = np.floor(d[core] * BINS).astype(int)
    bins -= bins.min()
    count = np.maximum(np.bincount(bins), 1)[:, None]
    means = np.stack([np.bincount(bins, column) for column in columns.T], axis=1) / count
    columns = columns - means[bins]
    scale = np.trace(columns.T @ columns)
    # the spread function absorbs the constant
    normal_matrix = columns.T @ columns + 1e-6 * scale * np.diag(
        np.arange(len(course.coefficients)) == len(columns[0]) - 1
    )
    covariance = np.linalg.pinv(normal_matrix, rcond=1e-8)
    return covariance @ (columns.T @ residual[core]), covariance
