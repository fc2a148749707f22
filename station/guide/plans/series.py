"""Guided series of one lens: the guided calibration up to its focus, then one photograph at each aperture or focus."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import log2
from types import SimpleNamespace
from typing import Any

from procedures.drawings import steps as drawings
from procedures.numbers import EDGE_MTF50
from procedures.outcome import BadParameter, Outcome
from procedures.pattern_psf.checks import check_shot
from procedures.pattern_psf.facts import PatternFacts
from procedures.pattern_psf.plan import estimate_shot
from procedures.pattern_psf.plan import plan as pattern_plan
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Fact,
    Facts,
    Go,
    Known,
    Outcomes,
    Plan,
    Step,
    Tour,
    TourStop,
    facts_as,
    say_ring,
)
from procedures.raw import RawFrame
from station.calibration.series import (
    TABLE,
    Best,
    BestFocus,
    Point,
    best_apertures,
    best_focuses,
    points_of,
    series_table,
)
from station.guide.catalogue import psf_results
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder
from station.results.terms import Terms

STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 32.0)
RING = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
"""Small steps of the focus ring about the sharpest focus; positive towards infinity."""
SETTING, NOW, MARK = "series_at_", "series_now", 16
"""Facts: setting of the photograph with this beginning of its hash, and the setting now."""
BEST = "series_best"
EXPOSURE = ("exposure_s", "iso", "f_number")
EQUAL_STOPS = 0.2


@dataclass(frozen=True, eq=False)
class SeriesPsf:
    """The PSF of one plane at the sharpest setting, that of photograph `frame`, with the points of all planes and the
    best settings."""

    psf: Any
    points: Sequence[Point]
    best: Sequence[Best | BestFocus]
    frame: int


def aperture_plan() -> Plan:
    """One photograph at each aperture."""

    def five_stops(facts: Facts) -> str:
        return " ".join(f"{one:g}" for one in [stop for stop in STOPS if stop > 0.95 * _aperture(facts)][:5])

    ask = Ask(
        "apertures", "At which f-numbers?", "text", proposed=five_stops,
        check=lambda answer, facts: _f_numbers(answer),
    )  # fmt: skip
    tour = Tour(lambda facts: [_aperture_stop(number) for number in _f_numbers(facts["apertures"])])
    return _plan("aperture-series", "Lens over aperture, from one mounting", "f_number", (ask, tour))


def focus_plan() -> Plan:
    """One photograph at each of seven positions of the focus ring."""
    tour = Tour(lambda facts: [_focus_stop(one) for one in RING])
    return _plan("focus-series", "Lens over focus, from one mounting", "focus_steps", (tour,))


def _plan(name: str, title: str, setting: str, requests: tuple[Ask | Tour, ...]) -> Plan:
    before = [step for step in pattern_plan().steps if step.name in ("print", "mount", "distance", "square", "focus")]
    say = "Photograph the chart at each setting. Nothing but the named setting may change."
    return Plan(
        name,
        title,
        (
            *before,
            Step("series", "Series", say, requests, drawings.SHOTS),
            Step(
                "estimate",
                "Estimate",
                "Estimate the PSF at every setting.",
                (Estimate(partial(estimate, setting), best_of),),
                gave=lambda facts: str(facts.get(BEST, "")),
            ),
            Step("verdict", "Verdict", "Accept the result, or take the series again.", (Decide("series"),)),
        ),
        facts=PatternFacts,
    )


def _f_numbers(answer: Fact) -> list[float]:
    """The f-numbers of an answer. Raises BadParameter unless they are two or more, from 0.5 to 64."""
    try:
        numbers = [float(one) for one in str(answer).replace(",", " ").replace(";", " ").split()]
    except ValueError:
        numbers = []
    if len(set(numbers)) < 2 or not all(0.5 <= number <= 64 for number in numbers):
        raise BadParameter(f"a series needs two f-numbers or more, from 0.5 to 64; got {answer!r}", "2.8 4 5.6 8")
    return list(dict.fromkeys(numbers))


def _aperture(facts: Facts) -> float:
    return float(facts.get(NOW) or facts_as(PatternFacts, facts).aperture or STOPS[3])


def _aperture_stop(wanted: float) -> TourStop:
    def change(facts: Facts) -> float:
        return round(2 * log2(wanted / _aperture(facts)), 3)

    def say(facts: Facts) -> str:
        if abs(change(facts)) < EQUAL_STOPS:
            return ""
        return f"Set the aperture to f/{wanted:g}, and change the exposure time by {change(facts):+.1f} stops."

    def check(frame: RawFrame, facts: Facts) -> Advice:
        recorded = frame.exposure.f_number
        if recorded is not None and abs(stops := round(2 * log2(wanted / recorded), 3)) > EQUAL_STOPS:
            return Advice(False, f"The aperture is f/{recorded:g}: set f/{wanted:g}.", by_hand={"aperture_ev": stops})
        return _at(wanted, frame, {name: fact for name, fact in facts.items() if name not in EXPOSURE})

    return TourStop(f"f/{wanted:g}", Go(lambda facts: {}, say, lambda facts: {"aperture_ev": change(facts)}), check)


def _focus_stop(wanted: float) -> TourStop:
    def change(facts: Facts) -> float:
        return wanted - float(facts.get(NOW, 0.0))

    go = Go(
        lambda facts: {},
        lambda facts: say_ring(change(facts)) if change(facts) else "",
        lambda facts: {"focus_steps": change(facts)},
    )
    return TourStop(f"focus {wanted:+g}", go, partial(_at, wanted))


def _at(wanted: float, frame: RawFrame, facts: Facts) -> Advice:
    """The check of a shot at a setting, which is noted."""
    advice = check_shot(frame, facts)
    noted = {f"{SETTING}{frame.sha256[:MARK]}": wanted, NOW: wanted} if advice.good else {}
    return replace(advice, facts={**advice.facts, **noted})


def estimate(setting: str, frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """Each plane's PSF at the setting with the greatest MTF50, with the whole series."""
    shots, rows, sharpness = [], [], []
    for frame in frames:
        at = float(facts[f"{SETTING}{frame.sha256[:MARK]}"])
        own = {**facts, setting: at} if setting == "f_number" else facts
        shots.append(estimate_shot(frame, own, [], known))
        planes = {name: SimpleNamespace(verdict=str(one.verdict), numbers=_numbers(one))
                  for name, one in shots[-1].items()}  # fmt: skip
        noted = {"iso": frame.exposure.iso, "f_number": frame.exposure.f_number, setting: at}
        rows.append(SimpleNamespace(noted=noted, planes=planes))
        sharpness.append(sum(one.value for one in points_of(rows[-1:]) if one.number == EDGE_MTF50))
    if not shots:
        return {}
    points, sharpest = points_of(rows), sharpness.index(max(sharpness))
    best: Sequence[Best | BestFocus] = best_apertures(points) if setting == "f_number" else best_focuses(points)
    return {
        name: one.of_value(None if one.value is None else SeriesPsf(one.value, points, best, sharpest))
        for name, one in shots[sharpest].items()
    }


