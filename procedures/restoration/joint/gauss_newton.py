"""Joint Gauss-Newton step over picture and depth, in place of the thesis's alternating descents.

A picture restored with a slightly wrong depth fits the error. A joint step lets each correct the other, and uses the
curvature of both (gradients 6.6 and 6.7 from one pass over the masks).
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Mask
from procedures.restoration.joint.data_term import CONVERGENCE_TOLERANCE, DataTerm, conjugate_gradients
from procedures.restoration.masks.array_loops import add_bending, add_diffusion
from procedures.restoration.masks.blur_operator import Array

LONGEST = 0.3
"""Largest change of w per step, pixels, for which the linearised masks are valid."""
AGILITY = 0.25
"""Factor of w's curvature in the preconditioner: with 0.15 to 0.4 the depth converges farther than with 1 to 2.5 (pairs
without noise: 0.8 and 1.2 grey levels instead of 1.0 and 1.6)."""


@dataclass(frozen=True)
class PriorWeights:
    """Weights of the priors in (6.1), relative to a data term in squared grey values of photographs in [0, 1].

    picture : lambda_u; depth : lambda_w; step : change of w between neighbours, pixels, taken as a depth edge.
    tilt, bend : fractions of lambda_w for squared first and second differences of w: surfaces slope, and a prior of
    first differences alone either flattens them or suppresses less noise.
    """

    picture: float
    depth: float
    step: float = 0.15
    tilt: float = 0.03
    bend: float = 0.75


def joint_step(
    data: DataTerm, u: Array, w: Array, weights: PriorWeights, iterations: int,
    diffusion: tuple[Array | float, Array | float] = (1.0, 1.0),
    edges: tuple[Array | float, Array | float] = (1.0, 1.0), active: Mask | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Picture (C, H + 2R, W + 2R) and depth after one Gauss-Newton step by conjugate gradients; `diffusion`, `edges` :
    the priors' weights on differences; active : (H + 2R, W + 2R), pixels that may change, if not all."""
    data.focus(w)
    e = data.residual(u)
    if active is not None:
        data.focus(w, active)

    def add_smoothing(out: Array, x: Array, y: Array, sign: int) -> Array:
        add_diffusion(out[:-1], x, sign * weights.picture, *diffusion)
        add_diffusion(out[-1], y, sign * weights.depth * weights.tilt, *edges)
        add_bending(out[-1], y, sign * weights.depth * weights.bend, *edges)
        if active is not None:
            out *= active
        return out

    def apply(x: Array) -> Array:
        return add_smoothing(data.change_adjoint(u, data.change(u, x)), x[:-1], x[-1], 1)

    gradient = add_smoothing(data.change_adjoint(u, e), u, w, -1)
    divide = np.empty_like(gradient)
    picture, depth = data.curvature(w)
    divide[:-1] = picture + 4 * weights.picture
    divide[-1] = AGILITY * depth * (u**2).sum(axis=0) + weights.depth * (4 * weights.tilt + 20 * weights.bend)
    x = conjugate_gradients(apply, gradient, iterations, divide, CONVERGENCE_TOLERANCE)
    limit = min(blur.stack.max_w for blur in data.blurs)
    return u + x[:-1], np.clip(w + np.clip(x[-1], -LONGEST, LONGEST), 0, limit)
