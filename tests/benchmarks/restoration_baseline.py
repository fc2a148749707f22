"""Algorithm I as published (Sorel 2007, p. 41): conjugate gradients for the picture, then steepest descent for w.

The step along a direction of descent is found by bisection of the cost's slope. What `restore` is compared with.
"""

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import DataTerm, inner, restore_picture
from procedures.restoration.joint.priors import diffuse
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks.blur_operator import MaskStack

Array = NDArray[np.floating]
# weights the thesis works with; w in pixels as there
PICTURE, FINAL_PICTURE, DEPTH = 1e-3, 1e-4, 1e-4
# longest step of bisection, pixels of w at the steepest place, and halvings of it
LONGEST, HALVINGS = 1.0, 6


def descent(z: Array, stacks: list[MaskStack], w: Array, scheme: Scheme, final: float) -> tuple[Array, Array]:
    """Picture (C, H, W) and depth (H, W) from photographs (P, C, H, W) and a first depth, Tikhonov for both.

    final : lambda_u of the last minimisation over the picture.
    """
    data, _ = joint_descent.problem_of(z, stacks, np.ones((len(z), 1, *w.shape)), np.float32)
    R = data.R
    w = np.pad(w, R, mode="edge").astype(np.float32)
    u = np.pad(z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float32)
    for _ in range(scheme.rounds):
        data.focus(w)
        u = restore_picture(data, u, PICTURE, scheme.picture)
        for _ in range(scheme.depth):
            w = _descended(data, u, w)
    data.focus(w)
    for _ in range(scheme.final_rounds):
        u = restore_picture(data, u, final, scheme.final)
    return u[:, R:-R, R:-R], w[R:-R, R:-R]


def _slope(data: DataTerm, u: Array, w: Array) -> Array:
    """Gradient of the cost (6.1) over w: equation (6.7) and the prior's."""
    data.focus(w)
    return np.asarray(DEPTH * diffuse(w) - data.change_adjoint(u, data.residual(u))[-1])


def _descended(data: DataTerm, u: Array, w: Array) -> Array:
    """w after one step of steepest descent, its length found by bisection."""
    direction = -_slope(data, u, w)
    low, high = 0.0, LONGEST / max(float(np.abs(direction).max()), 1e-12)
    limit = data.blurs[0].stack.max_w
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        downhill = inner(_slope(data, u, np.clip(w + np.float32(middle) * direction, 0, limit)), direction) < 0
        low, high = (middle, high) if downhill else (low, middle)
    return np.clip(w + np.float32(low) * direction, 0, limit)
