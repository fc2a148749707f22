"""The edge's course brought to where every sample fits one spread function, its order chosen by the data.

Values left over by the mean spread function are regressed on what a displacement of the edge would change; the spread
function takes up what it can of that, so that is eliminated first. Centroids of rows, which ISO 12233:2023 fits, err
with the phase of the edge on the pixels; this does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.slanted_edge.edge_line import Course
from procedures.slanted_edge.profile import BINS, Profile, edge_profile, rebinned, steepness, values_of
from procedures.slanted_edge.strip import Strip

Array = npt.NDArray[np.float64]

HIGHEST_ORDER = 5
"""Of the polynomial, as in ISO 12233:2023."""
ROUNDS = 4
BINNINGS = 2
"""Of the values, in each round."""
STILL_PX = 1e-4


def refine_course(strip: Strip, course: Course) -> Course:
    """The course of the order that Schwarz's criterion prefers; two orders in turn that gain nothing end the search."""
    profile = edge_profile(strip, course)
    best, least = _settled(strip, profile, _of_order(course, 1))
    for order in range(2, HIGHEST_ORDER + 1):
        candidate, criterion = _settled(strip, profile, _of_order(best, order))
        if criterion < least:
            best, least = candidate, criterion
        elif order > best.order + 1:
            break
    return best


def _of_order(course: Course, order: int) -> Course:
    """The course as a polynomial of another order, nearest to it."""
    t = np.linspace(-1, 1, 50)
    return replace(course, coefficients=np.polyfit(t, course.at(t * course.half), order))


def _settled(strip: Strip, profile: Profile, course: Course) -> tuple[Course, float]:
    """The course at rest, and Schwarz's criterion for its order."""
    for _ in range(ROUNDS):
        d = course.distances(strip)
        used = strip.usable & (np.abs(d) < profile.end_px + 1)
        profile, left = rebinned(profile, values_of(profile.light, strip, d), d, used, BINNINGS)
        core = used & (np.abs(d) < profile.flat_px)
        change, covariance = _displacement(strip, profile, course, d, left, core)
        course = replace(course, coefficients=course.coefficients + change)
        if np.abs(change).max() < STILL_PX:
            break
    n, p = int(core.sum()), len(course.coefficients)
    square = float(np.sum(left[core] ** 2)) + 1e-12
    # the chord's slope is that of the odd powers
    odd = np.arange(p)[::-1] % 2
    variance = float(odd @ covariance @ odd) * square / max(n - p, 1)
    course = replace(course, slope_uncertainty=max(variance, 0.0) ** 0.5 / course.half)
    return course, n * np.log(square) + p * np.log(n)


def _displacement(
    strip: Strip, profile: Profile, course: Course, d: Array, left: Array, core: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Change of the coefficients (p,) that explains best what is left, and its covariance for unit noise (p, p)."""
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
    # the constant is the spread function's own: it moves nothing here
    normal_matrix = columns.T @ columns + 1e-6 * scale * np.diag(
        np.arange(len(course.coefficients)) == len(columns[0]) - 1
    )
    covariance = np.linalg.pinv(normal_matrix, rcond=1e-8)
    return covariance @ (columns.T @ left[core]), covariance
