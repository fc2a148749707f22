"""Characterisation of a sensor from its recording: EMVA 1288 release 4.0, linear and general model."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procedures.clipping import SensorModel
from procedures.corruption.noise import LAG_X, LAG_Y, MASK_RADII, SMOOTHING_RADII, mask_scores, noise_checks
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
from procedures.numerics.arrays import Mask
from procedures.outcome import Check, Outcome, Verdict, verdict_of
from procedures.sensor.curves import Curves, curves_of, light_spread
from procedures.sensor.defects import Defects, IntervalNumber, dark_field, find_defects, response_field
from procedures.sensor.information import general_numbers
from procedures.sensor.photon_transfer import (
    LEAST_DARK_VARIANCE,
    RANGE,
    REGRESSION,
    Linearity,
    Response,
    Transfer,
    dark_current_numbers,
    fit_linearity,
    fit_response,
    fit_transfer,
    linearity_numbers,
    saturation_index,
    saturation_range,
    transfer_numbers,
)
from procedures.sensor.photon_transfer import LEAST_LEVELS as LEAST_LEVELS_OF_LINE
from procedures.sensor.spectrograms import Period, Spectrogram, find_periods, spectrogram
from procedures.sensor.stacks import FrameStack, SensorRecording, column, least_spread, slow_part
from procedures.sensor.uniformity import Rounding, before_rounding, dark_numbers, response_numbers, unevenness

DIRECTIONS = ("horizontal", "vertical")


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Structure of a mean picture; amplitudes in digital numbers, or per cent of the signal.

    spectrograms : along rows, along columns; periods : sinusoids common to all rows or all columns.
    """

    unit: str
    spectrograms: tuple[Spectrogram, ...]
    periods: tuple[Period, ...]
    defects: Defects


@dataclass(frozen=True, eq=False)
class SensorResult:
    """Characterisation of one plane.

    curves, transfer, linearity, response : basis of the temporal numbers
    dark, light : structure of the mean dark picture, and of the response
    dark_level : mean of the dark pictures, in digital numbers
    caveat : reason why gain, noise and response are doubtful, or "". Stacks and the linear model do not affect these.
    """

    numbers: Mapping[str, IntervalNumber]
    curves: Curves
    transfer: Transfer
    linearity: Linearity
    response: Response
    dark: FixedPattern | None
    light: FixedPattern | None
    dark_level: float
    caveat: str = ""

    __repr__ = summary


def characterise(recording: SensorRecording, rng: np.random.Generator) -> Outcome[SensorResult]:
    """All numbers of one plane with their intervals, or the reason why there are none.

    rng : for the draws behind the intervals of the temporal numbers
    """
    for checks_on in (count_checks, ladder_checks):  # the second requires what the first checks
        outcome: Outcome[SensorResult] = verdict_of(checks := checks_on(recording))
        if outcome.verdict is Verdict.REFUSED:
            return outcome
    result = _temporal(recording, rng)
    numbers = result.numbers
    result = replace(result, caveat=outcome.reason)
    checks += stack_checks(recording, numbers[SATURATION_SIGNAL].value)
    checks.append(Check("gain", bool(numbers[SYSTEM_GAIN].value <= 0), 0, REFUSED,
                        "temporal noise must grow with the light; it does not",
                        "give unprocessed pictures, in digital numbers, and several of a level"))  # fmt: skip
    checks.append(linearity_check(numbers[LINEARITY_ERROR].value))
    return verdict_of(checks, _spatial(result, recording, rng))


def sensor_model(result: SensorResult, step: float = 1.0) -> SensorModel:
    """The model of a calibrated sensor for other procedures; step : numbers of the file per digital number of the
    result."""
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


# --- checks of a recording ---

LEAST_LEVELS, ENOUGH_LEVELS = 8, 20
"""Minimum number of levels of light, and of an unquestioned ladder; EMVA requires 50."""
LEAST_FITTED = 4
LONG_S = 1.0  # exposure from which dark current may be significant
FLICKER_REFUSED, FLICKER_DOUBTFUL = 0.03, 0.005  # relative change of the light between two pictures of a level
CLIPPED_BLACK = 0.005  # accepted share of dark samples clipped at the lowest number
BELOW_MAXIMUM = 0.9  # the last level's temporal variance must have fallen below this share of the maximum
UNEVEN_REFUSED, UNEVEN_DOUBTFUL = 0.2, 0.03  # largest less smallest light over the mean; the standard allows 0.03
ENOUGH_PICTURES = 16
FLAT_RANGE = (0.2, 0.8)  # accepted signal of the flat stack, relative to saturation; the standard requires a half
COUPLED = 0.003  # standard uncertainty of a mask's amount by the coupling of neighbouring pixels in the sensor itself
OUTLYING = 0.03  # deviation of a level's signal from the line between its neighbours, relative to the signal
NONLINEAR = 1.0  # linearity error in per cent from which the linear model is doubtful


