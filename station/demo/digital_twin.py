"""Effect of remedies: a simulated camera like the measured one photographs the subject before and after each."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtr

from procedures.choice import COMMON, combined
from procedures.geometry.next_view import NextView, next_view_words
from procedures.numbers import EDGE_MTF50, MTF50_HORIZONTAL, PIXELS_PER_PATTERN, SYSTEM_GAIN, label
from procedures.outcome import BadInput
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from procedures.quality import PRINT_BLUR
from procedures.sensor.estimate import characterise
from procedures.sensor.stacks import LightLevel, SensorRecording, measure_level
from procedures.slanted_edge.estimate import estimate_edge
from procedures.slanted_edge.strip import Roi
from procedures.two_photo.estimate import TwoPhotoParameters, estimate_psf_of_pair
from simulators.camera.camera import SimulatedCamera, pixels_at, render_plane
from simulators.camera.optics import GaussianBlur, Optics, PixelAperture
from simulators.camera.sensor import Sensor
from simulators.camera.sheets import FlatSheet, PlacedSheet, draw, leaves
from simulators.world.projection import ObjectPose, Projection
from simulators.world.scene import Scene
from station.results.explanation import BRIGHTER, NEXT_VIEW

Entry = Mapping[str, Any]
Effects = Mapping[str, Mapping[str, float]]
"""By change of the set-up: the factor by which each term of the budget changes; others stay as they are."""

GAUSSIAN_AT_HALF = 0.1874
"""sigma f of a Gaussian whose transfer function is 0.5 at f: sqrt(ln 2 / 2) / pi."""
PIXEL_SIGMA = 0.2887
"""Standard deviation of a pixel's aperture, pixels: sqrt(1 / 12)."""
PITCH_UM, WHITE = 7.5, 0.8
CHART = Chart.from_seed()
SEEDS = (1, 2)
SAME_WIDTH = 0.05
"""Relative difference of widths that changes nothing."""
LIGHT = "four times the light"


@dataclass(frozen=True)
class TwinPrediction:
    """A change of the set-up, and the standard uncertainty of a number before and after it; None where a photograph of
    the twin is refused."""

    words: str
    number: str
    before: float
    after: float | None


def predictions(plane: Entry, number: str, budget: Mapping[str, float]) -> list[TwinPrediction]:
    """The predicted effects of remedies on the uncertainty of a plane's number with this budget, from its record.

    Twins have the measured sharpness, noise and size of the subject; their remaining properties are ideal. Terms that
    the change does not concern stay as they are. The next view of a geometry, and a restoration with more light, are
    those of their own models.
    Raises BadInput if no twin can photograph the subject.
    """
    before, plane = combined(dict(budget)), {**plane.get("diagnostics", {}), **plane}
    if (view := plane.get(NEXT_VIEW)) is not None:
        known = NextView(**view)
        words = f"one more view, with the chart in {next_view_words(known)}"
        return [TwinPrediction(words, known.of, known.before, known.after)]
    if (brighter := plane.get(BRIGHTER)) is not None:
        return [TwinPrediction(LIGHT, label(number), before, brighter)]
    twin = next((twin for name, twin in TWINS.items() if name in plane), None)
    if twin is None or not budget:
        raise BadInput(
            "no digital twin photographs this subject: there are twins of charts, walls, edges and flat fields",
            "read the gain of each remedy from the shares, without --twin",
        )
    try:
        effects = twin(plane)
    except (KeyError, TypeError, ValueError, StopIteration) as error:
        raise BadInput(
            "the record has too little for the digital twin", "measure it again with this version"
        ) from error
    return [TwinPrediction(words, label(number), before, _after(budget, factors)) for words, factors in effects.items()]


def _after(budget: Mapping[str, float], factors: Mapping[str, float]) -> float | None:
    known = np.isfinite(list(factors.values())).all()
    return combined({term: u * factors.get(term, 1.0) for term, u in budget.items()}) if known else None


