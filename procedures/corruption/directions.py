"""Directions of corruptions: how a picture changes with the strength of each, to first order.

A picture is what a fit predicts, black near 0 and white near 1, with `BORDER` pixels of what surrounds it. A fit
absorbs whatever a linear, shift-invariant filter does within the reach of its PSF; what is left of a direction
identifies the corruption.
"""

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array

BORDER = 40
"""Pixels around the picture that wide filters need."""
WIDE_PX = (3.0, 6.0)
"""Radii of wide unsharp masks, in pixels."""
WIDE_NAMES = tuple(f"{radius:g} px" for radius in WIDE_PX)
VEIL_PX = 20.0
"""Radius of a veil."""
GHOST_PX = 3.0
"""Blur of a ghost."""
FINE_PX = 1.0
"""Radius of an unsharp mask that has a threshold."""
DETAIL = 0.03
"""Contrast above which such a mask sharpens, relative to that of black and white."""
FLAT = 0.02
"""Gradient below which a filter along edges does little."""
FAINT, ADAPTIVE_PX = 0.03, 5
"""Standard deviation of detail, relative to the contrast of black and white, that adaptive smoothing halves; side of
its window."""
RING = 0.03
"""Width of the rings of a spectrum, in cycles/pixel."""

MEDIAN, FLOW, THRESHOLD, VEIL, GHOST = "median", "flow", "threshold", "veil", "ghost"
ADAPTIVE = "adaptive"
ZOOM, RIM = "zoom", "rim"


def blurred(picture: Array, radius_px: float) -> Array:
    """The picture through a Gaussian."""
    size = 2 * int(3 * radius_px) + 1
    return np.asarray(cv2.GaussianBlur(picture, (size, size), radius_px, borderType=cv2.BORDER_REPLICATE))


def mask(picture: Array, radius_px: float) -> Array:
    """An unsharp mask of amount 1: the picture less its Gaussian blur."""
    return np.asarray(picture - blurred(picture, radius_px))


def mask_gain(f: Array, radius_px: float) -> Array:
    """Gain of an unsharp mask of amount 1 at frequencies f in cycles/pixel, less 1."""
    return np.asarray(1 - np.exp(-2 * (np.pi * f * radius_px) ** 2))


def filters(picture: Array) -> dict[str, Array]:
    """Directions of filters that are not linear: median, smoothing along edges, sharpening above a threshold."""
    gy, gx = np.gradient(picture)
    gxy, gxx = np.gradient(gx)
    gyy = np.gradient(gy, axis=0)
    flow = (gy * gy * gxx - 2 * gx * gy * gxy + gx * gx * gyy) / (gx * gx + gy * gy + FLAT**2)
    fine = mask(picture, FINE_PX)
    return {
        MEDIAN: cv2.medianBlur(picture.astype(np.float32), 3) - picture,
        FLOW: flow,
        THRESHOLD: np.where(np.abs(fine) > DETAIL, fine, 0.0),
    }


def adaptive(picture: Array) -> Array:
    """Direction of denoising that smooths faint detail more than strong one: a filter guided by the picture itself (He,
    Sun, Tang, IEEE TPAMI 35 (2013), equations (5), (6), (8))."""
    mean, square = (_local_mean(one) for one in (picture, picture * picture))
    variance = square - mean * mean
    kept = variance / (variance + FAINT**2)
    return np.asarray(_local_mean(kept) * picture + _local_mean((1 - kept) * mean) - picture)


def _local_mean(picture: Array) -> Array:
    return np.asarray(cv2.blur(picture, (ADAPTIVE_PX, ADAPTIVE_PX)))


def gain_along(direction: Array, picture: Array, f: Array) -> Array:
    """Gain less 1, at frequencies f (n,) in cycles/pixel, of the linear filter that changes a picture most like a
    direction: their cross spectrum over the picture's spectrum, in rings."""
    window = np.outer(*(np.hanning(n) for n in picture.shape))
    changed, given = (np.fft.rfft2((one - one.mean()) * window) for one in (direction, picture))
    rows, columns = picture.shape
    at = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    ring = np.rint(at / RING).astype(int).ravel()
    cross, power = (np.bincount(ring, np.real(one * given.conj()).ravel(), ring.max() + 1) for one in (changed, given))
    return np.interp(f, RING * np.arange(len(power)), cross / np.maximum(power, 1e-30))


def wide_masks(picture: Array) -> dict[str, Array]:
    """Directions of unsharp masks wider than a PSF, and of a veil, which is the opposite of one."""
    return {name: mask(picture, r) for name, r in zip(WIDE_NAMES, WIDE_PX, strict=True)} | {
        VEIL: -mask(picture, VEIL_PX)
    }


def variations(picture: Array, x: Array, y: Array) -> dict[str, Array]:
    """Directions of blur that grows with the square of the distance (x, y): along the radius, and in all directions;
    the amplitudes are variances in square pixels at distance 1."""
    gy, gx = np.gradient(picture)
    gxy, gxx = np.gradient(gx)
    gyy = np.gradient(gy, axis=0)
    return {ZOOM: (x * x * gxx + 2 * x * y * gxy + y * y * gyy) / 2, RIM: (x * x + y * y) * (gxx + gyy) / 4}


def mirrored(samples: npt.NDArray[np.float32], corner: tuple[int, int], shape: tuple[int, int]) -> Array:
    """The part of a plane that is its own blurred ghost, mirrored through the plane's centre, in a window of first
    pixel `corner` (x, y)."""
    margin = int(4 * GHOST_PX)
    (rows, columns), (x, y) = samples.shape, corner
    down, across = (
        np.clip(np.arange(first + n - 1 + margin, first - margin - 1, -1), 0, most - 1)
        for first, n, most in ((rows - y - shape[0], shape[0], rows), (columns - x - shape[1], shape[1], columns))
    )
    ghost = blurred(samples[np.ix_(down, across)].astype(np.float64), GHOST_PX)
    return ghost[margin:-margin, margin:-margin]
