"""Rings around the cores of PSFs whose OTFs are formulae."""

from dataclasses import replace

import numpy as np

from procedures.corruption.ring import missing_light
from procedures.numerics.kernel_tail import tail_density
from procedures.psf import Psf, PsfTail
from procedures.quality import Diffraction

S, K = 5, 21
SHARP, SOFT = Diffraction(2.8, 9.2, 550), Diffraction(5.6, 9.2, 550)
"""Lenses before a Bayer plane, whose photosites are half a pixel of the plane wide."""


def seen(lens: Diffraction, mask: float = 0.0, radius_px: float = 1.0, k: int = K) -> Psf:
    """The lens and a photosite in the band of S, sharpened by an unsharp mask; samples known to 1e-4."""
    f = (np.arange(400) + 0.5) / 400 * S - S / 2
    r2 = f**2 + (f**2)[:, None]
    otf = lens.otf(np.sqrt(r2)) * np.sinc(0.5 * f) * np.sinc(0.5 * f[:, None])
    otf *= 1 + mask * (1 - np.exp(-2 * np.pi**2 * radius_px**2 * r2))
    x = (np.arange(k) - k // 2) / S
    waves = np.cos(2 * np.pi * x[:, None] * f)  # the OTF is even along either axis
    h = waves @ otf @ waves.T / 400**2
    tail = np.array([lens.tail_density_px * S / tail_density(k) / h.sum()])
    covariance = 1e-4**2 * np.eye(k * k)
    return Psf(h / h.sum(), S, covariance, PsfTail(tail, np.array([[1e-6]]), np.zeros((k * k, 1))))


def test_unsharp_masks_are_detected_by_either_lens_and_a_band_that_ends_is_none():
    # what f/2.8 passes beyond 2.5 cycles/pixel leaves rings of its own when it is missing
    assert missing_light(seen(SHARP)) < 3
    for lens in (SHARP, SOFT):
        assert missing_light(seen(lens, 0.2)) > 5
    assert missing_light(seen(SOFT, 0.1)) > 3
    assert missing_light(seen(SOFT)) < 0


def test_a_wide_mask_takes_light_from_the_outer_rings_of_a_wide_support():
    assert missing_light(seen(SOFT, 0.1, 3.0, 41)) > 5
    assert missing_light(seen(SOFT, k=41)) < 0


def test_a_steep_decay_outside_the_support_is_no_missing_light_unless_the_light_is_negative():
    def cut(steep: float) -> Psf:
        return replace(seen(SOFT), tail=PsfTail(np.array([-0.04, steep]), 1e-6 * np.eye(2), np.zeros((K * K, 2))))

    assert missing_light(cut(0.06)) <= 0 < cut(0.06).share_outside
    assert missing_light(cut(0.0)) > 5
