"""Sparse derivative of the samples by the offsets of printed edges: a few lines of each direction per sample."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.compiled import vectorised

Indices = npt.NDArray[np.int32]


@vectorised
def apply_edges(
    vertical: Array32, first_vertical: Indices, horizontal: Array32, first_horizontal: Indices, offsets: Array32
) -> Array32:
    """C offsets, (m,), of `printed_edges.EdgeColumns`."""
    out, lines = np.empty(len(vertical), np.float32), len(offsets) // 2
    for p in range(len(vertical)):
        total = np.float32(0)
        for a in range(min(vertical.shape[1], lines - first_vertical[p])):
            total += vertical[p, a] * offsets[first_vertical[p] + a]
        for a in range(min(horizontal.shape[1], lines - first_horizontal[p])):
            total += horizontal[p, a] * offsets[lines + first_horizontal[p] + a]
        out[p] = total
    return out


@vectorised
def apply_edges_transposed(
    vertical: Array32, first_vertical: Indices, horizontal: Array32, first_horizontal: Indices, samples: Array32,
    lines: int,
) -> Array32:  # fmt: skip
    """C' samples, (2 lines,)."""
    out = np.zeros(2 * lines, np.float32)
    for p in range(len(vertical)):
        for a in range(min(vertical.shape[1], lines - first_vertical[p])):
            out[first_vertical[p] + a] += vertical[p, a] * samples[p]
        for a in range(min(horizontal.shape[1], lines - first_horizontal[p])):
            out[lines + first_horizontal[p] + a] += horizontal[p, a] * samples[p]
    return out


@vectorised
def edge_gram(
    vertical: Array32, first_vertical: Indices, horizontal: Array32, first_horizontal: Indices, lines: int
) -> Array32:
    """Lower half of C'C, (2 lines, 2 lines)."""
    G = np.zeros((2 * lines, 2 * lines), np.float32)
    for p in range(len(vertical)):
        i, j = first_vertical[p], lines + first_horizontal[p]
        across, down = min(vertical.shape[1], lines - i), min(horizontal.shape[1], 2 * lines - j)
        for a in range(across):
            value, row = vertical[p, a], G[i + a]
            for b in range(a + 1):
                row[i + b] += value * vertical[p, b]
        for a in range(down):
            value, row = horizontal[p, a], G[j + a]
            for b in range(across):
                row[i + b] += value * vertical[p, b]
            for b in range(a + 1):
                row[j + b] += value * horizontal[p, b]
    return G


@vectorised
def edge_lines(
    cells: Array, steps: Array32, fine: Array32, scale: Array, reach: Array, pieces: int, weight: Array32
) -> tuple[Array32, Indices]:
    """Values (m, width) of the vertical lines around each sample, and the first line of each (m,); `steps` (257, 256)
    is the chart's step over each line, `scale` takes cells to samples of `fine`."""
    m = len(cells)
    n = steps.shape[1]
    middle = fine.shape[0] // 2
    last = fine.shape[0]
    width = 2 * int(np.ceil(reach[0])) + 1
    values = np.zeros((m, width), np.float32)
    first = np.empty(m, np.int32)
    for p in range(m):
        u, v = cells[p, 0], cells[p, 1]
        j0 = min(max(int(np.floor(u - reach[0])), 0), n)
        i0, i1 = max(int(v - reach[1]), 0), min(int(v + reach[1]) + 1, n)
        first[p] = j0
        for j in range(j0, min(j0 + width, n + 1)):
            # the line's points in samples of `fine`, rounded by the half that is added
            x = scale[0, 0] * (u - j) + scale[0, 1] * (v - i0 - 0.5 / pieces) + middle + 0.5
            y = scale[1, 0] * (u - j) + scale[1, 1] * (v - i0 - 0.5 / pieces) + middle + 0.5
            total, line = np.float32(0), steps[j]
            for i in range(i0, i1):
                for _ in range(pieces):
                    if x >= 0 and y >= 0 and x < last and y < last:
                        total += line[i] * fine[int(y), int(x)]
                    x -= scale[0, 1] / pieces
                    y -= scale[1, 1] / pieces
            values[p, j - j0] = total * weight[p] / pieces
    return values, first
