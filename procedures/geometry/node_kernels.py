"""Inner loop of the adjustment: contribution of a view to the nodes' part of the normal equations."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@compiled
def add_view(
    J: Array, E: Array, r: Array, whitening: Array, index: Indices, places: Indices, V: Array, v: Array, W: Array
) -> None:
    """Whiten J (n, 2, m) and E (n, 2, 3) in place, and add E'E, E'r and E'J to V, v and W of the nodes.

    J, E : (n, 2, m), (n, 2, 3) float64
        Derivatives of the points by the first unknowns and by their nodes.
    r : (n, 2) float64
        Whitened residuals.
    whitening : (n, 2, 2) float64
    index : (n,) int64
        Node of each point.
    places : (m,) int64
        Index of each column of J among the first unknowns.
    V, v, W : (N, 3, 3), (N, 3), (N, 3, M) float64
        See `adjustment.System`.
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
