"""A simulated bench in virtual time whose frames are cheap, and short plans to run on it."""

import functools
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drivers.dng import Shot, write_dng
from procedures.outcome import Outcome, Verdict
from procedures.plan import Advice, Ask, Go, Home, Look, Measure, Plan, Scan, SetLight, Shoot, Step
from simulators.bench.bench import Setup, SimulatedBench
from station.bench.opening import make_bench, simulated_tables
from station.sessions.session import Session


@functools.cache
def frame_bytes(number: int) -> bytes:
    """A small RAW file, different for every number."""
    mosaic = np.random.default_rng(number).integers(600, 9000, (64, 96)).astype(np.uint16)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "frame.dng")
        write_dng(path, mosaic, Shot(exposure_s=0.02, iso=100, f_number=5.6), cfa="RGGB", black=(512,) * 4, white=16383)
        return path.read_bytes()


@contextmanager
def quick_bench(folder: Path, *, faults=None, fault_events=(), seed: int = 1, shaker: bool = False):
    """A bench on which any exposure gives a small frame at once."""
    incoming = folder / "incoming"
    incoming.mkdir(exist_ok=True)
    setup = Setup(
        seed=seed, faults=faults or {}, fault_events=tuple(fault_events), virtual_time=True,
        develop=lambda opening: frame_bytes(opening.number),
    )  # fmt: skip
    truth = SimulatedBench(incoming, setup)
    tables = simulated_tables(truth.address, incoming, shaker=shaker)
    bench = make_bench(tables, folder=incoming, clock=truth.clock)
    bench.simulated = truth
    try:
        yield bench
    finally:
        bench.close()
        truth.close()


def new_session(folder: Path, bench, plan: str = "short") -> Session:
    return Session.create(folder / "sessions", plan=plan, camera="C", lens="L", config={}, clock=bench.clock, seed=1)


def good(frame, facts):
    return Advice(True, "good")


def passed(frame, facts, results, known):
    return {name: Outcome(None, Verdict.PASS) for name in frame.planes}


def short_plan(**changes) -> Plan:
    """Everything that a plan can ask of a bench, with checks that always pass."""
    parts = {
        "ask": Ask("width", "How wide?", "number", "mm", 3.0, low=1.0, high=9.0),
        "home": Home(),
        "go": Go(lambda facts: {"z_mm": 700.0}, lambda facts: "going to 700 mm"),
        "light": SetLight(lambda facts: 0.8),
        "measure": Measure(),
        "look": Look("trial", good, tries=3),
        "scan": Scan(
            "scan", "z_mm", lambda facts: (600.0, 620.0, 640.0),
            lambda frame, facts: -abs(facts.get("at_z_mm", 0.0) - 615.0),
            lambda places, scores: Advice(True, "best", moves={"z_mm": places[int(np.argmax(scores))] - places[-1]}),
            lambda change: f"move by {change}",
        ),
        "shoot": Shoot(
            "shot", good, passed,
            lambda results, facts: Advice(len(results) >= 2, f"{len(results)} shots"), most=4,
        ),
    }  # fmt: skip
    parts |= changes
    steps = (
        Step(
            "rig", "Rig", "Prepare the rig.", tuple(parts[name] for name in ("ask", "home", "go", "light", "measure"))
        ),
        Step("trials", "Trials", "Look.", (parts["look"], parts["scan"])),
        Step("shots", "Shots", "Shoot.", (parts["shoot"],)),
    )
    return Plan("short", "A short plan", steps)
