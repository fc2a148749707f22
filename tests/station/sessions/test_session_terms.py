"""A session's specification: frozen when it begins, compared with every result, reported as text and exit code."""

import numpy as np
import pytest

from drivers.errors import SystemClock
from procedures import BadParameter, Verdict, assess
from procedures.choice import knot_budgets, with_parts
from station.cli.guide import exit_code
from station.guide.frontend import Result, RunEnded
from station.results.comparison import Comparison, Compliance
from station.results.plane_result import PlaneResult
from station.results.terms import USUAL
from station.results.units import Pixels
from station.sessions.session import Session
from station.sessions.state import KEY, UNIT, frozen, in_terms, terms_of_session
from tests.psfs import gaussian

TEXT = """\
title = "lens \u00b5"
unit = "lp/mm"
[[limit]]
number = "mtf"
at = 25
min = 0.2
"""


def begun(tmp_path, **config):
    session = Session.create(tmp_path, plan="pattern", camera="camera", lens="lens", config=config, clock=SystemClock())
    session.close()
    return session.folder


@pytest.fixture
def specification(tmp_path):
    path = tmp_path / "lens.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_session_keeps_its_specification_whatever_becomes_of_the_file(tmp_path, specification):
    folder = begun(tmp_path / "sessions", **{KEY: frozen(specification)})
    specification.unlink()
    found = terms_of_session(folder).specification
    assert (found.title, found.source) == ("lens \u00b5", str(specification))
    assert [(one.number, one.at, one.least) for one in found.limits] == [("mtf", 25.0, 0.2)]


def test_session_without_one_is_held_to_nothing(tmp_path):
    assert terms_of_session(begun(tmp_path, simulate=True)) is USUAL


def test_specification_that_cannot_be_meant_is_refused_before_the_session(tmp_path):
    (tmp_path / "wrong.toml").write_text("[limits]\nmtf51 = { min = 1 }\n")
    with pytest.raises(BadParameter, match="mtf51 is not known"):
        frozen(tmp_path / "wrong.toml")
    with pytest.raises(BadParameter, match="there is no file"):
        frozen(tmp_path / "absent.toml")


def plane():
    psf = gaussian()
    quality = assess(psf, n=9)
    budgets = {**knot_budgets(quality), **quality.budgets}
    noise = {name: terms["noise"] for name, terms in budgets.items()}
    parts = {name: {"noise": own, "mismatch": 2 * own} for name, own in noise.items()}
    return PlaneResult.of("G1", Verdict.PASS, psf, with_parts(quality, parts), pitch=2)


def test_mtf_that_is_limited_is_reported_with_all_terms_of_its_uncertainty(tmp_path, specification):
    folder = begun(tmp_path / "sessions", **{KEY: frozen(specification)})
    found = in_terms(plane(), terms_of_session(folder), Pixels(2, 4.0))
    own = assess(plane().psf, n=9, at=(0.2,)).numbers["mtf_at_0.2_horizontal"]
    reported = found.numbers["mtf_at_0.2_horizontal"]  # 25 lp/mm of a pitch of two times 4 um
    assert reported.value == own.value
    # model error twice the noise: the root of 1 + 4 times as uncertain, but for the choice
    assert reported.uncertainty == pytest.approx(own.uncertainty * 5**0.5, rel=0.02)
    assert found.specification.judged == "meets"


def test_limits_that_need_an_unknown_pitch_stay_undecided_with_the_reason(tmp_path, specification):
    folder = begun(tmp_path / "sessions", **{KEY: frozen(specification)})
    found = in_terms(plane(), terms_of_session(folder), Pixels(2)).specification
    assert found.judged == "undecided"
    assert "lp/mm needs the pitch of the sensor's pixels" in found.against[0]


@pytest.mark.parametrize(("judged", "code"), [("meets", 0), ("undecided", 0), ("does not meet", 1)])
def test_plain_guide_returns_whether_the_specification_is_met(judged, code):
    green = PlaneResult("G1", Verdict.PASS, specification=Comparison(Compliance(judged)))
    result = Result("out", {"G1": green}, Verdict.PASS, "", "")
    assert exit_code(RunEnded("finished"), result) == code


def test_session_reports_frequencies_in_the_unit_that_it_was_begun_with(tmp_path):
    terms = terms_of_session(begun(tmp_path, **{UNIT: "lp/mm"}))
    before, reported = plane(), in_terms(plane(), terms, Pixels(2, 4.0))
    one = reported.numbers["mtf50_horizontal"]
    # a pixel of the plane is two of 4 um: 125 lp/mm for a cycle per pixel
    assert (one.value, one.unit) == (pytest.approx(125 * before.numbers["mtf50_horizontal"].value), "lp/mm")
    np.testing.assert_allclose(reported.curves["frequency"], 125 * before.curves["frequency"])
    unknown = in_terms(plane(), terms, Pixels(2)).numbers["mtf50_horizontal"]
    assert (unknown.value, unknown.unit) == (before.numbers["mtf50_horizontal"].value, "cycles/pixel")


def test_session_that_has_frozen_no_unit_is_named(tmp_path):
    with pytest.raises(BadParameter, match=r'unit must be one of .*; it is "lp/inch"'):
        terms_of_session(begun(tmp_path, **{UNIT: "lp/inch"}))
