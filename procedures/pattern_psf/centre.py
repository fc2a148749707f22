"""Centre of the PSF: the apparent position of the chart's x-corners when imaged through it.

A translation of the map and a shift of the PSF are indistinguishable in the photograph, so the marks fix the
translation: the mark of the chart lies where equation (1) of the paper locates it. The twelve marks of one photograph
are noisy and aliased. The fitted PSF predicts the mark without noise on the s grid, and equation (1) applied to this
prediction is the mean over infinitely many marks. For a PSF with a centre of symmetry it gives that centre, whatever
the window. For others (coma) the centre is this convention, and the centroid is reported as well.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from procedures.numerics import transforms
from procedures.numerics.arrays import Array

SUPERSAMPLING = 4  # points per sample of the s grid along each axis, for the antialiased mark


def mark_offset(h: Array, s: int, J: Array) -> Array:
    """Apparent displacement (x, y), in pixels, of the centre of an x-corner imaged through a PSF.

    h : (k, k) the PSF on the s grid; its sum does not matter
    J : (2, 2) derivative of cells with respect to pixels, which orients the mark on the sensor

    Source: Delbracio, Muse, Almansa, IPOL 2012, section 4.2, equation (1), its Gaussian window as wide as the PSF.
    """
    return _view(h, J).centre / s


def mark_offset_gradient(h: Array, s: int, J: Array) -> Array:
    """Derivative (2, k^2) of `mark_offset` with respect to the PSF's samples, in pixels."""
    view = _view(h, J)
    g, ray, w = view.gradient, view.ray, view.weight
    # equation (1) is F_a = sum w g_a (g . ray) = 0, g linear in h, and w and ray following the centre
    along = w * np.sum(g * ray, axis=0)
    tensor = np.einsum("aij,bij,ij->ab", g, g, w) - np.einsum("aij,bij,ij->ab", g, ray, along) / view.window**2
    fields = np.einsum("aij,bij->abij", w * g, ray)
    fields[0, 0] += along
    fields[1, 1] += along
    change = np.array([_correlation(view.slopes, fields[a], len(h)) for a in range(2)])
    return np.asarray(np.linalg.solve(tensor, change) / s)


@dataclass(frozen=True)
class _View:
    """An ideal x-corner imaged through a PSF, and the solution of equation (1) on it, in samples of the s grid.

    `slopes` (2, N, N) are those of the ideal mark; `gradient`, `ray` (2, n, n) and `weight` (n, n) those of its image.
    """

    centre: Array
    slopes: Array
    gradient: Array
    ray: Array
    weight: Array
    window: float


def _view(h: Array, J: Array) -> _View:
    reach = h.shape[0] // 2 + 1
    slope_y, slope_x = np.gradient(_x_corner(J, 3 * reach))
    slopes = np.stack([slope_x, slope_y])
    inner = slice(reach, -reach)
    g = np.asarray([cv2.filter2D(d, cv2.CV_64F, h[::-1, ::-1])[inner, inner] for d in slopes], np.float64)
    v, u = np.mgrid[: g.shape[1], : g.shape[1]] - g.shape[1] // 2
    centre, window = np.zeros(2), 0.6 * reach
    for _ in range(20):
        ray = np.stack([u - centre[0], v - centre[1]])
        w = np.exp(-np.sum(ray**2, axis=0) / (2 * window**2))
        along = w * np.sum(g * ray, axis=0)
        step = np.linalg.solve(np.einsum("aij,bij,ij->ab", g, g, w), np.einsum("aij,ij->a", g, along))
        centre = centre + step
        if np.abs(step).max() < 1e-7:
            break
    return _View(centre, slopes, g, ray, w, window)


def _correlation(slopes: Array, fields: Array, k: int) -> Array:
    """Sums over all b of fields (b, n, n) times slopes (b, N, N) shifted by each of the PSF's samples, (k^2,)."""
    n = fields.shape[1]
    first = (slopes.shape[1] - n) // 2 - k // 2
    parts = slopes[:, first : first + n + k - 1, first : first + n + k - 1]
    # circular correlation, of which the first k x k positions do not wrap around
    size = transforms.next_fast_len(n + k - 1)
    spectra = transforms.rfft2(parts, (size, size)) * np.conj(transforms.rfft2(fields, (size, size)))
    return np.asarray(transforms.irfft2(spectra.sum(axis=0), (size, size))[k - 1 :: -1, k - 1 :: -1].ravel())


def _x_corner(J: Array, reach: int) -> Array:
    """An unbounded x-corner on the s grid, (2 reach + 1) square: black above and below, antialiased, centred."""
    n = SUPERSAMPLING * (2 * reach + 1)
    t = (np.arange(n) - (n - 1) / 2) / SUPERSAMPLING
    across = np.abs(J[0, 0] * t + J[0, 1] * t[:, None])
    down = np.abs(J[1, 0] * t + J[1, 1] * t[:, None])
    wedge = (across > down).view(np.int8) - (across < down).view(np.int8)
    by_rows = wedge.reshape(-1, SUPERSAMPLING, n).sum(axis=1, dtype=np.int8)
    return np.asarray(by_rows.reshape(len(by_rows), -1, SUPERSAMPLING).sum(axis=2) / SUPERSAMPLING**2)
