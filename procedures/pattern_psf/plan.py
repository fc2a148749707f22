"""Plan of the pattern PSF: questions, checks and choices from the print to the verdict."""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import ceil, inf
from pathlib import Path
from typing import Any

import numpy as np

from procedures.choice import COMMON, START_K, combined
from procedures.drawings import steps as drawings
from procedures.outcome import Outcome, Verdict
from procedures.pattern import DEFAULT_SEED
from procedures.pattern_print.distance import LENGTH_MM
from procedures.pattern_print.formats import encode
from procedures.pattern_print.sheet import LARGEST_WIDTH_MM, PAPERS, SMALLEST_WIDTH_MM, Paper, Size, papers_of_locale
from procedures.pattern_print.source import Source
from procedures.pattern_print.tile_sheets import tiling_of
from procedures.pattern_psf.checks import (
    best_place,
    best_tried,
    check_distance,
    check_light,
    check_shot,
    check_square,
    sharpness,
)
from procedures.pattern_psf.combine import combine
from procedures.pattern_psf.estimate import estimate_psf
from procedures.pattern_psf.facts import MOSAIC, RATIO, SENSORS, SIZES, PatternFacts
from procedures.pattern_psf.focus.aperture import check_aperture
from procedures.pattern_psf.gamma import gamma_diagram
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Diagram,
    Estimate,
    Fact,
    Facts,
    Give,
    Go,
    Goal,
    Home,
    Known,
    Look,
    Measure,
    Outcomes,
    Plan,
    Reading,
    Scan,
    SetLight,
    Shoot,
    Show,
    Step,
    axes_of,
    facts_as,
    required,
    ring_places,
    say_ring,
)
from procedures.raw import Plane, RawFrame

CHART = "chart.pdf"
FEWEST, MOST = 3, 16  # number of shots; fewer cannot be tested for agreement
TARGET_UNCERTAINTY = 0.002  # default target of MTF50's standard uncertainty in every plane, in cycles/pixel
S_OVER_T = f"s/t near {RATIO:g}. s/t is the number of samples of the PSF across one cell of the chart."
SHARPNESS = "MTF50 in cycles/pixel"
RAIL = (-1.5, -0.75, 0.0, 0.75, 1.5)  # positions on the rail about the initial one, in depths of focus


def plan() -> Plan:
    """The guided calibration with the noise chart."""
    return Plan(
        "pattern",
        "PSF from a printed noise chart",
        (
            Step(
                "print", "Print", "Print the chart at its true size, and measure the print.", PRINT,
                drawings.PRINT, "{chart_width_mm:g} mm",
            ),
            Step(
                "mount", "Mount and light", "Mount the chart flat, light it evenly, and set the exposure.", MOUNT,
                drawings.MOUNT, "{white_percent:.0f} %",
            ),
            Step(
                "distance", "Distance", f"Set the distance at which the PSF has the least noise: {S_OVER_T}", DISTANCE,
                drawings.DISTANCE, "s/t {s_over_t:.2f}",
            ),
            Step(
                "square", "Square up", "Square the chart to the camera.", SQUARE,
                drawings.SQUARE, "{tilt_deg:.1f}°",
            ),
            Step(
                "focus", "Focus", "Find the sharpest focus.", FOCUS,
                drawings.FOCUS, "MTF50 {focus_mtf50:.2f}",
            ),
            Step(
                "shots", "Shots", "Take shots until the uncertainty reaches its target.", SHOTS,
                drawings.SHOTS, "±{mtf50_uncertainty:.4f}",
            ),
            Step("estimate", "Estimate", "Estimate every plane's PSF from all shots together.", (Estimate(estimate),)),
            Step("verdict", "Verdict", "Accept the result, or take the shots again.", (Decide("shots"),)),
        ),
        facts=PatternFacts,
    )  # fmt: skip


def chart_page(facts: Facts) -> bytes:
    """The PDF to print."""
    known = facts_as(PatternFacts, facts)
    return _pages(known.chart_seed, known.size, known.printed_on)


