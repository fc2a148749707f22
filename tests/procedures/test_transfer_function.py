import numpy as np
import pytest

from procedures.psf import Psf, PsfTail
from procedures.quality import otf
from procedures.transfer_function import mtf_map, phase_along


def _psf(dx_px: float = 0.0, *, tail: bool = False) -> Psf:
    """A Gaussian of 0.4 pixels whose centre lies dx pixels to the right, sampled 3 times a pixel."""
    x = (np.arange(13) - 6) / 3
    h = np.exp(-((x - dx_px) ** 2 + x[:, None] ** 2) / (2 * 0.4**2))
    h /= h.sum()
    covariance = 1e-8 * np.eye(169)
    outside = PsfTail(np.array([0.03]), np.array([[1e-6]]), np.zeros((169, 1)))
    return Psf(h, 3, covariance, outside) if tail else Psf(h, 3, covariance)


def test_phase_of_a_shifted_psf_is_a_straight_line_with_the_uncertainty_of_draws(rng):
    f = np.linspace(0, 1, 21)
    phase, uncertainty = phase_along(_psf(0.1), f, 0.0)
    # beyond sampling and support, which a Gaussian this narrow leaves at 1e-4
    np.testing.assert_allclose(phase, -360 * 0.1 * f, atol=0.1)
    down, _ = phase_along(_psf(0.1), f, np.pi / 2)
    np.testing.assert_allclose(down, 0, atol=1e-6)
    assert uncertainty[0] == pytest.approx(0, abs=1e-9)
    psf = _psf(0.1)
    f = np.array([0.2, 0.6])
    drawn = [
        phase_along(Psf(psf.h + 1e-4 * rng.standard_normal(psf.h.shape), 3, psf.covariance), f, 0.3)[0]
        for _ in range(400)
    ]
    # 400 draws: 1 / sqrt(800) = 3.5 %
    np.testing.assert_allclose(np.std(drawn, axis=0), phase_along(psf, f, 0.3)[1], rtol=0.14)


@pytest.mark.parametrize("tail", [False, True])
def test_map_is_the_modulus_of_the_whole_psfs_transfer_function(tail: bool) -> None:
    psf = _psf(0.1, tail=tail)
    f, mtf = mtf_map(psf, 9)
    np.testing.assert_allclose(mtf, np.abs(otf(psf, f, f[:, None])), atol=1e-12)
    assert mtf[4, 4] == pytest.approx(1)
