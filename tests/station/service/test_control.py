"""Runs are started, answered and stopped by other programs; the bench reports its state."""

import threading

import numpy as np
import pytest

from procedures import BadParameter, Plane
from procedures.plan import Advice, Ask, Outline, Step
from station.guide.frontend import FrameEvent, StepBegan, Stopped
from station.service.bench_state import coach_record
from station.service.remote_operator import RemoteOperator, RunStatus, after
from station.service.runs import read_order

from .alpaca_clients import beside

UNATTENDED = {"plan": "short", "camera": "C", "lens": "L", "answers": {"move": True, "lamp": True}, "by_default": True}


def wait_for(client, holds):
    """The run, once it is so."""
    while True:
        threading.Event().wait(0.01)  # the run needs the processor too
        run = client.get("/run")[1]
        if holds(run):
            return run


@pytest.mark.slow
def test_a_run_is_carried_out_and_its_session_is_there(client):
    status, run = client.post("/run", UNATTENDED)
    assert status == 201, run
    session = wait_for(client, lambda run: run["session"])["session"]
    entries = []
    for entry in client.journal(session):
        entries.append(entry)
        if entry["event"] == "ended":
            break
    assert [one["seq"] for one in entries] == list(range(1, len(entries) + 1))
    assert entries[-1]["how"] == "finished"
    run = wait_for(client, lambda run: run["ended"])
    assert (run["plan"], run["ended"], run["trouble"], run["question"]) == ("short", "finished", None, None)
    _, listed = client.get("/sessions")
    assert [(one["plan"], one["camera"], one["ended"]) for one in listed["sessions"]] == [("short", "C", "finished")]
    state = client.get(f"/sessions/{session}")[1]["state"]
    assert state["done"] == ["rig", "trials", "shots"]
    assert state["facts"]["width"] == 3.0


@pytest.mark.slow
def test_nothing_moves_before_somebody_said_so(client, served):
    client.post("/run", {**UNATTENDED, "answers": {}})
    question = wait_for(client, lambda run: run["question"])["question"]
    assert question["key"] == "move"
    assert "Homing" in question["question"]
    assert not any(one["moving"] for one in client.get("/status")[1]["devices"])
    assert client.post("/run/answer", {"key": "width", "answer": 3})[1]["reason"].endswith("open question is 'move'")
    assert client.post("/run/answer", {"key": "move", "answer": "perhaps"})[0] == 400
    while not (run := wait_for(client, lambda run: run["question"] or run["ended"]))["ended"]:
        client.post("/run/answer", {"key": run["question"]["key"], "answer": True})
    assert run["ended"] == "finished"
    assert served.bench.stage.position()["z_mm"] == pytest.approx(620.0, abs=0.01)  # the middle of the scan is its best


def test_a_run_waits_for_answers_that_have_no_default(client):
    client.post("/run", {"plan": "short", "answers": {"width": 300}})  # beyond what may be answered
    question = wait_for(client, lambda run: run["question"])["question"]
    assert (question["key"], question["unit"], question["low"], question["high"]) == ("width", "mm", 1.0, 9.0)
    status, reply = client.post("/run/answer", {"key": "width", "answer": 300})
    assert (status, reply["remedy"]) == (400, "It must lie between 1 and 9 mm.")
    assert client.post("/run/end")[0] == 200
    assert wait_for(client, lambda run: run["ended"])["ended"] == "stopped"


def test_an_invalid_given_answer_is_not_replaced_by_the_default():
    operator = RemoteOperator({"width": 300}, by_default=True, show=lambda plane: None)
    assert operator.answer(Ask("depth", "How deep?", "number", default=5.0)) == 5.0
    operator.stop()  # so that a question is not waited for
    with pytest.raises(Stopped):
        operator.answer(Ask("width", "How wide?", "number", default=5.0, low=1.0, high=9.0))


