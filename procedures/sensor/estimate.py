"""Characterisation of a sensor from its recording: EMVA 1288 release 4.0, linear and general model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procedures.display import summary
from procedures.numbers import (
    DEFECT_PIXELS,
    DSNU,
    HIGHPASS,
    LINEARITY_ERROR,
    PRNU,
    SATURATION_SIGNAL,
    SYSTEM_GAIN,
    SYSTEM_GAIN_AT_DARK,
    WITHOUT_DEFECTS,
    non_uniformity,
)
from procedures.outcome import Outcome, Verdict, verdict_of
from procedures.sensor.checks import count_checks, ladder_checks, linearity_check, stack_checks
from procedures.sensor.curves import Curves, curves_of
from procedures.sensor.defects import Defects, dark_field, find_defects, response_field
from procedures.sensor.linearity import Linearity, Response, fit_linearity, fit_response, linearity_numbers
from procedures.sensor.measured import IntervalNumber
from procedures.sensor.photon_transfer import (
    Transfer,
    dark_current_numbers,
    fit_transfer,
    saturation_index,
    saturation_range,
    transfer_numbers,
)
from procedures.sensor.recording import SensorRecording
from procedures.sensor.signal_to_noise import general_numbers
from procedures.sensor.spectrograms import Period, Spectrogram, find_periods, spectrogram
from procedures.sensor.stacks import FrameStack, least_spread, slow_part
from procedures.sensor.uniformity import Rounding, before_rounding, dark_numbers, response_numbers
from procedures.sensor_model import SensorModel

DIRECTIONS = ("horizontal", "vertical")


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Structure of a mean picture; amplitudes in digital numbers, or per cent of the signal.

    Attributes
    ----------
    spectrograms : along rows, along columns
    periods : sinusoids common to all rows or all columns
    """

    unit: str
    spectrograms: tuple[Spectrogram, ...]
    periods: tuple[Period, ...]
    defects: Defects


@dataclass(frozen=True, eq=False)
class SensorResult:
    """Characterisation of one plane.

    Attributes
    ----------
    curves, transfer, linearity, response : basis of the temporal numbers
    dark, light : structure of the mean dark picture, and of the response
    dark_level : mean of the dark pictures, in digital numbers
    doubt : reason why gain, noise and response are doubtful, or "". Stacks and the linear model do not affect these.
    """

    numbers: Mapping[str, IntervalNumber]
    curves: Curves
    transfer: Transfer
    linearity: Linearity
    response: Response
    dark: FixedPattern | None
    light: FixedPattern | None
    dark_level: float
    doubt: str = ""

    __repr__ = summary


def characterise(recording: SensorRecording, rng: np.random.Generator) -> Outcome[SensorResult]:
    """All numbers of one plane with their intervals, or the reason why there are none.

    Parameters
    ----------
    rng : for the draws behind the intervals of the temporal numbers
    """
    for checks_on in (count_checks, ladder_checks):  # the second requires what the first checks
        outcome: Outcome[SensorResult] = verdict_of(checks := checks_on(recording))
        if outcome.verdict is Verdict.REFUSED:
            return outcome
    result = _temporal(recording, rng)
    numbers = result.numbers
    result = replace(result, doubt=outcome.reason)
    checks += stack_checks(recording, numbers[SATURATION_SIGNAL].value)
    checks.append(linearity_check(numbers[LINEARITY_ERROR].value))
    return verdict_of(checks, _spatial(result, recording, rng))


def sensor_model(result: SensorResult, step: float = 1.0) -> SensorModel:
    """The model of a calibrated sensor for other procedures.

    Parameters
    ----------
    step : numbers of the file per digital number of the result
    """
    gain, response = result.numbers[SYSTEM_GAIN_AT_DARK], result.response
    dsnu = result.numbers.get(non_uniformity(DSNU, "_pixel", WITHOUT_DEFECTS, "_dn"))
    prnu = result.numbers.get(non_uniformity(PRNU, "_pixel", HIGHPASS))
    return SensorModel(
        gain.value * step,
        gain.uncertainty * step,
        result.dark_level * step,
        float(result.curves.dark_variance[0, 0]) * step**2,
        result.numbers[SATURATION_SIGNAL].value * step,
        float(response.coefficients[0, 0] * response.scale) * step,
        tuple(response.bend[0].tolist()),
        response.bend_uncertainty,
        dsnu.value * step if dsnu else 0.0,
        prnu.value / 100 if prnu else 0.0,
    )


