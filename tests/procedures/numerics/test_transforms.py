"""Transforms by OpenCV compared with NumPy's."""

import numpy as np
import pytest

from procedures.numerics.transforms import fft2, irfft_rows, rfft2

SHAPES = [(8, 12), (9, 12), (8, 15), (9, 15), (1, 6), (2, 2)]


@pytest.mark.parametrize("shape", SHAPES)
def test_half_plane_is_numpys(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(1).standard_normal(shape).astype(np.float32)
    # single precision: 1e-7 of a sum of up to 135 samples of size 1
    np.testing.assert_allclose(rfft2(picture), np.fft.rfft2(picture.astype(np.float64)), atol=2e-5)
    for exact, atol in ((np.float32, 2e-5), (np.float64, 1e-12)):
        np.testing.assert_allclose(fft2(picture.astype(exact)), np.fft.fft2(picture.astype(np.float64)), atol=atol)
    for padded in ([10, 16], [9, 17]):
        assert rfft2(picture, padded).dtype == np.complex64
        np.testing.assert_allclose(rfft2(picture, padded), np.fft.rfft2(picture, padded), atol=2e-5)


@pytest.mark.parametrize("columns", [12, 15])
@pytest.mark.parametrize("known", [3, 6, 7, 8])
def test_rows_are_reproduced_from_the_known_frequencies(columns: int, known: int) -> None:
    rng = np.random.default_rng(2)
    spectra = np.fft.rfft(rng.standard_normal((5, columns)), axis=1)[:, :known]
    expected = np.fft.irfft(spectra, columns, axis=1)
    np.testing.assert_allclose(irfft_rows(spectra.astype(np.complex64), columns), expected, atol=1e-6)
