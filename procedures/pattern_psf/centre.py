"""The PSF's centre: where the chart's x-corners appear when they are seen through it.

A translation of the map and a shift of the PSF explain the photograph equally well, so the marks decide: the map is
right when the mark of the chart lies where equation (1) of the paper finds it. The twelve marks of one photograph
are noisy and aliased; the fitted PSF predicts the same mark without noise and on the s grid, and equation (1) on
that prediction is the mean over infinitely many marks. For a PSF with a centre of symmetry it gives that centre,
whatever the window. For others (coma) the centre is this convention, and the centroid is reported beside it.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SUPERSAMPLING = 4  # points per sample of the s grid along each axis, for the antialiased mark


def mark_offset(h: Array, s: int, J: Array) -> Array:
    """Displacement (x, y), in pixels, at which a PSF shows the centre of an x-corner.

    Parameters
    ----------
    h : (k, k) float64
        The PSF on the s grid; its sum does not matter.
    s : int
    J : (2, 2) float64
        Derivative of cells with respect to pixels: how the mark lies on the sensor.

    References
    ----------
    Delbracio, Muse, Almansa, IPOL 2012, section 4.2, equation (1), its Gaussian window as wide as the PSF.
    """
    k = h.shape[0]
    reach = k // 2 + 1
    seen = cv2.filter2D(_x_corner(J, 3 * reach), cv2.CV_64F, h[::-1, ::-1] / h.sum(), borderType=cv2.BORDER_REPLICATE)
    gy, gx = np.gradient(seen)
    inner = slice(reach, -reach)
    gx, gy = gx[inner, inner], gy[inner, inner]
    v, u = np.mgrid[: len(gx), : len(gx)] - len(gx) // 2
    centre = np.zeros(2)
    for _ in range(20):
        x, y = u - centre[0], v - centre[1]
        w = np.exp(-(x * x + y * y) / (2 * (0.6 * reach) ** 2))
        tensor = np.array([[np.sum(w * gx * gx), np.sum(w * gx * gy)], [np.sum(w * gx * gy), np.sum(w * gy * gy)]])
        ray = gx * u + gy * v
        found = np.linalg.solve(tensor, [np.sum(w * gx * ray), np.sum(w * gy * ray)])
        still = np.abs(found - centre).max() < 1e-6
        centre = found
        if still:
            break
    return np.asarray(centre / s)


def _x_corner(J: Array, reach: int) -> Array:
    """A boundless x-corner on the s grid, (2 reach + 1) square: black above and below, antialiased, centred."""
    n = SUPERSAMPLING * (2 * reach + 1)
    t = (np.arange(n) - (n - 1) / 2) / SUPERSAMPLING
    across = J[0, 0] * t + J[0, 1] * t[:, None]
    down = J[1, 0] * t + J[1, 1] * t[:, None]
    wedge: Array = np.sign(np.abs(across) - np.abs(down))
    return np.asarray(wedge.reshape(n // SUPERSAMPLING, SUPERSAMPLING, -1, SUPERSAMPLING).mean(axis=(1, 3)))
