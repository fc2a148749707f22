"""After any fault of the bench a run ends in order, and the session keeps every photograph."""

import hashlib
import os

import pytest

from simulators.bench.bench import random_trouble
from station.guide.frontend import ProblemEvent
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

from . import benches

SEEDS = [int(os.environ["STATION_SCENARIO"])] if "STATION_SCENARIO" in os.environ else range(12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_runs_with_random_faults_end_in_order(tmp_path, seed):
    faults, fault_events = random_trouble(seed)
    operator = ScriptedOperator({"trouble": lambda ask: "try again" if operator.count("trouble") % 4 else "skip"})
    with benches.quick_bench(tmp_path, faults=faults, fault_events=fault_events, seed=seed) as bench:
        with benches.new_session(tmp_path, bench) as session:
            ended = Run(benches.short_plan(), bench, session, operator).go()
            assert ended.how in ("finished", "stopped")
            shots = session.state.shots
            folder = session.folder
        assert all(event.reason and event.remedy for event in operator.heard if isinstance(event, ProblemEvent))
        for shot in shots:
            assert hashlib.sha256((folder / shot.path).read_bytes()).hexdigest() == shot.sha256
            assert shot.counts is not None or ended.how == "stopped"
        with Session.open(folder, bench.clock) as again:
            assert again.state.shots == shots
