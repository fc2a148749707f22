"""One number given wrongly at a time, in every guided plan on the simulated bench, and where it is named.

`python -m tests.benchmarks.wrong_numbers [PLAN ...]` prints a row for each number and factor: the step whose question
it answers, the step that named it, the trial photographs up to then, and the sentence.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from procedures.whole_camera.plan import NO_PANEL
from station.bench.opening import simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import ProblemEvent, StepEnded
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session

FACTORS = (0.5, 0.8, 1.2, 2.0)
LAST = {
    "pattern": "focus", "field": "focus", "geometry": "focus", "camera": "focus", "tilt": "focus", "two-photo": "far",
    "restoration": "second",
}  # fmt: skip
"""After this step nothing more can name what was typed before."""
ASKED = {
    "focal_length_mm": "distance", "pixel_pitch_um": "distance", "ruler_mm": "print", "chart_width_mm": "print",
    "chart_seed": "print", "typed_f_number": "focus", "near_mm": "wall", "first_f_number": "scene",
    "second_f_number": "scene",
}  # fmt: skip
CHART = ("focal_length_mm", "pixel_pitch_um", "ruler_mm", "chart_seed", "typed_f_number")
NUMBERS = {
    **dict.fromkeys(("pattern", "field", "geometry", "camera", "tilt"), CHART),
    "two-photo": ("near_mm",),
    "restoration": ("first_f_number", "second_f_number", "pixel_pitch_um"),
}


@dataclass(frozen=True)
class Named:
    """Where a wrong number was named: the step, "" for nowhere; how many trials before; the sentence."""

    step: str
    trials: int
    reason: str
    reached: str


def named(plan: str, key: str, factor: float, folder: Path, *, seed: int = 3) -> Named:
    """Carry the plan out with the number off by the factor; an operator who insists on it until it is contradicted."""
    incoming = folder / "incoming"
    incoming.mkdir()
    bench = simulated_bench(incoming, seed=seed, virtual_time=True)
    view = bench.simulated.view
    lens = replace(view.camera.lens, f_number=8.0, noted=key != "typed_f_number")
    view.camera = replace(view.camera, oversampling=4, lens=lens)
    session = Session.create(folder, plan=plan, camera="C", lens="L", config={}, clock=bench.clock, seed=seed)
    answers: dict[str, Any] = {
        "contradiction": "stop", "focus_by": "skip", "blur_by": "apertures", "light": NO_PANEL,
    }  # fmt: skip
    if key == "chart_seed":
        session.learn({key: 10.0 * factor})
    else:
        answers[key] = lambda ask: factor * float(ask.default)
        answers[f"which_{key}"] = lambda ask: ask.choices[1]
    operator = ScriptedOperator(answers)
    run = Run(plan_named(plan), bench, session, operator)

    def listen(event: Any) -> None:
        if isinstance(event, StepEnded) and event.step.name == LAST[plan]:
            run.ask_to_stop()

    operator.listen = listen
    run.go()
    state = session.state
    session.close()
    bench.close()
    reasons = [event.reason for event in operator.heard if isinstance(event, ProblemEvent) and "Given:" in event.reason]
    trials = sum(shot.step == state.step for shot in state.shots)
    return Named(state.step if reasons else "", trials, reasons[-1] if reasons else "", state.step)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", nargs="*", default=list(NUMBERS))
    parser.add_argument("--numbers", nargs="*", default=[])
    parser.add_argument("--factors", nargs="*", type=float, default=FACTORS)
    given = parser.parse_args()
    for plan in given.plans:
        for key in given.numbers or NUMBERS[plan]:
            for factor in given.factors:
                begin_s = time.process_time()
                with tempfile.TemporaryDirectory() as folder:
                    found = named(plan, key, factor, Path(folder))
                took_s = time.process_time() - begin_s
                where = f"named in {found.step} after {found.trials}" if found.step else f"NOT NAMED by {found.reached}"
                asked = "scene" if plan == "restoration" else ASKED[key]
                row = f"{plan:12} {key:16} x {factor:3.1f} asked in {asked:9} {where:32} {took_s:5.1f} s"
                print(row, found.reason, flush=True)


if __name__ == "__main__":
    main()
