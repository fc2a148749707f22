"""Saddles in square bins: the neighbours of a place, and triples and sides in the layout of a chart's x-corners."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, BinnedSaddles, Complex, Indices, LayoutRules
from procedures.numerics.compiled import compiled, vectorised

FAR = 1e9  # greatest coordinate, as homographies can map points arbitrarily far


@compiled
def bins_within(field: BinnedSaddles, place: complex, reach: float) -> tuple[int, int, int, int]:
    """First and last row, first and last column of bins within `reach` of a place; last < first for none."""
    if not (abs(place) < FAR):
        return 0, -1, 0, -1
    x, y = (place.real - field.left) / field.side, (place.imag - field.top) / field.side
    r = reach / field.side
    top, bottom = max(np.floor(y - r), 0.0), min(np.floor(y + r), field.rows - 1.0)
    first, last = max(np.floor(x - r), 0.0), min(np.floor(x + r), field.columns - 1.0)
    if last < first:
        return 0, -1, 0, -1
    return int(top), int(bottom), int(first), int(last)


@compiled
def alike(field: BinnedSaddles, i: int, j: int, rules: LayoutRules) -> bool:
    """Whether two saddles have nearly the same axis, and merits within a ratio."""
    a, b = field.merits[i], field.merits[j]
    cosine = (field.axes[i] * field.axes[j].conjugate()).real
    return bool(cosine > rules.same_axis and a < rules.same_merit * b and b < rules.same_merit * a)


@compiled
def nearest(field: BinnedSaddles, place: complex, reach: float, like: int, rules: LayoutRules) -> int:
    """Nearest saddle within reach of a place that is similar to a given one; -1 for none."""
    best, index = reach * reach, -1
    top, bottom, first, last = bins_within(field, place, reach)
    for row in range(top, bottom + 1):
        for n in range(field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]):
            d = field.points[n] - place
            distance = d.real * d.real + d.imag * d.imag
            if distance <= best and alike(field, n, like, rules):
                best, index = distance, n
    return index


@compiled
def all_nearest(field: BinnedSaddles, places: Complex, reaches: Array, likes: Indices, rules: LayoutRules) -> Indices:
    """`nearest` for places (n, m), with reaches (n,) and similar to the saddles of indices (n,)."""
    out = np.empty(places.shape, np.int64)
    for i in range(places.shape[0]):
        for j in range(places.shape[1]):
            out[i, j] = nearest(field, places[i, j], reaches[i], likes[i], rules)
    return out


@compiled
def non_maximum_suppression(field: BinnedSaddles, radius: float, same_axis: float) -> npt.NDArray[np.bool_]:
    """Mask of the saddles with no better one of similar axis within a radius; the last of equal ones."""
    alone = np.empty(len(field.points), np.bool_)
    for i in range(len(field.points)):
        place, alone[i] = field.points[i], True
        top, bottom, first, last = bins_within(field, place, radius)
        for row in range(top, bottom + 1):
            for j in range(field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]):
                more = field.merits[j] > field.merits[i] or (field.merits[j] == field.merits[i] and j > i)
                d = field.points[j] - place
                if more and d.real * d.real + d.imag * d.imag <= radius * radius:
                    alone[i] &= (field.axes[i] * field.axes[j].conjugate()).real <= same_axis
    return alone


@compiled
def _is_step(field: BinnedSaddles, i: int, j: int, rules: LayoutRules) -> bool:
    """Whether two similar saddles lie one lattice step apart, parallel or perpendicular to their axis."""
    d = field.points[j] - field.points[i]
    square = d.real * d.real + d.imag * d.imag
    if square <= rules.min_step * rules.min_step or square >= rules.max_step * rules.max_step:
        return False
    if not alike(field, i, j, rules):
        return False
    axis = field.axes[i] + field.axes[j]
    return bool(abs((d * d * axis.conjugate()).real) > rules.along_axis * square * abs(axis))


@vectorised
def _may_be_steps(
    field: BinnedSaddles, i: int, first: int, last: int, rules: LayoutRules, fit: npt.NDArray[np.bool_]
) -> None:
    """Mask of the saddles in a range that are similar to one and a lattice step ahead; where the line is nearly
    horizontal, both directions count, as the second step may turn."""
    x, y = field.points[i].real, field.points[i].imag
    u, v, merit = field.axes[i].real, field.axes[i].imag, field.merits[i]
    points, axes, merits = field.points[first:last], field.axes[first:last], field.merits[first:last]
    for n in range(last - first):
        dx, dy = points[n].real - x, points[n].imag - y
        square = dx * dx + dy * dy
        near = (
            (square > rules.min_step * rules.min_step)
            & (square < rules.max_step * rules.max_step)
            & (dy >= -rules.level_slope * abs(dx))
        )
        like = (merits[n] < rules.same_merit * merit) & (merit < rules.same_merit * merits[n])
        fit[n] = near & like & (axes[n].real * u + axes[n].imag * v > rules.same_axis)


@compiled
def _is_free(field: BinnedSaddles, i: int, j: int, rules: LayoutRules) -> bool:
    """Whether no similar saddle lies midway between two."""
    a, b = field.points[i], field.points[j]
    return nearest(field, (a + b) / 2, rules.middle_radius * abs(a - b), i, rules) < 0


@compiled
def _double_capacity(triples: Indices) -> Indices:
    out = np.empty((2 * len(triples), 3), np.int64)
    for n in range(len(triples)):
        for m in range(3):
            out[n, m] = triples[n, m]
    return out


@compiled
def collinear_triples(field: BinnedSaddles, rules: LayoutRules) -> Indices:
    """Triples (n, 3) of similar saddles, equally spaced on a line, in one or both directions."""
    out = np.empty((1024, 3), np.int64)
    count = 0
    fit = np.empty(len(field.points), np.bool_)
    for i in range(len(field.points)):
        place = field.points[i]
        top, bottom, first, last = bins_within(field, place, rules.max_step)
        highest = int((place.imag - rules.level_slope * rules.max_step - field.top) / field.side)
        for row in range(max(top, highest), bottom + 1):
            start, end = field.starts[row * field.columns + first], field.starts[row * field.columns + last + 1]
            _may_be_steps(field, i, start, end, rules, fit)
            for j in range(start, end):
                if not fit[j - start] or not _is_step(field, i, j, rules):
                    continue
                step = field.points[j] - place
                k = nearest(field, field.points[j] + step, rules.collinear * abs(step), j, rules)
                if (
                    k >= 0
                    and _is_step(field, j, k, rules)
                    and (_is_free(field, i, j, rules) or _is_free(field, j, k, rules))
                ):
                    if count == len(out):
                        out = _double_capacity(out)
                    out[count, 0], out[count, 1], out[count, 2] = i, j, k
                    count += 1
    return out[:count]


@compiled
def square_sides(field: BinnedSaddles, triples: Indices, rules: LayoutRules) -> Indices:
    """Hypotheses that triples start at s = 0 or 1 of the side t = 0, with the chart on one side of it or the other.

    Returns the hits (n, 12) in the order of RIM, -1 for none, of the hypotheses with enough of the five nearest other
    x-corners, one of them off the side, and without both inner neighbours, which only a lattice of saddles has.
    """
    out = np.empty((4 * len(triples), 12), np.int64)
    count = 0
    for n in range(len(triples)):
        i, j, k = triples[n, 0], triples[n, 1], triples[n, 2]
        u = (field.points[k] - field.points[i]) / 2
        reach, near = rules.collinear * abs(u), rules.square * abs(u)
        least = (
            rules.min_near if _is_free(field, i, j, rules) and _is_free(field, j, k, rules) else rules.min_near_crowded
        )
        for which in range(4):
            first, v = which % 2, u * (1j if which < 2 else -1j)
            origin = field.points[i] - first * u
            if (
                nearest(field, origin + u + v, reach, j, rules) >= 0
                and nearest(field, origin + 2 * u + v, reach, j, rules) >= 0
            ):
                continue
            hits = out[count]
            for m in range(12):
                hits[m] = -1
            matches = 0
            for t in range(1, 3):
                for s in range(0, 4, 3):
                    place = 4 + 2 * (t - 1) + s // 3  # of (s, t) in RIM
                    hits[place] = nearest(field, origin + s * u + t * v, near, j, rules)
                    matches += hits[place] >= 0
            if matches == 0:
                continue
            hits[3 - 3 * first] = nearest(field, origin + (3 - 3 * first) * u, near, j, rules)
            matches += hits[3 - 3 * first] >= 0
            hits[first], hits[first + 1], hits[first + 2] = i, j, k
            count += matches >= least
    return out[:count]
