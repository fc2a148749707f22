"""Relative sharpness of both photographs, by their spectra: equal, when refocused at either distance."""

import numpy as np
import scipy.fft

from procedures.numerics.arrays import Array, Array32, Indices

PATCH = 64  # side of the patches; a smaller photograph is one patch along that axis
MOST_PATCHES = 6  # along either axis
LOW, HIGH = (0.06, 0.12), (0.27, 0.36)  # bands of frequencies, in cycles per pixel


def sharpness_ratio(near: Array32, far: Array32, noise: float) -> float:
    """Fine over coarse contrast of the near photograph, over that of the far one; 1 when both are equally sharp.

    Texture is approximately scale-invariant: from four times the distance a wall has the same spectrum up to a factor.
    Real walls give 0.5 to 1, as they have less very fine detail; other ratios are due to the focus.

    near, far : (rows, columns), the parts of the same wall
    noise : standard deviation of a pixel's noise, whose flat spectrum is subtracted
    """
    return fineness(near, noise) / fineness(far, noise)


def fineness(photograph: Array32, noise: float) -> float:
    """Amplitude of the high band over that of the low one, without noise."""
    rows, columns = (min(n, PATCH) for n in photograph.shape)
    power = patch_spectra(photograph, rows, columns)[0] - noise**2
    f = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    low, high = (float(power[(f >= start) & (f < end)].mean()) for start, end in (LOW, HIGH))
    floor = 1e-3 * noise**2  # noise alone must not give a negative power
    return float(np.sqrt(max(high, floor) / max(low, floor, 1e-12)))


def patch_spectra(photograph: Array32, rows: int, columns: int) -> tuple[Array, int]:
    """Power per pixel of a photograph, (rows, columns // 2 + 1), averaged over windowed patches, and their number."""
    window = np.outer(np.hanning(rows), np.hanning(columns)).astype(np.float32)
    tops, lefts = (_starts(n, side) for n, side in zip(photograph.shape, (rows, columns), strict=True))
    patches = np.stack([photograph[i : i + rows, j : j + columns] for i in tops for j in lefts])
    patches = (patches - patches.mean(axis=(1, 2), keepdims=True)) * window
    power = np.zeros((rows, columns // 2 + 1))
    for patch in patches:
        power += np.abs(scipy.fft.rfft2(patch)) ** 2
    return power / len(patches) / float(np.sum(window**2)), len(patches)


def _starts(n: int, side: int) -> Indices:
    """First pixels of at most six patches along an axis of n pixels, overlapping by half at most."""
    count = int(np.clip(2 * n // side - 1, 1, MOST_PATCHES))
    return np.unique(np.linspace(0, max(n - side, 0), count).astype(np.int64))
