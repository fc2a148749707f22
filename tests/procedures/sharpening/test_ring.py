"""The ring that sharpening digs, on PSFs of a circular pupil and square pixels by Fourier, without noise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from procedures.numerics.kernel_tail import tail_border, tail_kernels
from procedures.psf import Psf, PsfTail
from procedures.sharpening.ring import missing_light

S, K, GRID = 4, 17, 512
SAMPLE = 3e-4
"""Standard uncertainty of a sample: those of the published photograph are 2e-4 to 5e-4."""
TAIL = 0.003
"""And of the tail's amplitudes."""


def seen(cutoff: float, waves: float, amount: float, radius_px: float) -> npt.NDArray[np.float64]:
    """Samples (GRID, GRID) of a PSF with so much defocus and an unsharp mask, its centre in the middle."""
    f = np.fft.fftfreq(GRID, 1 / S)
    square = f[:, None] ** 2 + f**2
    pupil = (square <= (cutoff / 2) ** 2) * np.exp(8j * np.pi * waves * square / cutoff**2)
    otf = np.fft.fft2(np.abs(np.fft.ifft2(pupil)) ** 2)
    otf = otf / otf[0, 0] * np.sinc(f[:, None]) * np.sinc(f)
    otf *= 1 + amount * (1 - np.exp(-2 * np.pi**2 * radius_px**2 * square))
    return np.fft.fftshift(np.fft.ifft2(otf).real)


def as_estimated(image: npt.NDArray[np.float64]) -> Psf:
    """Its support, and the shapes of the tail that fit it best outside."""
    border, middle = tail_border(K), GRID // 2
    whole = image[middle - border : middle + border + 1, middle - border : middle + border + 1].copy()
    support = slice(border - K // 2, border + K // 2 + 1)
    h = whole[support, support].copy()
    whole[support, support] = 0
    shapes = tail_kernels(K)
    amplitudes = np.linalg.lstsq(shapes.reshape(len(shapes), -1).T, whole.ravel(), rcond=None)[0] / h.sum()
    q = len(shapes)
    tail = PsfTail(amplitudes, np.diag(np.full(q, TAIL**2)), np.zeros((K * K, q)))
    return Psf(h / h.sum(), S, np.diag(np.full(K * K, SAMPLE**2)), tail)


@pytest.mark.parametrize("cutoff", [0.8, 1.14, 1.9])  # of 2 cycles/pixel that the grid holds
@pytest.mark.parametrize("waves", [0.0, 0.3])
def test_no_lens_digs_a_ring_in_focus_or_out_of_it(cutoff: float, waves: float) -> None:
    assert missing_light(as_estimated(seen(cutoff, waves, 0.0, 1.0))) < 0


@pytest.mark.parametrize("radius_px", [0.7, 1.0])
def test_a_weak_mask_digs_a_ring(radius_px: float) -> None:
    # three standard uncertainties are what a verdict asks for
    assert missing_light(as_estimated(seen(1.9, 0.0, 0.15, radius_px))) > 3


def test_a_wide_mask_leaves_a_negative_tail() -> None:
    assert missing_light(as_estimated(seen(1.9, 0.0, 0.1, 2.0))) > 3


def test_nothing_is_told_without_a_tail() -> None:
    psf = as_estimated(seen(1.62, 0.0, 0.0, 1.0))
    assert missing_light(Psf(psf.h, S, psf.covariance)) == -np.inf
