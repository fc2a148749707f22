"""Masks that vary over the frame as well as with depth: stacks on a grid of positions, blended bilinearly (6.7).

All functions that take the masks of a photograph accept one stack or a field; one stack is a grid of one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, Concatenate, ParamSpec

import numpy as np
from numpy.typing import NDArray

from procedures.outcome import BadParameter
from procedures.restoration.masks.blur_operator import Array, BlurOperator, FieldBlur, MaskStack, hats

P = ParamSpec("P")
WINDOW = 10
"""Margin in pixels of matching windows around a tile, in addition to the reach of both masks."""


@dataclass(frozen=True)
class MaskField:
    """The masks of one photograph.

    stacks : rows of columns of MaskStack, at equal distances over the frame extended by R, its corners included (see
    `positions`); masks are constant along an axis with one node.

    Raises BadParameter if there are none, rows differ in length, or stacks in half-size, step or number of levels.
    """

    stacks: tuple[tuple[MaskStack, ...], ...]

    def __post_init__(self) -> None:
        if not self.stacks or not self.stacks[0] or len({len(row) for row in self.stacks}) > 1:
            raise BadParameter("a field of masks is a grid: rows of equal length", "give one stack for each node")
        if len({(node.masks.shape, node.step) for node in self.nodes}) > 1:
            raise BadParameter("masks of a field must agree in size, step and levels", "make them with one R and max w")

    @staticmethod
    def of(masks: "Masks") -> "MaskField":
        """One stack as a grid of one; a field unchanged."""
        return masks if isinstance(masks, MaskField) else MaskField(((masks,),))

    @property
    def nodes(self) -> list[MaskStack]:
        """All stacks, row by row."""
        return [one for row in self.stacks for one in row]

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of nodes."""
        return len(self.stacks), len(self.stacks[0])

    @property
    def middle(self) -> MaskStack:
        """The stack nearest to the middle of the frame."""
        return self.stacks[len(self.stacks) // 2][len(self.stacks[0]) // 2]

    @property
    def R(self) -> int:
        """Half-size of the masks, pixels."""
        return self.middle.R

    @property
    def step(self) -> float:
        """Pixels of w between levels."""
        return self.middle.step

    @property
    def max_w(self) -> float:
        """Largest w that can be interpolated, pixels."""
        return self.middle.max_w

    def supports(self) -> NDArray[np.int32]:
        """Half-size of the square outside which the masks of each level are zero everywhere in the frame."""
        return np.asarray(np.max([node.supports() for node in self.nodes], axis=0), dtype=np.int32)

    def at(self, w: float) -> Array:
        """The mask of one w at the frame's centre, which represents the frame in global figures."""
        return self.middle.at(w)

    def near(self, row: float, column: float) -> MaskStack:
        """The stack nearest to a position, as fractions of the frame's height and width."""
        i, j = (round(part * (n - 1)) for part, n in zip((row, column), self.grid, strict=True))
        return self.stacks[i][j]

    def spread(self, grid: tuple[int, int]) -> "MaskField":
        """The field on a larger grid, along axes where it is constant. Raises BadParameter if it varies otherwise."""
        if self.grid == grid:
            return self
        if self.grid != (1, 1):
            raise BadParameter(
                f"grids of masks differ: {self.grid[0]} x {self.grid[1]} and {grid[0]} x {grid[1]}", "use one grid"
            )
        return MaskField(((self.middle,) * grid[1],) * grid[0])

    def blur(self, shape: tuple[int, int], dtype: type[np.floating[Any]]) -> BlurOperator | FieldBlur:
        """The operator on photographs (H, W) of that shape."""
        if self.grid == (1, 1):
            return BlurOperator(self.middle, shape, dtype)
        return FieldBlur([list(row) for row in self.stacks], shape, dtype)


Masks = MaskStack | MaskField


def half_size_at(masks: Masks, w: float) -> int:
    """Half-size of the square outside which the mask of one w is zero everywhere in the frame, pixels."""
    supports = masks.supports()
    return int(supports[min(int(w / masks.step) + 1, len(supports) - 1)])


def positions(grid: tuple[int, int], shape: tuple[int, int], R: int) -> tuple[Array, Array]:
    """Rows y and columns x of a grid's nodes in pixels of the photograph; one node lies in the middle."""
    y, x = (
        np.linspace(-R, size - 1 + R, n) if n > 1 else np.array([(size - 1) / 2])
        for n, size in zip(grid, shape, strict=True)
    )
    return y, x


def one_grid(masks: Sequence[Masks]) -> list[MaskField]:
    """The masks of several photographs on one grid. Raises BadParameter if two of them vary over different grids."""
    fields = [MaskField.of(mask) for mask in masks]
    grid = max((field.grid for field in fields), key=lambda one: one[0] * one[1])
    return [field.spread(grid) for field in fields]


def alike(masks: Sequence[Masks]) -> bool:
    """Whether all photographs have the same masks everywhere."""
    first, *others = one_grid(masks)
    return all(
        a is b or (a.masks.shape == b.masks.shape and np.allclose(a.masks, b.masks, atol=1e-9))
        for other in others
        for a, b in zip(first.nodes, other.nodes, strict=True)
    )


def over_frame(
    of: Callable[Concatenate[Array, Sequence[MaskStack], P], Array],
) -> Callable[Concatenate[Array, Sequence[Masks], P], Array]:
    """Extend a computation with constant masks to masks that vary over the frame.

    of : (z (..., H, W), a stack for each photograph, ...) -> (H, W, ...), local: it is evaluated with the masks of each
    node on the node's surroundings, and the results are blended like the masks.
    """

    @wraps(of)
    def blended(z: Array, masks: Sequence[Masks], /, *args: P.args, **kwargs: P.kwargs) -> Array:
        fields = one_grid(masks)
        rows, columns = fields[0].grid
        if rows == columns == 1:
            return of(z, [one.middle for one in fields], *args, **kwargs)
        total: Array | None = None
        R, shape = fields[0].R, z.shape[-2:]
        down, across = (hats(n, size + 2 * R)[:, R:-R] for n, size in zip((rows, columns), shape, strict=True))
        for i, j in np.ndindex(rows, columns):
            (y, ys), (x, xs) = _tile(down[i], 2 * R + WINDOW), _tile(across[j], 2 * R + WINDOW)
            if y.stop <= y.start or x.stop <= x.start:
                continue
            part = of(z[..., ys, xs], [field.stacks[i][j] for field in fields], *args, **kwargs)
            part = part[y.start - ys.start : y.stop - ys.start, x.start - xs.start : x.stop - xs.start]
            weight = np.outer(down[i, y], across[j, x]).astype(part.dtype)
            if total is None:
                total = np.zeros((*shape, *part.shape[2:]), part.dtype)
            total[y, x] += weight.reshape(*weight.shape, *(1,) * (part.ndim - 2)) * part
        assert total is not None
        return total

    return blended


def _tile(hat: Array, margin: int) -> tuple[slice, slice]:
    """Range of a node's weight along one axis, and that with a margin, both within the frame."""
    inside = np.flatnonzero(hat > 0)
    if not inside.size:
        return slice(0, 0), slice(0, 0)
    start, stop = int(inside[0]), int(inside[-1]) + 1
    return slice(start, stop), slice(max(0, start - margin), min(len(hat), stop + margin))
