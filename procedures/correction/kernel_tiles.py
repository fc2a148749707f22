"""Correction of a developed picture by plain convolutions: a small inverse filter at each node of a grid.

The filter g of a node minimises the expected squared error of the convolution with a photograph of white noise,

    integral |G H - 1|^2 S + w |G|^2,    S = 1 / (f^2 + f0^2),    sum g = 1,

over all filters of its size; H is the transfer function of the PSF, S the power spectrum of pictures. The weight w is
common to the frame, as one photograph has one noise. Between nodes filters are interpolated bilinearly.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.optimize import brentq

from procedures.correction.optics import COLOURS, wrapped
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.psf_field import PsfField, SpaceVariantBlur

SIZE = 15
"""Side of a filter, pixels: of a Gaussian of 1.3 pixels, 21 leave 0.05 % less of the error, 9 leave 1 % more."""
COLUMNS = 9
"""Nodes along the longer side of the frame."""
NOISE_GAIN = 3.0
"""Standard deviation of white noise after the correction over that before, median over the frame."""
SAMPLES = 64
LOWEST = 0.01
"""Frequency f0, cycles/pixel, below which the spectrum of pictures is flat."""
WEIGHTS = (1e-9, 1e3)
"""Range of w, in which noise gains from 1 to those of an inverse without regularisation lie."""


@dataclass(frozen=True, eq=False)
class KernelTiles:
    """Filters on a grid over the developed picture.

    kernels : (rows, columns, colours, K, K), to be convolved with; the sum of each is 1
    x, y : positions of the nodes, pixels of the picture
    shape : (int, int), rows and columns of the picture
    noise_gain : (rows, columns, colours)
    sigma_px : (rows, columns), standard deviation of the Gaussian with the MTF50 of green
    """

    kernels: Array
    x: Array
    y: Array
    shape: tuple[int, int]
    noise_gain: Array
    sigma_px: Array


def kernel_tiles(
    fields: Mapping[str, PsfField], *, noise_gain: float = NOISE_GAIN, columns: int = COLUMNS, size: int = SIZE
) -> KernelTiles:
    """Filters of all colours: red, green and blue of a mosaic, or the grey plane.

    Raises BadParameter if fewer than 2 columns are asked for, the noise gain is not above 1, or a colour has no field.
    """
    if columns < 2 or noise_gain <= 1 or size % 2 == 0:
        raise BadParameter(
            f"filters need 2 columns, a noise gain above 1 and an odd size; got {columns}, {noise_gain:g} and {size}",
            "give other values",
        )
    colours = _by_colour(fields)
    pitch = 2 if len(colours) == 3 else 1
    first = next(iter(colours.values()))
    shape = (pitch * first.shape[0], pitch * first.shape[1])
    x, y = _nodes(shape[1], max(shape), columns), _nodes(shape[0], max(shape), columns)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) / pitch
    spectra = np.stack([_spectra(field, points, pitch) for field in colours.values()], axis=1)
    filters = [[_Normal.of(H, size) for H in node] for node in spectra]
    weight = _weight(filters, noise_gain)
    kernels = np.array([[one.kernel(weight) for one in node] for node in filters])
    grid = (len(y), len(x), len(colours))
    green = spectra[:, len(colours) // 2]
    return KernelTiles(
        kernels.reshape(*grid, size, size), x, y, shape, np.sqrt(np.sum(kernels**2, axis=(2, 3))).reshape(grid),
        np.array([gaussian_width(H) for H in green]).reshape(grid[:2]),
    )  # fmt: skip


def _by_colour(fields: Mapping[str, PsfField]) -> dict[int, PsfField]:
    """One field for each colour, the first green one for green."""
    colours: dict[int, PsfField] = {}
    for name, field in fields.items():
        if name in COLOURS:
            colours.setdefault(COLOURS[name], field)
    if set(fields) >= {"R", "B"} and len(colours) == 3:
        return dict(sorted(colours.items()))
    if "Y" in fields:
        return {0: fields["Y"]}
    raise BadParameter(
        f"filters need the fields of red, green and blue, or of a grey plane; got {', '.join(fields)}",
        "measure the field with all planes (--plane all)",
    )


def _nodes(length: int, longest: int, columns: int) -> Array:
    count = max(2, round(columns * length / longest))
    return np.round(np.linspace(0, length - 1, count))


def _spectra(field: PsfField, points: Array, pitch: int) -> Array:
    """Transfer functions (n, SAMPLES, SAMPLES) at points of the plane, on the picture's grid."""
    psfs = SpaceVariantBlur(field, pitch).at(points)
    return np.stack([np.fft.fft2(wrapped(psf, SAMPLES)) for psf in psfs])


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of a node's filter, (A + w I) g = b, in the eigenvectors of A."""

    values: Array
    vectors: Array
    b: Array
    ones: Array
    size: int

    @classmethod
    def of(cls, H: Array, size: int) -> "_Normal":
        f = np.fft.fftfreq(SAMPLES)
        S = 1 / (f[:, None] ** 2 + f**2 + LOWEST**2)
        S /= S.mean()
        correlation = np.fft.ifft2(np.abs(H) ** 2 * S).real
        cross = np.fft.ifft2(np.conj(H) * S).real
        at = np.arange(size) - size // 2
        lags = toeplitz(np.arange(size), -np.arange(size)) % SAMPLES
        A = correlation[lags[:, None, :, None], lags[None, :, None, :]].reshape(size**2, size**2)
        values, vectors = np.linalg.eigh((A + A.T) / 2)
        b = cross[np.ix_(at % SAMPLES, at % SAMPLES)].ravel()
        return cls(values.clip(0), vectors, vectors.T @ b, vectors.sum(axis=0), size)

    def kernel(self, weight: float) -> Array:
        """The filter, its sum held at 1 by a multiplier."""
        inverse = 1 / (self.values + weight)
        multiplier = (1 - np.sum(self.ones * inverse * self.b)) / np.sum(self.ones**2 * inverse)
        g = self.vectors @ (inverse * (self.b + multiplier * self.ones))
        return np.asarray(g.reshape(self.size, self.size))


def _weight(filters: list[list[_Normal]], noise_gain: float) -> float:
    """The weight at which the median noise gain is as given; the least one where no weight reaches it."""

    def excess(log_weight: float) -> float:
        gains = [np.linalg.norm(one.kernel(np.exp(log_weight))) for node in filters for one in node]
        return float(np.log(np.median(gains) / noise_gain))

    low, high = np.log(WEIGHTS)
    return float(np.exp(low if excess(low) < 0 else brentq(excess, low, high, rtol=1e-3)))


def gaussian_width(H: Array) -> float:
    """Standard deviation, pixels, of the Gaussian with the MTF50 of H, averaged over directions."""
    n = len(H)
    f = np.fft.fftfreq(n)
    ring = np.rint(n * np.hypot(f[:, None], f)).astype(int)
    mtf = np.bincount(ring.ravel(), np.abs(H).ravel())[: n // 2 + 1] / np.bincount(ring.ravel())[: n // 2 + 1]
    mtf50 = np.interp(-0.5, -mtf, np.arange(n // 2 + 1) / n)
    return float(np.sqrt(np.log(2) / 2) / (np.pi * mtf50))
