"""Space-variant convolution and correlation with stored masks, and their derivatives with respect to depth.

The sharp picture u and the depth w live on the photograph's grid extended by R pixels on each side, so that every
photographed pixel has all light that reached it and no boundary condition is needed.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.masks.array_loops import in_bands, threads_for
from procedures.restoration.masks.kernels import gather, pairs_of, spread

Array = NDArray[np.floating[Any]]

WORK_PER_THREAD = 20_000_000
"""Products of a mask's entry and a pixel that occupy a thread for some milliseconds."""


@dataclass(frozen=True)
class MaskStack:
    """Masks h(k step), k = 0, 1, ..., with linear interpolation (6.8).

    masks : (L, K, K) of sum 1, K = 2R + 1 odd, mask[R + t, R + s] = h(s, t); step in pixels of w.
    """

    masks: Array
    step: float

    @property
    def R(self) -> int:
        """Half-size of the masks, pixels."""
        return int(self.masks.shape[1] // 2)

    @property
    def max_w(self) -> float:
        """Largest w that can be interpolated, pixels."""
        return float((len(self.masks) - 1) * self.step)

    def at(self, w: float) -> Array:
        """The mask of one w, interpolated: (K, K)."""
        k = min(int(w / self.step), len(self.masks) - 2)
        f = w / self.step - k
        mask: Array = (1 - f) * self.masks[k] + f * self.masks[k + 1]
        return mask

    def curvature(self, w: Array) -> tuple[Array, Array]:
        """Sums of squares of the mask of every w, and of its derivative with respect to w."""
        slopes = np.diff(self.masks, axis=0) / self.step
        levels = np.arange(len(self.masks)) * self.step
        powers = [np.sum(m**2, axis=(1, 2)) for m in (self.masks, np.concatenate([slopes, slopes[-1:]]))]
        masks, changes = (np.interp(w, levels, power).astype(w.dtype) for power in powers)
        return masks, changes

    def supports(self) -> NDArray[np.int32]:
        """Half-size of the square outside which each mask is zero, non-decreasing with w."""
        used = self.masks != 0
        distance = np.abs(np.arange(-self.R, self.R + 1))
        farthest = np.max(distance * (used.any(axis=1) | used.any(axis=2)), axis=1)
        return np.maximum.accumulate(farthest).astype(np.int32)


class BlurOperator:
    """One photograph's masks, focused on a depth map, applied to any number of channels.

    shape : (H, W) of the photograph; w is (H + 2R, W + 2R), u is (..., H + 2R, W + 2R).
    dtype : float32 or float64, of all arrays.
    """

    def __init__(self, stack: MaskStack, shape: tuple[int, int], dtype: type[np.floating[Any]] = np.float64) -> None:
        self.stack, self.shape, self.dtype = stack, shape, dtype
        self._pairs = pairs_of(stack.masks, dtype)
        self._work = self._pairs.width * (self._pairs.last - self._pairs.first + 1)
        R, widest = stack.R, int(self._pairs.width.max())
        self.extended = (shape[0] + 2 * R, shape[1] + 2 * R)
        self._drawn = np.zeros(shape[0] * (self.extended[1] + widest), dtype)
        # pixels are processed in pairs, and the second may lie below the last row
        self._errors = np.zeros((shape[0] + 4 * R + 1, self.extended[1] + widest), dtype)
        left = R + widest // 2
        self._photograph = self._errors[2 * R : 2 * R + shape[0], left : left + shape[1]]
        self.focus(np.zeros(self.extended, dtype))

    def windowed(self, y: slice, x: slice) -> "BlurOperator":
        """The blur of a part of the photograph, not focused yet."""
        return BlurOperator(self.stack, (y.stop - y.start, x.stop - x.start), self.dtype)

    def focus(self, w: Array, active: NDArray[np.bool_] | None = None) -> None:
        """Set w, pixels, clipped to the stack, as the depth; pixels not `active` take no part until the next call."""
        scaled = np.clip(w, 0, self.stack.max_w) / self.stack.step
        self.level = np.minimum(scaled.astype(np.int32), len(self.stack.masks) - 2)
        self.f = (scaled - self.level).astype(self.dtype)
        pixels = self._work[self.level]
        if active is not None:
            self.level[~active], pixels[~active] = -1, 0
        work = pixels.sum(axis=1)
        threads = threads_for(int(work.sum()) // WORK_PER_THREAD)
        R = self.stack.R
        self._bands, self._rows = _bands(work, threads), _bands(work[R : R + self.shape[0]], threads)

    def _spread(self, x: Array, u: Array, dw: Array | None, rate: float) -> Array:
        """Photographs of x (..., H + 2R, W + 2R) at this depth, and of the change of u with w."""
        out = np.empty((*x.shape[:-2], *self.shape), self.dtype)
        at = (self.level, self.f, self._pairs, self._drawn)
        for n in np.ndindex(x.shape[:-2]):
            coefficients = (x[n], u[n], x[n] if dw is None else dw, self.dtype(rate))
            in_bands(partial(spread, *coefficients, *at, out[n]), self._rows)
        return out

    def _gather(self, e: Array, u: Array, rate: float, dx: Array, dw: Array | None) -> None:
        """Add the adjoint of `_spread` to dx, and to dw if given."""
        at = (self._errors, self.level, self.f, self._pairs)
        for n in np.ndindex(e.shape[:-2]):
            self._photograph[:] = e[n]
            to = (dx[n], dx[n] if dw is None else dw)
            in_bands(partial(gather, *at, u[n], self.dtype(rate), *to), self._bands)

    def blur(self, u: Array) -> Array:
        """Space-variant convolution u *v h(w), (..., H, W): equation (3.1)."""
        u = np.ascontiguousarray(u, self.dtype)
        return self._spread(u, u, None, 0.0)

    def blur_adjoint(self, e: Array, into: Array | None = None) -> Array:
        """Space-variant correlation of e with h(w), (..., H + 2R, W + 2R): equation (3.2); added to `into` if given."""
        out = np.zeros((*e.shape[:-2], *self.extended), self.dtype) if into is None else into
        self._gather(e, out, 0.0, out, None)
        return out

    def change(self, u: Array, du: Array, dw: Array) -> Array:
        """First-order change of the photograph for changes du and dw of u and w, (..., H, W)."""
        u, du, dw = (np.ascontiguousarray(x, self.dtype) for x in (u, du, dw))
        return self._spread(du, u, dw, 1 / self.stack.step)

    def change_adjoint(self, u: Array, e: Array, into: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """Add the gradients of <e, change> by du (6.6), and by dw, summed over channels (6.7), to `into` or zeros."""
        u = np.ascontiguousarray(u, self.dtype)
        du, dw = (np.zeros_like(u), np.zeros(self.extended, self.dtype)) if into is None else into
        self._gather(e, u, 1 / self.stack.step, du, dw)
        return du, dw


class FieldBlur:
    """A blur whose masks also vary over the frame: stacks on a grid of positions, blended bilinearly.

    Same methods as `BlurOperator`. Each node acts on its neighbourhood only.

    stacks : rows of columns of MaskStack of equal R and step, at equal distances over the frame, corners included;
    shape : (H, W) of the photograph.
    """

    def __init__(
        self, stacks: list[list[MaskStack]], shape: tuple[int, int], dtype: type[np.floating[Any]] = np.float64
    ) -> None:
        self.stack, self.dtype, self._stacks = stacks[len(stacks) // 2][len(stacks[0]) // 2], dtype, stacks
        R = self.stack.R
        self._lay(hats(len(stacks), shape[0] + 2 * R), hats(len(stacks[0]), shape[1] + 2 * R))

    def _lay(self, rows: Array, columns: Array) -> None:
        """Set the weights of each row and each column of nodes, (n, H + 2R) and (m, W + 2R)."""
        R = self.stack.R
        self.extended = (rows.shape[1], columns.shape[1])
        self.shape = (self.extended[0] - 2 * R, self.extended[1] - 2 * R)
        self._rows, self._columns = rows, columns
        self._nodes = [
            self._node(stack, row, column)
            for line, row in zip(self._stacks, rows, strict=True)
            for stack, column in zip(line, columns, strict=True)
            if row.any() and column.any()
        ]

    def windowed(self, y: slice, x: slice) -> "FieldBlur":
        """The blur of a part of the photograph, not focused yet."""
        R, part = self.stack.R, copy(self)
        part._lay(self._rows[:, y.start : y.stop + 2 * R], self._columns[:, x.start : x.stop + 2 * R])
        return part

    def _node(self, stack: MaskStack, row: Array, column: Array) -> tuple[BlurOperator, Array, slice, slice]:
        R = stack.R
        y0, y1 = _reach(row, R, self.shape[0])
        x0, x1 = _reach(column, R, self.shape[1])
        window = np.outer(row[y0 : y1 + 2 * R], column[x0 : x1 + 2 * R]).astype(self.dtype)
        return BlurOperator(stack, (y1 - y0, x1 - x0), self.dtype), window, slice(y0, y1), slice(x0, x1)

    def _around(self, y: slice, x: slice) -> Any:
        R = self.stack.R
        return ..., slice(y.start, y.stop + 2 * R), slice(x.start, x.stop + 2 * R)

    def focus(self, w: Array, active: NDArray[np.bool_] | None = None) -> None:
        """Set w, pixels, as the depth of the `active` pixels."""
        for node, window, y, x in self._nodes:
            at, counts = self._around(y, x), window > 0
            node.focus(w[at], counts if active is None else counts & active[at])

    def _photograph(self, of: Callable[[BlurOperator, Array, Any], Array], channels: tuple[int, ...]) -> Array:
        """The sum of the nodes' photographs, of(node, window, its part of the extended grid)."""
        out = np.zeros((*channels, *self.shape), self.dtype)
        for node, window, y, x in self._nodes:
            out[..., y, x] += of(node, window, self._around(y, x))
        return out

    def blur(self, u: Array) -> Array:
        """Space-variant convolution (3.1) with masks of position and depth."""
        return self._photograph(lambda node, window, at: node.blur(window * u[at]), u.shape[:-2])

    def blur_adjoint(self, e: Array, into: Array | None = None) -> Array:
        """Space-variant correlation (3.2), the adjoint of `blur`, added to `into` if given."""
        out = np.zeros((*e.shape[:-2], *self.extended), self.dtype) if into is None else into
        for node, window, y, x in self._nodes:
            out[self._around(y, x)] += window * node.blur_adjoint(e[..., y, x])
        return out

    def change(self, u: Array, du: Array, dw: Array) -> Array:
        """First-order change of the photograph with u and w."""
        return self._photograph(
            lambda node, window, at: node.change(window * u[at], window * du[at], dw[at]), u.shape[:-2]
        )

    def change_adjoint(self, u: Array, e: Array, into: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
        """Gradients of <e, change> with respect to du and dw, added to `into` if given."""
        du, dw = (np.zeros_like(u), np.zeros(self.extended, self.dtype)) if into is None else into
        for node, window, y, x in self._nodes:
            at = self._around(y, x)
            a, b = node.change_adjoint(window * u[at], e[..., y, x])
            du[at] += window * a
            dw[at] += b
        return du, dw


def _bands(work: NDArray[np.int64], n: int) -> list[int]:
    """Limits of n bands of rows of about equal work, 0 .. rows; even, so that the same pairs of rows are processed."""
    done = np.concatenate([[0], np.cumsum(work)])
    limits = np.searchsorted(done, np.arange(1, n) / n * done[-1]) // 2 * 2
    return [0, *limits.tolist(), len(work)]


def hats(n: int, size: int) -> Array:
    """Linear interpolation weights of n equidistant nodes over `size` samples, (n, size)."""
    if n == 1:
        return np.ones((1, size))
    position = np.linspace(0, n - 1, size)
    return np.asarray(np.clip(1 - np.abs(position[None, :] - np.arange(n)[:, None]), 0, None))


def _reach(hat: Array, R: int, size: int) -> tuple[int, int]:
    """Photographed samples within reach of the extended samples with non-zero weight."""
    inside = np.flatnonzero(hat)
    return max(0, int(inside[0]) - 2 * R), min(size, int(inside[-1]) + 1)
