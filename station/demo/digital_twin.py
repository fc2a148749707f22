"""Effect of remedies: a simulated camera like the measured one photographs the subject before and after each."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from procedures.choice import COMMON, combined
from procedures.geometry.next_view import NextView, next_view_words
from procedures.numbers import (
    EDGE_MTF50,
    MTF50_HORIZONTAL,
    PIXELS_PER_PATTERN,
    SYSTEM_GAIN,
    label,
)
from procedures.outcome import BadInput
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from procedures.quality import PRINT_BLUR
from procedures.sensor.estimate import characterise
from procedures.sensor.stacks import SensorRecording, measure_level
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

Array = npt.NDArray[np.float64]
Entry = Mapping[str, Any]
"""A plane in a record."""
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
    """A change of the set-up, and the standard uncertainty of a number before and after it."""

    words: str
    number: str
    before: float
    after: float


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
        return [TwinPrediction(words, f"uncertainty of the {known.of}", known.before, known.after)]
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
    return [
        TwinPrediction(
            words, label(number), before, combined({term: u * factors.get(term, 1.0) for term, u in budget.items()})
        )
        for words, factors in effects.items()
        if np.isfinite(list(factors.values())).all()  # the twin's photographs were not refused
    ]


def _sigma(mtf50: float) -> float:
    """Standard deviation of the lens's Gaussian that has this MTF50 with the pixels, in pixels."""
    return float(max((GAUSSIAN_AT_HALF / mtf50) ** 2 - PIXEL_SIGMA**2, 0.01) ** 0.5)


# --- charts ---


def chart_effects(plane: Entry) -> Effects:
    """A better distance, and more light: the blur of the print grows with the square of the chart's width."""
    width, mtf50, noise = plane[PIXELS_PER_PATTERN], plane[MTF50_HORIZONTAL]["value"], plane["noise"]
    parameters = PatternParameters(plane["s"], plane["k"], chosen=True)
    best = pixels_at(1.0, plane["s"])
    changes = {LIGHT: (width, noise / 2)}
    if abs(best / width - 1) > SAME_WIDTH:
        words = (
            f"{width / best:.2g} times the distance (s/t = 1, a chart {best:.0f} pixels wide instead of {width:.0f})"
        )
        changes |= {words: (best, noise)}
    now = _chart_uncertainty(width, noise, mtf50, parameters)
    own = [term for term in plane[MTF50_HORIZONTAL]["budget"] if term not in COMMON]
    return {
        words: dict.fromkeys(own, _chart_uncertainty(wide, less, mtf50, parameters) / now)
        | {PRINT_BLUR: (wide / width) ** 2}
        for words, (wide, less) in changes.items()
    }


def _chart_uncertainty(width: float, noise: float, mtf50: float, parameters: PatternParameters) -> float:
    """Standard uncertainty of MTF50 of the twin without shared terms: median of several photographs.

    noise : standard deviation of white samples over the chart's contrast
    """
    electrons = (1 / max(noise, 1e-4)) ** 2
    size = round(1.8 * width) + 40
    sensor = Sensor(size, size, None, full_well_e=electrons / WHITE, gain_e_per_dn=electrons / WHITE / 15000)
    camera = SimulatedCamera(sensor=sensor, pitch_um=PITCH_UM, optics=_optics(mtf50))
    scene = Scene((camera.place(CHART, pixels=width, roll_deg=3.0),))
    uncertainties = []
    for seed in SEEDS:
        samples = render_plane(scene, camera, np.random.default_rng(seed), exposure_s=_exposure_s(camera))
        outcome = estimate_psf(samples, CHART, parameters)
        if outcome.value is not None:
            budget = outcome.value.quality.budgets[MTF50_HORIZONTAL]
            uncertainties.append(combined({term: one for term, one in budget.items() if term not in COMMON}))
    return float(np.median(uncertainties)) if uncertainties else float("inf")


def _optics(mtf50: float) -> Optics:
    return Optics((GaussianBlur(_sigma(mtf50)), PixelAperture()), PITCH_UM)


def _exposure_s(camera: SimulatedCamera) -> float:
    return WHITE * camera.sensor.full_well_e / camera.white_e_per_s


# --- walls ---

FOCAL_PX, LARGEST, PER_LEAF = 3000.0, 240.0, 60.0
"""Distance of the lens from the sensor in pixels; largest leaf, and pixels per leaf, of the near photograph."""


def wall_effects(plane: Entry) -> Effects:
    """More light, and a far photograph from nearer or farther."""
    zoom, samples, noise = (float(np.mean(plane[name])) for name in ("scale", "samples", "noise"))
    mtf50, parameters = plane[MTF50_HORIZONTAL]["value"], TwoPhotoParameters(plane["s"], plane["k"])
    side = round(zoom * samples**0.5)
    changes = {LIGHT: (zoom, noise / 2)}
    changes |= {
        f"the far photograph from {z / zoom:.2g} times the distance": (z, noise) for z in (0.9 * zoom, 1.2 * zoom)
    }
    now = _wall_uncertainty(side, zoom, noise, mtf50, parameters)
    return {
        words: {"noise": _wall_uncertainty(side, z, less, mtf50, parameters) / now}
        for words, (z, less) in changes.items()
    }


