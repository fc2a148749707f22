"""Recovery of the parts of simulated cameras from their PSFs; simulator and model share no code for the optics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from procedures import Chart, Diffraction, Plane, Psf, estimate_psf
from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from procedures.physics.estimate import (
    Physics,
    WhitenedPsf,
    _fill_factor,
    distance_of_rise,
    estimate_physics,
    fit_parts,
)
from procedures.physics.model import TERMS, Aperture, Grid, LowPass, ModelParts, Pupil, aperture_otf, names_of
from simulators.camera.camera import Lens, SimulatedCamera, true_psf
from simulators.camera.optics import (
    WAVELENGTHS_UM,
    CircularPupil,
    FourSpots,
    GaussianBlur,
    LShapedAperture,
    Optics,
    PixelAperture,
)  # fmt: skip
from simulators.camera.pupil import Wavefront, aberrated_otf, circular_otf
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

S, K = 4, 17
PITCH_UM, F_NUMBER = 5.0, 5.6
WAVEFRONT = Wavefront(
    defocus_um=0.05, astigmatism_um=0.03, oblique_astigmatism_um=0.02, coma_y_um=-0.02, coma_x_um=0.04,
    spherical_um=0.03,
)  # fmt: skip


def camera(*sensor: PixelAperture | FourSpots | LShapedAperture | GaussianBlur, wavefront: Wavefront) -> Optics:
    return Optics((CircularPupil(F_NUMBER, wavefront), *sensor), PITCH_UM)


def measured(
    optics: Optics, colour: str, relative: float, rng: np.random.Generator, pitch: int = 2
) -> tuple[Psf, Diffraction]:
    """A plane's PSF with noise of a given relative L2 norm, white except for its sum of 1."""
    true = true_psf(optics, S, K, colour=colour, pitch=pitch).h
    sigma = relative * float(np.linalg.norm(true)) / K
    covariance = sigma**2 * (np.eye(K * K) - 1 / K**2)
    noise = sigma * rng.standard_normal(K * K)
    h = true + (noise - noise.mean()).reshape(K, K)
    return Psf(h, S, covariance), Diffraction(F_NUMBER, pitch * PITCH_UM, 1000 * WAVELENGTHS_UM[colour])


def value(outcome: Outcome[Physics]) -> Physics:
    assert outcome.value is not None
    return outcome.value


@pytest.mark.slow
def test_pupil_otf_agrees_with_an_independent_calculation() -> None:
    # quadrature over the overlap there, Fourier transforms of a sampled disc here: accurate up to the disc's rim
    f, scale = np.arange(-32, 33) / 16, 2 * 0.55 * 5.6 / 7.5
    pupil = Pupil(2 / scale, 1 / 16, 2.0)
    flat = circular_otf(np.minimum(scale * np.hypot(f, f[:, None]), 2))
    np.testing.assert_allclose(pupil.otf_and_slopes(np.zeros(8), ())[0], flat, atol=2e-3)
    w = WAVEFRONT
    terms = (w.defocus_um, w.oblique_astigmatism_um, w.astigmatism_um, w.coma_y_um, w.coma_x_um, 0, 0, w.spherical_um)
    aberrated = aberrated_otf(scale * f[None, :], scale * f[:, None], w, 0.55)
    np.testing.assert_allclose(pupil.otf_and_slopes(np.array(terms) / 0.55, ())[0], aberrated, atol=2e-3)


def test_strehl_follows_marechal_for_small_wavefronts() -> None:
    # 1 - (2 pi sigma)^2 to fourth order
    waves = 0.02 * np.eye(8)[[0, 3]]
    for one in waves:
        assert Pupil(2.0, 1 / 16, 2.0).strehl(one) == pytest.approx(1 - (2 * np.pi * 0.02) ** 2, abs=4e-4)


@pytest.mark.parametrize("turns", range(4))
def test_l_shaped_apertures_are_rotations_of_the_simulator_s(turns: int) -> None:
    f = np.linspace(-1.5, 1.5, 13)
    fx, fy = f[None, :], f[:, None]
    simulated = LShapedAperture(0.9, 0.4, quarter_turns=turns).otf(fx, fy, WAVELENGTHS_UM["G"], 5.0)
    shape = [Aperture.L_45, Aperture.L_135, Aperture.L_225, Aperture.L_315][turns]
    # the square common to both is centred on the pixel
    np.testing.assert_allclose(aperture_otf(shape, 0.9, 0.4, fx, fy), simulated, atol=1e-12)


@pytest.mark.slow
def test_model_derivatives_agree_with_differences(rng: np.random.Generator) -> None:
    psf, diffraction = measured(camera(PixelAperture(), wavefront=WAVEFRONT), "G", 0.01, rng)
    grid, parts = Grid(psf, diffraction, 2), ModelParts(Aperture.L_135, LowPass.FOUR, diffusion=True)
    p = np.concatenate([[0.1, -0.05, 0.9, 0.4, 0.7, 0.2], rng.uniform(-0.1, 0.1, len(TERMS))])
    _, J = grid.model(parts, p)
    for i, name in enumerate(names_of(parts)):
        step = 1e-5 * np.eye(len(p))[i]
        difference = (grid.model(parts, p + step)[0] - grid.model(parts, p - step)[0]) / 2e-5
        np.testing.assert_allclose(J[:, i], difference, atol=1e-5 * np.abs(difference).max(), err_msg=name)


