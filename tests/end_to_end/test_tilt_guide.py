"""The loop of a sensor's tilt: measured, screws turned inexactly, measured again, until no improvement is possible."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.outcome import Outcome
from procedures.plan import Ask, facts_as
from procedures.tilt.estimate import Tilt
from procedures.tilt.plan import TiltFacts, bracket_mm, off_reach_mm, plan
from procedures.tilt.plane import SURE, Screws, fit_plane, turns_for
from simulators.bench.view import SensorMount
from station.bench.opening import simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import Result
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

pytestmark = pytest.mark.slow

SIZE_MM = (7.6, 5.7)
NINE = np.array([(x, y) for y in (-2.0, 0.0, 2.0) for x in (-2.7, 0.0, 2.7)])
PLACE_UM = 0.7
"""Standard uncertainty of a height from a bracket of rendered photographs."""
MOUNT = SensorMount(slopes=(9.0, -6.0))
SCREWS = Screws(MOUNT.count, MOUNT.radius_mm, MOUNT.pitch_mm, MOUNT.first_deg, turn_uncertainty=0.004)


def corner_um(slopes: tuple[float, float]) -> float:
    return float(np.abs(slopes) @ np.array(SIZE_MM)) / 2


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    root = tmp_path_factory.mktemp("tilt")
    (root / "incoming").mkdir()
    bench = simulated_bench(root / "incoming", seed=3, virtual_time=True)
    collected = SimpleNamespace(true=[])

    def estimate(frames, facts, known):
        """The simulated sensor, as measured at nine places of a bracket."""
        slopes, rng = bench.simulated.view.held.slopes, np.random.default_rng(len(collected.true))
        collected.true.append(slopes)
        heights = NINE @ np.array(slopes) + PLACE_UM * rng.standard_normal(9)
        found = fit_plane(NINE, heights, PLACE_UM**2 * np.eye(9), SIZE_MM)
        turns = turns_for(found, SCREWS, with_focus=False)
        return {"Y": Outcome(Tilt(found, np.zeros(9), SCREWS, turns, with_focus=False))}

    loop = plan(estimate)
    loop = replace(loop, steps=tuple(loop.step(name) for name in ("turn", "estimate", "verdict")))
    with Session.create(root, plan="tilt", camera="C", lens="L", config={}, clock=bench.clock, seed=3) as session:
        operator = ScriptedOperator()
        collected.end, collected.state = Run(loop, bench, session, operator).go(), session.state
        collected.asked = [ask for ask in operator.asked if isinstance(ask, Ask)]
        collected.results = [event for event in operator.heard if isinstance(event, Result)]
        collected.left = bench.simulated.view.held.slopes
    bench.close()
    return collected


def test_two_turns_of_the_screws_leave_less_than_five_micrometres_and_no_more_are_asked_for(done):
    assert done.end.how == "finished"
    corners = [corner_um(slopes) for slopes in done.true]
    assert corners[0] == pytest.approx(corner_um(MOUNT.slopes))
    assert len(corners) >= 2
    assert corners[min(2, len(corners) - 1)] < 5.0
    turns = [ask.question for ask in done.asked if ask.key == "by_hand"]
    assert len(turns) == MOUNT.count * (len(done.results) - 1)
    assert all("of a turn" in question for question in turns)
    assert done.state.facts["helps"] < SURE
    assert done.left == done.true[-1]
    assert all((one.folder / "report.html").is_file() and (one.folder / "tilt.csv").is_file() for one in done.results)


@pytest.mark.nightly
def test_the_chart_that_is_proposed_has_its_bracket_in_the_rail_s_reach(tmp_path):
    (tmp_path / "incoming").mkdir()
    bench = simulated_bench(tmp_path / "incoming", seed=0, virtual_time=True)
    whole = plan_named("tilt")
    names = [step.name for step in whole.steps]
    begun = replace(whole, steps=whole.steps[: names.index("screws") + 1])
    with Session.create(tmp_path, plan="tilt", camera="C", lens="L", config={}, clock=bench.clock, seed=0) as session:
        operator = ScriptedOperator()
        assert Run(begun, bench, session, operator).go().how == "finished"
        facts = facts_as(TiltFacts, session.state.facts)
    bench.close()
    assert operator.count("look") == 0  # every check passed
    assert off_reach_mm(facts, bracket_mm(facts.optics(1), 2.8, facts.begun().distance_mm)) == 0.0
