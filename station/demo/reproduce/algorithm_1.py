"""Algorithm I of Sorel's thesis with its own solver: alternating minimisation of (6.1) over picture and depth. The
program's restoration replaces it by joint Gauss-Newton steps; the rows compare both with the thesis's numbers."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.joint_descent import problem_of
from procedures.restoration.joint.priors import diffuse, roughness, total_variation
from procedures.restoration.masks.blur_operator import MaskStack

Array = npt.NDArray[np.float64]

LEAST_SLOPE = 0.01
"""Change of w between neighbouring pixels below which total variation is quadratic: epsilon of section 6.3."""
HALVINGS = 6


@dataclass(frozen=True)
class Alternation:
    """The scheme rounds x (picture + depth) + final, and the weights lambda_u (Tikhonov) and lambda_w (TV) of (6.1)."""

    image_weight: float
    depth_weight: float
    rounds: int = 50
    picture: int = 8
    depth: int = 10
    final: int = 100


def data_term(z: Array, stacks: list[MaskStack]) -> DataTerm:
    """The error term of photographs (P, 1, H, W) whose samples are all trusted."""
    return problem_of(z, list(stacks), np.ones((len(z), 1, *z.shape[2:])), np.float32)[0]


def algorithm_1(z: Array, stacks: list[MaskStack], w: Array, p: Alternation) -> tuple[Array, Array]:
    """Picture and depth (H, W) from a first depth: conjugate gradients over the picture, steepest descent over w. The
    step along the gradient of w minimises the linearised cost, and is halved until the cost falls."""
    data = data_term(z, stacks)
    depth = np.pad(w, data.R, mode="edge").astype(np.float32)
    most = np.float32(min(stack.max_w for stack in stacks))
    u = data.mean()
    for _ in range(p.rounds):
        data.focus(depth)
        u = restore_picture(data, u, p.image_weight, p.picture)
        for _ in range(p.depth):
            depth = _descend(data, u, depth, p.depth_weight, most)
    data.focus(depth)
    u = restore_picture(data, u, p.image_weight, p.final)
    inside = np.s_[data.R : -data.R, data.R : -data.R]
    return np.asarray(u[0][inside], np.float64), np.asarray(depth[inside], np.float64)


def _descend(
    data: DataTerm, u: npt.NDArray[np.float32], w: npt.NDArray[np.float32], weight: float, most: np.float32
) -> npt.NDArray[np.float32]:
    """w after a step of steepest descent of the error term and the total variation of w."""
    data.focus(w)
    e = data.residual(u)
    variation = total_variation(w[None], LEAST_SLOPE)
    downhill = data.change_adjoint(u, e)[-1] - np.float32(weight) * diffuse(w, *variation)
    x = np.zeros((len(u) + 1, *w.shape), w.dtype)
    x[-1] = downhill
    change = data.change(u, x)
    slope = float(np.vdot(downhill, downhill))
    step = slope / max(float(np.vdot(change, change)) + 2 * weight * roughness(downhill, *variation), 1e-30)
    before = _cost(data, u, w, weight)
    for _ in range(HALVINGS):
        moved = np.clip(w + np.float32(step) * downhill, 0, most)
        if _cost(data, u, moved, weight) < before:
            return np.asarray(moved, np.float32)
        step /= 2
    return w


def _cost(data: DataTerm, u: npt.NDArray[np.float32], w: npt.NDArray[np.float32], weight: float) -> float:
    data.focus(w)
    e = data.residual(u)
    down, across = np.gradient(w)
    return 0.5 * float(np.vdot(e, e)) + weight * float(np.sum(np.sqrt(down**2 + across**2 + LEAST_SLOPE**2)))
