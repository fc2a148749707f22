"""The mailbox between a run and its operator, and jobs."""

import threading
from unittest.mock import Mock

import pytest

from drivers.errors import NoAnswer
from procedures.plan import Advice, Ask
from station.app.background import BackgroundJob, Finished
from station.app.mailbox import FramePreview, Mailbox, OperatorSession, Question
from station.guide.frontend import FrameEvent, ProgressEvent, StepBegan, StepEnded, Stopped

from .fakes import PLAN, plane

ASK = Ask("k", "?")


def test_current_state_replaces_its_predecessor_and_nothing_else_is_lost():
    rings: list[int] = []
    mailbox = Mailbox(lambda: rings.append(1))
    step = PLAN.steps[0]
    mailbox.notify(StepBegan(step))
    for i in range(50):
        mailbox.notify(ProgressEvent("exposing", i, 50))
        mailbox.notify(FrameEvent(plane(), Advice(True, f"frame {i}")))
    mailbox.notify(StepEnded(step))
    news = mailbox.take()
    assert [type(one) for one in news] == [StepBegan, ProgressEvent, FramePreview, StepEnded]
    assert news[1] == ProgressEvent("exposing", 49, 50)
    assert mailbox.take() == []
    assert len(rings) == 1  # once until it is taken


def test_an_answer_given_before_the_question_does_not_count():
    rung = threading.Event()
    mailbox, answers = Mailbox(rung.set), []
    mailbox.reply("early")
    asking = threading.Thread(target=lambda: answers.append(mailbox.answer(ASK)))
    asking.start()
    assert rung.wait(5)
    assert mailbox.take() == [Question(ASK)]
    mailbox.reply("late")
    asking.join(5)
    assert answers == ["late"]


def test_stopping_ends_the_question_that_waits_and_all_that_follow():
    mailbox = Mailbox(lambda: stop_soon())

    def stop_soon() -> None:
        threading.Thread(target=mailbox.stop).start()

    for _ in range(2):
        with pytest.raises(Stopped):
            mailbox.answer(ASK)


def finished(job_of: object) -> Finished:
    heard: list[Finished] = []
    done = threading.Event()

    def on_finished(one: Finished) -> None:
        heard.append(one)
        done.set()

    BackgroundJob("test", job_of, on_finished).start()  # type: ignore[arg-type]
    assert done.wait(5)
    return heard[0]


def test_a_job_ends_in_a_value_or_a_sentence():
    assert finished(lambda: 7).value == 7
    problem = finished(Mock(side_effect=NoAnswer("the laser said nothing", "switch it on"))).problem
    assert problem is not None
    assert (problem.reason, problem.remedy) == ("the laser said nothing", "switch it on")
    unforeseen = finished(lambda: {}["x"]).problem  # type: ignore[index]
    assert unforeseen is not None
    assert "KeyError" in unforeseen.reason


def test_cancelling_asks_first_then_halts():
    asked, halted, end = threading.Event(), threading.Event(), threading.Event()
    job = BackgroundJob("test", lambda: end.wait(5), lambda one: None, ask=asked.set, halt=halted.set).start()
    assert job.cancel()
    assert asked.wait(5)
    assert not halted.is_set()
    assert not job.cancel()
    assert halted.wait(5)
    end.set()


def test_a_run_that_was_asked_to_end_before_it_began_ends():
    calls: list[str] = []

    class Run:
        def go(self) -> str:
            calls.append("go")
            return "ended"

        def ask_to_stop(self) -> None:
            calls.append("ask")

        def stop_now(self) -> None: ...

    session = OperatorSession(lambda mailbox: Run(), lambda: None, lambda: None)  # type: ignore[arg-type,return-value]
    session.ask()
    session.work()
    assert calls == ["ask", "go"]
