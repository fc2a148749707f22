import numpy as np
import pytest
from scipy.special import j1

from simulators.camera.camera import true_psf
from simulators.camera.optics import WAVELENGTHS_UM, CircularPupil, FourSpots, GaussianBlur, Optics, Path, PixelAperture
from simulators.camera.pupil import Wavefront, defocus_um

ABERRATED = Wavefront(
    defocus_um=0.05, astigmatism_um=0.03, oblique_astigmatism_um=-0.02,
    coma_y_um=0.02, coma_x_um=0.04, spherical_um=0.02,
)  # fmt: skip
BLURS = [
    CircularPupil(5.6), CircularPupil(5.6, ABERRATED), PixelAperture(0.9, 0.7), FourSpots(0.8),
    GaussianBlur(0.4, 0.2, 30.0), Path(((0.0, 0.0), (0.3, 0.1), (0.5, -0.2))),
]  # fmt: skip
ZERO = np.zeros(1)


def cutoff(f_number: float, pitch_um: float) -> float:
    return pitch_um / (WAVELENGTHS_UM["Y"] * f_number)


@pytest.mark.slow
@pytest.mark.parametrize("blur", BLURS, ids=lambda b: type(b).__name__)
def test_no_blur_makes_or_takes_light(blur):
    assert Optics((blur,), 3.76).otf(ZERO, ZERO)[0] == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("blur", BLURS, ids=lambda b: type(b).__name__)
def test_the_psf_is_real(blur, rng):
    fx, fy = rng.uniform(-1, 1, (2, 50))
    optics = Optics((blur,), 3.76)
    np.testing.assert_allclose(optics.otf(-fx, -fy), np.conj(optics.otf(fx, fy)), atol=1e-6)


@pytest.mark.parametrize("blur", BLURS, ids=lambda b: type(b).__name__)
def test_no_frequency_is_amplified(blur, rng):
    # a nonnegative PSF of sum 1 has |H| <= 1
    fx, fy = rng.uniform(-1.5, 1.5, (2, 200))
    assert np.abs(Optics((blur,), 3.76).otf(fx, fy)).max() <= 1 + 1e-6


@pytest.mark.parametrize("wavefront", [Wavefront(), ABERRATED], ids=["perfect", "aberrated"])
def test_nothing_passes_beyond_the_cutoff_of_diffraction(wavefront):
    optics = Optics((CircularPupil(8.0, wavefront),), 3.76)
    f = cutoff(8.0, 3.76) * np.array([0.98, 1.0, 1.02])
    below, at, beyond = np.abs(optics.otf(f, np.zeros(3)))
    assert below > 1e-4
    assert at == pytest.approx(0, abs=1e-9)
    assert beyond == 0


def test_optics_are_airys_and_marechals(rng):
    # intensity (2 J1(v) / v)^2, v = pi r / (wavelength N); normalised it has pi / 4 / (wavelength N)^2 at its centre
    optics, pitch = Optics((CircularPupil(8.0),), 2.0), 2.0
    psf = true_psf(optics, 4, 65)
    reach = WAVELENGTHS_UM["Y"] * 8.0 / pitch
    r = np.hypot(*np.meshgrid(*[np.arange(-32, 33) / 4] * 2))
    v = np.pi * np.maximum(r, 1e-9) / reach
    airy = np.pi / 4 / reach**2 * (2 * j1(v) / v) ** 2 / 4**2
    # the sampled PSF repeats every 160 pixels: the neighbours' tails are all that differs
    np.testing.assert_allclose(psf.samples, airy, atol=2e-5 * airy.max())
    # Strehl = exp(-(2 pi rms / wavelength)^2) to second order; the next order is below rms^4
    wavefront = Wavefront(coma_x_um=0.02, spherical_um=0.015)
    phase = 2 * np.pi * np.hypot(0.02, 0.015) / WAVELENGTHS_UM["Y"]
    f = np.linspace(-1, 1, 401) * cutoff(5.6, 4.0)
    volumes = [
        np.sum(Optics((CircularPupil(5.6, w),), 4.0).otf(f[:, None], f[None, :]).real) for w in (wavefront, Wavefront())
    ]
    assert volumes[0] / volumes[1] == pytest.approx(np.exp(-(phase**2)), abs=phase**4)
    fx, fy = rng.uniform(-0.2, 0.2, (2, 100))
    tiny = Optics((CircularPupil(5.6, Wavefront(defocus_um=1e-9)),), 3.76)
    np.testing.assert_allclose(tiny.otf(fx, fy), Optics((CircularPupil(5.6),), 3.76).otf(fx, fy), atol=1e-6)