def test_the_stop_needs_no_token_and_ends_the_run(client, served):
    client.post("/run", {**UNATTENDED, "answers": {}})
    wait_for(client, lambda run: run["question"])
    client.token = ""
    status, reply = client.post("/stop")
    assert status == 200
    assert reply["stopped"]
    assert set(reply["stops"][0]["after_ms"]) >= {"stage", "head", "shutter"}
    assert client.get("/run")[0] == 401
    served.runs.wait(30)
    assert served.runs.status.ended == "emergency"
    assert not served.bench.stage.condition().usable


def test_a_stop_while_the_session_is_created_ends_the_run(client, served, monkeypatch):
    begin = served.lab.begin
    monkeypatch.setattr(served.lab, "begin", lambda *order: (served.stop(), begin(*order))[1])
    client.post("/run", UNATTENDED)
    assert wait_for(client, lambda run: run["ended"])["ended"] == "emergency"


def test_one_request_waits_for_a_device_that_does_not_answer_and_all_others_do_not(client, served, monkeypatch):
    release, hanging = threading.Event(), threading.Event()

    def hang():
        hanging.set()
        release.wait()
        return []

    monkeypatch.setattr(served._watch, "look", hang)
    first, outcome = beside(lambda: client.get("/status"))
    hanging.wait()
    assert {one["name"] for one in client.get("/status")[1]["devices"]} == set(served.bench.devices)
    assert client.request("GET", "/")[0] == 200
    assert client.post("/stop")[0] == 200
    release.set()
    first.join()
    assert outcome[0][0] == 200


def test_a_second_run_is_refused(client):
    client.post("/run", {**UNATTENDED, "answers": {}})
    status, reply = client.post("/run", UNATTENDED)
    assert status == 409
    assert reply == {
        "reason": "the bench is in use by a run of the plan short",
        "remedy": "wait until that ends, or stop it",
    }


@pytest.mark.slow
def test_the_newest_photograph_is_a_picture(client, served):
    assert client.get("/picture")[0] == 404
    client.post("/run", UNATTENDED)
    served.runs.wait(30)
    status, headers, body = client.request("GET", "/station/v1/picture")
    assert (status, headers["content-type"]) == (200, "image/jpeg")
    assert body.startswith(b"\xff\xd8\xff")
    assert headers["x-number"] == str(client.get("/status")[1]["picture"]) == "6"


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        ([], "JSON object"),
        ({"plans": "pattern"}, "no 'plans'"),
        ({"plan": None}, "must be text; got null"),
        ({"answers": [1]}, r"must be an object; got \[1\]"),
        ({"answers": {"width": None}}, "answers to width"),
        ({"by_default": "yes"}, 'must be true or false; got "yes"'),
    ],
)
def test_an_order_that_cannot_be_meant_is_refused(order, reason):
    with pytest.raises(BadParameter, match=reason):
        read_order(order, ("C", "L"))


def test_an_unknown_plan_is_refused_and_leaves_the_bench_free(client):
    status, reply = client.post("/run", {"plan": "patern"})
    assert status == 400
    assert "choose one of pattern" in reply["remedy"]
    assert client.get("/status")[1]["tenant"] == ""


def test_the_pose_to_match_is_given_in_fractions_of_the_picture():
    outline = Outline(((9.5, 9.5), (19.5, 9.5), (19.5, 19.5), (9.5, 19.5)), ((29.5, 9.5),) * 4)
    advice = Advice(False, "Shift the chart.", outline=outline)
    status = after(RunStatus(), FrameEvent(Plane("G1", np.zeros((100, 200), np.float32), 1e-3), advice, 2.0))
    pose = coach_record(status)
    assert pose["present"][:2] == [(0.05, 0.1), (0.1, 0.1)]
    assert (pose["wanted"][0], pose["arrows"][0], pose["hold_s"], pose["good"]) == ((0.15, 0.1), "→", 2.0, False)
    assert coach_record(after(status, StepBegan(Step("next", "Next", "", ())))) is None
