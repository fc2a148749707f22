"""Several photographs of one scene: registration, rejection, and a picture finer than the sensor."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from procedures import BadInput, CorrectionParameters, Verdict, correct
from procedures.correction.burst import place_of
from procedures.correction.noise import noise_of

from .lens_photographs import Sensor
from .small_lens import RIM, SmallLens, burst, scene

pytestmark = pytest.mark.slow

SHAPE = (120, 160)
MOVES = [(0.0, 0.0), (1.3, -2.4), (-0.6, 0.7), (2.1, 1.2), (-1.8, -0.3), (0.4, 2.6)]
TURNS = [(0.0, 1.0), (0.4, 1.003), (-0.3, 1.0), (0.2, 0.997), (-0.4, 1.0), (0.1, 1.002)]
LIGHT = [1.0, 1.0, 1.06, 1.0, 0.95, 1.0]
SENSOR = Sensor(white_e=20000.0)
FINER = CorrectionParameters(scale=2)


def fine(seed: int) -> np.ndarray:
    return scene((2 * SHAPE[0] + 2 * RIM, 2 * SHAPE[1] + 2 * RIM), seed=seed)


@pytest.fixture(scope="module")
def lens():
    return SmallLens(SHAPE, 0.3, growth=0.5)


@pytest.fixture(scope="module")
def field(lens):
    return lens.field("Y").field


@pytest.fixture(scope="module")
def photographs(lens):
    return burst({"Y": lens}, fine(3), MOVES, SENSOR, LIGHT)


def psnr(picture: np.ndarray) -> float:
    truth = fine(3)[:, RIM:-RIM, RIM:-RIM]
    return float(-10 * np.log10(np.mean((picture - truth)[:, RIM:-RIM, RIM:-RIM] ** 2)))


def finer(picture: np.ndarray) -> np.ndarray:
    """The picture (1, H, W) on the finer grid, by cubic interpolation."""
    columns, rows = 2 * picture.shape[2], 2 * picture.shape[1]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    to_pixels = np.array([[0.5, 0, 0], [0, 0.5, 0]])
    return cv2.warpAffine(picture[0], to_pixels, (columns, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)[None]


def test_photographs_shifted_by_fractions_of_a_pixel_resolve_more_than_the_sensor(photographs, field):
    outcome = correct(photographs[0], {"Y": field}, parameters=FINER, others=photographs[1:])
    assert (outcome.verdict, outcome.reason) == (Verdict.PASS, "")
    one = correct(photographs[0], {"Y": field}).value
    assert psnr(outcome.value.picture) > psnr(finer(one.picture)) + 3
    for place, move, light in zip(outcome.value.places, MOVES[1:], LIGHT[1:], strict=True):
        np.testing.assert_allclose(place.moved_px(SHAPE), move, atol=0.03)
        assert place.light == pytest.approx(light, abs=0.004)


def test_rotated_photographs_are_registered_in_every_tile(lens, field):
    turned = burst({"Y": lens}, fine(3), MOVES, SENSOR, turns=TURNS)
    outcome = correct(turned[0], {"Y": field}, parameters=FINER, others=turned[1:])
    assert (outcome.verdict, outcome.reason) == (Verdict.PASS, "")
    one = correct(turned[0], {"Y": field}).value
    assert psnr(outcome.value.picture) > psnr(finer(one.picture)) + 2.5


def test_one_photograph_does_not_resolve_a_finer_picture(photographs, field):
    outcome = correct(photographs[0], {"Y": field}, parameters=FINER)
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "resolve 25% of the detail" in outcome.reason


def test_photographs_of_another_scene_are_set_aside(lens, photographs, field):
    (other,) = burst({"Y": lens}, fine(8), [(0.5, 0.5)], SENSOR)
    outcome = correct(photographs[0], {"Y": field}, parameters=FINER, others=[*photographs[1:4], other])
    assert outcome.verdict is Verdict.PASS
    assert ["another scene" in place.reason for place in outcome.value.places] == [False, False, False, True]
    same = correct(photographs[0], {"Y": field}, parameters=FINER, others=photographs[1:4])
    np.testing.assert_array_equal(outcome.value.picture, same.value.picture)
    alone = correct(photographs[0], {"Y": field}, others=[other])
    assert alone.verdict is Verdict.DOUBTFUL
    assert "set aside: photograph 2: it shows another scene" in alone.reason


def changed(frame, samples):
    return replace(frame, planes={"Y": replace(frame.planes["Y"], samples=samples.astype(np.float32))})


def test_photographs_that_do_not_fit_together_are_distinguished_or_refused(photographs, field):
    noise = {"Y": noise_of(photographs[0].planes["Y"])}
    second = photographs[1].planes["Y"].samples
    turn = cv2.getRotationMatrix2D((80, 60), 1.5, 1)
    turned = cv2.warpAffine(second, turn, second.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    reasons = [
        place_of(photographs[0], changed(photographs[1], samples), noise).reason
        for samples in (cv2.GaussianBlur(second, (0, 0), 2.5), 0.6 * second, turned)
    ]
    words = ("blur is different", "0.60 times as bright", "rotated relative to the first")
    assert all(word in reason for word, reason in zip(words, reasons, strict=True)), reasons
    cut = changed(photographs[1], photographs[1].planes["Y"].samples[:-2])
    with pytest.raises(BadInput, match=r"160 x 120.*160 x 118"):
        correct(photographs[0], {"Y": field}, others=[cut])
    with pytest.raises(BadInput, match="8 samples per pixel of plane Y; the field's PSFs have 4"):
        correct(photographs[0], {"Y": field}, parameters=CorrectionParameters(scale=8))