REFUSED, DOUBTFUL = Verdict.REFUSED, Verdict.DOUBTFUL


def count_checks(recording: SensorRecording) -> list[Check]:
    """Checks of the number of levels, before any computation."""
    lights, darks = len(recording.lights), len(recording.darks)
    return [
        Check("darks", darks == 0, 0, REFUSED, "a pair of dark pictures is needed; there is none",
              "cover the lens and take two pictures at each exposure time of the ladder"),
        Check("levels", lights, LEAST_LEVELS, REFUSED,
              f"the ladder needs at least {LEAST_LEVELS} levels of light; it has {lights}",
              "take pairs of pictures at more exposure times, from near dark to beyond saturation", least=True),
    ]  # fmt: skip


def ladder_checks(recording: SensorRecording) -> list[Check]:
    """Checks of the ladder's pictures."""
    variance = column(light.variance for light in recording.lights)
    signal = recording.signal
    top = saturation_index(variance)
    fitted = int(np.sum(signal <= REGRESSION * signal[top]))
    judged = int(np.sum((signal >= RANGE[0] * signal[top]) & (signal <= RANGE[1] * signal[top])))
    spread = light_spread(recording)
    longest = float(column(light.exposure_s for light in recording.lights).max())
    longest_dark = float(column(dark.exposure_s for dark in recording.darks).max())
    clipped = float(np.max(column(dark.bottom for dark in recording.darks)))
    least_noise = float(column(dark.variance for dark in recording.darks).min())
    steady = "let the lamp warm up, use direct current, and exposure times of whole periods of the mains"
    return [
        Check("black", clipped, CLIPPED_BLACK, REFUSED,
              f"dark numbers must not be clipped; {clipped:.1%} are at the lowest",
              "raise the camera's black level (offset), and switch its black correction off"),
        Check("flicker", spread, FLICKER_REFUSED, REFUSED,
              f"light must not change between pictures; it does by {spread:.1%}", steady),
        Check("order", bool(np.any(signal <= 0) or recording.lights[0].light <= 0), 0, REFUSED,
              "every level of light must be positive, and brighter than the dark; one is not",
              "check which pictures are dark ones, and begin the ladder at more light"),
        Check("saturation", bool(variance[-1] >= BELOW_MAXIMUM * variance[top]), 0, REFUSED,
              "the ladder must go beyond saturation, where temporal noise falls; it does not",
              "add levels of more light, until the numbers no longer rise"),
        Check("little light", fitted, LEAST_FITTED, REFUSED,
              f"at least {LEAST_FITTED} levels must lie below {REGRESSION:.0%} of saturation; {fitted} do",
              "take more levels of little light", least=True),
        Check("levels of the line", judged, LEAST_LEVELS_OF_LINE, REFUSED,
              f"linearity needs {LEAST_LEVELS_OF_LINE} levels from {RANGE[0]:.0%} to {RANGE[1]:.0%} of saturation; "
              f"there are {judged}", "spread the levels evenly up to saturation", least=True),
        Check("long darks", longest, 1.01 * longest_dark, DOUBTFUL,
              f"no dark pictures were as long as the ladder's {longest:g} s: their dark current is not subtracted",
              "take a pair of dark pictures at the ladder's longest exposure too", given=longest > LONG_S),
        Check("flicker", spread, FLICKER_DOUBTFUL, DOUBTFUL,
              f"light changes by {spread:.2%} between two pictures", steady),
        Check("levels", len(variance), ENOUGH_LEVELS, DOUBTFUL,
              f"the ladder has {len(variance)} levels; the standard requires 50",
              f"take at least {ENOUGH_LEVELS} levels, evenly spaced", least=True),
        *_processing(recording, signal <= REGRESSION * signal[top]),
        _outlying_level(recording, top),
        Check("rounding", least_noise**0.5, LEAST_DARK_VARIANCE**0.5, DOUBTFUL,
              "rounding dominates in the dark: its effect is computed for normally distributed noise and pixels",
              "raise the gain until dark noise exceeds half a digital number", least=True),
    ]  # fmt: skip


