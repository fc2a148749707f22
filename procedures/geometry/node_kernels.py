"""Inner loops of the adjustment: a view's part of the normal equations of the nodes, and cubic B-splines of a frame."""

import numpy as np

from procedures.numerics.arrays import Array, Indices
from procedures.numerics.compiled import compiled


@compiled
def add_view(
    J: Array, E: Array, r: Array, whitening: Array, index: Indices, places: Indices, V: Array, v: Array, W: Array
) -> None:
    """Whiten J (n, 2, m) and E (n, 2, 3) in place, and add E'E, E'r and E'J to V, v and W of the nodes.

    J, E : (n, 2, m), (n, 2, 3) float64, derivatives of the points by the first unknowns and by their nodes
    r : (n, 2) float64, whitened residuals
    whitening : (n, 2, 2) float64
    index : (n,) int64, node of each point
    places : (m,) int64, index of each column of J among the first unknowns
    V, v, W : (N, 3, 3), (N, 3), (N, 3, M) float64, see `adjustment.System`
    """
    for i in range(len(index)):
        whiten(whitening[i], J[i])
        whiten(whitening[i], E[i])
        node = index[i]
        for a in range(3):
            x, y = E[i, 0, a], E[i, 1, a]
            v[node, a] += x * r[i, 0] + y * r[i, 1]
            for b in range(3):
                V[node, a, b] += x * E[i, 0, b] + y * E[i, 1, b]
            common = W[node, a]
            for c in range(len(places)):
                common[places[c]] += x * J[i, 0, c] + y * J[i, 1, c]


@compiled
def whiten(whitening: Array, rows: Array) -> None:
    """Multiply two rows of derivatives (2, m) by a point's whitening matrix (2, 2), in place."""
    for c in range(rows.shape[1]):
        x, y = rows[0, c], rows[1, c]
        rows[0, c] = whitening[0, 0] * x + whitening[0, 1] * y
        rows[1, c] = whitening[1, 0] * x + whitening[1, 1] * y


@compiled
def spline_at(places: Array, last: Array, controls: Array, moved: Array, stretched: Array) -> None:
    """Fill in displacements (n, 2), and derivatives (n, 2, 2) of the displaced places by the places.

    places : (n, 2) float64, in pixels. Beyond the frame the displacement is constant; NaN gives NaN.
    last : (2,) float64, the last pixel (x, y) of the frame
    controls : (ny, nx, 2) float64, control points of a regular grid over it
    """
    x, y = np.empty((2, 4)), np.empty((2, 4))
    for n in range(len(places)):
        i = _weights(places[n, 0], last[0], controls.shape[1], x)
        j = _weights(places[n, 1], last[1], controls.shape[0], y)
        for axis in range(2):
            value = along = down = 0.0
            for b in range(4):
                row = slope = 0.0
                for a in range(4):
                    row += x[0, a] * controls[j + b, i + a, axis]
                    slope += x[1, a] * controls[j + b, i + a, axis]
                value += y[0, b] * row
                along += y[0, b] * slope
                down += y[1, b] * row
            moved[n, axis] = value
            stretched[n, axis, 0], stretched[n, axis, 1] = along, down
            stretched[n, axis, axis] += 1.0


@compiled
def add_spline_weights(places: Array, last: Array, nx: int, ny: int, derivative: Array) -> None:
    """Add the derivatives (n, 2, 2 ny nx) of the displacements by the control points; see `spline_at`."""
    x, y = np.empty((2, 4)), np.empty((2, 4))
    for n in range(len(places)):
        i, j = _weights(places[n, 0], last[0], nx, x), _weights(places[n, 1], last[1], ny, y)
        for b in range(4):
            for a in range(4):
                first = 2 * ((j + b) * nx + i + a)
                derivative[n, 0, first] += y[0, b] * x[0, a]
                derivative[n, 1, first + 1] += y[0, b] * x[0, a]


@compiled
def _weights(at: float, last: float, count: int, weights: Array) -> int:
    """Fill in values and slopes (2, 4) of the B-splines that are not 0 at a place of a side; the first one's index."""
    per_px = (count - 3) / last
    t = min(max(at * per_px, 0.0), count - 3.0) if at == at else at
    first = min(int(t), count - 4) if at == at else 0
    t -= first
    weights[0, 0], weights[0, 3] = (1 - t) ** 3 / 6, t**3 / 6
    weights[0, 1], weights[0, 2] = (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6
    scale = per_px if 0 <= at <= last else 0.0
    weights[1, 0], weights[1, 3] = -scale * (1 - t) ** 2 / 2, scale * t**2 / 2
    weights[1, 1], weights[1, 2] = scale * (3 * t**2 - 4 * t) / 2, scale * (-3 * t**2 + 2 * t + 1) / 2
    return first
