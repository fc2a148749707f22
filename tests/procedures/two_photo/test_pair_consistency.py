"""Consistency of two photographs, and its effect on uncertainties and verdicts."""

from types import SimpleNamespace

import numpy as np
import pytest

from procedures.outcome import Outcome, Verdict
from procedures.psf import Psf, PsfTail
from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf
from procedures.two_photo.pair_consistency import beyond_light, light_turned, near_spectrum, residual_spectrum
from procedures.two_photo.trust import COARSE_RESIDUAL, FINE_RESIDUAL, SMOOTHING, STREAKS
from simulators.camera.sheets import leaves

from ..pattern_psf.analytic_camera import circular, mtf50
from .damage import damaged, relief
from .endless import CAMERAS, photographs
from .wall import Otf, Pair, samples_of
from .wall import estimate as by_wall

SLOW_FIXTURES = {"pair"}

OTF = CAMERAS["f/5.6"]


@pytest.fixture(scope="module")
def pair() -> Pair:
    return photographs(OTF, noise=0.004, size=130)


def estimate(near: np.ndarray, far: np.ndarray) -> Outcome[TwoPhotoPsf]:
    return by_wall(near, far, TwoPhotoParameters(3, 13))


def sigmas(outcome: Outcome[TwoPhotoPsf]) -> float:
    """Largest error of MTF50 over its stated uncertainty."""
    numbers = [outcome.result().quality.numbers[f"mtf50_{axis}"] for axis in ("horizontal", "vertical")]
    return max(abs(one.value - mtf50(OTF)) / one.uncertainty for one in numbers)


def true_psf(otf: Otf) -> Psf:
    """Samples in a wide support, with negligible uncertainty."""
    k = 41
    return Psf(samples_of(otf, 3, k), 3, 1e-14 * np.eye(k * k), PsfTail.none(k * k))


def test_a_good_pair_passes(pair: Pair) -> None:
    outcome = estimate(pair.near, pair.far)
    assert outcome.verdict is Verdict.PASS, outcome.reason
    assert sigmas(outcome) < 3


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("far sharpened 0.3", "no PSF of light has this MTF: the far photograph was sharpened"),
        ("far JPEG 85", "the residual of the far photograph is fine"),
        ("far softened 0.6", "it was smoothed"),
        ("far moved 1", "along one axis"),
        ("far gradient 0.3", "no PSF of light"),
        ("near gradient 0.3", "fine detail has another direction"),
        ("far smoothed", "denoised"),
        ("far gamma 0.8", "the residual of the far photograph is coarse"),
    ],
)
def test_damage_to_one_photograph_is_detected(pair: Pair, name: str, reason: str) -> None:
    outcome = estimate(*damaged(pair, name))
    assert outcome.verdict is not Verdict.PASS
    assert reason in outcome.reason


@pytest.mark.parametrize("name", ["near softened 0.45", "near sharpened 0.3", "near JPEG 85", "near gradient 0.1"])
def test_damage_that_resembles_the_wall_is_in_the_uncertainty(pair: Pair, name: str) -> None:
    outcome = estimate(*damaged(pair, name))
    assert outcome.verdict is not Verdict.PASS or sigmas(outcome) < 3


@pytest.mark.slow
@pytest.mark.parametrize("turned_deg", [2, pytest.param(10, marks=pytest.mark.nightly)])
def test_rotated_light_on_relief_is_detected(turned_deg: float) -> None:
    rotated = relief(OTF, turned_deg, size=130)
    outcome = estimate(rotated.near, rotated.far)
    assert outcome.verdict is not Verdict.PASS
    assert "light" in outcome.reason
    assert outcome.result().quality.budgets["mtf50_horizontal"]["light"] > 0.01 * mtf50(OTF)


@pytest.mark.slow
def test_still_light_on_relief_passes() -> None:
    one = relief(OTF, 0, size=130)
    outcome = estimate(one.near, one.far)
    assert outcome.verdict is Verdict.PASS, outcome.reason


def test_the_near_photograph_s_own_blur_is_measured(pair: Pair) -> None:
    psf = true_psf(OTF)
    assert np.abs(near_spectrum(pair.near, psf).softness).max() < 0.02
    # its own optics twice, and a blur of 0.45 pixel across and 0.3 down
    blurred = circular(1.62, fill=0.9)
    soft = photographs(
        OTF,
        noise=0.004,
        size=130,
        near_otf=lambda fx, fy: blurred(fx, fy) * np.exp(-2 * np.pi**2 * (0.45**2 * fx**2 + 0.3**2 * fy**2)),
    )
    assert near_spectrum(soft.near, psf).softness == pytest.approx([0.45**2, 0.3**2], abs=0.03)


@pytest.mark.slow
def test_a_sharpened_otf_is_not_one_of_light() -> None:
    assert beyond_light(true_psf(OTF)) == 0
    assert beyond_light(true_psf(circular(3.25))) == 0

    def sharpened(fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
        return OTF(fx, fy) * (1 + 1.0 * (1 - np.exp(-2 * np.pi**2 * 1.5**2 * (fx**2 + fy**2))))

    assert beyond_light(true_psf(sharpened)) > 0.2


@pytest.mark.parametrize("shape", [(56, 74), (84, 111)])
def test_the_scatter_of_a_small_photograph_is_accepted(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    near = SimpleNamespace(shape=shape)
    for _ in range(60):
        noise, wall = rng.normal(0, 0.01, shape), rng.normal(0.4, 0.1, shape)
        fit = SimpleNamespace(near=near, residual=noise, prediction=wall, as_image=lambda values, background: values)
        _, colour, smoothing, streaks = residual_spectrum(fit)  # type: ignore[arg-type]
        assert FINE_RESIDUAL <= colour <= COARSE_RESIDUAL
        assert smoothing <= SMOOTHING
        assert 1 / STREAKS <= streaks <= STREAKS


@pytest.mark.slow
@pytest.mark.parametrize("seed", [15, 29])
def test_random_anisotropy_of_a_small_wall_is_accepted(seed: int) -> None:
    # six of 40 such walls were beyond one standard deviation of a scatter that was 1.3 to 2 times too small
    rng, n, shape = np.random.default_rng(seed), 4, (240, 320)
    wall = leaves((n * shape[0], n * shape[1]), rng, largest=160.0, per_leaf=100.0)
    fx, fy = np.fft.rfftfreq(wall.shape[1]) * n, np.fft.fftfreq(wall.shape[0])[:, None] * n
    near = np.fft.irfft2(np.fft.rfft2(wall) * OTF(fx, fy), wall.shape)[::n, ::n] + rng.normal(0, 0.004, shape)
    assert not near_spectrum(near.astype(np.float32), true_psf(OTF)).turned.any()


def test_motion_is_not_rotated_light() -> None:
    assert light_turned(true_psf(OTF)) < 1e-3
    assert light_turned(true_psf(lambda fx, fy: OTF(fx, fy) * np.sinc(fx))) < 2e-3
    turned = true_psf(
        lambda fx, fy: OTF(fx, fy) * (1 + 0.1 * np.cos(2 * np.arctan2(fy, fx)) * (np.hypot(fx, fy) > 0.03))
    )
    assert light_turned(turned) > 0.02
