"""Guard bands: the same number passes, is doubtful or fails by how far its uncertainty reaches."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.outcome import Verdict
from procedures.psf import Psf
from procedures.quality import Diffraction, assess
from station.results.limits import QUANTITIES, Compliance, Limit, judge
from station.results.plane_result import PlaneResult


@lru_cache
def record(sd=1e-4, name="G1"):
    """A plane with a Gaussian PSF of a standard deviation of one pixel, its samples uncertain by `sd`."""
    x = (np.arange(17) - 8) / 4
    h = np.exp(-(x[:, None] ** 2 + x**2) / 2)
    psf = Psf(h / h.sum(), 4, np.eye(289) * sd**2)
    quality = assess(psf, n=1000, diffraction=Diffraction(5.6, 4.0, 550))
    return PlaneResult.of(name, Verdict.PASS, psf, quality, values={"gamma": 0.5, "scale": (4.0, 4.0)})


def one(limit, plane=None):
    (judged,) = judge(plane or record(), [limit])
    return judged


def test_every_number_of_an_estimate_can_have_a_limit():
    assert set(record().numbers) == set(QUANTITIES)


@pytest.mark.parametrize(("sigmas", "judged"), [(-2.1, "pass"), (-1.9, "doubtful"), (1.9, "doubtful"), (2.1, "fail")])
def test_number_must_clear_its_limit_by_its_uncertainty(sigmas, judged):
    mtf50 = record().quality.numbers["mtf50_horizontal"]
    limit = mtf50.value + sigmas * mtf50.uncertainty
    assert one(Limit("mtf50_horizontal", least=limit)).judged == judged
    mirrored = mtf50.value - sigmas * mtf50.uncertainty
    assert one(Limit("mtf50_horizontal", most=mirrored)).judged == judged


@given(st.floats(-5, 5), st.floats(0, 4), st.floats(0, 3))
def test_wider_guard_bands_never_make_a_verdict_of_doubt_sure(offset, coverage, more):
    mtf50 = record().quality.numbers["mtf50_vertical"]
    limit = mtf50.value + offset * mtf50.uncertainty
    narrow = one(Limit("mtf50_vertical", least=limit, coverage=coverage)).judged
    wide = one(Limit("mtf50_vertical", least=limit, coverage=coverage + more)).judged
    assert wide in (narrow, Compliance.DOUBTFUL)


def test_number_without_uncertainty_has_no_guard_band():
    assert [one(Limit("gamma", most=most)).judged for most in (0.5, 0.499)] == ["pass", "fail"]


def test_number_that_the_psf_has_not_is_doubtful_and_said():
    judged = one(Limit("gain", least=1.0))
    assert (judged.judged, judged.value) == ("doubtful", None)
    assert judged.words == "the limit gain ≥ 1 cannot be judged: the PSF has no such number"


@pytest.mark.parametrize("uncertainty", [np.inf, np.nan])
def test_uncertainty_that_is_not_known_passes_nothing(uncertainty):
    plane = record()
    number = replace(plane.quality.numbers["strehl"], uncertainty=uncertainty)
    plane = replace(plane, numbers={"strehl": number})
    assert one(Limit("strehl", least=0.0), plane).judged == Compliance.DOUBTFUL


def test_limit_of_some_planes_holds_for_them_only():
    limits = [Limit("gamma", most=0.1, planes=("R", "B"))]
    assert judge(record(name="G1"), limits) == ()
    assert [judged.judged for judged in judge(record(name="B"), limits)] == ["fail"]


def test_refused_plane_is_not_judged():
    assert judge(PlaneResult("G1", Verdict.REFUSED), [Limit("gamma", most=1.0)]) == ()
