"""Cubic B-splines of band-limited images, computed in Fourier space, evaluated through a smooth map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics import transforms
from procedures.numerics.compiled import vectorised

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Complex64 = npt.NDArray[np.complex64]
Footprint = Callable[[Array], npt.NDArray[np.inexact[Any]]]


@dataclass(frozen=True)
class CellSpectra:
    """Spectra of a lattice of cells and of the steps between cells, each (n, n) complex64.

    Attributes
    ----------
    cells : of the cells' values
    left, upper : of the step heights at each cell's left and upper edge
    """

    cells: Complex64
    left: Complex64
    upper: Complex64

    @classmethod
    def of(cls, cells: npt.NDArray[np.floating]) -> CellSpectra:
        """From the values of the cells (n, n), [row, column]: one period of an image."""
        left = np.abs(cells - np.roll(cells, 1, axis=1))
        upper = np.abs(cells - np.roll(cells, 1, axis=0))
        return cls(*(np.asarray(transforms.fft2(x), np.complex64) for x in (cells, left, upper)))


@dataclass(frozen=True)
class Band:
    """Frequencies f of a lattice whose image J'f lies in [-limit, limit]^2, as the target grid represents them.

    Attributes
    ----------
    n : int
        Cells along one side of the lattice.
    per_cell : int
        Points of the splines' grid per cell, at (i + 1/2) / per_cell cells.
    J : (2, 2) float64
        d(cells x, y) / d(target x, y).
    limit : float
        In cycles per unit of the target.
    """

    n: int
    per_cell: int
    J: Array
    limit: float

    def spline(self, parts: list[tuple[Complex64, Footprint, Footprint]]) -> Array32:
        """Coefficients of a sum of lattices, given their spectra and the footprints' spectra along y and x."""
        size = self.n * self.per_cell
        reach = self.limit * np.abs(np.linalg.inv(self.J)).sum(axis=0) * self.n
        last_x, last_y = min(int(reach[0]), size // 2), min(int(reach[1]), (size - 1) // 2)
        fx, fy = np.arange(last_x + 1) / self.n, np.arange(-last_y, last_y + 1) / self.n
        along_y, along_x = _to_spline(fy, self.per_cell), _to_spline(fx, self.per_cell) * self.per_cell**2
        cut = np.zeros((size, len(fx)), dtype=np.complex64)
        for spectrum, footprint_y, footprint_x in parts:
            filter_y, filter_x = footprint_y(fy) * along_y, footprint_x(fx) * along_x
            _add_band(cut, spectrum, filter_y.astype(np.complex64), filter_x.astype(np.complex64), self.J, self.limit)
        # columns beyond the band are zero and are skipped in the first transform
        return transforms.irfft_rows(transforms.ifft(cut, axis=0), size)


@vectorised
def _add_band(
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


def cell_image_spline(spectra: CellSpectra, band: Band) -> Array32:
    """Spline coefficients of a piecewise constant image, cut to a band.

    The spectrum is that of the cells, repeated, times the cell's footprint sinc(f_x) sinc(f_y): without a raster, edges
    have no discretisation error.

    Returns
    -------
    (n per_cell, n per_cell) float32
        Coefficients for `read_spline`.
    """
    return band.spline([(spectra.cells, np.sinc, np.sinc)])


def outline_spline(spectra: CellSpectra, band: Band) -> Array32:
    """Spline coefficients of the cells' outlines: lines weighted by the step between neighbours.

    Added with a factor d to the cell image they move every edge by d cells from its darker to its brighter side, to
    first order. Parameters and result as in `cell_image_spline`.
    """
    return band.spline([(spectra.left, np.sinc, _line), (spectra.upper, _line, np.sinc)])


def _line(f: Array) -> npt.NDArray[np.complex128]:
    """Spectrum of a line at a cell's lower edge, from the cell's centre."""
    return np.asarray(np.exp(1j * np.pi * f))


def _to_spline(f: Array, per_cell: int) -> npt.NDArray[np.complex128]:
    """Spline prefilter, and the shift from cell centres to grid points, along one axis."""
    return np.asarray(_prefilter(f / per_cell) * np.exp(2j * np.pi * f * (0.5 / per_cell - 0.5)))


RIM = 32
"""Points of padding on every side of a photograph before its transform, fading to its mean."""
POINTS_PER_PERIOD = 3.2
"""Grid points per shortest retained period: the error of a cubic spline is then under 1 % at the band limit."""


def photograph_spline(image: Array32, J: Array, band: float) -> tuple[Array32, Array]:
    """Spline coefficients of a photograph, band-limited to the frequencies of another photograph.

    Frequencies f with J'f in [-band, band]^2 are retained. The rim is mirrored and faded out, so that the transform has
    no jump.

    Parameters
    ----------
    image : (rows, columns) float32
        Best centred about zero, for single precision.
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
    spectrum = transforms.rfft2(framed, [transforms.next_fast_len(n) for n in framed.shape])
    rows, columns = len(spectrum), transforms.next_fast_len(framed.shape[1])
    reach_x, reach_y = np.minimum(band * np.abs(np.linalg.inv(J)).sum(axis=0), 0.5)
    fine_rows, fine_columns = (
        transforms.next_fast_len(int(np.ceil(POINTS_PER_PERIOD * reach * n)))
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
    coefficients = transforms.irfft2(cut, (fine_rows, fine_columns)) * np.float32(scale_y * scale_x)
    return np.asarray(coefficients, np.float32), np.array(
        [[scale_x, 0, RIM * scale_x], [0, scale_y, RIM * scale_y], [0, 0, 1]]
    )


def _faded(image: Array32) -> Array32:
    """The image with a mirrored rim that fades to zero outwards."""
    framed = np.pad(image, RIM, mode="symmetric")
    fade = (0.5 - 0.5 * np.cos(np.pi * (np.arange(RIM) + 0.5) / RIM)).astype(np.float32)
    framed[:RIM] *= fade[:, None]
    framed[-RIM:] *= fade[::-1, None]
    framed[:, :RIM] *= fade
    framed[:, -RIM:] *= fade[::-1]
    return framed


def _prefilter(f: Array) -> Array:
    """Spectrum of the cubic spline prefilter, at f cycles per grid point."""
    return np.asarray(3 / (2 + np.cos(2 * np.pi * f)))


@vectorised
def _cubic_weights(
    t: np.float32,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:  # pragma: no cover - compiled
    """The four values of the cubic B-spline at -1 - t, -t, 1 - t, 2 - t."""
    a = np.float32(1) - t
    w0 = a * a * a * np.float32(1 / 6)
    w3 = t * t * t * np.float32(1 / 6)
    w1 = np.float32(2 / 3) - t * t * (np.float32(1) - np.float32(0.5) * t)
    return w0, w1, np.float32(1) - w0 - w1 - w3, w3


def read_spline(
    coefficients: Array32,
    H: Array,
    centre: Array,
    radius: float,
    displacement: Array,
    start: Array,
    step: float,
    shape: tuple[int, int],
) -> Array32:
    """Values of a spline on a regular target grid, through a displacement and a homography.

    The value at a target point p is that at H(p + d(p)), in grid points of the coefficients; d is a cubic polynomial of
    (p - centre) / radius. Points beyond the coefficients take the value at their rim.

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
    flat = np.ascontiguousarray(coefficients).ravel()
    return _read(flat, coefficients.shape, H, centre, radius, displacement, start, step, shape)


@vectorised
def _row(
    out: Array32,
    flat: Array32,
    line: int,
    first: npt.NDArray[np.int64],
    t_x: Array32,
    t_y: Array32,
    weights: Array32,
    sums: Array32,
) -> None:  # pragma: no cover - compiled
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
def _read(
    flat: Array32,
    size: tuple[int, ...],
    H: Array,
    centre: Array,
    radius: float,
    displacement: Array,
    start: Array,
    step: float,
    shape: tuple[int, int],
) -> Array32:  # pragma: no cover - compiled
    """`read_spline` of coefficients row after row; `size` are their rows and columns."""
    rows, columns = shape
    n_y, n_x = size[0], size[1]
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
