"""Data term of Algorithm I (6.1): residuals of a pair (picture, depth), and their derivatives."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.masks.array_loops import add_diffusion, advance, turn
from procedures.restoration.masks.blur_operator import Array, BlurOperator, FieldBlur

AnyBlur = BlurOperator | FieldBlur
CONVERGENCE_TOLERANCE = 1e-3
"""Squared preconditioned gradient, relative to the first, at which a joint step ends: a quarter fewer iterations than
the schemes allow, with the same pictures and depths; 1e-2 loses 2 % of depth."""


class DataTerm:
    """Photographs with their blurs: residuals, derivatives and adjoints of all of them at once.

    z : (P, C, H, W) photographs.
    blurs : P blurs of one R.
    trust : (P, 1, H, W) weights of the samples in the data term: 0 where saturated.
    """

    def __init__(self, z: Array, blurs: list[AnyBlur], trust: Array) -> None:
        self.z, self.blurs, self.trust = z, blurs, trust
        self.R = blurs[0].stack.R
        self.extended: tuple[int, int] = blurs[0].extended
        self._all_trusted = bool((trust == 1).all())

    def windowed(self, y: slice, x: slice) -> "DataTerm":
        """The term for a part of the photographs, not focused yet."""
        return DataTerm(self.z[..., y, x], [blur.windowed(y, x) for blur in self.blurs], self.trust[..., y, x])

    def mean(self) -> Array:
        """Mean of the photographs' trusted samples, (C, H + 2R, W + 2R), constant beyond the frame."""
        mean = (self.z * self.trust).sum(axis=0) / np.maximum(self.trust.sum(axis=0), 1e-6)
        return np.pad(mean, ((0, 0), (self.R, self.R), (self.R, self.R)), mode="edge")

    def _weighted(self, e: Array) -> Array:
        return e if self._all_trusted else e * self.trust

    def _seen(self, pictures: list[Array]) -> Array:
        """Weighted samples (P, C, H, W) of blurred pictures, one for each photograph."""
        return self._weighted(np.stack(pictures))

    def _unseen(self, e: Array) -> Iterable[Array]:
        """The adjoint of `_seen`."""
        return self._weighted(e)

    def focus(self, w: Array, active: NDArray[np.bool_] | None = None) -> None:
        """Set w as the depth for every photograph; if given, only `active` pixels send and receive."""
        for blur in self.blurs:
            blur.focus(w, active)

    def blur(self, u: Array) -> Array:
        """Photographs of u, weighted, (P, C, H, W)."""
        return self._seen([blur.blur(u) for blur in self.blurs])

    def blur_adjoint(self, e: Array) -> Array:
        """Gradient over u of <e, weighted photographs of u>, (C, H + 2R, W + 2R)."""
        out = np.zeros((*e.shape[1:-2], *self.extended), e.dtype)
        for blur, a in zip(self.blurs, self._unseen(e), strict=True):
            blur.blur_adjoint(a, out)
        return out

    def curvature(self, w: Array) -> tuple[Array, Array]:
        """Diagonal of the data term's Hessian over the picture, and over w for a picture of 1; both (H', W')."""
        parts = [blur.stack.curvature(w) for blur in self.blurs]
        picture, depth = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
        return picture, depth

    def residual(self, u: Array) -> Array:
        """Weighted photographs minus their prediction, (P, C, H, W)."""
        return self._weighted(self.z) - self.blur(u)

    def change(self, u: Array, x: Array) -> Array:
        """Derivative of the weighted photographs along x = (du..., dw) stacked, (C + 1, H + 2R, W + 2R)."""
        return self._seen([blur.change(u, x[:-1], x[-1]) for blur in self.blurs])

    def change_adjoint(self, u: Array, e: Array) -> Array:
        """Adjoint of `change`, (C + 1, H + 2R, W + 2R)."""
        out = np.zeros((len(u) + 1, *self.extended), u.dtype)
        for blur, a in zip(self.blurs, self._unseen(e), strict=True):
            blur.change_adjoint(u, a, (out[:-1], out[-1]))
        return out


def conjugate_gradients(
    apply: Callable[[Array], Array], gradient: Array, iterations: int, divide: Array | float = 1.0,
    tolerance: float = 0.0,
) -> Array:  # fmt: skip
    """Approximate solution x of A x = gradient, from zero; apply : x -> A x; divide : diagonal preconditioner;
    iterations : at most; tolerance : of the squared preconditioned gradient over the first, at which it ends."""
    x = np.zeros(gradient.shape, gradient.dtype)
    r = gradient.copy()
    plain = np.ndim(divide) == 0 and divide == 1
    y = r if plain else r / divide
    p = y.copy()
    size = first = float(np.vdot(r, y))
    for _ in range(iterations):
        if size <= tolerance * first:
            break
        q = apply(p)
        bend = float(np.vdot(p, q))
        if bend <= 0:
            break
        advance(x, r, p, q, size / bend)
        if not plain:
            np.divide(r, divide, out=y)
        before, size = size, float(np.vdot(r, y))
        turn(p, y, size / before)
    return x


def restore_picture(
    data: DataTerm, u: Array, weight: float, iterations: int,
    diffusion: tuple[Array | float, Array | float] = (1.0, 1.0), divide: Array | float = 1.0,
) -> Array:  # fmt: skip
    """The picture of minimal cost at the data term's depth: conjugate gradients from u (6.6); `diffusion` : weights of
    the prior."""

    def apply(x: Array) -> Array:
        out = data.blur_adjoint(data.blur(x))
        add_diffusion(out, x, weight, *diffusion)
        return out

    downhill = data.blur_adjoint(data.residual(u))
    add_diffusion(downhill, u, -weight, *diffusion)
    return u + conjugate_gradients(apply, downhill, iterations, divide)
