"""Edges that a program, a rough print or vibration changed: flagged by name, or within the uncertainty."""

import re
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import Plane, Roi, Verdict
from procedures.corruption.family import FALSE_ALARM, Strength, nuisance, threshold
from procedures.slanted_edge import corruptions
from procedures.slanted_edge.corruptions import corruption_checks
from procedures.slanted_edge.estimate import EdgeOutcome, estimate_edge
from procedures.slanted_edge.evidence import HALO_PX, WIDE_PX, Evidence, _fall, _Samples
from procedures.slanted_edge.transfer import FREQUENCIES

from ..pattern_psf.damage import demosaiced
from .analytic import Array, Camera, edge

CAMERA = Camera(2.0, blur_px=0.6)
ANGLE = 6.0
ELECTRONS, READ_E = 12000, 3
NONE = Strength(0.0, 0.1)
CLEAN = Evidence([NONE] * 3, [NONE] * 3, NONE, NONE, NONE, NONE, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 4, 0.0, 0.0, 0.0, 0.0)


def picture(rng: np.random.Generator, light: Array | None = None) -> Array:
    """An edge in the light of so many electrons at white, with their noise and that of reading them."""
    light = edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE) if light is None else light
    return (rng.poisson(np.maximum(light, 0) * ELECTRONS) + READ_E * rng.standard_normal(light.shape)) / ELECTRONS


def measured(samples: Array, *, raw: bool = False) -> EdgeOutcome:
    plane = Plane("Y", np.asarray(np.rint(samples * 65535) / 65535, np.float32), 1 / 65535, raw=raw)
    return estimate_edge(plane, Roi.whole(plane.samples))


def unsharp(amount: float, radius_px: float) -> Callable[[Array], Array]:
    return lambda x: x + amount * (x - gaussian_filter(x, radius_px))


PROCESSED: dict[str, tuple[Callable[[Array], Array], str]] = {
    "sharpened": (unsharp(0.5, 1.0), "anticorrelated"),
    "sharpened widely": (unsharp(0.2, 3.0), "no light is negative"),
    "demosaicked": (demosaiced(2), "denoised, resampled or demosaicked"),
    "enlarged": (lambda x: cv2.resize(x, None, fx=1.5, fy=1.5), "denoised, resampled or demosaicked"),
    "moved": (lambda x: cv2.warpAffine(x, np.float32([[1, 0, 0.3], [0, 1, 0.3]]), x.shape[::-1]), "resampled"),
    "gamma": (lambda x: np.maximum(x, 0) ** (1 / 2.4), "as a tone curve"),
    "shoulder": (lambda x: np.where(x < 0.4, x, 0.8 - 0.4 * np.exp((0.4 - x) / 0.4)), "scatters"),
    "local tone": (lambda x: x + 0.5 * (x - cv2.bilateralFilter(x.astype(np.float32), -1, 0.1, 6)), "less noise"),
    "bilateral": (lambda x: cv2.bilateralFilter(x.astype(np.float32), -1, 0.03, 2.0), "scatters"),
}  # fmt: skip


@pytest.mark.parametrize("name", PROCESSED)
def test_what_a_program_does_is_flagged_by_name(name: str, rng: np.random.Generator) -> None:
    process, words = PROCESSED[name]
    outcome = measured(process(picture(rng)))
    assert outcome.verdict is Verdict.DOUBTFUL
    causes = [outcome.reason, *(one.reason for one in outcome.other_causes)]
    assert any(words in cause for cause in causes), causes
    assert "RAW" in outcome.remedy


def test_light_of_another_edge_on_the_dark_side_is_no_tone_curve(rng: np.random.Generator) -> None:
    light = edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE)
    light += 0.01 / (np.arange(120)[:, None] + 8) * (light < 0.5)  # diffracted by the end of the dark area
    assert measured(light + 0.0005 * rng.standard_normal(light.shape)).verdict is Verdict.PASS