@pytest.mark.slow
def test_a_round_wavefront_is_the_limit_of_one_that_is_hardly_not_round(rng):
    # 1e-9 um of coma changes nothing that matters, but takes the other way of reckoning
    fx, fy = rng.uniform(-0.4, 0.4, (2, 100))
    for round_ in (Wavefront(defocus_um=0.1), Wavefront(defocus_um=-0.4, spherical_um=0.05)):
        bent = round_ + Wavefront(coma_x_um=1e-9)
        otf = Optics((CircularPupil(5.6, round_),), 3.76).otf(fx, fy)
        np.testing.assert_allclose(otf, Optics((CircularPupil(5.6, bent),), 3.76).otf(fx, fy), atol=2e-5)


def test_far_out_of_focus_the_psf_is_the_disc_of_geometry():
    # a sensor 0.4 mm from the focus at f/4 sees a disc of 0.1 mm: its radius' root mean square is 0.05 / sqrt 2 mm
    pitch_um = 10.0
    wavefront = Wavefront(defocus_um=defocus_um(0.4, 4.0))
    h = true_psf(Optics((CircularPupil(4.0, wavefront), GaussianBlur(0.3)), pitch_um), 2, 61).h
    x = np.arange(-30, 31) / 2
    spread = np.sqrt(np.sum(h * (x[None, :] ** 2 + x[:, None] ** 2)) - 2 * 0.3**2)
    # diffraction adds 1/r^3 tails to a sharp disc: some per cent
    assert spread * pitch_um == pytest.approx(50 / 2**0.5, rel=0.03)


@pytest.mark.slow
def test_positive_coma_throws_its_tail_towards_larger_x():
    h = true_psf(Optics((CircularPupil(5.6, Wavefront(coma_x_um=0.08)), PixelAperture()), 3.76), 4, 33).h
    x = (np.arange(33) - 16) / 4
    peak = x[np.unravel_index(h.argmax(), h.shape)[1]]
    far = np.sum(h[:, x > peak + 1.5]) - np.sum(h[:, x < peak - 1.5])
    assert far > 0.02


def test_a_moved_image_and_a_bayer_plane_keep_the_psf_with_its_floor():
    h = true_psf(Optics((GaussianBlur(0.7), Path(((0.5, -0.25),))), 3.76), 4, 41).h
    x = (np.arange(41) - 20) / 4
    assert np.sum(h * x[None, :]) == pytest.approx(0.5, abs=1e-6)
    assert np.sum(h * x[:, None]) == pytest.approx(-0.25, abs=1e-6)
    optics = Optics.typical(f_number=11, pitch_um=3.76)
    wide, narrow = true_psf(optics, 4, 401), true_psf(optics, 4, 17)
    cut = np.pad(narrow.samples, 192)
    assert narrow.floor == pytest.approx(np.linalg.norm(wide.samples - cut) / np.linalg.norm(wide.samples), rel=1e-3)
    assert narrow.energy_outside - wide.energy_outside == pytest.approx(np.sum(wide.samples - cut), abs=1e-12)
    optics = Optics.typical(pitch_um=3.76, gaussian_px=0.5)
    coarse, fine = true_psf(optics, 4, 17, pitch=2), true_psf(optics, 2, 17, pitch=1)
    # s samples per pixel of the plane are s / 2 per sensor pixel: the same grid in space, the same band
    np.testing.assert_allclose(coarse.h, fine.h, atol=1e-6)
