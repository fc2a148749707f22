"""Walls that a program or a lens changed: flagged by name; clean ones by none of the tests."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from procedures import Plane, TwoPhotoParameters, estimate_psf_of_pair
from procedures.outcome import Verdict, causes_of
from tests.benchmarks.adversarial import guided, unsharp

from .endless import CAMERAS, photographs

Array = np.ndarray


CHANGED: dict[str, tuple[Callable[[Array], Array], str]] = {
    "clean": (lambda x: x, ""),
    "median": (lambda x: 0.7 * x + 0.3 * cv2.medianBlur(x.astype(np.float32), 3), "unlike any image by a lens"),
    "mask above a threshold": (
        lambda x: unsharp(0.4, 1.0, 5.0).process(x, 0.006, None),
        "strong detail is sharpened more",
    ),
    "ghost": (lambda x: 0.92 * x + 0.08 * cv2.GaussianBlur(x[::-1, ::-1], (0, 0), 3.0), "the lens reflects light"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANGED)
def test_what_a_program_or_a_lens_does_is_flagged_by_name(name: str) -> None:
    change, words = CHANGED[name]
    pair = photographs(CAMERAS["f/5.6"], noise=0.006, seed=3)
    near, far = (change(one.astype(float)) for one in (pair.near, pair.far))
    pictures = (pair.near if name == "ghost" else near, far)  # another ghost lies in another place of the wall
    planes = [Plane("Y", one.astype(np.float32), 1e-5, raw=True) for one in pictures]
    outcome = estimate_psf_of_pair(*planes, TwoPhotoParameters(3, 13))
    if words:
        assert outcome.verdict is not Verdict.PASS
        assert any(words in cause.reason for cause in causes_of(outcome)), causes_of(outcome)
    else:
        assert outcome.verdict is Verdict.PASS


@pytest.mark.slow
@pytest.mark.parametrize(("amount", "passes"), [(0.3, True), (1.0, False)])
def test_faint_detail_that_is_smoothed_is_in_the_uncertainty_or_flagged(
    rng: np.random.Generator, amount: float, passes: bool
) -> None:
    pair = photographs(CAMERAS["f/5.6"], noise=0.006, seed=3)
    smooth = guided(2, 3.0).process
    planes = [
        Plane("Y", (x + amount * (smooth(x, 0.006, rng) - x)).astype(np.float32), 1e-5) for x in (pair.near, pair.far)
    ]
    outcome, clean = (estimate_psf_of_pair(*one, TwoPhotoParameters(3, 13)) for one in (planes, (pair.near, pair.far)))
    assert outcome.value is not None
    found, truth = (one.quality.numbers["mtf50_horizontal"] for one in (outcome.value, clean.result()))
    assert truth.value - found.value < (2 if passes else 3) * found.uncertainty
    assert truth.uncertainty < 0.6 * found.uncertainty
    assert (outcome.verdict is Verdict.PASS) is passes
    assert passes or "faint detail is smoother" in outcome.reason
