"""The effect of a remedy: the chart photographed by a simulated camera like the measured one, before and after it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from procedures.budget import COMMON, combined
from procedures.numbers import MTF50_HORIZONTAL, PIXELS_PER_PATTERN
from procedures.outcome import BadInput
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from simulators.camera.camera import SimulatedCamera, pixels_at, render_plane
from simulators.camera.optics import GaussianBlur, Optics, PixelAperture
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

GAUSSIAN_AT_HALF = 0.1874
"""sigma f of a Gaussian whose transfer function is 0.5 at f: sqrt(ln 2 / 2) / pi."""
PIXEL_SIGMA = 0.2887
"""Standard deviation of a pixel's aperture, pixels: sqrt(1 / 12)."""
PITCH_UM, WHITE = 7.5, 0.8
CHART = Chart.from_seed()
SEEDS = (1, 2)
SAME_WIDTH = 0.05
"""Relative difference of widths that changes nothing."""


@dataclass(frozen=True)
class TwinPrediction:
    """A change of the set-up, and the standard uncertainty of MTF50 after it, in the unit of the record."""

    words: str
    uncertainty: float


def predictions(plane: Mapping[str, Any]) -> list[TwinPrediction]:
    """The predicted effects of a better distance and of four times the light, from the record of a plane.

    The twin has the measured MTF50, noise and size of the chart; its remaining properties are those of an ideal lens.
    Terms that all photographs of the chart share, such as the blur of the print, stay as they are.
    Raises BadInput if the record is not that of a photograph of the chart.
    """
    try:
        width, mtf50 = float(plane[PIXELS_PER_PATTERN]), float(plane[MTF50_HORIZONTAL]["value"])
        budget: Mapping[str, float] = plane[MTF50_HORIZONTAL]["budget"]
        noise, s, k = float(plane["diagnostics"]["noise"]), int(plane["s"]), int(plane["k"])
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput("the digital twin needs the record of a photograph of the chart", "name one") from error
    best = pixels_at(1.0, s)
    changes = {"four times the light": (width, noise / 2)}
    if abs(best / width - 1) > SAME_WIDTH:
        changes |= {f"a chart {best:.0f} pixels wide instead of {width:.0f} (s/t = 1)": (best, noise)}
    parameters = PatternParameters(s, k, chosen=True)
    shared = combined({term: one for term, one in budget.items() if term in COMMON})
    own = combined({term: one for term, one in budget.items() if term not in COMMON})
    now = _uncertainty(width, noise, mtf50, parameters)
    return [
        TwinPrediction(words, math.hypot(shared, own * _uncertainty(*change, mtf50, parameters) / now))
        for words, change in changes.items()
    ]


def _uncertainty(width: float, noise: float, mtf50: float, parameters: PatternParameters) -> float:
    """Standard uncertainty of MTF50 of the twin without shared terms: median of several photographs.

    noise : standard deviation of white samples over the chart's contrast
    """
    sigma = max((GAUSSIAN_AT_HALF / mtf50) ** 2 - PIXEL_SIGMA**2, 0.01) ** 0.5
    electrons = (1 / max(noise, 1e-4)) ** 2
    size = round(1.8 * width) + 40
    sensor = Sensor(size, size, None, full_well_e=electrons / WHITE, gain_e_per_dn=electrons / WHITE / 15000)
    camera = SimulatedCamera(
        sensor=sensor, pitch_um=PITCH_UM, optics=Optics((GaussianBlur(sigma), PixelAperture()), PITCH_UM)
    )
    scene = Scene((camera.place(CHART, pixels=width, roll_deg=3.0),))
    uncertainties = []
    for seed in SEEDS:
        samples = render_plane(scene, camera, np.random.default_rng(seed), exposure_s=_exposure_s(camera))
        outcome = estimate_psf(samples, CHART, parameters)
        if outcome.value is not None:
            budget = outcome.value.quality.budgets[MTF50_HORIZONTAL]
            uncertainties.append(combined({term: one for term, one in budget.items() if term not in COMMON}))
    return float(np.median(uncertainties)) if uncertainties else float("inf")


def _exposure_s(camera: SimulatedCamera) -> float:
    """The exposure at which white is at `WHITE`."""
    return WHITE * camera.sensor.full_well_e / camera.white_e_per_s
