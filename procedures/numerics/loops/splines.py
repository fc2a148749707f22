"""Cubic B-splines of band-limited images: their spectra, and their values through a smooth map."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.compiled import vectorised

Complex64 = npt.NDArray[np.complex64]


@vectorised
def add_band(
    cut: Complex64, spectrum: Complex64, filter_y: Complex64, filter_x: Complex64, J: Array, limit: float
) -> None:
    """Add a lattice's spectrum (n, n), repeated and filtered, inside the band; the filters' frequencies are centred
    along y and begin with zero along x."""
    n, last = len(spectrum), len(filter_y) // 2
    bound = limit * n
    for i in range(len(filter_y)):
        ky = i - last
        row, line, along_y = cut[ky], spectrum[ky % n], filter_y[i]
        for kx in range(len(filter_x)):
            if abs(J[0, 0] * kx + J[1, 0] * ky) <= bound and abs(J[0, 1] * kx + J[1, 1] * ky) <= bound:
                row[kx] += line[kx % n] * along_y * filter_x[kx]


@vectorised
def _cubic_weights(t: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """The four values of the cubic B-spline at -1 - t, -t, 1 - t, 2 - t."""
    a = np.float32(1) - t
    w0 = a * a * a * np.float32(1 / 6)
    w3 = t * t * t * np.float32(1 / 6)
    w1 = np.float32(2 / 3) - t * t * (np.float32(1) - np.float32(0.5) * t)
    return w0, w1, np.float32(1) - w0 - w1 - w3, w3


@vectorised
def _row(
    out: Array32, flat: Array32, line: int, first: npt.NDArray[np.int64], t_x: Array32, t_y: Array32,
    weights: Array32, sums: Array32,
) -> None:  # fmt: skip
    """A row of values (n,), from their first coefficients and fractional positions; `line` is the length of a row.

    `weights` (8, n) and `sums` (4 n,) are scratch arrays: separate loops over the weights, the sums of four columns and
    the result vectorise.
    """
    down, across = weights[:4], weights[4:]
    for j in range(len(out)):
        down[0, j], down[1, j], down[2, j], down[3, j] = _cubic_weights(t_y[j])
        across[0, j], across[1, j], across[2, j], across[3, j] = _cubic_weights(t_x[j])
    for j in range(len(out)):
        y0, y1, y2, y3 = down[0, j], down[1, j], down[2, j], down[3, j]
        a = np.uint64(first[j])  # unsigned: no test for negative indices
        b, c, d = a + np.uint64(line), a + np.uint64(2 * line), a + np.uint64(3 * line)
        to = np.uint64(4 * j)
        for n in range(4):
            m = np.uint64(n)
            sums[to + m] = y0 * flat[a + m] + y1 * flat[b + m] + y2 * flat[c + m] + y3 * flat[d + m]
    for j in range(len(out)):
        left = across[0, j] * sums[4 * j] + across[1, j] * sums[4 * j + 1]
        out[j] = left + across[2, j] * sums[4 * j + 2] + across[3, j] * sums[4 * j + 3]


@vectorised
def read_spline(
    coefficients: Array32, H: Array, centre: Array, radius: float, displacement: Array, start: Array, step: float,
    shape: tuple[int, int],
) -> Array32:  # fmt: skip
    """See `procedures.numerics.splines.read_spline`."""
    rows, columns = shape
    n_y, n_x = coefficients.shape
    flat = coefficients.ravel()
    out = np.empty((rows, columns), np.float32)
    weights, sums = np.empty((8, columns), np.float32), np.empty(4 * columns, np.float32)
    # a row's positions first, in a loop of plain arithmetic that vectorises
    t_x, t_y, first = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.int64)
    c = displacement
    for i in range(rows):
        py = start[1] + i * step
        y = (py - centre[1]) / radius
        # the two cubics of x along this row, by their coefficients
        u0, v0 = y * (c[0, 1] + y * (c[0, 4] + y * c[0, 8])), y * (c[1, 1] + y * (c[1, 4] + y * c[1, 8]))
        u1, v1 = c[0, 0] + y * (c[0, 3] + y * c[0, 7]), c[1, 0] + y * (c[1, 3] + y * c[1, 7])
        u2, v2 = c[0, 2] + y * c[0, 6], c[1, 2] + y * c[1, 6]
        u3, v3 = c[0, 5], c[1, 5]
        for j in range(columns):
            px = start[0] + j * step
            x = (px - centre[0]) / radius
            qx = px + u0 + x * (u1 + x * (u2 + x * u3))
            qy = py + v0 + x * (v1 + x * (v2 + x * v3))
            w = 1.0 / (H[2, 0] * qx + H[2, 1] * qy + H[2, 2])
            gx = min(max((H[0, 0] * qx + H[0, 1] * qy + H[0, 2]) * w, 1.0), n_x - 2.001)
            gy = min(max((H[1, 0] * qx + H[1, 1] * qy + H[1, 2]) * w, 1.0), n_y - 2.001)
            ix, iy = np.int32(gx), np.int32(gy)
            t_x[j], t_y[j], first[j] = gx - ix, gy - iy, (iy - 1) * np.int64(n_x) + ix - 1
        _row(out[i], flat, n_x, first, t_x, t_y, weights, sums)
    return out


@vectorised
def folded_product(transform: npt.NDArray[np.complex64], spectrum: Array32, s: int) -> npt.NDArray[np.complex64]:
    """The product (rows, c) of two half planes, its s bands of rows / s added: (rows / s, c)."""
    rows = len(transform) // s
    out = np.zeros((rows, transform.shape[1]), np.complex64)
    for i in range(len(transform)):
        total, values, factors = out[i % rows], transform[i], spectrum[i]
        for j in range(len(values)):
            total[j] += values[j] * factors[j]
    return out
