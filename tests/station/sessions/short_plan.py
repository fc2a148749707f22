"""A calibration that takes as little time as one can: homing, a look, two shots, one plane's estimate."""

from dataclasses import replace

import numpy as np

from procedures import Chart, Outcome, PatternParameters, estimate_psf
from procedures.pattern_psf.combine import combine
from procedures.plan import Advice, Decide, Estimate, Home, Look, Plan, Shoot, Step
from simulators.bench.body import Opening
from simulators.bench.view import View, bench_camera
from simulators.camera.sensor import Sensor
from simulators.world.world import World
from station.guide.catalogue import GuidedProcedure

SHOTS = 2
CHART, PARAMETERS = Chart.from_seed(), PatternParameters(s=3, k=13)


def plan() -> Plan:
    """The plan."""
    steps = (
        Step("mount", "Mount", "", (Home(), Look("look", seen))),
        Step("shots", "Shots", "", (Shoot("shot", fine, brightness, enough),)),
        Step("estimate", "Estimate", "", (Estimate(estimate),)),
        Step("verdict", "Verdict", "", (Decide("shots"),)),
    )
    return Plan("short", "A short one", steps)


def seen(frame, facts):
    return Advice(True, "fine", facts={"mean": float(frame.planes["G1"].samples.mean())})


def fine(frame, facts):
    return Advice(True, "")


def brightness(frame, facts, results, known):
    """What a shot is looked at for here: an outcome that takes no time."""
    return {"G1": Outcome(float(frame.planes["G1"].samples.mean()))}


def enough(results, facts):
    return Advice(len(results) >= SHOTS, f"{len(results)} of {SHOTS}")


def estimate(frames, facts, known):
    return {"G1": combine([estimate_psf(frame.planes["G1"], CHART, PARAMETERS) for frame in frames])}


def photographs() -> dict[str, bytes]:
    """The frames by what they are taken for."""
    view = View(World(), np.random.default_rng(1), replace(bench_camera(), sensor=Sensor(rows=320, columns=400)))
    names = ["look", *(f"shot {i}" for i in range(SHOTS))]
    return {name: view.develop(Opening(0.0, 0.02, i)) for i, name in enumerate(names)}


ENTRY = {"short": GuidedProcedure("a short one", plan)}
"""For the table of plans."""