def _wall_uncertainty(side: int, zoom: float, noise: float, mtf50: float, parameters: TwoPhotoParameters) -> float:
    """Standard uncertainty of MTF50 by the noise of a near and a far photograph of a wall: median of several pairs.

    side : rows and columns of either
    """
    projection, uncertainties = Projection(FOCAL_PX, ((side - 1) / 2, (side - 1) / 2)), []
    for seed in SEEDS:
        rng, texels = np.random.default_rng(seed), round(1.1 * side * zoom)
        wall = FlatSheet(leaves((texels, texels), rng, largest=LARGEST, per_leaf=PER_LEAF), 1.0)
        near, far = (
            draw([PlacedSheet(wall, ObjectPose((0.0, 0.0, FOCAL_PX * z), roll_deg=2.0 * z), _optics(mtf50))],
                 projection, (side, side), {(0, 0): "Y"})
            + np.float32(noise) * rng.standard_normal((side, side), np.float32)
            for z in (1.0, zoom)
        )  # fmt: skip
        outcome = estimate_psf_of_pair(near, far, parameters)
        if outcome.value is not None:
            uncertainties.append(outcome.value.quality.budgets[MTF50_HORIZONTAL]["noise"])
    return float(np.median(uncertainties)) if uncertainties else math.inf


# --- edges ---


def edge_effects(plane: Entry) -> Effects:
    """More light, and an edge twice as long."""
    edge = next(one for one in plane["edges"] if EDGE_MTF50 in one)
    short, length = sorted(edge["roi"][2:])
    noise = edge["diagnostics"]["noise"] / edge["diagnostics"]["contrast"]
    mtf50 = edge[EDGE_MTF50]["value"]
    changes = {LIGHT: (length, noise / 2), "an edge twice as long": (2 * length, noise)}
    now = _edge_budget(short, length, noise, mtf50)
    each = {words: _edge_budget(short, long, less, mtf50) for words, (long, less) in changes.items()}
    return {
        words: {term: then[term] / max(now[term], 1e-9) for term in ("noise", "bins")} for words, then in each.items()
    }


def _edge_budget(width: int, height: int, noise: float, mtf50: float) -> Mapping[str, float]:
    """Budget of MTF50 across an edge 5 degrees from vertical in a region of this size; noise over the contrast."""
    y, x = np.indices((height, width + height // 8))
    distance = (x - x.mean()) * math.cos(math.radians(5)) + (y - y.mean()) * math.sin(math.radians(5))
    light = 0.1 + 0.7 * (
        ndtr(distance * mtf50 / GAUSSIAN_AT_HALF) + noise * np.random.default_rng(1).standard_normal(x.shape)
    )
    outcome = estimate_edge(light, Roi(0, 0, x.shape[1], height)).value
    return {"noise": math.inf, "bins": math.inf} if outcome is None else outcome.budgets[EDGE_MTF50]


# --- sensors ---

LEVELS, MOST_PIXELS = 24, 40_000
"""Levels of light of the twin from dark to saturation, and its most pixels."""


def sensor_effects(plane: Entry) -> Effects:
    """More pictures of each level, and more levels."""
    model, side = plane["model"], math.isqrt(min(plane["rows"] * plane["columns"], MOST_PIXELS))
    changes = {"four times as many pictures of each level": (8, LEVELS), "twice as many levels": (2, 2 * LEVELS)}
    now = _gain_uncertainty(model, side, 2, LEVELS)
    return {words: {"noise": _gain_uncertainty(model, side, *change) / now} for words, change in changes.items()}


def _gain_uncertainty(model: Mapping[str, float], side: int, pictures: int, levels: int) -> float:
    """Standard uncertainty of the gain by `pictures` at each of the levels of a sensor with `side` rows and columns."""
    rng = np.random.default_rng(SEEDS[0])
    gain, dark, top = (float(model[name]) for name in ("gain", "dark_level", "saturation"))

    def taken(signal: float) -> list[Array]:
        electrons = rng.poisson(signal / gain, (pictures, side, side)) * gain
        noise = float(model["dark_variance"]) ** 0.5 * rng.standard_normal(electrons.shape)
        return list(np.rint(np.minimum(dark + electrons + noise, dark + 1.02 * top)))

    ladder = np.linspace(0, 1.1 * top, levels + 1)[1:]
    lights = tuple(measure_level(taken(signal), 0.01, signal) for signal in ladder)
    recording = SensorRecording((measure_level(taken(0.0), 0.01, 0.0),), lights, False, None, None)
    outcome = characterise(recording, rng).value
    return math.inf if outcome is None else outcome.numbers[SYSTEM_GAIN].uncertainty


TWINS: Mapping[str, Callable[[Entry], Effects]] = {
    PIXELS_PER_PATTERN: chart_effects, "edges": edge_effects, "scale": wall_effects, SYSTEM_GAIN: sensor_effects,
}  # fmt: skip
"""By an entry of the plane that shows its subject, as `station.results.explanation.TWIN`."""