def _effects(
    spread: Callable[..., float], now: tuple[float, ...], changes: Mapping[str, tuple[float, ...]],
    terms: Sequence[str] = ("noise",),
) -> Effects:  # fmt: skip
    """The effects on the terms, by the twin's uncertainty `spread` now and after each change."""
    before = spread(*now)
    return {words: dict.fromkeys(terms, spread(*change) / before) for words, change in changes.items()}


def _optics(mtf50: float) -> Optics:
    sigma = max((GAUSSIAN_AT_HALF / mtf50) ** 2 - PIXEL_SIGMA**2, 0.01) ** 0.5
    return Optics((GaussianBlur(sigma), PixelAperture()), PITCH_UM)


def _median(uncertainties: Sequence[float]) -> float:
    """Infinite where every photograph was refused."""
    return float(np.median(uncertainties)) if uncertainties else math.inf


def chart_effects(plane: Entry) -> Effects:
    """A better distance, and more light: the blur of the print grows with the square of the chart's width."""
    width, noise, best = plane[PIXELS_PER_PATTERN], plane["noise"], pixels_at(1.0, plane["s"])
    changes = {LIGHT: (width, noise / 2)}
    if abs(best / width - 1) > SAME_WIDTH:
        size = f"a chart {best:.0f} pixels wide instead of {width:.0f}"
        changes |= {f"{width / best:.2g} times the distance (s/t = 1, {size})": (best, noise)}
    own = [term for term in plane[MTF50_HORIZONTAL]["budget"] if term not in COMMON]
    effects = _effects(partial(_chart_uncertainty, plane), (width, noise), changes, own)
    return {words: {**effects[words], PRINT_BLUR: (wide / width) ** 2} for words, (wide, _) in changes.items()}


def _chart_uncertainty(plane: Entry, width: float, noise: float) -> float:
    """Standard uncertainty of MTF50 of the twin without shared terms.

    noise : standard deviation of white samples over the chart's contrast
    """
    electrons, size = (1 / max(noise, 1e-4)) ** 2, round(1.8 * width) + 40
    sensor = Sensor(size, size, None, full_well_e=electrons / WHITE, gain_e_per_dn=electrons / WHITE / 15000)
    camera = SimulatedCamera(sensor=sensor, pitch_um=PITCH_UM, optics=_optics(plane[MTF50_HORIZONTAL]["value"]))
    scene = Scene((camera.place(CHART, pixels=width, roll_deg=3.0),))
    exposure_s = WHITE * sensor.full_well_e / camera.white_e_per_s
    parameters, uncertainties = PatternParameters(plane["s"], plane["k"], chosen=True), []
    for seed in SEEDS:
        samples = render_plane(scene, camera, np.random.default_rng(seed), exposure_s=exposure_s)
        outcome = estimate_psf(samples, CHART, parameters)
        if outcome.value is not None:
            budget = outcome.value.quality.budgets[MTF50_HORIZONTAL]
            uncertainties.append(combined({term: one for term, one in budget.items() if term not in COMMON}))
    return _median(uncertainties)


FOCAL_PX, LARGEST, PER_LEAF = 3000.0, 240.0, 60.0
"""Distance of the lens from the sensor in pixels; largest leaf, and pixels per leaf, of the near photograph."""


def wall_effects(plane: Entry) -> Effects:
    """More light, and a far photograph from nearer or farther."""
    zoom, samples, noise = (float(np.mean(plane[name])) for name in ("scale", "samples", "noise"))
    changes = {f"the far photograph from {z:.2g} times the distance": (z * zoom, noise) for z in (0.9, 1.2)}
    spread = partial(_wall_uncertainty, plane, round(zoom * samples**0.5))
    return _effects(spread, (zoom, noise), {LIGHT: (zoom, noise / 2), **changes})


