"""Kernels of any form, one sample a pixel: constraints, and their least-squares step."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import label
from scipy.signal import fftconvolve

from procedures.outcome import Refused

Kernels = NDArray[np.float32]
"""(P, K, K), K odd, sum 1 each; a common shift of all affects only the picture."""
LEAST_PIECE = 0.05
"""Fraction of a kernel's light below which an isolated piece is noise."""


def unit(kernels: Kernels) -> Kernels:
    """Kernels normalised to sum 1."""
    normalised: Kernels = kernels / np.maximum(kernels.sum(axis=(1, 2), keepdims=True), 1e-9)
    return normalised


def thin(kernels: Kernels, least: float) -> Kernels:
    """Kernels without values below `least` of their maximum and small isolated pieces. Raises Refused if nothing
    remains."""
    thinned = np.stack([_whole_pieces(np.where(k < least * k.max(), 0, k)) for k in kernels])
    if not thinned.any():
        raise Refused("no kernels explain the photographs", "put structure into the scene, or give larger photographs")
    return unit(thinned)


def _whole_pieces(kernel: NDArray[np.float32]) -> NDArray[np.float32]:
    pieces, count = label(kernel > 0, np.ones((3, 3)))
    light = np.bincount(pieces.ravel(), kernel.ravel(), count + 1)
    clean: NDArray[np.float32] = np.where(light[pieces] < LEAST_PIECE * light.sum(), 0, kernel).astype(np.float32)
    return clean


def recentred(kernels: Kernels) -> Kernels:
    """Kernels shifted together by whole pixels so that their common centroid is in the middle."""
    common, R = kernels.sum(axis=0), kernels.shape[1] // 2
    places = np.arange(2 * R + 1)
    dy, dx = (round(float(R - places @ common.sum(axis=axis) / common.sum())) for axis in (1, 0))
    wide = np.pad(kernels, ((0, 0), (R, R), (R, R)))
    return unit(np.roll(wide, (dy, dx), (1, 2))[:, R : 3 * R + 1, R : 3 * R + 1])


def scaled(kernels: Kernels, factor: float, R: int) -> Kernels:
    """Kernels on pixels `factor` times as fine, of half-size R."""
    middle = R - factor * (kernels.shape[1] // 2)
    to = np.array([[factor, 0, middle], [0, factor, middle]])
    side = (2 * R + 1, 2 * R + 1)
    return unit(np.stack([np.maximum(cv2.warpAffine(k, to, side, flags=cv2.INTER_LINEAR), 0) for k in kernels]))


def about_middle(kernels: Kernels) -> Kernels:
    """Kernels shifted together by whole pixels so that their common extent is centred."""
    R = kernels.shape[1] // 2
    moves = [round(R - (at[0] + at[-1]) / 2) for at in _extents(kernels)]
    return np.roll(kernels, moves, (1, 2))


def _extents(kernels: Kernels) -> list[NDArray[np.intp]]:
    return [np.flatnonzero(kernels.sum(axis=axes)) for axes in ((0, 2), (0, 1))]


def cropped(kernels: Kernels) -> NDArray[np.float64]:
    """Kernels centred on their common extent, in the smallest square that contains them."""
    R, kernels = kernels.shape[1] // 2, about_middle(kernels)
    half = max(1, *(int(np.abs(at - R).max()) for at in _extents(kernels)))
    side = slice(R - half, R + half + 1)
    return kernels[:, side, side].astype(np.float64)


def likeness(a: Kernels, b: Kernels) -> float:
    """Normalised correlation of two sets of kernels, the smallest of any, at the best common shift."""
    products = [fftconvolve(one, other[::-1, ::-1]) for one, other in zip(a, b, strict=True)]
    at = np.unravel_index(np.sum(products, axis=0).argmax(), products[0].shape)
    norms = (np.linalg.norm(one) * np.linalg.norm(other) for one, other in zip(a, b, strict=True))
    return float(min(p[at] / n for p, n in zip(products, norms, strict=True)))


def least_squares(
    kernels: Kernels, gradient: Kernels, correlation: NDArray[np.float32], ridge: float, iterations: int
) -> Kernels:
    """Non-negative kernels h of least h'(T + ridge)h / 2 - b'h, with `gradient` b - T h at the start; sum 1.

    correlation : T, the autocorrelation of the picture, (2K - 1, 2K - 1). T neglects the end of the frame; `gradient`
    may include it, and the iteration still converges to its zero.

    Source: Beck and Teboulle, SIAM J. Imaging Sciences 2009 (the accelerated steps).
    """
    K = kernels.shape[1]
    n = next_fast_len(3 * K, True)
    wide = np.zeros((n, n), np.float32)
    wide[: 2 * K - 1, : 2 * K - 1] = correlation
    power = np.maximum(rfft2(np.roll(wide, (1 - K, 1 - K), (0, 1))).real, 0)
    step = 1 / (power.max() + ridge)
    now = ahead = kernels
    t = 1.0
    for _ in range(iterations):
        change = irfft2(rfft2(ahead - kernels, (n, n)) * power, (n, n))[:, :K, :K]
        before, now = now, np.maximum(ahead + step * (gradient - change - ridge * ahead), 0)
        t, past = (1 + math.sqrt(1 + 4 * t * t)) / 2, t
        ahead = now + (past - 1) / t * (now - before)
    return unit(now)
