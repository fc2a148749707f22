"""Far tail of the PSF beyond the k x k samples of its support, as a sum of a few shapes.

For any aberrations the mean far tail falls as 1/r^3 and carries some per cent of the energy beyond any support. If it
is omitted, the outer samples of the support absorb it, as it is a wide blur of the scene and not noise. The first shape
is that tail. The others model deviations from it: an excess close to the support (defocus, rings of a small aperture),
and variation with direction (spikes of a polygonal iris, astigmatism).
"""

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics import loops, transforms
from procedures.numerics.arrays import Array, Array32, Complex, Indices
from procedures.numerics.transforms import integral_of_j0, j0, j1

REACH = 64
"""Radius of the shapes in samples of the s grid, for supports up to half of it. Beyond it there is the mean tail only,
which a shorter reach biases, as varying light from beyond is attributed to it."""
FAR = 128  # greatest distance in pixels of light beyond the reach; light from further away is taken as constant
SHAPES = ("1/r^3", "1/r^5", "cos 2", "sin 2", "cos 4", "sin 4")
"""Names of the shapes: the mean tail, an excess close to the support, and the tail times cos and sin of 2 and 4
times the direction."""
MIRRORED, EXCHANGED = np.array([1.0, 1, 1, -1, 1, -1]), np.array([1.0, 1, -1, 1, 1, -1])
"""Signs of the shapes after the reversal of an axis, and after the exchange of x and y."""
DIFFERS = np.array([0.5, 0.2, 0.2, 0.3, 0.3])
"""Prior standard deviations of the shapes after the mean tail, relative to its energy: an excess close to the support,
and variation with twice and four times the direction. Without the prior, noise would dominate them."""
KEPT = 256  # greatest number of frequencies whose spectra are cached
DIGITS = 11  # decimals of an argument of the transform beyond the reach, whose slope is at most 1
LEAST_TAIL = 1e-3  # least amplitude of the mean tail for which deviations are reported


def tail_border(k: int) -> int:
    """Samples of the s grid that the tail needs around a raster."""
    return max(REACH, 2 * k)


