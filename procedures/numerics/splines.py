"""Cubic B-splines of band-limited images, computed in Fourier space, evaluated through a smooth map."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops, transforms
from procedures.numerics.arrays import Array, Array32, Complex

Complex64 = npt.NDArray[np.complex64]
Footprint = Callable[[Array], npt.NDArray[np.inexact[Any]]]


@dataclass(frozen=True)
class CellSpectra:
    """Spectra (n, n) of a lattice's cells, and of the steps at each cell's left and upper edge."""

    cells: Complex64
    left: Complex64
    upper: Complex64

    @classmethod
    def of(cls, cells: npt.NDArray[np.floating]) -> "CellSpectra":
        """From the values of the cells (n, n), [row, column]: one period of an image."""
        left = np.abs(cells - np.roll(cells, 1, axis=1))
        upper = np.abs(cells - np.roll(cells, 1, axis=0))
        return cls(*(np.asarray(transforms.fft2(x), np.complex64) for x in (cells, left, upper)))


@dataclass(frozen=True)
class Band:
    """Frequencies f of a lattice whose image J'f lies in [-limit, limit]^2, as the target grid represents them.

    n : cells along one side of the lattice
    per_cell : points of the splines' grid per cell, at (i + 1/2) / per_cell cells
    J : (2, 2) d(cells x, y) / d(target x, y)
    limit : in cycles per unit of the target
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
            loops.add_band(
                cut, spectrum, filter_y.astype(np.complex64), filter_x.astype(np.complex64), self.J, self.limit
            )
        # columns beyond the band are zero and are skipped in the first transform
        return transforms.irfft_rows(transforms.ifft(cut, axis=0), size)


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
    """Spline coefficients of the cells' outlines, weighted by the step between neighbours: added to the cell image with
    a factor d they move every edge by d cells to its brighter side."""
    return band.spline([(spectra.left, np.sinc, _line), (spectra.upper, _line, np.sinc)])


def _line(f: Array) -> Complex:
    """Spectrum of a line at a cell's lower edge, from the cell's centre."""
    return np.asarray(np.exp(1j * np.pi * f))


def _to_spline(f: Array, per_cell: int) -> Complex:
    """Spline prefilter, and the shift from cell centres to grid points, along one axis."""
    return np.asarray(_prefilter(f / per_cell) * np.exp(2j * np.pi * f * (0.5 / per_cell - 0.5)))


RIM = 32  # points of padding on every side of a photograph before its transform, fading to its mean
POINTS_PER_PERIOD = 3.2
"""Grid points per shortest retained period: the error of a cubic spline is then under 1 % at the band limit."""


def photograph_spline(image: Array32, J: Array, band: float) -> tuple[Array32, Array]:
    """Spline coefficients of a photograph, band-limited to the frequencies of another photograph.

    Frequencies f with J'f in [-band, band]^2 are retained. The rim is mirrored and faded out, so that the transform has
    no jump.

    image : (rows, columns) float32 best centred about zero, for single precision
    J : (2, 2) d(pixels x, y of the image) / d(target x, y)
    band : largest frequency kept along each target axis, in cycles per unit of the target

    Returns
    -------
    coefficients : (rows, columns) float32
        For `read_spline`, on a grid as fine as the band needs.
    grid : (3, 3) float64
        Pixels (x, y) of the image -> grid points of the coefficients.
    """
    # the image with a mirrored rim that fades to zero outwards
    framed = np.pad(image, RIM, mode="symmetric")
    fade = (0.5 - 0.5 * np.cos(np.pi * (np.arange(RIM) + 0.5) / RIM)).astype(np.float32)
    framed[:RIM] *= fade[:, None]
    framed[-RIM:] *= fade[::-1, None]
    framed[:, :RIM] *= fade
    framed[:, -RIM:] *= fade[::-1]
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


def _prefilter(f: Array) -> Array:
    """Spectrum of the cubic spline prefilter, at f cycles per grid point."""
    return np.asarray(3 / (2 + np.cos(2 * np.pi * f)))


def read_spline(
    coefficients: Array32, H: Array, centre: Array, radius: float, displacement: Array, start: Array, step: float,
    shape: tuple[int, int],
) -> Array32:  # fmt: skip
    """Values of a spline on a regular target grid, through a displacement and a homography.

    The value at a target point p is that at H(p + d(p)), in grid points of the coefficients; d is a cubic polynomial of
    (p - centre) / radius. Points beyond the coefficients take the value at their rim.

    coefficients : (rows, columns) float32 from `cell_image_spline` or `photograph_spline`
    H : (3, 3) target -> grid points of the coefficients
    centre, radius : normalisation of the displacement's argument
    displacement : (2, 9) coefficients of d for `CUBIC_EXPONENTS`, in target units
    start : (2,) first target point (x, y)
    step : distance of target points
    shape : (rows, columns) size of the target grid

    Returns
    -------
    (rows, columns) float32
    """
    flat = np.ascontiguousarray(coefficients)
    return loops.read_spline(flat, H, centre, radius, displacement, start, step, shape)
