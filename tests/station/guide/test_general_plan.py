"""The general plan: the settings of a procedure as questions, and the photographs that it requires."""

from pathlib import Path
from typing import Annotated, Literal

import pytest

from procedures import BadParameter, Verdict, read_frame
from procedures.plan import Tour
from station.guide.catalogue import PLANS, entries
from station.guide.plans import general
from station.procedure import PhotographProcedure, PlaneSettings, setting
from station.procedure.base import Inputs
from station.procedure.schema import BUILTIN, procedure_named
from station.sessions.layout import SCHEMA
from tests.station.sessions.short_plan import photographs


class Chosen(PlaneSettings, frozen=True, kw_only=True):
    share: Annotated[float, setting("A share.", least=0, most=1)] = 0.5
    limit: Annotated[int, setting("A limit.", least=1)] | None = None
    dark: Annotated[bool, setting("Whether it is dark.")] = False
    kind: Annotated[Literal["one", "two"], setting("A kind.")] = "one"
    tables: Annotated[tuple[Path, ...], setting("Tables.")] = ()


class Measured(PhotographProcedure[Chosen]):
    name, title, help = "measured", "a measurement", "Measure A and B."
    inputs, Settings = Inputs.PAIR, Chosen

    def run(self, frames, settings):
        raise BadParameter("the photographs are alike", "take different ones")


@pytest.fixture
def plan(monkeypatch):
    monkeypatch.setattr(general, "procedure_named", lambda name: Measured())
    return general.plan("measured", Path("session"))


def asked(plan, name):
    return plan.asks()[general.SETTING + name]


def test_every_setting_is_a_question_with_its_default(plan):
    asks = {key.removeprefix(general.SETTING): ask for key, ask in plan.asks().items() if general.SETTING in key}
    assert {name: (ask.kind, ask.default) for name, ask in asks.items()} == {
        "plane": ("text", ""), "share": ("number", 0.5), "limit": ("text", ""), "dark": ("choice", "no"),
        "kind": ("choice", "one"), "tables": ("text", ""),
    }  # fmt: skip
    assert (asks["share"].low, asks["share"].high) == (0, 1)
    assert asks["tables"].names_file("table.csv")
    assert not asks["plane"].names_file("G1")


@pytest.mark.parametrize(("name", "answer"), [("limit", "0"), ("limit", "many"), ("limit", "1.5")])
def test_an_invalid_answer_is_refused_at_its_question(plan, name, answer):
    with pytest.raises(BadParameter, match="limit must be a whole number at least 1"):
        asked(plan, name).check(answer, {})


@pytest.mark.parametrize(
    ("name", "answer"), [("limit", "3"), ("limit", ""), ("tables", "a.csv; b.csv"), ("dark", "yes")]
)
def test_a_valid_answer_is_accepted(plan, name, answer):
    asked(plan, name).check(answer, {})


def test_a_pair_is_two_photographs_and_the_operator_prepares_each(plan):
    (tour,) = (one for one in plan.step("photographs").requests if isinstance(one, Tour))
    assert [stop.go.say({}) for stop in tour.stops({})] == [f"Prepare photograph {n} of 2." for n in (1, 2)]


def test_an_error_of_the_procedure_refuses_every_plane(tmp_path):
    path = tmp_path / "1.dng"
    path.write_bytes(photographs()["look"])
    (tmp_path / "session.toml").write_text(f'schema = "{SCHEMA}"\n')
    outcomes = general.estimate(Measured(), tmp_path, [read_frame(path)], {}, {})
    assert {name: (one.verdict, one.reason) for name, one in outcomes.items()} == dict.fromkeys(
        read_frame(path).planes, (Verdict.REFUSED, "the photographs are alike")
    )


@pytest.mark.parametrize("name", sorted(BUILTIN))
def test_procedures_with_other_inputs_have_no_general_plan(name):
    if procedure_named(name).inputs in general.COUNTS:
        assert general.plan(name).steps
    else:
        with pytest.raises(BadParameter, match="must be photographs"):
            general.plan(name)


def test_the_catalogue_has_the_plans_of_the_station():
    assert list(entries())[: len(PLANS)] == list(PLANS)
    assert PLANS["edge"].general