@lru_cache(maxsize=2)
def _pages(seed: int, size: Size, paper: Paper | None) -> bytes:
    """PDF of a chart; cached, as drawing it takes half a second."""
    return encode(Path(CHART), Source.from_seed(seed), size, paper=paper, tile=True).data


def on_several_sheets(facts: Facts) -> bool:
    """Whether the chart is wider than the paper holds."""
    known = facts_as(PatternFacts, facts)
    return known.printed_on is not None and not known.size.fits(known.printed_on, edges=False)


def check_sheets(answer: Fact, facts: Facts) -> None:
    """Raises BadParameter where a chart of this width takes too many sheets of the paper."""
    paper = facts_as(PatternFacts, facts).printed_on
    if paper is not None:
        tiling_of(Size(float(answer)), paper)


SEED = Ask(
    "chart_seed", "Which number is printed on the chart?", "number", "", DEFAULT_SEED, low=0, high=2**53,
    when=lambda facts: "chart_seed" in facts,
)  # fmt: skip
"""Asked where a number other than the default was given, or the chart has other cells."""
PRINT = (
    Ask(
        "paper", "Which paper is in the printer?", "choice", choices=tuple(PAPERS),
        proposed=lambda facts: papers_of_locale(os.environ)[0].key,
    ),
    Ask(
        "chart_width_mm", "How wide shall the chart be? If it exceeds one sheet, it is printed on several.",
        "number", "mm", low=SMALLEST_WIDTH_MM, high=LARGEST_WIDTH_MM,
        proposed=lambda facts: facts_as(PatternFacts, facts).size.whole_mm, check=check_sheets,
    ),
    Give(CHART, chart_page, lambda path: f"the chart to print: {path}"),
    SEED,
    Ask("printed", f"Print {CHART} on matt paper at 100 % (actual size)."),
    Ask("joined", "Join the sheets as the first page shows.", when=on_several_sheets),
    Ask(
        "ruler_mm",
        f"Measure the printed ruler from 0 to {LENGTH_MM}: how long is it?",
        "number",
        "mm",
        float(LENGTH_MM),
        low=0.8 * LENGTH_MM,
        high=1.25 * LENGTH_MM,
    ),
)  # fmt: skip


def middle(facts: Facts) -> dict[str, float]:
    """Centre of every axis' travel, from which moves in both directions are possible."""
    return {name: axis.middle for name, axis in axes_of(facts).items() if axis.middle is not None}


MOUNT = (
    Home(),
    Go(middle, lambda facts: "going to the middle of the travel" if middle(facts) else ""),
    Ask("mounted", "Mount the chart flat and upright on a wall or board, its centre in front of the camera."),
    SetLight(lambda facts: 1.0),
    Ask("lit", "Light the chart from both sides, without glare. Keep other light out."),
    Ask("camera_set", "Set the camera: RAW, manual exposure, ISO 100, your aperture, stabiliser off."),
    Ask("focused", "Focus on the chart, then switch autofocus off."),
    Look("light", check_light),
)


def towards_distance(facts: Facts) -> dict[str, float]:
    """Target of the rail within its travel, by lens and laser; empty without them."""
    known = facts_as(PatternFacts, facts)
    rail, laser_mm, offset_mm = known.axes.get("z_mm"), known.distance_mm, known.laser_offset_mm
    if rail is None or rail.at is None or laser_mm is None or offset_mm is None:
        return {}
    return {"z_mm": rail.nearest(rail.at + known.wanted_distance_mm() - (laser_mm - offset_mm))}


def say_distance(facts: Facts) -> str:
    """Instruction without a rail, or announcement of the rail's move; empty until the laser's offset is known."""
    known = facts_as(PatternFacts, facts)
    if "z_mm" in known.where():
        return f"moving to the distance with s/t near {RATIO:g}" if towards_distance(facts) else ""
    return f"Put the camera {known.wanted_distance_mm() / 1000:.2f} m from the chart, by a tape measure."


def explain_distance(facts: Facts) -> Diagram:
    """Diagram of gamma over the distance, for lens and print."""
    known = facts_as(PatternFacts, facts)
    return gamma_diagram(known.optics(), known.s_or_start, known.parameters.k or START_K, RATIO)


