"""Shape of the printed chart: deviations of its nodes from the plan, and their prior.

A print is stretched, sheared and uneven, the sheet bends, and every node has an error of its own. Translation, rotation
and scale are excluded: the first two belong to the pose, and a larger chart at a larger distance has the same image, so
that the scale cannot be estimated without a known distance.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array

STRETCH, UNEVEN, BEND = 0.005, 0.002, 0.02
"""Prior standard deviations relative to half the chart: of stretch and shear, of quadratic errors in the plane, and of
bending out of it."""
NODE_MM = 0.05  # initial standard deviation of the node errors, in the plane and out of it
LEAST_MM = 1e-4  # lower limit of that standard deviation: keeps the system of an ideal chart solvable
NAMES = (
    "stretch", "shear",
    "uneven_x_xx", "uneven_x_xy", "uneven_x_yy", "uneven_y_xx", "uneven_y_xy", "uneven_y_yy",
    "bend_xx", "bend_xy", "bend_yy", "bend_xxx", "bend_xxy", "bend_xyy", "bend_yyy",
)  # fmt: skip
"""The terms: direction of the displacement (x or y in the plane, or out of it), and powers of the position."""


@dataclass(frozen=True, eq=False)
class ShapeModel:
    """Prior of a chart's shape.

    terms : (N, 3, q) float64, displacement of the nodes per mm of every term, 1 at the chart's edge
    prior_mm : (q,) float64, standard deviations of the terms
    node_mm : (3,) float64, standard deviations of the node errors along x, y and z; 0 without node errors
    similarity : (N, 3, 7) float64
        Orthonormal displacements by a change of pose or scale, excluded from terms and node errors.
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
    """The model of a board with nodes (N, 3) and given terms (N, 3, q); see `ShapeModel`."""
    basis = _similarity(nodes)
    common = np.einsum("nas,naq->sq", basis, terms)
    return ShapeModel(terms - basis @ common, prior_mm, np.full(3, node_mm), basis)


def rigid_shape(nodes: Array) -> ShapeModel:
    """The model of an ideal chart."""
    return ShapeModel(np.zeros((len(nodes), 3, 0)), np.zeros(0), np.zeros(3), _similarity(nodes))


def estimated_node_errors(errors_mm: Array, variance: Array) -> Array:
    """Standard deviations (3,) of the node errors, equal for x and y, from the estimated errors (N, 3).

    One step of expectation maximisation: the mean of the squared errors, each plus its variance.
    """
    squares = errors_mm**2 + variance
    plane, out = float(squares[:, :2].mean()), float(squares[:, 2].mean())
    return np.maximum(np.sqrt([plane, plane, out]), LEAST_MM)


def scale_spread(nodes: Array, node_mm: Array) -> float:
    """Relative standard deviation of the scale of a print due to the node errors.

    Errors e of nodes X contain a scale of sum(e X) / sum(X^2). The gauge excludes it from the estimated errors, since
    photographs do not determine it; distances are affected nevertheless.
    """
    squares = np.sum(nodes**2, axis=0)
    return float(np.sqrt(squares @ node_mm**2) / squares.sum())


def _similarity(nodes: Array) -> Array:
    """Translations, rotations and scaling of nodes (N, 3), orthonormalised, (N, 3, 7)."""
    moves = [np.broadcast_to(axis, nodes.shape) for axis in np.eye(3)]
    moves += [np.cross(axis, nodes) for axis in np.eye(3)]
    basis = np.linalg.qr(np.stack([*moves, nodes], axis=-1).reshape(-1, 7))[0]
    return np.asarray(basis.reshape(len(nodes), 3, 7))
