"""Fourier transforms by NumPy, and the lengths that are fast: SciPy's take as long to import as a PSF to estimate."""

from __future__ import annotations

from functools import lru_cache

from numpy.fft import fft2, fftfreq, ifft, irfft, irfft2, rfft2

__all__ = ["fft2", "fftfreq", "ifft", "irfft", "irfft2", "next_fast_len", "rfft2"]


@lru_cache(maxsize=256)
def next_fast_len(n: int) -> int:
    """The least length from n on that is a product of twos, threes and fives."""
    best = 1 << max(n - 1, 0).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            best = min(best, three << max(-(-n // three) - 1, 0).bit_length())
            three *= 3
        five *= 5
    return best
