"""Remedies for unsuitable given s and k, and the first cause of damaged photographs."""

from pathlib import Path

import numpy as np
import pytest

from procedures import Chart, Plane, Verdict, estimate_psf, read_frame
from procedures.choice import Trial
from procedures.pattern_psf.trust import VerdictInputs, _truncation_checks
from procedures.psf import Sampling

from .damage import damaged


@pytest.mark.parametrize(
    ("better", "words"),
    [
        ((3, 13), "use -s 3 -k 13"),
        ((2, 17), "raise s, and photograph from a distance"),
        (None, "raise s, and photograph from a distance"),
    ],
)
def test_a_band_that_ends_too_soon_asks_for_s(better: tuple[int, int] | None, words: str) -> None:
    tried = Trial(2, 11, (0.41, 0.41), uncertainty=0.0004, truncation=0.0001, band_edge=0.06, better=better)
    assert tried.band_open
    inputs = VerdictInputs(Sampling(2, 11, "ls", ()), False, (tried,), (), [])
    for unexplained, verdict in ((0.001, Verdict.DOUBTFUL), (0.3, Verdict.REFUSED)):
        (cause,) = (one for one in _truncation_checks(inputs, unexplained) if one.fails)
        assert cause.remedy.startswith(words)
        assert cause.severity is verdict


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("sharpened 0.5, 1.0 px", "the picture was sharpened"),
        ("gamma 0.5", "the response is not linear"),
        ("black floored 0.1", "black is clipped"),
        ("half defocused 0.5", "the PSF varies over the chart"),
        ("finger 0.1, 20 px", "the darkest white block"),
        pytest.param("toner 80 of 2.0 px", "of the samples are outliers", marks=pytest.mark.nightly),
        ("red demosaiced", "the picture was demosaiced"),
        ("shadow 0.3", "neither chart nor noise"),
    ],
)
def test_what_was_done_to_a_photograph_is_the_first_cause(shared_data: Path, name: str, reason: str) -> None:
    photographs = shared_data / "pattern_photo"
    chart = Chart.from_image(read_frame(photographs / "pattern_noise.pgm").planes["Y"].samples)
    samples = np.round(255 * damaged(read_frame(photographs / "img_example.pgm").planes["Y"].samples, name)) / 255
    assert reason in estimate_psf(Plane("Y", samples.astype(np.float32), 1 / 255), chart).reason