TAPE = Ask(
    "tape_mm", "How far is the chart from the lens now, by a tape measure?", "number", "mm", low=50.0, high=1e5,
    when=lambda facts: "distance_mm" not in facts and "at_z_mm" not in facts,
)  # fmt: skip
SENSOR = Ask(
    "sensor_kind", "Has the sensor a colour mosaic, or is it monochrome?", "choice", "", MOSAIC, choices=SENSORS,
    when=lambda facts: "sensor_kind" not in facts,
)  # fmt: skip
"""Asked before any photograph has shown it: a mosaic's planes have twice the sensor's pixel pitch."""
LENS = (
    Ask("focal_length_mm", "What is the lens's focal length?", "number", "mm", low=1.0, high=5000.0),
    Ask("pixel_pitch_um", "What is the sensor's pixel pitch?", "number", "µm", low=0.5, high=50.0),
    SENSOR,
)
DISTANCE = (
    *LENS,
    Show(explain_distance),
    Measure(),
    TAPE,
    Go(towards_distance, say_distance),
    Look("distance", check_distance, tries=10, rests_on=SIZES),
)

SQUARE = (Look("square", check_square, tries=10),)


def rail_places(facts: Facts) -> Sequence[float]:
    """Positions of the rail about the current one in its travel, if it focuses; a step dz widens the circle of
    confusion f^2 dz / (N z^2) by a pixel of the plane: Smith, 6.8."""
    known = facts_as(PatternFacts, facts)
    rail = known.axes.get("z_mm")
    if known.focus_by != "rail" or rail is None or rail.at is None:
        return ()
    optics, here = known.optics(), rail.at
    f_number = required(known.aperture, "the f-number", "give it, or focus by the ring")
    pixel_mm, z = optics.plane_pitch_um / 1000, known.wanted_distance_mm()
    depth = pixel_mm * f_number * (z / optics.focal_length_mm) ** 2
    return [here + step * depth for step in RAIL if rail.holds(here + step * depth)]


