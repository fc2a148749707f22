"""Witnesses of a PSF: what two exposures, two distances and a defocus show that a single photograph does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import Chart, Plane
from procedures.numbers import WITNESS_CURVATURE, WITNESS_RATIO, WITNESS_SHARPENING
from procedures.outcome import Refused, Verdict, verdict_of
from procedures.pattern_psf import witness
from procedures.pattern_psf.witness import Photographs, witnessed_psf
from tests.benchmarks.witnessed import CORRUPTIONS, outcomes, photographs

WHITE_E = 2e4


def exposures(rng: np.random.Generator, process=lambda x: x, ratio: float = 2.0) -> Photographs:
    """Two exposures of smooth texture, processed."""
    texture = gaussian_filter(rng.standard_normal((240, 260)), 2)
    scene = 0.4 + 0.3 * texture / np.abs(texture).max()
    planes = []
    for light in (scene / ratio, scene):
        picture = rng.poisson(light * WHITE_E) / WHITE_E
        planes.append(Plane("Y", process(picture).astype(np.float32), 1 / 65535, raw=False))
    return Photographs(*planes, planes[1], planes[1], ratio)


def by_exposures(four: Photographs):
    numbers = {}
    return verdict_of(list(witness._exposures(four, numbers))), numbers


def test_linear_exposures_pass_with_the_numbers_of_a_linear_camera(rng):
    outcome, numbers = by_exposures(exposures(rng))
    assert outcome.verdict is Verdict.PASS, outcome.reason
    for name, expected in ((WITNESS_RATIO, 1.0), (WITNESS_CURVATURE, 0.0), (WITNESS_SHARPENING, 0.0)):
        assert abs(numbers[name].value - expected) < 4 * numbers[name].uncertainty, name


@pytest.mark.parametrize(
    ("process", "words"),
    [
        (lambda x: np.clip(x, 0, 1) ** (1 / 1.05), "times the signal"),  # invisible to a line through both exposures
        (lambda x: x - 0.08 * x * x, "the response is not linear"),
        (lambda x: x + 0.05 * (x - gaussian_filter(x, 1.0)), "anticorrelated"),
        (lambda x: gaussian_filter(x, 0.4), "smoothing"),
    ],
)
def test_two_exposures_show_what_was_done_to_them(rng, process, words):
    outcome, _ = by_exposures(exposures(rng, process))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert words in " ".join([outcome.reason, *(one.reason for one in outcome.other_causes)])


def test_exposures_that_do_not_differ_are_refused(rng):
    alike = witnessed_psf(exposures(rng, ratio=1.1), Chart.from_seed())
    assert alike.verdict is Verdict.REFUSED
    assert "at least 1.3 times" in alike.reason
    with pytest.raises(Refused, match="must not be clipped"):
        by_exposures(exposures(rng, lambda x: np.ones_like(x)))


@pytest.mark.slow
def test_a_distance_that_is_not_nearer_is_refused():
    four, _ = photographs(1, CORRUPTIONS["clean"])
    outcome = witnessed_psf(replace(four, near=four.long), Chart.from_seed())
    assert outcome.verdict is Verdict.REFUSED
    assert "1.2 times as wide" in outcome.reason


@pytest.mark.nightly
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_an_independent_renderer_s_corruptions_are_found_or_in_the_uncertainty(name):
    _, witnessed, truth = outcomes(21000, CORRUPTIONS[name])
    assert name != "clean" or witnessed.verdict is Verdict.PASS, witnessed.reason
    if witnessed.verdict is Verdict.PASS:
        number = witnessed.value.psf.quality.numbers["mtf50_horizontal"]
        assert abs(number.value - truth) < 3 * number.uncertainty
