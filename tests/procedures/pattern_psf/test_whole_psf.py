"""Numbers of the PSF compared with analytic optics of unlimited extent, independent of the method."""

from functools import cache

import cv2
import numpy as np
import pytest

from procedures import Chart, Plane, Verdict
from procedures.choice import UNSEEN
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from tests.benchmarks.whole_psf import truths

from .analytic_camera import View, circular, exposed, light, mtf50

CHART = Chart.from_seed(1)
F56 = circular(1.62, fill=0.9)  # f/5.6 of a camera with 5 um pixels, 90 % of each filled
F8 = circular(1.14, blur_px=0.3)
NAMES = ("mtf50_horizontal", "mtf50_vertical", "mtf_nyquist_horizontal", "mtf_nyquist_vertical")


@cache
def photograph() -> np.ndarray:
    return light(F56, CHART, View())


@cache
def softer() -> np.ndarray:
    return light(F8, CHART, View())


def found(parameters: PatternParameters | None = None, seed: int = 0) -> tuple[PatternPsf, Verdict]:
    outcome = estimate_psf(exposed(photograph(), np.random.default_rng(seed)), CHART, parameters)
    assert outcome.value is not None, outcome.reason
    return outcome.value, outcome.verdict


@pytest.mark.slow
def test_numbers_are_those_of_the_whole_psf() -> None:
    estimate, verdict = found(PatternParameters(print_blur=0.075))
    assert verdict is Verdict.PASS
    for name, true in zip(NAMES, truths(F56), strict=True):
        number = estimate.quality.numbers[name]
        # four numbers of one photograph, each within 3 of its standard uncertainties
        assert abs(number.value - true) < 3 * number.uncertainty, name
        budget = estimate.quality.budgets[name]
        unseen = np.linalg.norm([budget[name] for name in UNSEEN])
        assert unseen < 0.03 * true
        assert number.uncertainty**2 - unseen**2 < (0.008 * true) ** 2


@pytest.mark.slow
@pytest.mark.parametrize(("s", "k"), [(4, 9), (4, 13), (4, 25), (2, 9), (3, 13)])
def test_what_s_and_k_exclude_is_doubtful_and_never_wrong(s: int, k: int) -> None:
    estimate, verdict = found(PatternParameters(s, k))
    errors = [
        (estimate.quality.numbers[name].value - true) / estimate.quality.numbers[name].uncertainty
        for name, true in zip(NAMES, truths(F56), strict=True)
    ]
    assert np.abs(errors).max() < 3.5
    if (s, k) == (4, 9):  # 11 % of the light lies outside: a share of the OTF that its noise does not hide
        assert verdict is Verdict.DOUBTFUL