def choose_focus(axis: str, unit: str) -> Any:
    """Function that chooses the best focus of a bracket."""

    def choose(places: Sequence[float], scores: Sequence[float]) -> Advice:
        best = best_place(places, scores) if axis.endswith("_mm") else best_tried(places, scores)
        if best is None:
            back = float(places[len(places) // 2]) - float(places[-1])
            return Advice(False, "No position of the bracket was sharp enough: focus by eye.", moves={axis: back})
        at_end = best in (places[0], places[-1])
        more = " The best focus lies at the end of the bracket: focus again, and repeat the step." if at_end else ""
        score = float(np.nanmax(np.asarray(scores)))
        say = f"Sharpest at {best:+.2f}{unit}, MTF50 {score:.3f} cycles/pixel.{more}"
        reading = Reading("MTF50", score, "cycles/pixel")
        return Advice(not at_end, say, (reading,), moves={axis: best - places[-1]}, facts={"focus_mtf50": score})

    return choose


F_NUMBER = Ask(
    "typed_f_number", "Which f-number is set? The camera does not record it.", "number", "", low=0.5, high=64.0,
    when=lambda facts: facts_as(PatternFacts, facts).f_number is None,
)  # fmt: skip
FOCUS = (
    F_NUMBER,
    Ask("refocused", "Focus on the chart again: the distance has changed. Leave autofocus off."),
    Ask(
        "focus_by", "How will you search the focus: turn its ring, move the rail, or skip it?", "choice",
        default="ring", choices=("ring", "rail", "skip"),
    ),
    Scan("focus", "focus_steps", ring_places, sharpness, choose_focus("focus_steps", " steps"), say_ring,
        SHARPNESS,
    ),
    Scan(
        "focus", "z_mm", rail_places, sharpness, choose_focus("z_mm", " mm"),
        lambda change: f"Move the camera by {change:.1f} mm.", SHARPNESS,
    ),
    Look("aperture", check_aperture, when=lambda facts: facts_as(PatternFacts, facts).f_number is None),
)  # fmt: skip


def estimate_shot(frame: RawFrame, facts: Facts, results: Sequence[Outcomes], known: Known) -> Outcomes:
    """Estimate the PSF of every plane of one shot, with the sampling of the first shot that gave a PSF."""
    known_facts = facts_as(PatternFacts, facts)
    first = {name: one for outcomes in reversed(results) for name, one in outcomes.items() if one.value is not None}
    return {
        name: _estimate_plane(frame, plane, known_facts, first.get(name), known) for name, plane in frame.planes.items()
    }


def _estimate_plane(
    frame: RawFrame, plane: Plane, known_facts: PatternFacts, first: Outcome[Any] | None, known: Known
) -> Outcome[Any]:
    parameters, limit = known_facts.parameters, known_facts.diffraction(plane)
    if first is not None and first.value is not None:
        parameters = replace(parameters, s=first.value.psf.s, k=first.value.psf.k, chosen=True)
    key = (frame.sha256, plane.name, known_facts.chart_seed, parameters, limit)
    if key not in known:
        known[key] = estimate_psf(plane, known_facts.chart, parameters, limit)
    return known[key]


def uncertainty(outcome: Outcome[Any]) -> float:
    """Standard uncertainty of MTF50 in cycles/pixel, in the worse direction, without terms that all photographs share;
    infinite where refused."""
    if outcome.value is None:
        return float("inf")
    budgets = outcome.value.quality.budgets
    both = [budgets.get(f"mtf50_{way}", budgets.get(f"mtf_nyquist_{way}")) for way in ("horizontal", "vertical")]
    own = [{term: one for term, one in terms.items() if term not in COMMON} for terms in both if terms is not None]
    return max(map(combined, own), default=float("inf"))


def enough(results: Sequence[Outcomes], facts: Facts) -> Advice:
    """Check whether the mean of the shots reaches the target uncertainty in every plane that is not always refused."""
    wanted = facts_as(PatternFacts, facts).wanted_mtf50 or TARGET_UNCERTAINTY
    by_plane = [_weights([result[name] for result in results if name in result]) for name in results[0]]
    reached = max(1 / float(np.sqrt(sum(one))) if one else 0.0 for one in by_plane)
    shots = len(results)
    readings = (Reading("MTF50 uncertainty", reached, "cycles/pixel", None, wanted),)
    say = f"Shots: {shots}. They leave {reached:.4f} cycles/pixel uncertainty of MTF50; the target is {wanted:g}."
    facts = {"mtf50_uncertainty": reached} if np.isfinite(reached) else {}
    goal = max((goal_of(one, wanted) for one in by_plane if one), key=lambda one: one.now, default=None)
    return Advice(shots >= FEWEST and reached <= wanted, say, readings, facts=facts, goal=goal)


def _weights(outcomes: Sequence[Outcome[Any]]) -> list[float]:
    """Weights 1/u_i^2 of the shots, whose sum is 1/u^2 of their mean; none for a plane that every shot refuses."""
    return [1 / uncertainty(outcome) ** 2 for outcome in outcomes if outcome.verdict is not Verdict.REFUSED]


def goal_of(weights: Sequence[float], wanted: float) -> Goal:
    """Progress of the mean towards the target, if further shots have the mean weight of the present ones."""
    total, usual = sum(weights), max(sum(weights) / len(weights), 1e-30)
    left = max(ceil((wanted**-2 - total) / usual * (1 - 1e-9)), FEWEST - len(weights), 0)
    return Goal(
        left, "MTF50 between photographs", "cycles/pixel", total**-0.5 if total else inf, (total + usual) ** -0.5
    )


SHOTS = (
    Ask(
        "wanted_mtf50", "Which standard uncertainty of MTF50 is required?", "number", "cycles/pixel",
        TARGET_UNCERTAINTY, low=1e-5, high=0.1,
    ),
    Look("light", check_light),
    Shoot("shot", check_shot, estimate_shot, enough, MOST),
)  # fmt: skip


def estimate(frames: Sequence[RawFrame], facts: Facts, known: Known) -> Outcomes:
    """Combine the PSFs of all shots in every plane."""
    shots: list[Outcomes] = []
    for frame in frames:
        shots.append(estimate_shot(frame, facts, shots, known))
    names = list(shots[0]) if shots else []
    return {name: combine([shot[name] for shot in shots]) for name in names}