def _numbers(one: Outcome[Any]) -> Mapping[str, Any]:
    return {} if one.value is None else {name: asdict(number) for name, number in one.value.quality.numbers.items()}


def best_of(estimates: Mapping[str, Any]) -> Facts:
    """The sharpest setting of green or grey as a fact."""
    best = next((one.best for one in estimates.values() if one is not None), ())
    settings = [one.short for one in best if one.plane in ("G1", "Y")]
    return {BEST: settings[0]} if settings else {}


def results(frames: Sequence[RawFrame], outcomes: Outcomes, terms: Terms, facts: Facts) -> list[PlaneResult]:
    """The planes at the sharpest setting; `estimate` of each has the series."""
    series: dict[str, SeriesPsf] = {name: one.value for name, one in outcomes.items() if one.value is not None}
    best = next((one.frame for one in series.values()), 0)
    alone = {name: outcome.of_value(series[name].psf if name in series else None) for name, outcome in outcomes.items()}
    planes = psf_results(frames[best : best + 1], alone, terms, facts)
    return [replace(plane, estimate=series.get(plane.name)) for plane in planes]


def write(folder: ResultFolder, planes: Sequence[PlaneResult], frames: Sequence[RawFrame], head: RecordHead) -> str:
    """The files of the PSF at the sharpest setting, with table and page of the series."""
    from station.reports.batches.series_page import series_page  # imported here: it draws, which is slow to load

    series: SeriesPsf | None = next((plane.estimate for plane in planes if plane.estimate is not None), None)
    if series is not None:
        folder.write(TABLE, series_table(series.points))
        folder.write("report.html", series_page(series.points, [one.words for one in series.best]).encode())
    return write_psf_result(folder, planes, head)