def _processing(recording: SensorRecording, fitted: Mask) -> list[Check]:
    """Whether the noise of neighbouring pixels is correlated, in the levels from which the gain is fitted."""
    noise = [
        light.noise
        for light, used in zip(recording.lights, fitted, strict=True)
        if used and light.variance > LEAST_DARK_VARIANCE
    ]
    lines = [(lag == 0).astype(np.float64) for lag in (LAG_X, LAG_Y)]  # subtracted means correlate rows and columns
    scores = (
        [replace(one, uncertainty=math.hypot(one.uncertainty, COUPLED)) for one in mask_scores(noise, radii, lines)]
        for radii in (MASK_RADII, SMOOTHING_RADII)
    )
    return noise_checks(*scores, raw=True)


def _outlying_level(recording: SensorRecording, top: int) -> Check:
    """Whether a level from 5 % of saturation upwards deviates from the line between its neighbours, and which most."""
    signal, light = recording.signal, column(one.light for one in recording.lights)
    below, above = light[:-2], light[2:]
    share = (light[1:-1] - below) / np.maximum(above - below, 1e-300)
    between = (1 - share) * signal[:-2] + share * signal[2:]
    considered = np.minimum(signal[1:-1], between) >= RANGE[0] * signal[top]
    considered[max(top - 1, 0) :] = False  # beyond saturation the response bends
    deviation = np.divide(signal[1:-1] - between, between, out=np.zeros(len(between)), where=considered)
    worst = int(np.argmax(np.abs(deviation)))
    level = recording.lights[worst + 1]
    return Check("outlying level", abs(deviation[worst]), OUTLYING, DOUBTFUL,
                 f"every level must lie on a smooth curve; that of light {level.light:g} (exposure "
                 f"{level.exposure_s:g} s) is {deviation[worst]:+.0%} off the line between its neighbours",
                 "correct its light, or take the level again")  # fmt: skip


def stack_checks(recording: SensorRecording, saturation_signal: float) -> list[Check]:
    """Checks of the stacks, or the consequence of their absence."""
    dark, flat = recording.dark_stack, recording.flat_stack
    if dark is None or flat is None:
        missing = " and ".join(name for name, one in (("dark", dark), ("flat", flat)) if one is None)
        remedy = f"take {ENOUGH_PICTURES} pictures or more in the dark, and as many at half of saturation"
        reason = f"without a {missing} stack non-uniformity is not or not completely known"
        return [Check("stacks", statistic=True, threshold=0, severity=DOUBTFUL, sentence=reason, remedy=remedy)]
    share = (flat.mean - dark.mean) / saturation_signal
    uneven = unevenness(slow_part(flat.mean_picture - dark.mean_picture))
    few = min(dark.count, flat.count)
    low, high = FLAT_RANGE
    even = "use an integrating sphere, or a diffuser far from the sensor, without a lens"
    return [
        Check("evenness", uneven, UNEVEN_REFUSED, REFUSED,
              f"light must be even over the sensor; it differs by {uneven:.0%}", even),
        Check("evenness", uneven, UNEVEN_DOUBTFUL, DOUBTFUL,
              f"light differs by {uneven:.1%} over the sensor, the standard allows 3 %: PRNU includes that, "
              "prnu_highpass does not", even),
        Check("level of the flats", abs(share - (low + high) / 2), (high - low) / 2, DOUBTFUL,
              f"the flat stack lies at {share:.0%} of saturation", "take it at half of saturation"),
        Check("pictures", few, ENOUGH_PICTURES, DOUBTFUL, f"a stack has only {few} pictures",
              f"take {ENOUGH_PICTURES} or more; the standard requires 100", least=True),
    ]  # fmt: skip


def linearity_check(error: float) -> Check:
    """Whether the linear model applies."""
    return Check("linearity", error, NONLINEAR, DOUBTFUL,
                 f"the response deviates from a line by {error:.1f} % on average; the uncertainties of the linear "
                 "model's numbers include that", "prefer the numbers of the general model")  # fmt: skip