def _wall_uncertainty(plane: Entry, side: int, zoom: float, noise: float) -> float:
    """Standard uncertainty of MTF50 by the noise of a near and a far photograph of a wall, of `side` rows and
    columns."""
    projection, optics = (
        Projection(FOCAL_PX, ((side - 1) / 2, (side - 1) / 2)),
        _optics(plane[MTF50_HORIZONTAL]["value"]),
    )
    parameters, uncertainties = TwoPhotoParameters(plane["s"], plane["k"]), []
    for seed in SEEDS:
        rng, texels = np.random.default_rng(seed), round(1.1 * side * zoom)
        wall = FlatSheet(leaves((texels, texels), rng, largest=LARGEST, per_leaf=PER_LEAF), 1.0)
        near, far = (
            draw([PlacedSheet(wall, ObjectPose((0.0, 0.0, FOCAL_PX * z), roll_deg=2.0 * z), optics)],
                 projection, (side, side), {(0, 0): "Y"})
            + np.float32(noise) * rng.standard_normal((side, side), np.float32)
            for z in (1.0, zoom)
        )  # fmt: skip
        outcome = estimate_psf_of_pair(near, far, parameters)
        if outcome.value is not None:
            uncertainties.append(outcome.value.quality.budgets[MTF50_HORIZONTAL]["noise"])
    return _median(uncertainties)


SLANT = math.radians(5)


def edge_effects(plane: Entry) -> Effects:
    """More light, and an edge twice as long."""
    edge = next(one for one in plane["edges"] if EDGE_MTF50 in one)
    short, length = sorted(edge["roi"][2:])
    noise = edge["diagnostics"]["noise"] / edge["diagnostics"]["contrast"]
    changes = {LIGHT: (length, noise / 2), "an edge twice as long": (2 * length, noise)}
    return _effects(partial(_edge_uncertainty, edge[EDGE_MTF50]["value"], short), (length, noise), changes)


def _edge_uncertainty(mtf50: float, width: int, height: int, noise: float) -> float:
    """Standard uncertainty of MTF50 by the noise, over the contrast, across an edge near vertical in a region of this
    size."""
    y, x = np.indices((height, width + height // 8))
    distance = (x - x.mean()) * math.cos(SLANT) + (y - y.mean()) * math.sin(SLANT)
    grain = noise * np.random.default_rng(SEEDS[0]).standard_normal(x.shape)
    light = 0.1 + 0.7 * (ndtr(distance * mtf50 / GAUSSIAN_AT_HALF) + grain)
    outcome = estimate_edge(light, Roi(0, 0, x.shape[1], height))
    return math.inf if outcome.value is None else outcome.value.budgets[EDGE_MTF50]["noise"]


LEVELS, MOST_PIXELS = 24, 40_000
"""Levels of light of the twin from dark to saturation, and its most pixels."""


def sensor_effects(plane: Entry) -> Effects:
    """More pictures of each level, and more levels."""
    changes = {"four times as many pictures of each level": (8, LEVELS), "twice as many levels": (2, 2 * LEVELS)}
    side = math.isqrt(min(plane["rows"] * plane["columns"], MOST_PIXELS))
    return _effects(partial(_gain_uncertainty, plane["model"], side), (2, LEVELS), changes)


def _gain_uncertainty(model: Mapping[str, float], side: int, pictures: int, levels: int) -> float:
    """Standard uncertainty of the gain by `pictures` at each of the levels of a sensor with `side` rows and columns."""
    rng = np.random.default_rng(SEEDS[0])
    gain, dark, top, variance = (float(model[name]) for name in ("gain", "dark_level", "saturation", "dark_variance"))

    def level(signal: float) -> LightLevel:
        electrons = rng.poisson(signal / gain, (pictures, side, side)) * gain
        samples = dark + electrons + variance**0.5 * rng.standard_normal(electrons.shape)
        return measure_level(list(np.rint(np.minimum(samples, dark + 1.02 * top))), 0.01, signal)

    ladder = np.linspace(0, 1.1 * top, levels + 1)
    recording = SensorRecording((level(0.0),), tuple(map(level, ladder[1:])), False, None, None)
    outcome = characterise(recording, rng)
    return math.inf if outcome.value is None else outcome.value.numbers[SYSTEM_GAIN].uncertainty


TWINS: Mapping[str, Callable[[Entry], Effects]] = {
    PIXELS_PER_PATTERN: chart_effects, "edges": edge_effects, "scale": wall_effects, SYSTEM_GAIN: sensor_effects,
}  # fmt: skip
"""By an entry of the plane that shows its subject, as `station.results.explanation.TWIN`."""
