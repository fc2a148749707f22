"""Chart on the s grid of the sensor: cells and frame, band-limited to s pi, resampled through the registration."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from procedures.numerics.arrays import Array32, Indices
from procedures.numerics.splines import Band, CellSpectra, cell_image_spline, outline_spline, read_spline
from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, CELLS, X_CORNER_BLOCKS, Chart
from procedures.pattern_psf.registration import Registration


@dataclass(frozen=True)
class Window:
    """Pixels around the noise region: first pixel (x, y), columns and rows."""

    x: int
    y: int
    columns: int
    rows: int

    @classmethod
    def around(cls, registration: Registration, shape: tuple[int, ...], frame: float, wider: float) -> "Window":
        """Bounding box of the noise region with `frame` cells around it, enlarged by `wider` of its size on each side,
        and clipped to a plane of this shape."""
        low, high = -frame, CELLS + frame
        rim = registration.to_sensor(np.array([[low, low], [high, low], [high, high], [low, high]]))
        limit = np.array(shape[::-1]) - 1
        more = wider * np.ptp(rim, axis=0)
        first = np.clip(np.floor(rim.min(axis=0) - more), 0, limit).astype(int)
        last = np.clip(np.ceil(rim.max(axis=0) + more), 0, limit).astype(int)
        return cls(int(first[0]), int(first[1]), int(last[0] - first[0] + 1), int(last[1] - first[1] + 1))

    def pixels(self) -> Indices:
        """All pixels (x, y) of the plane in the window, row by row, (rows * columns, 2)."""
        x, y = np.meshgrid(self.x + np.arange(self.columns), self.y + np.arange(self.rows))
        return np.column_stack([x.ravel(), y.ravel()])

    def cut(self, samples: Array32) -> Array32:
        """The window's part of a plane."""
        return samples[self.y : self.y + self.rows, self.x : self.x + self.columns]


@lru_cache(maxsize=1)
def frame_cells() -> Array32:
    """The whole chart as 320 x 320 cells: white 1, the noise region too, black 0, and 1/2 along the x-corners'
    diagonals."""
    chart = np.ones((BLOCKS * BLOCK, BLOCKS * BLOCK), dtype=np.float32)
    for column, row in BLACK_BLOCKS:
        chart[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK] = 0
    v, u = np.mgrid[:BLOCK, :BLOCK] - (BLOCK - 1) / 2
    bow_tie = np.where(np.abs(v) > np.abs(u), 0.0, np.where(np.abs(v) == np.abs(u), 0.5, 1.0))
    for column, row in X_CORNER_BLOCKS:
        chart[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK] = bow_tie
    return chart


def whole_chart(chart: Chart) -> Array32:
    """The chart with its frame, 320 x 320 cells, white 1, black 0, float32."""
    cells = frame_cells().copy()
    cells[BLOCK : BLOCK + CELLS, BLOCK : BLOCK + CELLS] = chart.cells
    return cells


@dataclass(frozen=True)
class Raster:
    """Spline coefficients of the chart, to be resampled through any map near the one they were made for.

    coefficients : (320 G, 320 G) float32 G grid points per cell. The mean of black and white is subtracted: values lie
        about 0.
    outline : (320 G, 320 G) float32 coefficients of the cells' outlines, which are added where ink spreads over the
        edges
    per_cell : G
    s : samples per pixel of the rasters
    """

    coefficients: Array32
    outline: Array32
    per_cell: int
    s: int

    def read(self, registration: Registration, window: Window, border: int, *, outline: bool = False) -> Array32:
        """The chart, or its cells' outlines, on the s grid over a window and `border` samples around it.

        Returns
        -------
        (s (rows - 1) + 1 + 2 border, s (columns - 1) + 1 + 2 border) float32
            Minus 1/2 for black, plus 1/2 for white; sample (border + s i, border + s j) is at the window's pixel
            (i, j). Outlines are in units of one cell of spread.
        """
        G = self.per_cell
        grid = np.array([[G, 0, G * BLOCK - 0.5], [0, G, G * BLOCK - 0.5], [0, 0, 1]])
        start = np.array([window.x, window.y], dtype=np.float64) - border / self.s
        shape = (self.s * (window.rows - 1) + 1 + 2 * border, self.s * (window.columns - 1) + 1 + 2 * border)
        return np.asarray(
            read_spline(
                self.outline if outline else self.coefficients,
                grid @ registration.H,
                registration.centre,
                registration.radius,
                registration.displacement,
                start,
                1 / self.s,
                shape,
            )
        )


def band_limited_chart(chart: Chart, registration: Registration, s: int) -> Raster:
    """Band-limit the chart to the s grid: s/2 cycles per pixel along each axis of the sensor.

    The cutoff is applied in the chart's Fourier domain for the map's derivative at the chart's centre. Over a tilted
    chart it varies by a few per cent, at frequencies beyond the cutoff of the optics.

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.6; the cells' footprint is exact instead of 4 x 4 points.
    """
    J = registration.jacobian()
    # largest frequency along an axis of the chart, in cycles per cell: f_cell = J^-T f_pixel
    largest = (s / 2) * np.abs(np.linalg.inv(J)).sum(axis=0).max()
    # a cubic spline of 3.2 points per period errs by under 1 % at the very edge of the band, 1e-4 in its middle
    per_cell = max(2, int(np.ceil(3.2 * largest)))
    spectra, band = _spectra(chart.cells.tobytes()), Band(BLOCKS * BLOCK, per_cell, J, s / 2)
    return Raster(cell_image_spline(spectra, band), outline_spline(spectra, band), per_cell, s)


@lru_cache(maxsize=4)
def _spectra(cells: bytes) -> CellSpectra:
    """Spectra of a chart's cells about their mean; cached for all planes and photographs of one chart."""
    chart = Chart(np.frombuffer(cells, dtype=np.uint8).reshape(CELLS, CELLS))
    return CellSpectra.of(whole_chart(chart) - np.float32(0.5))
