"""Overlapping tiles that cover a frame, each with a margin, and blending windows that sum to 1."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Single = npt.NDArray[np.float32]

FADE = 16
"""Samples over which one tile fades into the next."""
DECAY = 12
"""Distance in samples over which the influence of a tile's rim decays."""


@dataclass(frozen=True)
class TileAxis:
    """Tiles along one axis of a frame.

    size : int
        Samples of the frame.
    n : int
        Samples of a tile, even.
    margin : int
        Samples at both ends of a tile that have no weight in any window, even.
    """

    size: int
    n: int
    margin: int

    @property
    def step(self) -> int:
        """Samples from one tile to the next; even, so that a mosaic has the same phase in all tiles."""
        return self.n - 2 * self.margin - FADE

    @property
    def starts(self) -> list[int]:
        """First sample of each tile in the frame; negative for the first tile."""
        count = max(1, -(-self.size // self.step))
        return [k * self.step - FADE // 2 - self.margin for k in range(count)]

    def window(self, start: int) -> Single:
        """Weight of each sample (n,) of the tile in the frame."""
        at = np.arange(self.n) - self.margin
        rise = np.clip((at + 0.5) / FADE, 0, 1)
        fall = rise[::-1]
        place = start + np.arange(self.n)
        first, last = start == self.starts[0], start == self.starts[-1]
        rise = np.where(first, 1.0, rise)
        fall = np.where(last, 1.0, fall)
        inside = (place >= 0) & (place < self.size)
        return np.asarray(rise * fall * inside, dtype=np.float32)


@dataclass(frozen=True)
class TileGrid:
    """Square tiles over a frame of some rows and columns."""

    rows: TileAxis
    columns: TileAxis

    @classmethod
    def over(cls, shape: tuple[int, int], n: int, ring: int) -> "TileGrid":
        """Tiles of n samples with a margin for a ring without data and for the decay of its influence."""
        margin = (ring + DECAY + 1) // 2 * 2
        return cls(TileAxis(shape[0], n, margin), TileAxis(shape[1], n, margin))

    def __iter__(self):  # type: ignore[no-untyped-def]
        """Starts (row, column) of all tiles."""
        return ((row, column) for row in self.rows.starts for column in self.columns.starts)

    def centre(self, start: tuple[int, int]) -> tuple[float, float]:
        """(x, y) of the middle of a tile's part of the frame."""
        return tuple(  # type: ignore[return-value]
            float(np.clip(at + (axis.n - 1) / 2, 0, axis.size - 1))
            for at, axis in ((start[1], self.columns), (start[0], self.rows))
        )
