"""Estimated noise and contrast, compared with the truth and with solutions for random photographs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.outcome import Refused
from procedures.restoration.joint import joint_descent, noise_and_contrast
from procedures.restoration.joint.data_term import DataTerm, conjugate_gradients, restore_picture
from procedures.restoration.joint.gauss_newton import PriorWeights
from procedures.restoration.masks.array_loops import add_bending, add_diffusion


@pytest.fixture(scope="module")
def data(vibrating):
    term, _ = joint_descent.problem_of(
        vibrating.z, vibrating.stacks, np.ones((2, 1, *vibrating.z.shape[2:])), np.float64
    )
    term.focus(vibrating.w)
    return term


@pytest.fixture(scope="module")
def noise(vibrating, data):
    return float(np.std(data.residual(vibrating.sharp)))


def test_a_picture_without_frequencies_in_a_band_is_refused():
    # the mean of no power is no number, and passed every check
    with pytest.raises(Refused, match="a picture of 40 x 20 pixels has no frequencies in one of 8 bands"):
        noise_and_contrast.band_powers(np.random.default_rng(1).random((1, 20, 40)))


def weights_of(blurred, data, u):
    """The effective weights of a restoration u."""
    downhill = data.blur_adjoint(data.residual(u))
    return noise_and_contrast.effective_weights(
        *(picture[:, blurred.R : -blurred.R, blurred.R : -blurred.R] for picture in (u, downhill))
    )


def moments_of(blurred, data, u):
    """The moments of a restoration u."""
    R = blurred.R
    residual = noise_and_contrast.band_powers(data.residual(u))
    slopes = noise_and_contrast.gradient_powers(u[:, R:-R, R:-R])
    depths = np.quantile(blurred.w[R:-R, R:-R], noise_and_contrast.DECILES)
    return noise_and_contrast.moments(blurred.stacks, depths, weights_of(blurred, data, u), residual, slopes)


@pytest.mark.parametrize("weight", [3e-5, 1e-3])
def test_noise_and_contrast_are_estimated_for_any_weight(vibrating, data, noise, weight):
    R = vibrating.R
    u = restore_picture(data, np.full_like(vibrating.sharp, 0.5), weight, 200)
    # low bands depend on the rim and converge last
    assert weights_of(vibrating, data, u)[3:] == pytest.approx(np.full(5, weight), rel=0.1)
    estimate = moments_of(vibrating, data, u)
    truth = vibrating.sharp[:, R:-R, R:-R]
    # five depths represent all, the frame's rim is less determined
    assert np.sqrt(estimate.noise) == pytest.approx(noise, rel=0.15)
    # the weight decides between frequencies that masks pass and those that they do not: in no extreme band
    inner = noise_and_contrast.gradient_powers(truth)[1:-1]
    assert 0.85 * inner.min() < estimate.contrast < 1.15 * inner.max()


def test_contrast_and_powers_of_bands_are_estimated_early(vibrating, data):
    R = vibrating.R
    u = restore_picture(data, np.full_like(vibrating.sharp, 0.5), 3e-5, 8)
    inner = noise_and_contrast.gradient_powers(vibrating.sharp[:, R:-R, R:-R])[1:-1]
    # iterations filter differently from the one weight that represents them in a band; with 3e-5 itself it is 0.45
    assert 0.65 * inner.min() < moments_of(vibrating, data, u).contrast < 1.15 * inner.max()
    rng = np.random.default_rng(1)
    white = 0.3 * rng.standard_normal((4, 90, 110))
    # 4 images of 9900 samples in 8 bands, at least about 400 each: 5 % is twice their standard deviation
    assert noise_and_contrast.band_powers(white + 5.0) == pytest.approx(np.full(8, 0.09), rel=0.15)
    soft = noise_and_contrast.band_powers(gaussian_filter(white, (0, 1.5, 1.5)))
    # the filter's squared response at the centre of each ring
    at = (np.arange(8) + 0.5) / 16
    assert soft[:3] == pytest.approx(0.09 * np.exp(-((2 * np.pi * at[:3] * 1.5) ** 2)), rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("blur", [0.0, 1.5])
def test_the_weight_is_optimal_for_any_spectrum_of_noise(vibrating, data, blur):
    # correlated noise is that of inaccurate masks: largest where the picture has most power
    rng = np.random.default_rng(6)
    soft = gaussian_filter(rng.standard_normal(data.z.shape), (0, 0, blur, blur))
    blurred = DataTerm(data.z + 0.01 * soft / soft.std(), data.blurs, data.trust)
    blurred.focus(vibrating.w)
    R, truth = data.R, vibrating.sharp[:, 12 + data.R : -12 - data.R, 12 + data.R : -12 - data.R]

    def restored(weight: float):
        return restore_picture(blurred, np.full_like(vibrating.sharp, 0.5), weight, 60)

    def error(weight: float) -> float:
        return float(np.sqrt(np.mean((restored(weight)[:, 12 + R : -12 - R, 12 + R : -12 - R] - truth) ** 2)))

    best = 1e-3
    for _ in range(3):
        u = restored(best)
        estimate = moments_of(vibrating, blurred, u)
        best = estimate.deciding / estimate.contrast
    least = min(error(weight) for weight in best * 2.0 ** np.array([-2, -1, 1, 2]))
    # the scene's gradient is as uneven over the bands as real ones
    assert error(best) < 1.05 * least


@pytest.mark.slow
def test_degrees_of_freedom_of_depth_agree_with_solutions(vibrating, data):
    u, weights = vibrating.sharp, PriorWeights(1e-4, 0.01)
    estimate = noise_and_contrast.depth_freedom(data, u, weights)

    def fitted(factor: float) -> float:
        """Fraction of random photographs that picture and depth fit, per pixel of the frame."""
        noise = np.random.default_rng(5).choice([-1.0, 1.0], data.z.shape)

        def apply(x):
            out = data.change_adjoint(u, data.change(u, x))
            add_diffusion(out[:-1], x[:-1], weights.picture)
            add_diffusion(out[-1], x[-1], factor * weights.depth * weights.tilt)
            add_bending(out[-1], x[-1], factor * weights.depth * weights.bend, 1.0, 1.0)
            return out

        weight = conjugate_gradients(apply, data.change_adjoint(u, noise), 150)
        return float(np.sum(noise * data.change(u, weight)) / noise[0].size)

    # with a depth prior a thousand times as strong only the picture fits
    assert estimate == pytest.approx(fitted(1) - fitted(1000), abs=0.1)
    assert noise_and_contrast.depth_freedom(data, u, replace(weights, depth=0.1)) < estimate


def test_a_depth_without_effect_fits_no_noise(vibrating, data):
    """At w = 0 masks are points and depth has no effect: in a wrong order of photographs all of the frame ends
    there."""
    u = np.zeros_like(vibrating.sharp)
    assert noise_and_contrast.depth_freedom(data, u, PriorWeights(1e-4, 0.01)) == 0