@lru_cache(maxsize=8)
def tail_kernels(k: int) -> Array:
    """The shapes outside the central k x k samples, in a circle: (q, K, K); two of sum 1, then the first times cosines
    and sines."""
    half = tail_border(k)
    x = np.arange(-half, half + 1)
    r, angle = np.hypot(x, x[:, None]), np.arctan2(x[:, None], x)
    outside = (np.maximum(np.abs(x), np.abs(x[:, None])) > k // 2) & (r <= half)
    square = np.maximum(r * r, 1)
    mean = outside / (square * np.sqrt(square))
    close = mean / square
    mean, close = mean / mean.sum(), close / close.sum()
    turning = [mean * wave(m * angle) for m in (2, 4) for wave in (np.cos, np.sin)]
    kernels = np.stack([mean, close, *turning])
    kernels.flags.writeable = False  # shared by all callers
    return kernels


def tail_columns(
    u: Array32, rows: Indices, columns: Indices, s: int, k: int,
    shapes: int = len(SHAPES),
) -> Array:  # fmt: skip
    """Convolution of an image `u` on the s grid, with a border of `tail_border`, with the first tail shapes, at pixels:
    (m, q)."""
    # only every s-th sample is needed: along y by folding the spectrum, which is exact
    shape = (s * transforms.next_fast_len(-(-u.shape[0] // s)), transforms.next_fast_len(u.shape[1]))
    spectrum_u = transforms.rfft2(u, shape) * _shift(k, shape[0])
    samples, index = np.empty((len(rows), shapes)), rows * shape[1] + tail_border(k) + s * columns
    for j, spectrum in enumerate(_spectra(k, *shape)[:shapes]):
        folded = loops.folded_product(spectrum_u, spectrum, s)
        samples[:, j] = transforms.irfft2(folded, (shape[0] // s, shape[1])).ravel()[index]
    return samples / s


def far_light(
    picture: npt.NDArray[np.floating[Any]], corner: tuple[int, int], shape: tuple[int, int], s: int, k: int,
    levels: tuple[float, float] = (-0.5, 0.5),
) -> Array32:  # fmt: skip
    """Light from beyond the reach, for a mean tail of energy 1 within it: a picture filtered by 1/r^3, (rows, columns).

    picture : (rows, columns) the scene at pixels. Details do not matter at that distance, so the photograph itself
        serves.
    corner : (x, y) first pixel of the window
    shape : (rows, columns) size of the window
    levels : levels of the picture that correspond to -1/2 and 1/2
    """
    x, y = corner
    rows, columns = (
        np.clip(np.arange(a - FAR, a + n + FAR), 0, most - 1)
        for a, n, most in ((y, shape[0], picture.shape[0]), (x, shape[1], picture.shape[1]))
    )
    around = (picture[np.ix_(rows, columns)] - levels[0]) / (levels[1] - levels[0]) - 0.5
    part = around.astype(np.float32)
    size = tuple(transforms.next_fast_len(n) for n in part.shape)
    filtered = transforms.irfft2(transforms.rfft2(part, size) * _far_spectrum(size[0], size[1], s, k), size)
    return np.asarray(filtered[FAR : FAR + shape[0], FAR : FAR + shape[1]])


@lru_cache(maxsize=8)
def _far_spectrum(rows: int, columns: int, s: int, k: int) -> npt.NDArray[np.complex64]:
    """Spectrum of the tail from the reach to `FAR`, on a grid of pixels."""
    y, x = (transforms.fftfreq(n, 1 / n).astype(np.float32) for n in (rows, columns))
    r = np.hypot(y[:, None], x)
    weight = np.clip(r - tail_border(k) / s + 0.5, 0, 1) * (r <= FAR)
    density = tail_density(k) / s * weight / np.maximum(r * r * r, 1)
    return np.asarray(transforms.rfft2(density.astype(np.float32)), dtype=np.complex64)


@lru_cache(maxsize=4)
def _shift(k: int, rows: int) -> npt.NDArray[np.complex64]:
    """Phase factors (rows, 1) that move the first row within reach of all shapes to row 0."""
    return np.asarray(np.exp(2j * np.pi * tail_border(k) * transforms.fftfreq(rows)[:, None]), dtype=np.complex64)


@lru_cache(maxsize=4)
def _spectra(k: int, rows: int, columns: int) -> Array32:
    """Spectra of the shapes about their centres, (q, rows, columns // 2 + 1), real as the shapes are symmetric."""
    half, kernels = tail_border(k), tail_kernels(k).astype(np.float32)
    spectra = np.empty((len(kernels), rows, columns // 2 + 1), np.float32)
    picture = np.zeros((rows, columns), np.float32)
    centred = np.ix_(np.arange(-half, half + 1) % rows, np.arange(-half, half + 1) % columns)
    for spectrum, kernel in zip(spectra, kernels, strict=True):
        picture[centred] = kernel
        spectrum[:] = transforms.rfft2(picture).real
    return spectra


@lru_cache(maxsize=8)
def tail_sums(k: int) -> Array:
    """Energy of each shape (q,); for the first, that of the infinite tail relative to the part within the reach."""
    sums = np.asarray(tail_kernels(k).sum(axis=(1, 2)))
    sums[0] += _beyond(k)
    sums.flags.writeable = False  # shared by all callers
    return sums


def tail_density(k: int) -> float:
    """c of the mean tail c / r^3 per sample of the s grid, whose sum within the reach is 1; r in samples."""
    half = tail_border(k)
    return float(tail_kernels(k)[0, half, 0] * half**3)


def tail_spectra(fx: Array, fy: Array, k: int) -> Array:
    """Spectra of the shapes at frequencies (n,) in cycles per sample: (n, q), real; `tail_sums` at 0.

    The shapes are symmetric about their centre. The mean tail continues beyond the reach R: there the Hankel transform
    of 1/r^3 over its value at 0 is g(x) = x times the integral of J0(t) / t^2 from x = 2 pi f R on, which is
    J0(x) + x (the integral of J0 from 0 to x - 1 - J1(x)).
    """
    x, y = np.ascontiguousarray(fx, np.float64), np.ascontiguousarray(fy, np.float64)
    return _kept_spectra(x.tobytes(), y.tobytes(), k) if len(x) <= KEPT else _spectra_at(x, y, k)


@lru_cache(maxsize=4096)
def _kept_spectra(x_bytes: bytes, y_bytes: bytes, k: int) -> Array:
    """`_spectra_at`, cached, as curves are drawn repeatedly at the same frequencies."""
    return _spectra_at(np.frombuffer(x_bytes), np.frombuffer(y_bytes), k)


def _spectra_at(fx: Array, fy: Array, k: int) -> Array:
    half = tail_border(k)
    quadrants = tail_kernels(k)[:, half:, half:]
    times = np.where(np.arange(half + 1) > 0, 2.0, 1.0)  # multiplicity of a column of the quadrant in the whole
    x, y = _waves(fx, half), _waves(fy, half)
    even, odd = (x.real * times, y.real * times), (2 * x.imag, -2 * y.imag)
    within = np.empty((len(fx), len(SHAPES)))
    for j, quadrant in enumerate(quadrants):
        across, down = odd if SHAPES[j].startswith("sin") else even
        within[:, j] = np.sum((down @ quadrant) * across, axis=1)
    within[:, 0] += spectrum_beyond(np.hypot(fx, fy), k)
    within.flags.writeable = False  # shared by all callers
    return within


def spectrum_beyond(f: Array, k: int) -> Array:
    """Contribution from beyond the reach to the spectrum of the mean tail at frequencies (n,) in cycles per sample."""
    return np.asarray(_beyond(k) * _transform_beyond(2 * np.pi * f * tail_border(k)))


def _waves(f: Array, last: int) -> Complex:
    """exp(2 pi i f n) at frequencies (n,) for n from 0 to the last: (n, last + 1)."""
    steps = np.exp(2j * np.pi * f)
    return np.concatenate([np.ones((len(f), 1)), np.cumprod(np.repeat(steps[:, None], last, axis=1), axis=1)], axis=1)


def _transform_beyond(x: Array) -> Array:
    """Hankel transform g of 1/r^3 beyond the reach at x (n,), computed once for values equal to rounding."""
    r, index = np.unique(np.round(x, DIGITS), return_inverse=True)
    return _kept_transform(r.tobytes())[index]


@lru_cache(maxsize=64)
def _kept_transform(x_bytes: bytes) -> Array:
    """`_transform_beyond` at distinct points, cached, as all directions of a curve share them."""
    x = np.frombuffer(x_bytes)
    return np.asarray(j0(x) + x * (integral_of_j0(x) - 1 - j1(x)))


def _beyond(k: int) -> float:
    """Energy of 1/r^3 beyond the reach over that within: 2 pi / R over the sum."""
    half = tail_border(k)
    return 2 * np.pi / half * tail_density(k)
