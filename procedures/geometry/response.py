"""How a camera's parameters follow the points that they were found from: what ties them to anything else seen there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from procedures.geometry.adjustment import POSE, Adjustment, assemble, jacobian
from procedures.geometry.shape import ShapeModel
from procedures.geometry.views import ChartView

Array = npt.NDArray[np.float64]


def camera_response(found: Adjustment, nodes: Array, views: Sequence[ChartView], shape: ShapeModel) -> list[Array]:
    """Derivative (p, n, 2) of the camera's parameters by the points of every view, poses and chart following.

    A point that moves by d changes the right sides by J' P d and E' P d, P its precision; what the nodes' own errors
    take of that is eliminated as in the adjustment itself.
    """
    state = found.state
    system = assemble(state, nodes, views, shape)
    p, q = len(state.camera.params), len(shape.prior_mm)
    inverse = np.linalg.inv(system.reduced()[0])[:p]
    of_nodes = system.solved(system.W) @ inverse.T  # (N, 3, p)
    answer = []
    for i, view in enumerate(views):
        J, E = jacobian(state, nodes, view, shape, i)
        first = p + q + POSE * i
        places = np.r_[0 : p + q, first : first + POSE]
        moved = J @ inverse[:, places].T - E @ of_nodes[view.index]  # (n, 2, p)
        precision = np.swapaxes(view.whitening, 1, 2) @ view.whitening
        answer.append(np.asarray((precision @ moved).transpose(2, 0, 1)))
    return answer
