"""Guard bands: the same number meets its limit, is undecided or does not by how far its uncertainty reaches."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures import Diffraction, assess
from procedures.outcome import BadParameter, Quantity, Verdict
from station.results.comparison import Comparison, Compliance
from station.results.limits import Limit, Place, Specification, Spot, compare, limited_numbers, place_of
from station.results.plane_result import PlaneResult
from station.results.units import Pixels, Unit
from tests.psfs import gaussian

LOW = Quantity(0.25, "cycles/pixel", 0.001, "", 1)


@lru_cache
def record(sd=1e-4, name="G1"):
    """A plane with a Gaussian PSF of a standard deviation of one pixel, its samples uncertain by `sd`."""
    psf = gaussian(sd=sd)
    quality = assess(psf, n=1000, diffraction=Diffraction(5.6, 4.0, 550))
    return PlaneResult.of(name, Verdict.PASS, psf, quality, values={"gamma": 0.5, "scale": (4.0, 4.0)})


def judgements(limit, plane=None, **more):
    return compare(plane or record(), Specification((limit,)), **more).judgements


def one(limit, plane=None, **more):
    (judged,) = judgements(limit, plane, **more)
    return judged


def test_numbers_of_every_procedure_can_have_a_limit():
    assert set(record().numbers) <= set(limited_numbers())
    assert {"prnu", "fx", "tilt_corner", "corner_light", "baseline", "w_median", "mtf50_sagittal_median"} <= set(
        limited_numbers()
    )


@pytest.mark.parametrize(
    ("sigmas", "judged"), [(-2.1, "meets"), (-1.9, "undecided"), (1.9, "undecided"), (2.1, "does not meet")]
)
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
    assert wide in (narrow, Compliance.UNDECIDED)


def test_numbers_without_uncertainty_or_value_are_judged_or_undecided():
    assert [one(Limit("gamma", most=most)).judged for most in (0.5, 0.499)] == ["meets", "does not meet"]
    assert [one(Limit("gamma", least=least)).judged for least in (0.5, 0.501)] == ["meets", "does not meet"]
    judged = one(Limit("gain", least=1.0))
    assert (judged.judged, judged.value) == ("undecided", None)
    assert "cannot be judged: there is no such number" in judged.words


@pytest.mark.parametrize("uncertainty", [np.inf, np.nan])
def test_uncertainty_that_is_not_known_meets_nothing(uncertainty):
    plane = record()
    number = replace(plane.quality.numbers["strehl"], uncertainty=uncertainty)
    plane = replace(plane, numbers={"strehl": number})
    assert one(Limit("strehl", least=0.0), plane).judged == Compliance.UNDECIDED


def test_limits_hold_for_their_planes_directions_frequencies_and_places():
    limits = Specification((Limit("gamma", most=0.1, planes=("R", "B")),))
    assert compare(record(name="G1"), limits) == Comparison()
    assert [judged.judged for judged in compare(record(name="B"), limits).judgements] == ["does not meet"]
    refused = compare(PlaneResult("G1", Verdict.REFUSED), Specification((Limit("gamma", most=1.0),)))
    assert refused == Comparison(Compliance.UNDECIDED)
    both = judgements(Limit("mtf50", least=0.1))
    assert [one.number for one in both] == ["mtf50_horizontal", "mtf50_vertical"]
    edge = PlaneResult("Y", Verdict.PASS, numbers={"mtf50": LOW})
    (across,) = judgements(Limit("mtf50", least=0.1), edge)
    assert (across.number, across.judged) == ("mtf50", "meets")
    assert one(Limit("mtf_nyquist", least=0.1), edge).judged == "undecided"
    psf = gaussian(sd=1e-6)
    mtf = assess(psf, n=1, at=(0.125,)).numbers["mtf_at_0.125_horizontal"].value
    plane = PlaneResult.of("G1", Verdict.PASS, psf, assess(psf, n=1, at=(0.125,)))
    assert {one.judged for one in judgements(Limit("mtf", least=mtf - 0.01, at=0.125), plane)} == {"meets"}
    assert {one.judged for one in judgements(Limit("mtf", least=mtf + 0.01, at=0.125), plane)} == {"does not meet"}
    (far,) = judgements(Limit("mtf", least=0.1, at=0.3), plane)
    assert far.judged == "undecided"
    plane = replace(record(), place="centre")
    assert one(Limit("gamma", most=1.0, place=Place.CENTRE), plane).judged == "meets"
    elsewhere = one(Limit("mtf50_radial", most=1.0, place=Place.CORNERS), plane)
    assert elsewhere.judged == "undecided"
    assert "it was not measured there" in elsewhere.words


def test_every_place_of_a_frame_has_its_limit_and_what_was_not_measured_one_sentence():
    spots = [
        Spot("centre", (Place.CENTRE,), {"mtf50_radial": LOW}),
        Spot("upper left corner", (Place.CORNERS,), {"mtf50_radial": replace(LOW, value=0.1)}),
        Spot("lower right corner", (Place.CORNERS,)),
    ]
    found = judgements(Limit("mtf50_radial", least=0.2, place=Place.CORNERS), spots=spots)
    assert [(one.place, one.judged) for one in found] == [
        ("upper left corner", "does not meet"),
        ("lower right corner", "undecided"),
    ]
    corners = [Spot(name, (Place.CORNERS,)) for name in ("upper left corner", "lower right corner")]
    spots = [Spot("centre", (Place.CENTRE,), {"mtf50_radial": LOW}), *corners]
    limits = (Limit("mtf50_radial", least=0.3), Limit("fwhm_horizontal", most=1.0, place=Place.CORNERS))
    found = compare(record(), Specification(limits), spots=spots)
    missed, together = found.against
    assert missed.startswith("the limit MTF50, mean over directions, centre")
    assert together == ("4 limits cannot be judged, for nothing was measured at upper left corner, lower right corner")
    assert len(found.judgements) == 5  # the record has every one


@pytest.mark.parametrize(
    ("at", "place"), [((100, 80), "centre"), ((195, 80), "sides"), ((100, 2), "sides"), ((5, 155), "corners")]
)
def test_frame_is_divided_into_centre_sides_and_corners(at, place):
    assert place_of(*at, (160, 200)) == place


@pytest.mark.parametrize(("unit", "factor"), [(Unit.LINE_PAIRS, 1000 / 8.0), (Unit.LINE_WIDTHS, 2 * 300.0)])
def test_limit_in_another_unit_is_the_same_limit(unit, factor):
    # a pixel of the plane is two of the sensor's 4 um: one cycle in it is 125 line pairs per millimetre
    pixels = Pixels(2, 4.0, 300)
    mtf50 = record().numbers["mtf50_horizontal"]
    for nudge, judged in ((-3, "meets"), (3, "does not meet")):
        limit = (mtf50.value + nudge * mtf50.uncertainty) * factor
        found = one(Limit("mtf50_horizontal", least=limit, unit=unit), pixels=pixels)
        assert (found.judged, found.unit) == (judged, unit)
        assert found.value == pytest.approx(mtf50.value * factor)
        assert str(unit) in found.words


def test_results_in_other_units_need_the_pitch_and_are_the_same():
    with pytest.raises(BadParameter, match="lp/mm needs the pitch of the sensor's pixels"):
        one(Limit("mtf50_radial", least=1.0, unit=Unit.LINE_PAIRS), pixels=Pixels(2))
    assert one(Limit("fwhm_horizontal", least=0.0, unit=Unit.LINE_PAIRS), pixels=Pixels(2)).judged == "meets"
    psf = gaussian(sd=1e-5)
    plane = PlaneResult.of("G1", Verdict.PASS, psf, assess(psf, n=1, at=(0.25,)))
    stated = plane.in_unit(Unit.LINE_PAIRS, Pixels(2, 4.0))
    for name, factor in (("mtf50_radial", 125), ("fwhm_horizontal", 1)):
        assert stated.numbers[name].value == pytest.approx(plane.numbers[name].value * factor)
        assert stated.numbers[name].uncertainty == pytest.approx(plane.numbers[name].uncertainty * factor)
    assert stated.numbers["mtf_at_31.25_radial"].value == plane.numbers["mtf_at_0.25_radial"].value
    assert stated.numbers["mtf_at_31.25_radial"].method == "|OTF| at 31.25 lp/mm"
    assert stated.curves["frequency"][-1] == pytest.approx(250)
    budget = stated.quality.budgets["mtf50_radial"]
    assert sum(term**2 for term in budget.values()) ** 0.5 == pytest.approx(stated.numbers["mtf50_radial"].uncertainty)