@pytest.mark.slow
def test_all_parts_of_a_camera_are_recovered(rng: np.random.Generator) -> None:
    optics = camera(PixelAperture(0.95, 0.95), FourSpots(0.8), wavefront=WAVEFRONT)
    psf, diffraction = measured(optics, "G", 0.01, rng)
    outcome = estimate_physics(psf, diffraction, 2)
    physics = value(outcome)
    assert outcome.verdict is Verdict.PASS
    assert (physics.aperture, physics.low_pass) == ("square", "four spots")
    waves = 1 / WAVELENGTHS_UM["G"]
    true = {"side": 0.95, "separation": 0.8, "fill_factor": 0.95**2, "defocus": 0.05 * waves, "coma_x": 0.04 * waves}
    true |= {"astigmatism": 0.03 * waves, "coma_y": -0.02 * waves, "trefoil_x": 0.0, "spherical": 0.03 * waves}
    rms = float(np.linalg.norm([0.05, 0.03, 0.02, 0.02, 0.04, 0.03])) * waves
    for name, expected in {**true, "wavefront_rms": rms}.items():
        number = physics.numbers[name]
        # four standard deviations, and 1 % of a wave or pixel for the grids
        assert abs(number.value - expected) < 4 * number.uncertainty + 0.002, name
    # the residual is noise alone, of variance 2 / freedom
    assert physics.chi_square / physics.freedom == pytest.approx(1, abs=0.3)
    assert physics.remaining < 0.001


@pytest.mark.slow
def test_charge_diffusion_is_no_low_pass_filter(rng: np.random.Generator) -> None:
    optics = camera(PixelAperture(0.95, 0.95), GaussianBlur(0.2), wavefront=Wavefront(defocus_um=0.05))
    physics = value(estimate_physics(*measured(optics, "Y", 0.03, rng, pitch=1), 1))
    assert physics.low_pass == "none"
    for name, expected in {"side": 0.95, "diffusion": 0.2, "defocus": 0.05 / WAVELENGTHS_UM["Y"]}.items():
        number = physics.numbers[name]
        assert abs(number.value - expected) < 4 * number.uncertainty, name


@pytest.mark.slow
def test_error_bars_are_as_large_as_errors(rng: np.random.Generator) -> None:
    optics = camera(PixelAperture(0.9, 0.9), wavefront=WAVEFRONT)
    parts, start, z = ModelParts(), None, []
    true = np.array([0.9, *(v / WAVELENGTHS_UM["G"] for v in (0.05, 0.02, 0.03, -0.02, 0.04, 0, 0, 0.03))])
    for _ in range(8):
        psf, diffraction = measured(optics, "G", 0.02, rng)
        fit = fit_parts(WhitenedPsf.of(Grid(psf, diffraction, 2)), parts, start)
        start = fit.p
        z.append((fit.p[2:] - true) / np.sqrt(np.diag(fit.covariance))[2:])
    # 72 numbers, some of them correlated: their spread is known to an eighth
    assert np.std(z) == pytest.approx(1, abs=0.35)


@pytest.mark.slow
def test_a_perfect_lens_has_no_aberrations(rng: np.random.Generator) -> None:
    psf, diffraction = measured(camera(PixelAperture(0.9, 0.9), wavefront=Wavefront()), "G", 0.01, rng)
    outcome = estimate_physics(psf, diffraction, 2)
    physics = value(outcome)
    assert (physics.aperture, physics.low_pass) == ("square", "none")
    assert physics.numbers["side"].value == pytest.approx(0.9, abs=0.01)
    # the bound is reached: a limit from the likelihood, flagged as doubtful
    strehl = physics.numbers["strehl_lens"]
    assert strehl.value == 1
    assert 0.001 < strehl.uncertainty < 0.2
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "strehl lens is at its bound 1, within" in outcome.reason
    # so is the wavefront error, to which the Strehl ratio is related as 1 - (2 pi w)^2 (Marechal)
    waves, nm = (physics.numbers[name] for name in ("wavefront_rms", "wavefront_rms_nm"))
    assert (waves.value, nm.value) == (0, 0)
    assert waves.uncertainty >= 0.8 * strehl.uncertainty**0.5 / (2 * np.pi)
    assert nm.uncertainty == pytest.approx(diffraction.wavelength_nm * waves.uncertainty)
    assert "wavefront" not in outcome.reason


