"""The chart as it was printed and hangs: what its nodes may deviate from the plan, and how far beforehand.

A print is stretched, sheared and drawn unevenly by its printer, the sheet bends, and every node errs by itself.
Translation, rotation and scale of the whole are no part of it: the first two are the pose's, and a larger chart farther
away looks the same, so that the scale is nobody's to find without a distance that is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STRETCH, UNEVEN, BEND = 0.005, 0.002, 0.02
"""Standard deviations before anything is seen, over half the chart: of stretch and shear, of the quadratic errors in
the plane, and of the sheet's bending out of it."""
NODE_MM = 0.05
"""Standard deviation of a node's own error, in the plane and out of it, where the fit begins."""
LEAST_MM = 1e-4
"""No print is better: keeps the system of an ideal chart solvable."""
NAMES = (
    "stretch", "shear",
    "uneven_x_xx", "uneven_x_xy", "uneven_x_yy", "uneven_y_xx", "uneven_y_xy", "uneven_y_yy",
    "bend_xx", "bend_xy", "bend_yy", "bend_xxx", "bend_xxy", "bend_xyy", "bend_yyy",
)  # fmt: skip
"""The terms: what moves (in the plane along x or y, or out of it) and with which powers of place."""


@dataclass(frozen=True, eq=False)
class ShapeModel:
    """What is known beforehand of a chart's shape.

    Attributes
    ----------
    terms : (N, 3, q) float64
        How the nodes move per mm of every term, most at the chart's rim.
    prior_mm : (q,) float64
        Standard deviations of the terms.
    node_mm : (3,) float64
        Standard deviations of every node's own error along x, y and z; 0 where it has none.
    similarity : (N, 3, 7) float64
        What a pose or another scale does to the nodes, orthonormal: neither terms nor own errors may do it.
    """

    terms: Array
    prior_mm: Array
    node_mm: Array
    similarity: Array


def shape_model(nodes: Array, node_mm: float = NODE_MM) -> ShapeModel:
    """The model for nodes (N, 3) of a flat chart, in mm."""
    half = float(np.abs(nodes[:, :2]).max())
    x, y = (nodes[:, :2] / half).T
    plane = [(x, -y), (y, x), *((one, 0 * x) for one in (x * x, x * y, y * y)),
             *((0 * x, one) for one in (x * x, x * y, y * y))]  # fmt: skip
    bend = [x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3]
    terms = [np.stack([a, b, 0 * x], axis=-1) for a, b in plane] + [np.stack([0 * x, 0 * x, z], axis=-1) for z in bend]
    prior = np.repeat([STRETCH, UNEVEN, BEND], [2, 6, 7]) * half
    return shape_of_terms(nodes, np.stack(terms, axis=-1), prior, node_mm)


def shape_of_terms(nodes: Array, terms: Array, prior_mm: Array, node_mm: float) -> ShapeModel:
    """The model of a board whose nodes (N, 3) move by terms (N, 3, q) of one's own; see `ShapeModel`."""
    basis = _similarity(nodes)
    common = np.einsum("nas,naq->sq", basis, terms)
    return ShapeModel(terms - basis @ common, prior_mm, np.full(3, node_mm), basis)


def rigid_shape(nodes: Array) -> ShapeModel:
    """The model of a chart that is as it should be."""
    return ShapeModel(np.zeros((len(nodes), 3, 0)), np.zeros(0), np.zeros(3), _similarity(nodes))


def own_errors(errors_mm: Array, variance: Array) -> Array:
    """Standard deviations (3,) of the nodes' own errors that explain those found: x and y alike, and z.

    One step of expectation maximisation: the mean of the errors' squares (N, 3), each with its variance.
    """
    squares = errors_mm**2 + variance
    plane, out = float(squares[:, :2].mean()), float(squares[:, 2].mean())
    return np.maximum(np.sqrt([plane, plane, out]), LEAST_MM)


def scale_spread(nodes: Array, node_mm: Array) -> float:
    """Standard deviation of a print's scale as a whole, over it, that the nodes' own errors make.

    Errors e of nodes X are a scale of sum(e X) / sum(X^2). The gauge keeps it out of the errors that are found, as no
    photograph tells it; a distance has it all the same.
    """
    squares = np.sum(nodes**2, axis=0)
    return float(np.sqrt(squares @ node_mm**2) / squares.sum())


def _similarity(nodes: Array) -> Array:
    """Translations, rotations and scale of nodes (N, 3), orthonormal, (N, 3, 7)."""
    moves = [np.broadcast_to(axis, nodes.shape) for axis in np.eye(3)]
    moves += [np.cross(axis, nodes) for axis in np.eye(3)]
    basis = np.linalg.qr(np.stack([*moves, nodes], axis=-1).reshape(-1, 7))[0]
    return np.asarray(basis.reshape(len(nodes), 3, 7))