@pytest.mark.parametrize("raw", [False, True])
def test_roughness_and_vibration_are_flagged_and_in_the_uncertainty(raw: bool, rng: np.random.Generator) -> None:
    # every row displaced on its own by 0.2 pixel: MTF falls by exp(-2 (pi f 0.2)^2)
    light = np.stack([
        edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE, shift_px=shift)[row]
        for row, shift in enumerate(0.2 * np.tile([-1, 1, 1, -1, -1, 1], 20))
    ])  # fmt: skip
    outcome = measured(picture(rng, light), raw=raw)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "rough or moved" in outcome.reason
    assert outcome.value is not None
    mtf50 = outcome.value.numbers["mtf50"]
    assert mtf50.value < 0.97 * CAMERA.mtf50(ANGLE)
    assert mtf50.value + 2 * mtf50.uncertainty > CAMERA.mtf50(ANGLE)


def test_vibration_of_the_period_of_the_crossings_is_flagged(rng: np.random.Generator) -> None:
    # the edge crosses a column every 9.5 rows: vibration of that period displaces all samples of one phase alike
    rows = np.arange(120)
    shifts = 0.2 * np.sin(2 * np.pi * rows * np.tan(np.radians(ANGLE)))
    light = np.stack([
        edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE, shift_px=shift)[row] for row, shift in enumerate(shifts)
    ])  # fmt: skip
    outcome = measured(picture(rng, light), raw=True)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "as no lens makes it" in outcome.reason


def test_a_ghost_may_hide_where_the_mirrored_frame_has_an_edge(rng: np.random.Generator) -> None:
    light = edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE)
    ghost = 0.95 * light + 0.05 * gaussian_filter(light[::-1, ::-1], 3.0, mode="nearest")
    outcome = measured(picture(rng, ghost), raw=True)
    assert outcome.value is not None
    mtf50 = outcome.value.numbers["mtf50"]
    assert 0.03 < mtf50.value / CAMERA.mtf50(ANGLE) - 1 < 3 * mtf50.uncertainty / CAMERA.mtf50(ANGLE)
    beside = picture(rng, np.pad(light, ((0, 0), (0, 80)), mode="edge"))
    alone = estimate_edge(Plane("Y", beside.astype(np.float32), 1 / 65535, raw=True), Roi(0, 0, 80, 120)).value
    assert alone is not None
    assert alone.budgets["mtf50"]["ghost"] < 0.1 * outcome.value.budgets["mtf50"]["ghost"]


def test_a_mild_mask_is_not_seen_and_is_within_the_uncertainty(rng: np.random.Generator) -> None:
    clean = picture(rng)
    outcome = measured(unsharp(0.05, 1.0)(clean))
    assert outcome.value is not None
    mtf50, budget = outcome.value.numbers["mtf50"], outcome.value.budgets["mtf50"]
    error = mtf50.value - CAMERA.mtf50(ANGLE)
    assert error / CAMERA.mtf50(ANGLE) > 0.02
    assert abs(error) < 2 * mtf50.uncertainty
    assert budget["sharpening"] > budget["noise"]


def test_a_raw_file_is_as_sure_as_its_noise_and_the_lens(rng: np.random.Generator) -> None:
    samples = picture(rng)
    raw, grey = (measured(samples, raw=kind).value for kind in (True, False))
    assert raw is not None
    assert grey is not None
    assert raw.numbers["mtf50"].value == grey.numbers["mtf50"].value
    budget = raw.budgets["mtf50"]
    assert raw.numbers["mtf50"].uncertainty == pytest.approx(np.hypot(budget["noise"], budget["ghost"]), rel=0.02)
    assert {"sharpening", "overshoot", "tone"} <= set(grey.budgets["mtf50"]) - set(raw.budgets["mtf50"])


@pytest.mark.parametrize("raw", [False, True])
def test_curve_and_numbers_have_one_uncertainty(raw: bool, rng: np.random.Generator) -> None:
    found = measured(picture(rng), raw=raw).value
    assert found is not None
    for name, level in (("mtf50", 0.5), ("mtf20", 0.2)):
        number = found.numbers[name]
        slope = np.interp(number.value, found.frequencies, np.gradient(found.mtf, found.frequencies))
        by_curve = np.interp(number.value, found.frequencies, found.uncertainty) / abs(slope)
        assert np.interp(number.value, found.frequencies, found.mtf) == pytest.approx(level, abs=1e-3)
        # of 300 draws a standard deviation is known to 4 %
        assert number.uncertainty == pytest.approx(by_curve, rel=0.12)
    nyquist = found.at(0.5)
    assert nyquist is not None
    assert found.numbers["mtf_nyquist"].uncertainty == pytest.approx(nyquist.uncertainty)
    for name, budget in found.budgets.items():
        assert found.numbers[name].uncertainty == pytest.approx(np.sqrt(np.sum(np.square([*budget.values()]))))


