"""Cubic B-splines of band-limited images: made in Fourier, read through a smooth map."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import scipy.fft

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


def cell_image_spline(cells: npt.NDArray[np.floating], per_cell: int, J: Array, band: float) -> Array32:
    """Spline coefficients of a piecewise constant image, its spectrum cut to a square of the *target's* frequencies.

    The image is one period of (n, n) unit cells; its spectrum is the cells' own, repeated, times the cell's
    footprint sinc(f_x) sinc(f_y): no raster, hence no discretisation of the edges. Of it the frequencies f stay
    whose image J'f, with J the derivative of cells with respect to target coordinates, lies in [-band, band]^2.

    Parameters
    ----------
    cells : (n, n) floating
        Values of the cells, [row, column].
    per_cell : int
        Grid points per cell; the grid's points lie at (i + 1/2) / per_cell cells.
    J : (2, 2) float64
        d(cells x, y) / d(target x, y).
    band : float
        Largest frequency kept along each target axis, in cycles per unit of the target.

    Returns
    -------
    (n per_cell, n per_cell) float32
        Coefficients for `read_spline`.
    """
    return _band_limited([(cells, np.sinc, np.sinc)], per_cell, J, band)


def outline_spline(cells: npt.NDArray[np.floating], per_cell: int, J: Array, band: float) -> Array32:
    """Spline coefficients of the cells' outlines: lines of the steps' heights where neighbours differ.

    Added with a factor d to the cells' own image they move every edge by d cells from its darker to its brighter
    side, to first order. Parameters and result as in `cell_image_spline`.
    """
    left = np.abs(cells - np.roll(cells, 1, axis=1))
    upper = np.abs(cells - np.roll(cells, 1, axis=0))
    return _band_limited([(left, np.sinc, _line), (upper, _line, np.sinc)], per_cell, J, band)


@lru_cache(maxsize=12)
def _spectrum(lattice: bytes, n: int) -> npt.NDArray[np.complex64]:
    """Spectrum of a lattice (n, n) of float32; kept, since one chart serves every plane of every photograph."""
    return np.asarray(scipy.fft.fft2(np.frombuffer(lattice, dtype=np.float32).reshape(n, n)))


def _line(f: Array) -> npt.NDArray[np.complex128]:
    """Spectrum of a line at a cell's lower edge, from the cell's centre."""
    return np.asarray(np.exp(1j * np.pi * f))


def _band_limited(
    parts: list[tuple[npt.NDArray[np.floating], Callable[[Array], Any], Callable[[Array], Any]]],
    per_cell: int,
    J: Array,
    band: float,
) -> Array32:
    """Spline coefficients of sums of lattices (n, n) with footprints, given by their spectra along y and x."""
    n = len(parts[0][0])
    size = n * per_cell
    index_y = np.fft.fftfreq(size, 1 / size).astype(int)
    index_x = np.arange(size // 2 + 1)
    # rows and columns that the band touches at all
    reach_x, reach_y = band * np.abs(np.linalg.inv(J)).sum(axis=0) * n
    rows, columns = np.abs(index_y) <= reach_y, index_x <= reach_x
    ky, kx = index_y[rows], index_x[columns]
    fy, fx = ky / n, kx / n
    inside = (np.abs(J[0, 0] * fx + J[1, 0] * fy[:, None]) <= band) & (
        np.abs(J[0, 1] * fx + J[1, 1] * fy[:, None]) <= band
    )
    block = np.zeros((len(ky), len(kx)), dtype=np.complex64)
    for lattice, footprint_y, footprint_x in parts:
        spectrum = _spectrum(np.asarray(lattice, dtype=np.float32).tobytes(), n)
        filter_y, filter_x = footprint_y(fy) * _to_spline(fy, per_cell), footprint_x(fx) * _to_spline(fx, per_cell)
        block += spectrum[ky % n][:, kx % n] * np.outer(filter_y, filter_x).astype(np.complex64)
    cut = np.zeros((size, len(index_x)), dtype=np.complex64)
    cut[np.ix_(rows, columns)] = block * inside
    return np.asarray(scipy.fft.irfft2(cut, (size, size), overwrite_x=True) * np.float32(per_cell**2))


def _to_spline(f: Array, per_cell: int) -> npt.NDArray[np.complex128]:
    """Spline prefilter, and the shift from cell centres to grid points, along one axis."""
    return np.asarray(_prefilter(f / per_cell) * np.exp(2j * np.pi * f * (0.5 / per_cell - 0.5)))


RIM = 32
"""Points by which a photograph is continued on every side before its transform, fading into its mean."""
POINTS_PER_PERIOD = 3.2
"""Grid points per shortest period kept: a cubic spline then errs by under 1 % at the very edge of the band."""


def photograph_spline(image: Array32, J: Array, band: float) -> tuple[Array32, Array]:
    """Spline coefficients of a photograph, its spectrum cut to a square of another photograph's frequencies.

    The frequencies f stay whose image J'f lies in [-band, band]^2. The rim is mirrored and faded out, so that the
    transform sees no jump.

    Parameters
    ----------
    image : (rows, columns) float32
        Best about zero: single precision counts from there.
    J : (2, 2) float64
        d(pixels x, y of the image) / d(target x, y).
    band : float
        Largest frequency kept along each target axis, in cycles per unit of the target.

    Returns
    -------
    coefficients : (rows, columns) float32
        For `read_spline`, on a grid as fine as the band needs.
    grid : (3, 3) float64
        Pixels (x, y) of the image -> grid points of the coefficients.
    """
    framed = _faded(image)
    spectrum = scipy.fft.rfft2(framed, [scipy.fft.next_fast_len(n, real=True) for n in framed.shape])
    rows, columns = len(spectrum), scipy.fft.next_fast_len(framed.shape[1], real=True)
    reach_x, reach_y = np.minimum(band * np.abs(np.linalg.inv(J)).sum(axis=0), 0.5)
    fine_rows, fine_columns = (
        scipy.fft.next_fast_len(int(np.ceil(POINTS_PER_PERIOD * reach * n)), real=True)
        for reach, n in ((reach_y, rows), (reach_x, columns))
    )
    y, x = int(reach_y * rows), int(reach_x * columns)  # largest indices inside the band
    index_y, index_x = np.r_[0 : y + 1, -y:0], np.arange(x + 1)
    fy, fx = (index_y / rows)[:, None], index_x / columns
    inside = (np.abs(J[0, 0] * fx + J[1, 0] * fy) <= band) & (np.abs(J[0, 1] * fx + J[1, 1] * fy) <= band)
    prefilter = _prefilter(index_y / fine_rows)[:, None] * _prefilter(index_x / fine_columns)
    cut = np.zeros((fine_rows, fine_columns // 2 + 1), dtype=np.complex64)
    cut[index_y, : x + 1] = spectrum[index_y, : x + 1] * (inside * prefilter).astype(np.float32)
    scale_y, scale_x = fine_rows / rows, fine_columns / columns
    coefficients = scipy.fft.irfft2(cut, (fine_rows, fine_columns), overwrite_x=True) * np.float32(scale_y * scale_x)
    return coefficients, np.array([[scale_x, 0, RIM * scale_x], [0, scale_y, RIM * scale_y], [0, 0, 1]])


def _faded(image: Array32) -> Array32:
    """The image with its mirrored rim, which fades to zero outwards."""
    framed = np.pad(image, RIM, mode="symmetric")
    fade = (0.5 - 0.5 * np.cos(np.pi * (np.arange(RIM) + 0.5) / RIM)).astype(np.float32)
    framed[:RIM] *= fade[:, None]
    framed[-RIM:] *= fade[::-1, None]
    framed[:, :RIM] *= fade
    framed[:, -RIM:] *= fade[::-1]
    return framed


def _prefilter(f: Array) -> Array:
    """What turns samples into cubic spline coefficients, at f cycles per grid point."""
    return np.asarray(3 / (2 + np.cos(2 * np.pi * f)))


@numba.njit(cache=True, nogil=True, fastmath=True, inline="always")
def _cubic_weights(
    t: np.float32,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:  # pragma: no cover - compiled
    """The four values of the cubic B-spline at -1 - t, -t, 1 - t, 2 - t."""
    a = np.float32(1) - t
    w0 = a * a * a * np.float32(1 / 6)
    w3 = t * t * t * np.float32(1 / 6)
    w1 = np.float32(2 / 3) - t * t * (np.float32(1) - np.float32(0.5) * t)
    return w0, w1, np.float32(1) - w0 - w1 - w3, w3


@numba.njit(cache=True, nogil=True, fastmath=True)
def read_spline(
    coefficients: Array32,
    H: Array,
    centre: Array,
    radius: float,
    displacement: Array,
    start: Array,
    step: float,
    shape: tuple[int, int],
) -> Array32:  # pragma: no cover - compiled
    """Values of a spline on a regular target grid, read through a displacement and a homography.

    The target point p is read at H(p + d(p)), in grid points of the coefficients; d is a cubic polynomial of
    (p - centre) / radius. Points beyond the coefficients are read at their rim.

    Parameters
    ----------
    coefficients : (rows, columns) float32
        From `cell_image_spline` or `photograph_spline`.
    H : (3, 3) float64
        Target -> grid points of the coefficients.
    centre, radius
        Normalisation of the displacement's argument.
    displacement : (2, 9) float64
        Coefficients of d for `CUBIC_EXPONENTS`, in target units.
    start : (2,) float64
        First target point (x, y).
    step : float
        Distance of target points.
    shape : (rows, columns)
        Size of the target grid.

    Returns
    -------
    (rows, columns) float32
    """
    rows, columns = shape
    n_y, n_x = coefficients.shape
    flat, line = coefficients.ravel(), np.uint64(n_x)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)  # unsigned: no test for negative indices
    out = np.empty((rows, columns), np.float32)
    # a row's places first, in a loop of plain arithmetic that the processor does several at a time
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
        for j in range(columns):
            x0, x1, x2, x3 = _cubic_weights(t_x[j])
            y0, y1, y2, y3 = _cubic_weights(t_y[j])
            a0 = np.uint64(first[j])
            a1, a2, a3 = a0 + line, a0 + line + line, a0 + line + line + line
            out[i, j] = (
                y0 * (x0 * flat[a0] + x1 * flat[a0 + one] + x2 * flat[a0 + two] + x3 * flat[a0 + three])
                + y1 * (x0 * flat[a1] + x1 * flat[a1 + one] + x2 * flat[a1 + two] + x3 * flat[a1 + three])
                + y2 * (x0 * flat[a2] + x1 * flat[a2 + one] + x2 * flat[a2 + two] + x3 * flat[a2 + three])
                + y3 * (x0 * flat[a3] + x1 * flat[a3 + one] + x2 * flat[a3 + two] + x3 * flat[a3 + three])
            )
    return out
