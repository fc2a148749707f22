"""The guided plan of a witnessed PSF: the guided calibration up to its focus, then four photographs. Bench and camera
change exposure time and distance themselves where they can; the operator turns the focus."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, cast

from procedures.choice import combined
from procedures.drawings import steps as drawings
from procedures.numbers import MTF50_HORIZONTAL
from procedures.pattern_psf.checks import check_shot, sharpness, shown
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import PatternFacts
from procedures.pattern_psf.plan import choose_focus
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Facts,
    Go,
    Goal,
    Known,
    Outcomes,
    Plan,
    Scan,
    Step,
    Tour,
    TourStop,
    facts_as,
    number,
    ring_places,
    say_ring,
)
from procedures.quality import PRINT_BLUR
from procedures.raw import RawFrame
from station.guide.plans import general
from station.guide.plans.general import measurement, results
from station.procedure.schema import procedure_named

__all__ = ["measurement", "plan", "results"]

TAKEN = ("long exposure", "short exposure", "slight defocus", "nearer")
ORDER = (1, 0, 3, 2)
"""Their places in the order of the command: short, long, near, defocused."""
EXPOSURE = "long_exposure_s"
"""Fact: exposure time of the long exposure, where the camera records it."""
MTF50_WHOLE, MTF50_REST = "long_mtf50_uncertainty", "long_mtf50_without_print"
"""Facts: standard uncertainty of MTF50 in the long exposure, and without the blur of the print."""
HALF, WHOLE, NEAREST = (0.4, 0.6), (0.9, 1.1), 1 / 3
"""Accepted exposure times of the short one and of the others, relative to the long one; share of the distance by which
the camera moves."""
DEFOCUS_STEPS = 3.0


def plan(folder: Path | None = None) -> Plan:
    """The plan of the session in a folder, if given."""
    procedure, pattern = procedure_named("witnessed"), pattern_plan()
    before = tuple(step for step in pattern.steps if step.name in ("print", "mount", "distance", "square", "focus"))
    still = (_stop(TAKEN[0], _long), _stop(TAKEN[1], _exposed(HALF, "Halve"), by_hand={"exposure_ev": -1.0}))
    blurred = _stop(
        TAKEN[2], _exposed(WHOLE, "Restore"), f"Turn the focus ring by {DEFOCUS_STEPS:g} small steps towards infinity.",
        by_hand={"focus_steps": DEFOCUS_STEPS},
    )  # fmt: skip
    near = _stop(TAKEN[3], _exposed(WHOLE, "Restore"))
    shots = (
        Tour(lambda facts: (*still, blurred)),
        Go(_nearer, lambda facts: "moving to two thirds of the distance", _nearer_by_hand),
        Ask("refocused_near", "Focus on the chart again: the distance has changed. Leave autofocus off."),
        Scan("focus", "focus_steps", ring_places, sharpness, choose_focus("focus_steps", " steps"), say_ring),
        Tour(lambda facts: (near,)),
    )

    def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
        own = facts_as(PatternFacts, facts)
        settings: dict[str, Any] = {"seed": str(own.chart_seed)}
        if own.print_blur is not None:
            settings["print_blur"] = str(own.print_blur)
        if EXPOSURE not in facts:
            settings["exposure_ratio"] = "2"
        given = {**facts, **{general.SETTING + name: value for name, value in settings.items()}}
        ordered = [frames[i] for i in ORDER] if len(frames) == len(ORDER) else frames
        return general.estimate(procedure_named("witnessed"), folder, ordered, given, known)

    return Plan(
        "witnessed",
        procedure.title,
        (
            *before,
            Step(
                "witnesses",
                "Witnesses",
                "Photograph the chart with two exposures, defocused, from nearer.",
                shots,
                drawings.SHOTS,
            ),
            Step("estimate", "Estimate", "Estimate the PSF, and compare the four photographs.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the photographs again.", (Decide("witnesses"),)),
        ),
        facts=PatternFacts,
    )


def _stop(
    name: str, check: Callable[[RawFrame, Facts], Advice], say: str = "", *, by_hand: Mapping[str, float] | None = None
) -> TourStop:
    """One photograph; `say` is what the operator does first. A camera that records no exposure time is set by hand."""

    def words(facts: Facts) -> str:
        return say or ("" if EXPOSURE in facts or by_hand is None else "Halve the exposure time.")

    return TourStop(name, Go(lambda facts: {}, words, lambda facts: by_hand or {}), check, partial(_goal, name))


def _goal(name: str, facts: Facts) -> Goal:
    """Progress of MTF50 by its budget in the long exposure, from which the nearer photograph takes the print's blur."""
    whole, rest = (float(cast(float, facts.get(key, inf))) for key in (MTF50_WHOLE, MTF50_REST))
    return Goal(len(TAKEN) - TAKEN.index(name), "MTF50", "cycles/pixel", whole, rest if name == TAKEN[-1] else whole)


def _long(frame: RawFrame, facts: Facts) -> Advice:
    """Accept a good shot, whose exposure time is that of the long exposure."""
    advice, exposure_s = check_shot(frame, facts), frame.exposure.exposure_s
    if not advice.good or exposure_s is None:
        return advice
    known = facts_as(PatternFacts, facts)
    estimate = estimate_psf(shown(frame), known.chart, known.quick_parameters).value
    budget = {} if estimate is None else estimate.quality.budgets.get(MTF50_HORIZONTAL, {})
    rest = {term: one for term, one in budget.items() if term != PRINT_BLUR}
    more = {MTF50_WHOLE: combined(budget), MTF50_REST: combined(rest)} if budget else {}
    return Advice(True, advice.say, advice.readings, facts={EXPOSURE: exposure_s, **more}, marks=advice.marks)


def _exposed(wanted: tuple[float, float], what: str) -> Callable[[RawFrame, Facts], Advice]:
    def check(frame: RawFrame, facts: Facts) -> Advice:
        exposure_s = frame.exposure.exposure_s
        if exposure_s is None or EXPOSURE not in facts:
            return Advice(True, "This photograph is accepted.")
        share = exposure_s / number(facts, EXPOSURE)
        if wanted[0] < share < wanted[1]:
            return Advice(True, "This photograph is accepted.")
        stops = round(math.log2(sum(wanted) / 2 / share), 3)
        return Advice(False, f"{what} the exposure time, and move nothing else.", by_hand={"exposure_ev": stops})

    return check


def _nearer(facts: Facts) -> dict[str, float]:
    """Position of the rail at two thirds of the distance; empty without a rail."""
    rail = facts_as(PatternFacts, facts).axes.get("z_mm")
    return {} if rail is None or rail.at is None else {"z_mm": rail.at + _nearer_by_hand(facts)["z_mm"]}


def _nearer_by_hand(facts: Facts) -> dict[str, float]:
    """Move of the camera to two thirds of the distance at which the chart has its width."""
    return {"z_mm": -NEAREST * facts_as(PatternFacts, facts).wanted_distance_mm()}
