"""Answers of the operator compared with the camera's metadata."""

from types import SimpleNamespace

import pytest

from procedures.outcome import BadParameter
from procedures.plan import Ask
from station.guide.dialogue import MAX_INVALID_ANSWERS, Conversation
from station.guide.frontend import ProblemEvent, Stopped
from station.guide.scripted import ScriptedOperator

FOCAL = Ask("focal_length_mm", "What is the lens's focal length?", "number", "mm", low=1.0, high=5000.0)


def conversation(typed, which="", **facts):
    """A conversation that knows facts, with an operator who types this and then chooses."""
    known = dict(facts)
    session = SimpleNamespace(state=SimpleNamespace(facts=known), learn=known.update)
    operator = ScriptedOperator({"focal_length_mm": typed, "which_focal_length_mm": which})
    return Conversation(operator, session, None), operator, known


@pytest.mark.parametrize(("typed", "facts"), [(50.0, {}), (51.5, {"focal_length_mm": 50.0})])
def test_answer_that_agrees_or_stands_alone_is_accepted(typed, facts):
    talk, operator, _ = conversation(typed, **facts)
    assert talk.agreed(FOCAL) == typed
    assert len(operator.asked) == 1


def test_answers_that_contradict_the_camera_are_confirmed_and_invalid_ones_repeated():
    talk, operator, known = conversation(35.0, "50 mm", focal_length_mm=50.0)
    assert talk.agreed(FOCAL) == 50.0
    assert operator.asked[-1].question == (
        "You entered 35 mm for the focal length; 50 mm was recorded before. Which is right?"
    )
    assert operator.asked[-1].choices == ("50 mm", "35 mm")
    talk.learn_from_photograph({"focal_length_mm": 50.0, "iso": 100})
    assert (known["focal_length_mm"], known["iso"]) == (50.0, 100)
    talk, _, known = conversation(35.0, "35 mm", focal_length_mm=50.0)
    talk.learn({"focal_length_mm": talk.agreed(FOCAL)})
    talk.learn_from_photograph({"focal_length_mm": 50.0, "iso": 100})
    assert (known["focal_length_mm"], known["iso"]) == (35.0, 100)

    def check(answer, facts):
        if answer == "gone.npy":
            raise BadParameter("there is no gone.npy", "name another file")

    typed = iter(["gone.npy", "here.npy"])
    talk, operator, _ = conversation(50.0)
    operator.answers = {"shape": lambda ask: next(typed)}
    assert talk.ask(Ask("shape", "Which?", "text", check=check)) == "here.npy"
    assert operator.heard == [ProblemEvent("there is no gone.npy", "name another file")]
    operator.answers = {"shape": "gone.npy"}
    with pytest.raises(Stopped):
        talk.ask(Ask("shape", "Which?", "text", check=check))
    assert operator.count("shape") == 2 + MAX_INVALID_ANSWERS
    ask = Ask("width_mm", "How wide?", "number", "mm", 1.0, proposed=lambda facts: facts.get("paper_mm"))
    for facts, default in (({}, 1.0), ({"paper_mm": 145.0}, 145.0), ({"paper_mm": 145.0, "width_mm": 96.0}, 96.0)):
        talk, _, _ = conversation(50.0, **facts)
        assert talk.ask(ask) == default
