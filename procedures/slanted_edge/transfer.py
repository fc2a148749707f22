"""MTF of an edge spread function: differences, window, tail beyond the window, Fourier transform."""

from functools import lru_cache

import numpy as np

from procedures.numerics.arrays import Array
from procedures.slanted_edge.edge_line import tukey
from procedures.slanted_edge.profile import BINS

STEP = 0.005  # spacing of the frequencies, in cycles per pixel
HIGHEST = 1.0
FREQUENCIES: Array = np.arange(0, HIGHEST + STEP / 2, STEP)
TAIL_END_PX = 400.0


def mtf_of(esf: Array, tail: Array, flat_px: float, end_px: float) -> Array:
    """MTF (..., f) at `FREQUENCIES` of edge spread functions with tails a: differences of bins, less the sinc of their
    box (ISO 12233:2023, annex D) and the spline's gain."""
    K = esf.shape[-1] // 2
    x = (np.arange(-K + 1, K)) / BINS
    lsf = np.diff(esf, axis=-1) * tukey(x, flat_px, end_px)
    waves = np.exp(-2j * np.pi * FREQUENCIES[:, None] * x)
    inside = lsf @ waves.T / (np.sinc(FREQUENCIES / BINS) * _spline_gain())
    otf = inside + np.asarray(tail)[..., None] * _tail_spectrum(flat_px, end_px)
    modulus = np.abs(otf)
    return np.asarray(modulus / modulus[..., :1])


@lru_cache(maxsize=1)
def _spline_gain() -> Array:
    """Gain at `FREQUENCIES` of a wave at the bins' centres, by a cubic spline whose mean over each bin is that of the
    samples."""
    u = FREQUENCIES[:, None] / BINS + np.arange(-8, 9)
    spline = np.sinc(u) ** 4
    spline /= spline.sum(axis=1, keepdims=True)
    return np.asarray(np.sinc(FREQUENCIES / BINS) / np.sum(spline * np.sinc(u), axis=1))


def noise_gain() -> Array:
    """Noise of the spline through the bins over that of the bins' means, at `FREQUENCIES`."""
    return np.asarray(_spline_gain() / np.sinc(FREQUENCIES / BINS))


@lru_cache(maxsize=8)
def _tail_spectrum(flat_px: float, end_px: float) -> Array:
    """Spectrum of the part of 1/d^2 outside the window, on both sides, at `FREQUENCIES`."""
    step = 0.05
    d = np.arange(flat_px + step / 2, TAIL_END_PX, step)
    beyond = (1 - tukey(d, flat_px, end_px)) / d**2 * step
    spectrum = 2 * np.cos(2 * np.pi * FREQUENCIES[:, None] * d) @ beyond
    spectrum[0] += 2 / TAIL_END_PX
    spectrum.flags.writeable = False
    return np.asarray(spectrum)


def frequency_at(mtf: Array, level: float) -> Array:
    """Frequency at which MTFs (..., f) first fall below a level, in cycles per pixel; NaN where they do not."""
    below = mtf < level
    i = np.argmax(below, axis=-1)
    high = np.take_along_axis(mtf, np.maximum(i - 1, 0)[..., None], -1)[..., 0]
    low = np.take_along_axis(mtf, i[..., None], -1)[..., 0]
    share = (high - level) / np.where(high > low, high - low, 1.0)
    return np.asarray(np.where(below.any(axis=-1) & (i > 0), (i - 1 + share) * STEP, np.nan))