@pytest.mark.slow
@pytest.mark.parametrize("pitch", [pytest.param(1, marks=pytest.mark.nightly), 2])
def test_clean_photographs_pass(pitch: int, rng: np.random.Generator) -> None:
    # seven tests fail together on 2 % of clean photographs: of 60, five or more in one of a hundred trials
    light = edge(CAMERA, rows=120 * pitch, columns=80 * pitch, angle_deg=ANGLE)
    verdicts = [measured(picture(rng, light)[::pitch, ::pitch], raw=pitch == 2).verdict for _ in range(60)]
    assert verdicts.count(Verdict.PASS) >= 56


@pytest.mark.parametrize(("bits", "contrast"), [(8, 1.0), (16, 1.0), (8, 0.2)])
def test_a_picture_without_noise_passes_with_the_uncertainty_of_its_processing(bits: int, contrast: float) -> None:
    most = 2**bits - 1
    light = 0.1 + contrast * (edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE) - 0.1)
    outcome = estimate_edge(
        Plane("Y", (np.rint(light * most) / most).astype(np.float32), 1 / most), Roi(0, 0, *light.shape[::-1])
    )
    assert outcome.verdict is Verdict.PASS
    assert outcome.value is not None
    assert outcome.value.numbers["mtf50"].uncertainty > 0.02 * outcome.value.numbers["mtf50"].value


def test_paper_s_texture_through_the_lens_is_no_smoothing(rng: np.random.Generator) -> None:
    # as strong as the noise: a spectrum of the squared MTF
    light = edge(CAMERA, rows=120, columns=80, angle_deg=ANGLE)
    fy, fx = np.meshgrid(*map(np.fft.fftfreq, light.shape), indexing="ij")
    mtf = CAMERA.otf(np.hypot(fx, fy), 0.0)
    white = rng.standard_normal(light.shape)
    texture = np.fft.ifft2(np.fft.fft2(white) * mtf).real
    outcome = measured(picture(rng, light * (1 + 0.01 * texture / texture.std())), raw=True)
    assert "denoised" not in outcome.reason


@pytest.mark.parametrize(("estimate", "uncertainty"), [(0.0, 0.05), (0.1, 0.03), (-0.1, 0.04), (-0.4, 0.05)])
def test_a_nuisance_is_the_root_mean_square_of_its_posterior(estimate: float, uncertainty: float) -> None:
    prior = 0.05
    a = np.linspace(0, 0.5, 200001)
    log = -((a - estimate) ** 2) / (2 * uncertainty**2) - a**2 / (2 * prior**2)
    density = np.exp(log - log.max())
    expected = np.sqrt(np.sum(a**2 * density) / np.sum(density))
    # far below 0 the exponential is the limit of a normal distribution's end
    assert nuisance(estimate, uncertainty, prior) == pytest.approx(expected, rel=0.1 if estimate < -0.2 else 1e-4)
    assert nuisance(estimate, np.inf, prior) == prior


def test_thresholds_share_the_rate_of_false_alarms(rng: np.random.Generator) -> None:
    largest = rng.standard_normal((40000, 10)).max(axis=1)
    false = np.mean(largest > threshold(10))
    # 120 are expected of 40000: three times their square root
    assert abs(false - FALSE_ALARM) < 3 * np.sqrt(FALSE_ALARM / 40000)


