"""A sensor characterised from its recording, start to end: EMVA 1288 release 4.0, linear and general model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

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
from procedures.sensor.checks import count_checks, ladder_checks, linearity_checks, stack_checks
from procedures.sensor.curves import Curves, curves_of
from procedures.sensor.dark_current import dark_current_numbers
from procedures.sensor.defects import Defects, dark_field, find_defects, response_field
from procedures.sensor.general import general_numbers
from procedures.sensor.linearity import Linearity, Response, fit_linearity, fit_response, linearity_numbers
from procedures.sensor.measured import IntervalNumber
from procedures.sensor.photon_transfer import (
    Transfer,
    fit_transfer,
    saturation_index,
    saturation_range,
    transfer_numbers,
)
from procedures.sensor.recording import SensorRecording
from procedures.sensor.spectrograms import Period, Spectrogram, find_periods, spectrogram
from procedures.sensor.stacks import FrameStack, slow_part
from procedures.sensor.uniformity import dark_numbers, response_numbers
from procedures.sensor_model import SensorModel

Mask = npt.NDArray[np.bool_]

DIRECTIONS = ("horizontal", "vertical")


@dataclass(frozen=True, eq=False)
class Pattern:
    """What a mean picture shows beside its variance; amplitudes in digital numbers, or per cent of the signal.

    Attributes
    ----------
    unit : str
    spectrograms : tuple of Spectrogram
        Along rows, along columns.
    periods : tuple of Period
        Sinusoids that all rows or all columns share.
    defects : Defects
    """

    unit: str
    spectrograms: tuple[Spectrogram, ...]
    periods: tuple[Period, ...]
    defects: Defects


@dataclass(frozen=True, eq=False)
class SensorResult:
    """One plane's sensor.

    Attributes
    ----------
    numbers : mapping of str to IntervalNumber
    curves, transfer, linearity, response
        What the numbers of the temporal part are drawn from.
    dark, light : Pattern or None
        Of the mean dark picture, and of the response.
    dark_level : float
        Mean of the dark pictures, in digital numbers.
    doubt : str
        Why gain, noise and response are doubted, "" where they are not: a doubt about stacks or the linear model is
        none about these.
    """

    numbers: Mapping[str, IntervalNumber]
    curves: Curves
    transfer: Transfer
    linearity: Linearity
    response: Response
    dark: Pattern | None
    light: Pattern | None
    dark_level: float
    doubt: str = ""

    __repr__ = summary


def characterise(recording: SensorRecording, rng: np.random.Generator) -> Outcome[SensorResult]:
    """All numbers of one plane with their intervals, or the reason why there are none.

    Parameters
    ----------
    rng : Generator
        Of the draws that the intervals of the temporal numbers come from.
    """
    for checks_on in (count_checks, ladder_checks):  # the second reads what the first asks for
        outcome: Outcome[SensorResult] = verdict_of(checks := checks_on(recording))
        if outcome.verdict is Verdict.REFUSED:
            return outcome
    result = _temporal(recording, rng)
    numbers = result.numbers
    result = replace(result, doubt=outcome.reason)
    checks += stack_checks(recording, numbers[SATURATION_SIGNAL].value)
    checks += linearity_checks(numbers[LINEARITY_ERROR].value)
    return verdict_of(checks, _spatial(result, recording))


def sensor_model(result: SensorResult, step: float = 1.0) -> SensorModel:
    """What other procedures take from a sensor's calibration.

    Parameters
    ----------
    step : float
        How many of the file's numbers one digital number of the result is.
    """
    gain, response = result.numbers[SYSTEM_GAIN_AT_DARK], result.response
    return SensorModel(
        gain.value * step,
        gain.uncertainty * step,
        result.dark_level * step,
        float(result.curves.dark_variance[0, 0]) * step**2,
        result.numbers[SATURATION_SIGNAL].value * step,
        float(response.coefficients[0, 0] * response.scale) * step,
        tuple(response.bend[0].tolist()),
        response.bend_uncertainty,
        _pixels(result, non_uniformity(DSNU, "_pixel", WITHOUT_DEFECTS, "_dn")) * step,
        _pixels(result, non_uniformity(PRNU, "_pixel", HIGHPASS)) / 100,
    )


def _pixels(result: SensorResult, name: str) -> float:
    """A non-uniformity, 0 where no stack tells it."""
    return result.numbers[name].value if name in result.numbers else 0.0


def _temporal(recording: SensorRecording, rng: np.random.Generator) -> SensorResult:
    """What the ladder tells."""
    curves = curves_of(recording, rng)
    top = saturation_index(curves.variance[0])
    response = fit_response(curves, top)
    linearity = fit_linearity(curves, top)
    transfer = fit_transfer(curves, response)
    photons = recording.photons_known
    numbers = {
        **transfer_numbers(curves, transfer, photons_known=photons),
        **linearity_numbers(linearity, _beside(curves, top), curves.samples * int(linearity.used.sum())),
        **dark_current_numbers(curves, transfer),
        **general_numbers(curves, top, photons_known=photons),
    }
    dark_level = float(curves.dark_mean[0, 0])
    return SensorResult(numbers, curves, transfer, linearity, response, None, None, dark_level)


def _beside(curves: Curves, top: int) -> list[Linearity]:
    """Linearity, were saturation at the first or last level where it may be."""
    return [fit_linearity(curves, near) for near in saturation_range(curves, top)]


def _spatial(result: SensorResult, recording: SensorRecording) -> SensorResult:
    """The same with what the stacks tell."""
    dark, flat = recording.dark_stack, recording.flat_stack
    if dark is None:
        return result
    gain = result.numbers[SYSTEM_GAIN]
    in_dark = find_defects(dark_field(dark), np.sqrt(dark.left_over[0]))
    shape = dark.mean_picture.shape
    numbers = {
        **result.numbers,
        **dark_numbers(dark, gain),
        **dark_numbers(dark, gain, _mask(in_dark, shape), suffix="_without_defects"),
        DEFECT_PIXELS["dark"]: in_dark.count,
    }
    result = replace(result, numbers=numbers, dark=_pattern(dark, in_dark, "DN", 1.0))
    return result if flat is None else _with_response(result, dark, flat)


def _with_response(result: SensorResult, dark: FrameStack, flat: FrameStack) -> SensorResult:
    """The same with the response's non-uniformity."""
    signal = flat.mean - dark.mean
    noise = np.sqrt(flat.left_over[0] + dark.left_over[0])
    in_light = find_defects(response_field(dark, flat), noise, 100 / signal)
    either = _mask(in_light, flat.mean_picture.shape)
    if result.dark is not None:
        either |= _mask(result.dark.defects, flat.mean_picture.shape)
    slow = slow_part(flat.mean_picture - dark.mean_picture)
    flattened = replace(flat, mean_picture=flat.mean_picture - slow + slow.mean())
    bent = _bent_at(result, signal)
    numbers = {
        **result.numbers,
        **response_numbers(dark, flat, bent),
        **response_numbers(dark, flat, bent, either, suffix="_without_defects"),
        **response_numbers(dark, flattened, bent, either, suffix="_highpass"),
        DEFECT_PIXELS["light"]: in_light.count,
    }
    response = replace(flat, mean_picture=flat.mean_picture - dark.mean_picture)
    return replace(result, numbers=numbers, light=_pattern(response, in_light, "%", 100 / signal))


