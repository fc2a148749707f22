"""The numbers for analytic OTFs with infinite PSFs: errors must be consistent with uncertainties."""

import numpy as np
import pytest

from procedures.outcome import Outcome, Verdict, causes_of
from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf

from ..pattern_psf.analytic_camera import circular, mtf50
from .endless import CAMERAS, mtf_nyquist, photographs
from .wall import Pair
from .wall import estimate as by_wall

pytestmark = pytest.mark.slow

WALLS = (("pink", 3.3), ("leaves", 4.2), ("pink", 5.2))
"""Walls, and ratios of the distances."""


def estimate(pair: Pair, parameters: TwoPhotoParameters | None = None) -> Outcome[TwoPhotoPsf]:
    return by_wall(pair.near, pair.far, parameters)


def errors(outcome: Outcome[TwoPhotoPsf], name: str) -> dict[str, tuple[float, float]]:
    """Relative error of each number, and error over the stated uncertainty."""
    quality, all_errors = outcome.result().quality, {}
    for number, truth in (("mtf50", mtf50(CAMERAS[name])), ("mtf_nyquist", mtf_nyquist(CAMERAS[name]))):
        for axis in ("horizontal", "vertical"):
            one = quality.numbers[f"{number}_{axis}"]
            all_errors[f"{number}_{axis}"] = (one.value / truth - 1, (one.value - truth) / one.uncertainty)
    return all_errors


def test_the_numbers_and_the_choice_are_of_the_whole_psf():
    outcome = estimate(photographs(CAMERAS["f/5.6"], noise=0.002, size=110), TwoPhotoParameters(3, 13))
    assert outcome.verdict is Verdict.PASS, outcome.reason
    psf = outcome.result().psf
    # 5 % of the energy lies outside a support of 4.3 pixels: MTF50 of the samples alone would be 5 % high
    assert 1 - psf.h.sum() / psf.light == pytest.approx(2 / (np.pi**2 * 1.62 * 13 / 6), abs=0.012)
    for number, (off, sigmas) in errors(outcome, "f/5.6").items():
        assert abs(sigmas) < 3, number
        assert abs(off) < 0.02, number
    # the pixel of a colour plane is half as wide as its pitch: the MTF stays above 1/2 beyond one cycle per pixel
    outcome = estimate(photographs(circular(6.5, fill=0.3), zoom=2.9, size=130, noise=0.002))
    assert outcome.verdict is Verdict.DOUBTFUL
    beyond = next(one for one in causes_of(outcome) if "MTF50 lies beyond the band of s = 2" in one.reason)
    assert "it needs s = 3" in beyond.remedy
    outcome = estimate(photographs(circular(6.5, fill=0.3), zoom=4.4, size=110, noise=0.002))
    tried = outcome.result().choice
    assert [trial.s for trial in tried] == [3, 4]  # 4 is what the zoom allows
    assert "near the band's edge" in tried[0].reason
    assert None not in tried[-1].mtf50


@pytest.mark.parametrize("each", [False, pytest.param(True, marks=pytest.mark.nightly)], ids=["three", "all"])
def test_uncertainties_are_realistic_over_cameras_walls_and_zooms(each: bool) -> None:
    off, bias = [], []
    for i, name in enumerate(CAMERAS):
        for j, (wall, zoom) in enumerate(WALLS):
            if not each and i != j:
                continue
            pair = photographs(CAMERAS[name], wall=wall, zoom=zoom, noise=0.005, size=110, seed=10 * i + j, tilt=0.02)
            outcome = estimate(pair)
            assert outcome.verdict is not Verdict.REFUSED, outcome.reason
            found = errors(outcome, name)
            off += [sigmas for _, sigmas in found.values()]
            bias += [found[f"mtf50_{axis}"][0] for axis in ("horizontal", "vertical")]
    # x and y share the tail's error: about ten independent draws, or three
    assert np.sqrt(np.mean(np.square(off))) < (1.3 if each else 1.7)
    assert np.abs(off).max() < 3.5
    # each pair is known to 0.5 to 1 %
    assert abs(np.mean(bias)) < (0.008 if each else 0.012)
