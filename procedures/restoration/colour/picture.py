"""Colour picture and depth of minimal cost: data term of the mosaic, total variation of all colours jointly (6.11).

The unknowns are lightness and two differences of colour, whose gradients are penalised jointly in the prior. Those of
colour have a larger weight, as edges rarely change colour alone: that transfers detail from the sampled colour to the
missing ones. All colours have the same blur, so blurring commutes with this change of variables.
"""

from __future__ import annotations

import numpy as np

from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights, joint_step
from procedures.restoration.joint.priors import differences, steps_allowed, total_variation
from procedures.restoration.joint.schedule import DEPTH_SLOPE
from procedures.restoration.masks.blur_operator import Array, BlurOperator, FieldBlur

CHROMA = 5.0
"""Weight of differences of colour relative to differences of lightness."""
TAU = 0.8
"""Strength of the prior, variance over mean difference, with the best results for simulated grey and colour
pictures."""
LEAST = 0.1
"""Fraction of the mean difference below which total variation is taken as quadratic."""


def mixing() -> Array:
    """Matrix from red, green, blue to lightness and weighted differences of colour: (3, 3)."""
    lightness = np.ones(3) / np.sqrt(3)
    colour = np.array([[1.0, 0.0, -1.0], [1.0, -2.0, 1.0]]) / np.sqrt([[2.0], [6.0]])
    return np.vstack([lightness, CHROMA * colour])


class MosaicTerm(DataTerm):
    """Mosaics (P, 3, H, W), balanced, 0 where not sampled, with their blurs, over pictures (3, H', W') of lightness and
    colour."""

    def __init__(self, z: Array, blurs: list[BlurOperator | FieldBlur], trust: Array) -> None:
        super().__init__(z, blurs, trust)
        self._unmix = np.linalg.inv(mixing()).astype(z.dtype)

    def _seen(self, pictures: list[Array]) -> Array:
        return self.trust * np.stack([np.tensordot(self._unmix, picture, axes=1) for picture in pictures])

    def _unseen(self, e: Array) -> list[Array]:
        return [np.ascontiguousarray(np.tensordot(self._unmix.T, one, axes=1)) for one in self.trust * e]

    def picture_curvature(self, w: Array) -> Array:
        """Diagonal of the Hessian over each of the three unknowns, (3, H', W').

        For joint steps `curvature`, equal for all three, converges better: it lets the colours follow the depth.
        """
        picture, _ = self.curvature(w)
        share = w.dtype.type(np.mean(self.trust**2))
        return np.asarray(share * np.sum(self._unmix**2, axis=0)[:, None, None] * picture)


def with_depth(data: MosaicTerm, u: Array, w: Array, sigma: float, rounds: int, iterations: int) -> tuple[Array, Array]:
    """Picture u (3, H', W') of lightness and differences, and depth w, after joint steps; sigma : the photographs'
    noise."""
    for _ in range(rounds):
        strength, diffusion = prior_of(u, sigma)
        weights = PriorWeights(strength, sigma**2 / DEPTH_SLOPE**2)
        u, w = joint_step(data, u, w, weights, iterations, diffusion, steps_allowed(w, weights.step))
    return u, w


def alone(data: MosaicTerm, u: Array, w: Array, sigma: float, rounds: int, iterations: int) -> Array:
    """The picture at a depth, with a number of relinearisations (6.10) of its prior."""
    data.focus(w)
    curvature = data.picture_curvature(w)
    for _ in range(rounds):
        strength, diffusion = prior_of(u, sigma)
        divide = curvature + u.dtype.type(4 * strength)
        u = restore_picture(data, u, strength, iterations, diffusion, divide)
    return u


def prior_of(u: Array, sigma: float) -> tuple[float, tuple[Array, Array]]:
    """Strength of the quadratic prior that approximates total variation at u, and its weights on differences."""
    mean = max(mean_difference(u[:1]), 1e-5)
    down, across = (u.dtype.type(mean) * one.astype(u.dtype) for one in total_variation(u, LEAST * mean))
    return TAU * sigma**2 / mean**2, (down, across)


def mean_difference(u: Array) -> float:
    """Mean length of the differences of channels (C, H, W)."""
    down, across = differences(u)
    squares = (down[:, :, :-1] ** 2).sum(axis=0) + (across[:, :-1] ** 2).sum(axis=0)
    return float(np.sqrt(squares).mean())
