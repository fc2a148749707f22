"""A tour of places: one shot that counts at each, corrections, skipped places, interruptions."""

import json

import pytest

from procedures.plan import Advice, Go, Plan, Step, Tour, TourStop
from station.guide.frontend import ProgressEvent
from station.guide.photographing import SKIP_PLACE
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

from . import benches

PLACES_MM = {"near": 600.0, "middle": 640.0, "far": 680.0}


def tour_plan(check=lambda name, facts: Advice(True, "good"), tries=2, off_mm=0.0):
    def stop(name, place_mm):
        go = Go(lambda facts: {"z_mm": place_mm + off_mm}, lambda facts: f"going to {name}")
        return TourStop(name, go, lambda frame, facts: check(name, facts))

    stops = [stop(*one) for one in PLACES_MM.items()]
    home = benches.Home()
    return Plan("short", "A tour", (Step("tour", "Tour", "Go.", (home, Tour(lambda facts: stops, tries))),))


def shots(session):
    return [(shot.purpose, shot.counts) for shot in session.state.shots]


def at_mm(session):
    return [shot.snapshot["axes"]["z_mm"] for shot in session.state.counting()]


def test_every_place_is_visited_and_photographed_once(bench, session):
    assert Run(tour_plan(), bench, session, ScriptedOperator()).go().how == "finished"
    assert shots(session) == [(name, True) for name in PLACES_MM]
    assert at_mm(session) == pytest.approx(list(PLACES_MM.values()), abs=0.05)


@pytest.mark.slow
def test_advice_of_the_check_is_carried_out_before_the_next_try(bench, session):
    def check(name, facts):
        off = PLACES_MM[name] - facts["at_z_mm"]
        return Advice(abs(off) < 0.1, "off its place", moves={"z_mm": off})

    operator = ScriptedOperator()
    Run(tour_plan(check, off_mm=7.0), bench, session, operator).go()
    assert shots(session) == [(name, counts) for name in PLACES_MM for counts in (False, True)]
    assert at_mm(session) == pytest.approx(list(PLACES_MM.values()), abs=0.05)
    assert {ask.key for ask in operator.asked} <= {"move"}  # only the approvals of moves


def test_without_axes_the_operator_moves_the_camera(bench, session):
    go = Go(lambda facts: {}, lambda facts: "Turn the camera to the left.")
    stops = [TourStop("left", go, lambda frame, facts: Advice(True, "good"))]
    plan = Plan("short", "A tour", (Step("tour", "Tour", "Go.", (Tour(lambda facts: stops),)),))
    operator = ScriptedOperator()
    Run(plan, bench, session, operator).go()
    assert [ask.question for ask in operator.asked] == ["Turn the camera to the left."]
    assert shots(session) == [("left", True)]


def test_a_place_where_no_shot_counts_is_skipped_with_its_reason(bench, session):
    operator = ScriptedOperator()
    plan = tour_plan(lambda name, facts: Advice(name != "middle", "glare"))
    assert Run(plan, bench, session, operator).go().how == "finished"
    assert [shot.purpose for shot in session.state.counting()] == ["near", "far"]
    assert [shot.reason for shot in session.state.shots if not shot.counts] == ["glare", "glare"]
    says = [event.say for event in operator.heard if isinstance(event, ProgressEvent)]
    assert "middle is skipped: glare" in says
    lines = (session.folder / "journal.jsonl").read_text().splitlines()
    (line,) = (line for line in map(json.loads, lines) if line["event"] == "left_out")
    assert (line["place"], line["reason"]) == ("middle", "glare")


def test_the_operator_may_try_a_place_again(bench, session):
    answers = iter(["try again", SKIP_PLACE])
    operator = ScriptedOperator({"place": lambda ask: next(answers)})
    Run(tour_plan(lambda name, facts: Advice(name != "middle", "glare")), bench, session, operator).go()
    assert shots(session).count(("middle", False)) == 4


def test_the_operator_may_stop_at_a_place_and_resumes_there(bench, session):
    operator = ScriptedOperator({"place": "stop"})
    plan = tour_plan(lambda name, facts: Advice(name != "middle", "glare"))
    assert Run(plan, bench, session, operator).go().how == "stopped"
    session.close()
    with Session.open(session.folder, bench.clock) as again:
        assert Run(tour_plan(), bench, again, ScriptedOperator()).go().how == "finished"
        assert [shot.purpose for shot in again.state.counting()] == list(PLACES_MM)
        # the first place has its shot from before
        assert sum(shot.purpose == "near" for shot in again.state.shots) == 1


def test_a_shot_left_unchecked_by_an_interruption_is_checked_and_not_repeated(bench, session):
    def power_cut(name, facts):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Run(tour_plan(power_cut), bench, session, ScriptedOperator()).go()
    assert shots(session) == [("near", None)]
    session.close()
    with Session.open(session.folder, bench.clock) as again:
        assert Run(tour_plan(), bench, again, ScriptedOperator()).go().how == "finished"
        assert shots(again) == [(name, True) for name in PLACES_MM]
