import numpy as np
import pytest

from procedures.correction.estimate import _smoothed
from procedures.correction.mosaic import Mosaic
from procedures.correction.noise import Noise
from procedures.correction.optics import PlaneFields
from procedures.correction.prediction import Prediction, predict
from procedures.correction.priors import Prior
from procedures.raw import Plane

from .small_lens import SmallLens

SLOW_FIXTURES = {"predictions"}

SHAPE = (80, 100)


@pytest.fixture(scope="module")
def predictions():
    lens = SmallLens(SHAPE, 0.7, growth=1.0, coma=0.0)
    planes = {"Y": Plane("Y", np.full(SHAPE, 0.5, np.float32), 1e-4)}
    mosaic = Mosaic.of(planes, {"Y": Noise(1e-6, 1e-5, 1.0, 2.0)})
    optics = PlaneFields.of(planes, {"Y": lens.field("Y").field}, {})
    return {tau: predict(optics, mosaic, Prior(), tau, 0.03) for tau in (1e-5, 3e-4, 1.0)}


def test_a_smoothed_picture_is_doubtful():
    maps = {"x": np.zeros(1), "y": np.zeros(1), "noise_gain": np.ones((1, 1))}
    softer = _smoothed(Prediction(before=np.array([[0.31]]), after=np.array([[0.15]]), **maps), 1)
    assert softer.fails
    assert "from 0.31 to 0.15" in softer.sentence
    assert not _smoothed(Prediction(before=np.array([[0.31]]), after=np.array([[0.4]]), **maps), 1).fails


def test_the_gain_of_mtf50_is_that_of_the_inverse_without_a_prior(predictions):
    # at the centre: a Gaussian of 0.7 pixels times an aperture of 0.7 pixels
    f = np.linspace(0, 0.5, 2001)
    expected = f[np.argmax(np.exp(-2 * np.pi**2 * 0.7**2 * f**2) * np.sinc(0.7 * f) < 0.5)]
    middle = predictions[3e-4].before[3, 4]
    assert middle == pytest.approx(expected, abs=0.01)  # the mean over directions of a square aperture
    assert predictions[3e-4].before[0, 0] < middle
    weak, usual, strong = (predictions[tau] for tau in (1e-5, 3e-4, 1.0))
    assert (weak.noise_gain > usual.noise_gain).all()
    assert (usual.noise_gain > strong.noise_gain).all()
    assert (weak.after >= usual.after).all()
    assert (usual.after > strong.after).all()
    assert (usual.after > usual.before).all()
    # tau 1e-5 over 0.03 is small compared with |H|^2 > 0.003 except in the corners of the frequency square
    lens, n = SmallLens(SHAPE, 0.7, growth=1.0, coma=0.0), 128
    f = np.fft.fftfreq(n)
    H = lens.otf((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2, *np.meshgrid(f, f)).real
    D = (2 - 2 * np.cos(2 * np.pi * f))[:, None] + (2 - 2 * np.cos(2 * np.pi * f))
    expected = np.sqrt(np.mean((H / (H**2 + 1e-5 / 0.03 * D)) ** 2))
    assert predictions[1e-5].noise_gain[3, 4] == pytest.approx(expected, rel=0.03)
