"""The cost of Algorithm I (6.1): how photographs and a pair (picture, depth) disagree, and how that changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.forward import Array, Blur, FieldBlur
from procedures.restoration.priors import diffuse

AnyBlur = Blur | FieldBlur


class DataTerm:
    """Photographs with their blurs: residuals, changes and adjoints of all of them at once.

    Parameters
    ----------
    z : (P, C, H, W) photographs.
    blurs : P blurs, all of one R.
    trust : (P, 1, H, W) weights of the samples in the data term: 0 where saturated.
    """

    def __init__(self, z: Array, blurs: list[AnyBlur], trust: Array) -> None:
        self.z, self.blurs, self.trust = z, blurs, trust
        self.R = blurs[0].stack.R
        self.extended: tuple[int, int] = blurs[0].extended

    def focus(self, w: Array, active: NDArray[np.bool_] | None = None) -> None:
        """Take w as the depth of every photograph; only `active` pixels send and receive, if given."""
        for blur in self.blurs:
            blur.focus(w, active)

    def blur(self, u: Array) -> Array:
        """Photographs of u, weighted, (P, C, H, W)."""
        return np.stack([blur.blur(u) for blur in self.blurs]) * self.trust

    def blur_adjoint(self, e: Array) -> Array:
        """Gradient over u of <e, weighted photographs of u>, (C, H + 2R, W + 2R)."""
        return np.asarray(sum(blur.blur_adjoint(a) for blur, a in zip(self.blurs, e * self.trust, strict=True)))

    def residual(self, u: Array) -> Array:
        """Weighted photographs minus their prediction, (P, C, H, W)."""
        return self.z * self.trust - self.blur(u)

    def change(self, u: Array, x: Array) -> Array:
        """Change of the weighted photographs for x = (du..., dw) stacked, (C + 1, H + 2R, W + 2R)."""
        return np.stack([blur.change(u, x[:-1], x[-1]) for blur in self.blurs]) * self.trust

    def change_adjoint(self, u: Array, e: Array) -> Array:
        """Adjoint of `change`, (C + 1, H + 2R, W + 2R)."""
        out = np.zeros((len(u) + 1, *self.extended), u.dtype)
        for blur, a in zip(self.blurs, e * self.trust, strict=True):
            du, dw = blur.change_adjoint(u, a)
            out[:-1] += du
            out[-1] += dw
        return out


def inner(a: Array, b: Array) -> float:
    """Scalar product of two arrays."""
    return float(np.vdot(a, b))


def conjugate_gradients(
    apply: Callable[[Array], Array], gradient: Array, iterations: int, divide: Array | float = 1.0
) -> Array:
    """Approximate solution x of A x = gradient, from zero.

    apply : x -> A x, symmetric, positive; divide : diagonal preconditioner.
    """
    x = np.zeros_like(gradient)
    r = gradient.copy()
    y = r / divide
    p = y.copy()
    size = inner(r, y)
    for _ in range(iterations):
        if size <= 0:
            break
        q = apply(p)
        bend = inner(p, q)
        if bend <= 0:
            break
        x += (size / bend) * p
        r -= (size / bend) * q
        y = r / divide
        before, size = size, inner(r, y)
        p *= size / before
        p += y
    return x


def restored_change(
    data: DataTerm,
    u: Array,
    e: Array,
    weight: float,
    iterations: int,
    around: Array | float = 1.0,
    diffusion: tuple[Array | float, Array | float] = (1.0, 1.0),
) -> Array:
    """Change of the picture that lowers the cost of errors e, by conjugate gradients; zero where `around` is zero."""

    def apply(x: Array) -> Array:
        return data.blur_adjoint(data.blur(x)) + around * (weight * diffuse(x, *diffusion))

    gradient = around * (data.blur_adjoint(e) - weight * diffuse(u, *diffusion))
    return conjugate_gradients(apply, gradient, iterations)


def restore_picture(
    data: DataTerm,
    u: Array,
    weight: float,
    iterations: int,
    diffusion: tuple[Array | float, Array | float] = (1.0, 1.0),
) -> Array:
    """The picture of least cost at the depth the data term is focused on: conjugate gradients from u (6.6).

    `diffusion` are the picture prior's weights on differences.
    """
    return u + restored_change(data, u, data.residual(u), weight, iterations, 1.0, diffusion)
