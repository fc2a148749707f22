"""The chart: 256 x 256 Bernoulli(0.5) cells framed by x-corners and black and white blocks.

Pattern coordinates are (x, y) in cells, x to the right and y down; the noise fills [0, 256] x [0, 256] and the
cell of row i, column j covers [j, j+1] x [i, i+1]. The frame is made of blocks of 32 cells, ten by ten, from -32
to 288. Geometry: Delbracio, Muse, Almansa, IPOL 2012, section 3.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.display import summary
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter

Cells = npt.NDArray[np.uint8]

CELLS = 256  # cells along one side of the noise region
BLOCK = 32  # cells along one side of a block of the frame
BLOCKS = 10  # blocks along one side of the whole chart; the noise is in blocks 1 to 8
DEFAULT_SEED = 1  # seed of the default chart

# sampling ratio s/t, samples of the PSF per cell; `pattern_psf.gamma` gives the noise amplification over it
AIM_S_OVER_T = 1.3  # target of s/t: gamma is within a few per cent of its minimum
BEST_S_OVER_T = (1.0, 1.5)  # range in which the PSF's error by noise is at most a third above its minimum
GOOD_S_OVER_T = (0.7, 1.8)
"""Range in which it is at most 2.5 times its minimum; at 2 the cells' spectrum has a zero at the band's edge, and gamma
is unbounded."""

# (column, row) of blocks, clockwise from the top left
X_CORNER_BLOCKS = (
    (0, 0), (3, 0), (6, 0), (9, 0),
    (9, 3), (9, 6), (9, 9),
    (6, 9), (3, 9), (0, 9),
    (0, 6), (0, 3),
)  # fmt: skip
BLACK_BLOCKS = (
    (2, 0), (5, 0), (8, 0),
    (9, 2), (9, 5), (9, 8),
    (8, 9), (5, 9), (2, 9),
    (0, 8), (0, 5), (0, 2),
)  # fmt: skip
WHITE_BLOCKS = (
    (1, 0), (4, 0), (7, 0),
    (9, 1), (9, 4), (9, 7),
    (7, 9), (4, 9), (1, 9),
    (0, 7), (0, 4), (0, 1),
)  # fmt: skip


EDGES: Array = np.array([[[320, 0], [345, 256]], [[0, 320], [256, 345]]], dtype=np.float64)
"""Ends (x, y) of the optional slanted edges in cells, (2, 2, 2): right of the chart, and below it.

They are slanted by atan(25 / 256) = 5.6 degrees in opposite directions: a roll that aligns one with an axis does not
align the other.
"""
EDGE_END = 370  # outer limit of the black areas behind the edges, in x or y; the white areas are more than a block wide


def edge_areas() -> Array:
    """Black areas of the slanted edges, (2, 4, 2): corners (x, y) in cells, clockwise on paper."""
    (top, bottom), (left, right) = EDGES
    end = float(EDGE_END)
    return np.array([[top, (end, top[1]), (end, bottom[1]), bottom], [left, right, (right[0], end), (left[0], end)]])


def block_corner(column: int, row: int) -> tuple[float, float]:
    """Pattern coordinates (x, y) of a block's top left corner."""
    return float(BLOCK * (column - 1)), float(BLOCK * (row - 1))


def block_centres(blocks: tuple[tuple[int, int], ...]) -> Array:
    """Pattern coordinates (x, y) of the blocks' centres, (n, 2)."""
    return (np.array(blocks, dtype=np.float64) - 0.5) * BLOCK


X_CORNERS: Array = block_centres(X_CORNER_BLOCKS)
"""The twelve x-corners (x, y) in cells, clockwise from the top left, (12, 2)."""


def triangles() -> Array:
    """Black triangles of the x-corners, (24, 3, 2): each block's upper one, then its lower one."""
    shapes = []
    for column, row in X_CORNER_BLOCKS:
        x, y = block_corner(column, row)
        centre = (x + BLOCK / 2, y + BLOCK / 2)
        for edge in (y, y + BLOCK):
            shapes.append([(x, edge), (x + BLOCK, edge), centre])
    return np.array(shapes, dtype=np.float64)


@dataclass(frozen=True)
class Chart:
    """A chart: its cells, and their seed (None if the cells were given).

    cells : (256, 256) uint8, 1 = white, 0 = black, [row, column]
    edges : bool, whether it has the two slanted edges
    """

    cells: Cells
    seed: int | None = None
    edges: bool = False

    __repr__ = summary

    def __post_init__(self) -> None:
        if self.cells.shape != (CELLS, CELLS):
            raise ValueError(f"the chart has {CELLS} x {CELLS} cells; got {self.cells.shape}")

    @classmethod
    def from_seed(cls, seed: int = DEFAULT_SEED) -> "Chart":
        """Chart of a seed, with the same cells on every machine and in every version.

        The bits are those of SHAKE-256 over the seed's decimal text, most significant first: a standardised function,
        unlike the stream of a random generator, which may change with library releases.
        """
        if not isinstance(seed, int | np.integer) or seed < 0:
            raise BadParameter(
                f"a seed is a whole number, 0 or more; got {seed!r}", "give the one printed on the sheet"
            )
        digest = hashlib.shake_256(f"calibration-station chart {seed}".encode()).digest(CELLS * CELLS // 8)
        bits = np.unpackbits(np.frombuffer(digest, dtype=np.uint8))
        return cls(bits.reshape(CELLS, CELLS), seed)

    @classmethod
    def from_image(cls, image: npt.NDArray[np.generic]) -> "Chart":
        """Chart of a 256 x 256 grey image: white where it exceeds half of its maximum."""
        if image.shape != (CELLS, CELLS):
            raise BadParameter(
                f"the cells come from a {CELLS} x {CELLS} grey image; got shape {image.shape}",
                "give one pixel per cell",
            )
        levels = np.asarray(image, dtype=np.float64)
        return cls((levels > levels.max() / 2).astype(np.uint8))
