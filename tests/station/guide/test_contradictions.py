"""Handling of numbers that contradict a photograph, and of moves without improvement."""

from dataclasses import dataclass

from procedures.plan import Advice, Ask, CameraFacts, Look, Plan, Reading, Shoot, Step, derived_from
from station.guide.frontend import ProblemEvent
from station.guide.photographing import CORRECT, INSIST, LookProgress
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.reader import read_session

from . import benches

WIDTH = Ask("width", "How wide?", "number", "mm", 3.0, low=1.0, high=9.0)


@dataclass(frozen=True)
class WidthFacts(CameraFacts):
    width: float | None = None
    area: float | None = derived_from("width")


def check(frame, facts):
    if facts["width"] != 5.0 and not facts.get("insisted_width"):
        return Advice(False, "It is 5 mm wide.", contradictory=("width",))
    return Advice(True, "good", facts={"area": facts["width"] ** 2})


def plan(look, *more):
    return Plan("short", "Short", (Step("one", "One", "Look.", (WIDTH, look, *more)),), facts=WidthFacts)


def photographs(session):
    return len(session.state.shots)


def troubles(operator):
    reasons = [event.reason for event in operator.heard if isinstance(event, ProblemEvent)]
    return [reason for reason in reasons if "Given:" in reason]


def test_a_number_contradicting_the_photograph_repeats_its_question_and_drops_derived_facts(bench, session):
    session.learn({"width": 4.0, "area": 16.0})
    answers = iter([4.0, 5.0])
    operator = ScriptedOperator({"width": lambda ask: next(answers), "contradiction": CORRECT})
    assert Run(plan(Look("trial", check)), bench, session, operator).go().how == "finished"
    assert troubles(operator) == ["It is 5 mm wide. Given: How wide? 4 mm."]
    assert session.state.facts["area"] == 25.0
    assert photographs(session) == 2


def test_facts_derived_from_a_number_are_dropped_when_it_changes(bench, session):
    session.learn({"width": 4.0, "area": 16.0})
    never = Look("trial", lambda frame, facts: Advice(True, "good"))
    Run(plan(never), bench, session, ScriptedOperator({"width": 6.0})).go()
    assert session.state.facts["width"] == 6.0
    assert "area" not in session.state.facts
    assert read_session(session.folder).state.facts == session.state.facts


def test_shots_that_count_may_contradict_a_number_too(bench, session):
    def enough(results, facts):
        return Advice(True, "enough") if facts["width"] == 5.0 else check(None, facts)

    answers = iter([4.0, 5.0])
    operator = ScriptedOperator({"width": lambda ask: next(answers), "contradiction": CORRECT})
    shoot = Shoot("shots", benches.good, benches.passed, enough)
    assert Run(plan(shoot), bench, session, operator).go().how == "finished"
    assert troubles(operator) == ["It is 5 mm wide. Given: How wide? 4 mm."]
    assert session.state.facts["width"] == 5.0


def test_the_operator_may_insist(bench, session):
    operator = ScriptedOperator({"width": 4.0, "contradiction": INSIST})
    assert Run(plan(Look("trial", check)), bench, session, operator).go().how == "finished"
    assert session.state.facts["insisted_width"] is True
    assert session.state.facts["area"] == 16.0


def test_after_three_answers_that_do_not_help_the_plan_stops(bench, session):
    operator = ScriptedOperator({"width": 4.0, "contradiction": CORRECT})
    assert Run(plan(Look("trial", check)), bench, session, operator).go().how == "stopped"
    assert photographs(session) == 3


def test_after_three_moves_without_improvement_the_plan_stops_and_lists_the_inputs(bench, session):
    def never(frame, facts):
        return Advice(False, "Move.", (Reading("s/t", 0.6, "", 1.0, 1.5),), moves={"z_mm": 10.0})

    operator = ScriptedOperator()
    ended = Run(plan(Look("trial", never, rests_on=("width",))), bench, session, operator).go()
    assert ended.how == "stopped"
    assert troubles(operator) == [
        "3 moves have not brought the s/t nearer to its tolerance: it was 0.6, 0.6, 0.6, 0.6. Given: How wide? 3 mm."
    ]
    assert photographs(session) == 4


def test_moves_that_help_are_not_counted():
    progress = LookProgress()
    for value in (3.0, 2.5, 2.2, 2.0, 1.8):
        # deviations 1.5, 1.0, 0.7, 0.5, 0.3
        advice = Advice(False, "Move.", (Reading("s/t", value, "", 1.0, 1.5),), moves={"z_mm": 10.0})
        assert progress.stalled(advice) == ""