@pytest.mark.slow
def test_the_energy_outside_is_the_optics_own_and_a_known_aperture_narrows_it(rng):
    outcome = estimate_psf(exposed(photograph(), np.random.default_rng(0)), CHART, PatternParameters(4, 9))
    assert outcome.value is not None
    better = outcome.value.choice[-1].better
    assert better is not None
    assert better[1] > 9
    assert f"-k {better[1]}" in outcome.remedy
    estimate, _ = found(PatternParameters(4, 17))
    n = 1024
    f = np.fft.fftfreq(n) * 4
    psf = np.fft.fftshift(np.fft.ifft2(F56(f[None], f[:, None])).real)
    inside = psf[n // 2 - 8 : n // 2 + 9, n // 2 - 8 : n // 2 + 9].sum()
    share, uncertainty = estimate.psf.energy_outside
    # the transform's period of 256 pixels folds 2 / (pi^2 f_c 128) = 0.001 of the light back
    assert abs(share - (1 - inside)) < 3 * uncertainty + 0.001
    from procedures.quality import Diffraction

    plane = exposed(photograph(), rng)
    limit = Diffraction(f_number=5.6, pixel_pitch_um=1.62 * 0.55 * 5.6, wavelength_nm=550)  # cutoff 1.62
    free, with_prior = (estimate_psf(plane, CHART, PatternParameters(4, 17), one).value for one in (None, limit))
    assert free is not None
    assert with_prior is not None
    assert with_prior.psf.energy_outside[1] < free.psf.energy_outside[1]
    assert abs(with_prior.diagnostics["tail_sigmas"]) < 3


@pytest.mark.slow
def test_a_wrong_aperture_and_a_sharpened_picture_are_flagged_and_the_budget_adds_up(rng):
    from procedures.quality import Diffraction

    limit = Diffraction(f_number=2.0, pixel_pitch_um=1.62 * 0.55 * 5.6, wavelength_nm=550)
    outcome = estimate_psf(exposed(photograph(), rng), CHART, None, limit)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "f-number" in outcome.reason
    estimate, _ = found()
    for name, number in estimate.quality.numbers.items():
        terms = estimate.quality.budgets[name]
        assert np.sqrt(sum(term**2 for term in terms.values())) == pytest.approx(number.uncertainty)
    terms = estimate.quality.budgets["mtf50_horizontal"]
    assert terms["noise"] > 0
    assert terms["tail"] > 0
    assert terms["choice"] > 0
    plane = exposed(photograph(), rng)
    blurred = (plane.samples + np.roll(plane.samples, 1, 0) + np.roll(plane.samples, -1, 0)) / 3
    blurred = (blurred + np.roll(blurred, 1, 1) + np.roll(blurred, -1, 1)) / 3
    sharpened = plane.samples + 0.4 * (plane.samples - blurred)
    outcome = estimate_psf(type(plane)("Y", sharpened.astype(np.float32), plane.quantisation), CHART)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "sharpened" in outcome.reason


@pytest.mark.slow
@pytest.mark.parametrize(("amount", "radius"), [(0.2, 0.7), (0.5, 1.0)])
def test_noise_shows_a_mask_whose_psf_a_softer_lens_could_have(amount: float, radius: float) -> None:
    plane = exposed(softer(), np.random.default_rng(0))
    masked = plane.samples + amount * (plane.samples - cv2.GaussianBlur(plane.samples, (0, 0), radius))
    settings = PatternParameters(4, 17, chosen=True)
    before, after = (estimate_psf(Plane("Y", x, plane.quantisation), CHART, settings) for x in (plane.samples, masked))
    assert before.verdict is Verdict.PASS
    assert after.verdict is Verdict.DOUBTFUL
    assert after.value is not None
    assert "noise of neighbouring pixels is anticorrelated" in after.reason
    assert amount / 2 < after.value.diagnostics["sharpened_by"] < 1.6 * amount  # to first order


@pytest.mark.slow
def test_wide_masks_and_half_a_defocused_chart_are_told(rng):
    from procedures.quality import Diffraction

    plane = exposed(photograph(), rng)
    masked = plane.samples + 0.1 * (plane.samples - cv2.GaussianBlur(plane.samples, (0, 0), 2.0))
    limit = Diffraction(f_number=5.6, pixel_pitch_um=1.62 * 0.55 * 5.6, wavelength_nm=550)  # cutoff 1.62
    outcome = estimate_psf(Plane("Y", masked, plane.quantisation), CHART, PatternParameters(4, 17, chosen=True), limit)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "as in a sharpened picture" in outcome.reason
    sharp = photograph()
    soft = light(circular(1.62, fill=0.9, blur_px=0.5), CHART, View())
    left = np.arange(sharp.shape[1]) < sharp.shape[1] / 2
    outcome = estimate_psf(exposed(np.where(left, soft, sharp), rng), CHART)
    assert outcome.verdict is not Verdict.PASS
    assert outcome.value is None or "varies over the chart" in outcome.reason


@pytest.mark.slow
def test_what_a_hand_leaves_of_the_chart_is_enough(rng: np.random.Generator) -> None:
    plane = exposed(photograph(), rng)
    rows, columns = np.indices(plane.samples.shape)
    middle, width = np.array(plane.samples.shape) / 2, plane.samples.shape[1]
    hand = np.hypot(columns - middle[1] - 0.12 * width, rows - middle[0]) < 0.16 * width
    hidden = np.where(hand, 0.3, plane.samples).astype(np.float32)
    outcome = estimate_psf(type(plane)("Y", hidden, plane.quantisation), CHART, PatternParameters(4, 17, chosen=True))
    assert outcome.verdict is Verdict.DOUBTFUL, outcome.reason
    assert "of the samples are outliers" in outcome.reason
    assert outcome.value is not None
    for name, true in zip(NAMES, truths(F56), strict=True):
        number = outcome.value.quality.numbers[name]
        assert abs(number.value - true) < 3.5 * number.uncertainty, name


@pytest.mark.nightly
def test_errors_are_those_that_the_uncertainties_tell() -> None:
    errors, shares = [], []
    for otf, seeds in ((F56, range(2, 6)), (F8, range(4))):
        picture = light(otf, CHART, View(shift_px=(0.1, 0.4), roll=-0.02))
        for seed in seeds:
            outcome = estimate_psf(exposed(picture, np.random.default_rng(seed)), CHART)
            assert outcome.value is not None
            for axis, name in enumerate(("mtf50_horizontal", "mtf50_vertical")):
                number, true = outcome.value.quality.numbers[name], mtf50(otf, axis)
                errors.append((number.value - true) / number.uncertainty)
                shares.append(number.value / true - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.abs(errors).max() < 3.5
    assert abs(np.mean(shares)) < 0.003