def _temporal(recording: SensorRecording, rng: np.random.Generator) -> SensorResult:
    curves = curves_of(recording, rng)
    top = saturation_index(curves.variance[0])
    response = fit_response(curves, top)
    linearity = fit_linearity(curves, top)
    alternatives = [fit_linearity(curves, level) for level in saturation_range(curves, top)]
    transfer = fit_transfer(curves, response)
    photons = recording.photons_known
    numbers = {
        **transfer_numbers(curves, transfer, photons_known=photons),
        **linearity_numbers(linearity, alternatives, curves.samples * int(linearity.used.sum())),
        **dark_current_numbers(curves, transfer),
        **general_numbers(curves, top, photons_known=photons),
    }
    dark_level = float(curves.dark_mean[0, 0])
    return SensorResult(numbers, curves, transfer, linearity, response, None, None, dark_level)


def _spatial(result: SensorResult, recording: SensorRecording, rng: np.random.Generator) -> SensorResult:
    dark, flat = recording.dark_stack, recording.flat_stack
    if dark is None:
        return result
    gain, rounding = result.numbers[SYSTEM_GAIN], before_rounding(dark, rng)
    noise = dark.residual_variance[0] ** 0.5
    in_dark = find_defects(dark_field(dark), noise, least_spread=least_spread(dark))
    shape = dark.mean_picture.shape
    numbers = {
        **result.numbers,
        **dark_numbers(dark, rounding, gain),
        **dark_numbers(dark, rounding, gain, in_dark.mask(shape), suffix="_without_defects"),
        DEFECT_PIXELS["dark"]: in_dark.count,
    }
    result = replace(result, numbers=numbers, dark=_pattern(dark, in_dark, "DN", 1.0))
    return result if flat is None else _with_response(result, dark, flat, (rounding, before_rounding(flat, rng)))


def _with_response(
    result: SensorResult, dark: FrameStack, flat: FrameStack, rounding: tuple[Rounding, Rounding]
) -> SensorResult:
    signal = flat.mean - dark.mean
    noise = np.sqrt(flat.residual_variance[0] + dark.residual_variance[0])
    in_light = find_defects(response_field(dark, flat), noise, 100 / signal)
    shape = flat.mean_picture.shape
    either = in_light.mask(shape)
    if result.dark is not None:
        either |= result.dark.defects.mask(shape)
    slow = slow_part(flat.mean_picture - dark.mean_picture)
    flattened = replace(flat, mean_picture=flat.mean_picture - slow + slow.mean())
    curvature = _curvature_at(result, signal)
    numbers = {
        **result.numbers,
        **response_numbers(dark, flat, rounding, curvature),
        **response_numbers(dark, flat, rounding, curvature, either, suffix="_without_defects"),
        **response_numbers(dark, flattened, rounding, curvature, either, suffix="_highpass"),
        DEFECT_PIXELS["light"]: in_light.count,
    }
    response = replace(flat, mean_picture=flat.mean_picture - dark.mean_picture)
    return replace(result, numbers=numbers, light=_pattern(response, in_light, "%", 100 / signal))


def _pattern(stack: FrameStack, defects: Defects, unit: str, scale: float) -> FixedPattern:
    """Spectrograms and periods of a mean picture; defects are excluded from the search for periods."""
    tame = np.where(defects.mask(stack.mean_picture.shape), np.median(stack.mean_picture), stack.mean_picture)
    spectra = tuple(spectrogram(stack, direction, scale) for direction in DIRECTIONS)
    periods = tuple(p for name in ("row", "column") for p in find_periods(tame, name, unit, scale))
    return FixedPattern(unit, spectra, periods, defects)


def _curvature_at(result: SensorResult, signal: float) -> float:
    """Relative difference of slope and signal over light: effect of the curvature on a relative response."""
    if not result.transfer.gain_bent:
        return 0.0
    light = np.array([[signal / result.transfer.responsivity[0]]])
    response = replace(result.response, coefficients=result.response.coefficients[:1])
    powers = (light / response.scale) ** np.arange(response.coefficients.shape[1])
    ratio = float(np.sum(response.coefficients * powers) / response.coefficients[0, 0])
    return float(abs(response.relative_slope(light)[0, 0] / ratio - 1))