def _pattern(stack: FrameStack, defects: Defects, unit: str, scale: float) -> Pattern:
    """Spectrograms and periods of a mean picture; the periods are looked for beside the defects."""
    mask = _mask(defects, stack.mean_picture.shape)
    tame = np.where(mask, np.median(stack.mean_picture), stack.mean_picture)
    spectra = tuple(spectrogram(stack, direction, scale) for direction in DIRECTIONS)
    periods = tuple(p for name in ("row", "column") for p in find_periods(tame, name, unit, scale))
    return Pattern(unit, spectra, periods, defects)


def _mask(defects: Defects, shape: tuple[int, ...]) -> Mask:
    mask = np.zeros(shape, dtype=np.bool_)
    mask[tuple(defects.places.T)] = True
    return mask


def _bent_at(result: SensorResult, signal: float) -> float:
    """How far slope and signal over light differ at a signal: what curvature may do to a relative response."""
    if not result.transfer.bent:
        return 0.0
    light = np.array([[signal / result.transfer.responsivity[0]]])
    response = replace(result.response, coefficients=result.response.coefficients[:1])
    powers = (light / response.scale) ** np.arange(response.coefficients.shape[1])
    seen = float(np.sum(response.coefficients * powers) / response.coefficients[0, 0])
    return float(abs(response.relative_slope(light)[0, 0] / seen - 1))