@pytest.mark.parametrize("dip", [0.0, 0.05])
def test_a_fall_counts_alike_in_the_dark_and_in_the_bright(dip: float, rng: np.random.Generator) -> None:
    d, sigma = rng.uniform(-20, 20, 8000), 0.02
    value = (d > 0) - dip * np.exp(-(((d + 6) / 2) ** 2)) + sigma * rng.standard_normal(len(d))
    inside = np.ones(len(d), dtype=bool)
    fall, windows = _fall(_Samples(d, value, inside, (sigma**2, sigma**2)), np.zeros(2))
    mirrored, same = _fall(_Samples(-d, 1 - value, inside, (sigma**2, sigma**2)), np.zeros(2))
    assert (mirrored, same) == (pytest.approx(fall), windows)
    # from two pixels of the dip's flank to the next two the mean falls by 0.03 or more, known to 0.02 (2 / 400)^(1/2)
    assert fall > 5 * threshold(windows) if dip else fall < threshold(windows)


def test_noise_that_is_correlated_is_smoothed_and_noise_that_is_anticorrelated_is_sharpened() -> None:
    for amount, name, scores in ((1.0, "sharpening", "masks"), (-1.0, "smoothing", "textured")):
        one = replace(NONE, value=amount)
        checks = corruption_checks(replace(CLEAN, **{scores: [NONE, one, NONE]}), raw=False)
        assert [check.name for check in checks if check.fails] == [name]
        checks = corruption_checks(replace(CLEAN, **{scores: [NONE, replace(NONE, value=-amount), NONE]}), raw=False)
        assert not any(check.fails for check in checks)


def test_the_mode_of_a_mask_is_its_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_by_tone", "_by_contrast"):
        monkeypatch.setattr(corruptions, name, lambda *given: np.zeros_like(FREQUENCIES))
    mtf = 1 - FREQUENCIES / 2
    modes = corruptions.modes_of(CLEAN, None, mtf, raw=False)  # type: ignore[arg-type]
    point, n = np.zeros(81), np.arange(-40, 41)
    point[40] = 1
    seen = (FREQUENCIES > 0.05) & (FREQUENCIES <= 0.4)
    for name, radius in (("sharpening", 1.0), ("overshoot", HALO_PX), ("wide mask", WIDE_PX)):
        mask = point - gaussian_filter(point, radius)
        gain = np.cos(2 * np.pi * FREQUENCIES[seen, None] * n) @ mask
        amount = modes[name][seen] / (mtf[seen] * gain)
        # the sampled Gaussian is cut off at four standard deviations
        np.testing.assert_allclose(amount, amount.mean(), rtol=2e-3)


@pytest.mark.parametrize("blur_px", [1.5, 2.5])
def test_a_wide_gaussian_lacks_no_light(blur_px: float, rng: np.random.Generator) -> None:
    lens = Camera(fill=0.0, blur_px=blur_px)
    outcome = measured(picture(rng, edge(lens, rows=120, columns=110, angle_deg=ANGLE)))
    assert outcome.verdict is Verdict.PASS, outcome.reason
    assert outcome.value is not None
    mtf50 = outcome.value.numbers["mtf50"]
    assert abs(mtf50.value - lens.mtf50(ANGLE)) < 2 * mtf50.uncertainty
    # the modulus of noise is positive where the lens passes nothing
    assert np.all((outcome.value.mtf < 4 * outcome.value.uncertainty)[outcome.value.frequencies > 1 / blur_px])


def test_local_contrast_that_keeps_the_edge_is_within_the_uncertainty(rng: np.random.Generator) -> None:
    lens = Camera(2.0, blur_px=1.0)
    clean = picture(rng, edge(lens, rows=120, columns=80, angle_deg=ANGLE))
    found = measured(clean + 0.2 * (clean - cv2.bilateralFilter(clean.astype(np.float32), -1, 0.15, 20))).value
    assert found is not None
    error = np.abs(found.mtf - np.abs(lens.otf(found.frequencies, ANGLE)))[found.frequencies <= 0.5]
    assert error.max() > 0.05
    assert np.all(error <= 2.5 * found.uncertainty[: len(error)])


def test_light_that_a_wide_mask_takes_from_beside_the_edge_is_measured(rng: np.random.Generator) -> None:
    # 5 % hide in the fall of the edge spread function, but not in its shape
    outcome = measured(unsharp(0.05, 3.0)(picture(rng)))
    causes = " ".join([outcome.reason, *(one.reason for one in outcome.other_causes)])
    found = re.search(r"([\d.]+)% of the light is missing beside the edge", causes)
    assert found, causes
    assert 0.03 < float(found[1]) / 100 < 0.07