@pytest.mark.slow
@pytest.mark.parametrize("term", ["defocus", "coma_x"])
def test_chi_square_rises_by_one_at_the_distance_from_the_bound(rng: np.random.Generator, term: str) -> None:
    psf, diffraction = measured(camera(PixelAperture(0.9, 0.9), wavefront=Wavefront()), "G", 0.01, rng)
    data, parts = WhitenedPsf.of(Grid(psf, diffraction, 2)), ModelParts(aberrations=())
    fit = fit_parts(data, parts)
    probe = replace(parts, aberrations=(TERMS.index(term),))
    started = replace(fit, parts=probe, p=np.append(fit.p, 0.0))
    waves = distance_of_rise(data, started, term, 0.0, 1.0)

    def chi2(held: float) -> float:
        # a derivative-free optimiser over the free parameters
        def cost(p: np.ndarray) -> float:
            h, _ = data.grid.model(probe, np.append(p, held))
            return float(np.sum((data.W @ (h - psf.h.ravel())) ** 2))

        return float(minimize(cost, fit.p, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-4}).fun)

    least = max(fit.chi2 / fit.freedom, 1)
    assert chi2(waves) - chi2(0.0) == pytest.approx(least, rel=0.2)


def test_fill_factor_over_one_is_one_sided() -> None:
    over = {"fill_factor": Quantity(1.03, "1", 0.02, "m", 9)}
    d = 0.03 / 0.02
    physics = _fill_factor(over["fill_factor"])
    assert physics is not None
    number = physics.quantity(over["fill_factor"])
    assert number.value == 1
    # chi-square ((1.03 - f) / 0.02)^2 is one more there than at f = 1
    assert ((1.03 - (1 - number.uncertainty)) / 0.02) ** 2 == pytest.approx(d**2 + 1)
    assert physics.words == "fill factor fits best at 1.03, beyond its bound 1"
    assert _fill_factor(Quantity(0.99, "1", 0.02, "m", 9)) is None


@pytest.mark.nightly
def test_l_shaped_photosites_differ_by_a_rotation_between_green_and_red(rng: np.random.Generator) -> None:
    # figure 3.7 of Delbracio's thesis: transfer functions of red and blue look like green's rotated by 90 degrees
    optics = camera(LShapedAperture(0.98, 0.55, quarter_turns=1), wavefront=Wavefront(defocus_um=0.02))
    psf, diffraction = measured(optics, "G", 0.005, rng)
    green = value(estimate_physics(psf, diffraction, 2))
    assert green.missing_corner_deg == 135
    assert green.numbers["notch"].value == pytest.approx(0.55, abs=0.05)
    psf, diffraction = measured(optics, "R", 0.005, rng)
    data = WhitenedPsf.of(Grid(psf, diffraction, 2))
    fits = [fit_parts(data, ModelParts(shape, aberrations=(0,))) for shape in Aperture]
    best = min(fits, key=lambda one: one.criterion())
    assert best.parts.aperture.missing_corner_deg == green.missing_corner_deg + 90
    # the second best, rotated by 180 degrees, has the same modulus but another phase
    assert sorted(one.chi2 for one in fits)[1] > best.chi2 + 100


@pytest.mark.nightly
def test_the_sensor_is_estimated_from_the_chart_and_other_blur_is_reported(rng):
    # the complete path: render, add noise, estimate with the true covariance, fit the model
    optics = Optics((CircularPupil(4.0), PixelAperture(0.9, 0.9), FourSpots(0.8)), 7.5)
    sensor = Sensor(150, 150, None, bits=14, full_well_e=5e4, gain_e_per_dn=3.2)
    photographer = SimulatedCamera(Lens(f_number=4.0), sensor, 7.5, optics, white_e_per_s=4e4 / 0.02 * (4.0 / 5.6) ** 2)
    placed = photographer.place(Chart.from_seed(), pixels=100, yaw_deg=3.0, roll_deg=2.0)
    shot = photographer.photograph(Scene((placed,)), rng)
    psf = estimate_psf(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 15000), Chart.from_seed()).value
    assert psf is not None
    physics = value(estimate_physics(psf.psf, Diffraction(4.0, 7.5, 550.0), 1))
    assert (physics.aperture, physics.low_pass) == ("square", "four spots")
    for name, true in {"side": 0.9, "separation": 0.8}.items():
        assert abs(physics.numbers[name].value - true) < 4 * physics.numbers[name].uncertainty + 0.005
    assert physics.chi_square / physics.freedom == pytest.approx(1, abs=0.4)
    # an elongated Gaussian is none of the parts
    optics = camera(PixelAperture(), GaussianBlur(1.6, 0.4, 30.0), wavefront=Wavefront())
    psf, diffraction = measured(optics, "G", 0.003, rng)
    outcome = estimate_physics(psf, diffraction, 2)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "residual of the best model" in outcome.reason


def test_without_pitch_or_aperture_there_is_no_physics(rng: np.random.Generator) -> None:
    psf, _ = measured(camera(PixelAperture(), wavefront=Wavefront()), "G", 0.01, rng)
    with pytest.raises(BadParameter, match="pitch and the f-number"):
        estimate_physics(psf, None, 2)
