"""Checks of a recording, with reason and remedy."""

from __future__ import annotations

import numpy as np

from procedures.outcome import Check, Verdict
from procedures.sensor.curves import light_spread
from procedures.sensor.linearity import LEAST_LEVELS as LEAST_LEVELS_OF_LINE
from procedures.sensor.linearity import RANGE
from procedures.sensor.photon_transfer import LEAST_DARK_VARIANCE, REGRESSION, saturation_index
from procedures.sensor.recording import SensorRecording, column
from procedures.sensor.stacks import slow_part
from procedures.sensor.uniformity import unevenness

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
    variance = column(one.variance for one in recording.lights)
    signal = recording.signal
    top = saturation_index(variance)
    fitted = int(np.sum(signal <= REGRESSION * signal[top]))
    judged = int(np.sum((signal >= RANGE[0] * signal[top]) & (signal <= RANGE[1] * signal[top])))
    spread = light_spread(recording)
    longest = float(column(one.exposure_s for one in recording.lights).max())
    longest_dark = float(column(one.exposure_s for one in recording.darks).max())
    clipped = float(np.max(column(one.bottom for one in recording.darks)))
    least_noise = float(column(one.variance for one in recording.darks).min())
    steady = "let the lamp warm up, use direct current, and exposure times of whole periods of the mains"
    return [
        Check("black", clipped, CLIPPED_BLACK, REFUSED,
              f"dark numbers must not be clipped; {clipped:.1%} are at the lowest",
              "raise the camera's black level (offset), and switch its black correction off"),
        Check("flicker", spread, FLICKER_REFUSED, REFUSED,
              f"light must not change between pictures; it does by {spread:.1%}", steady),
        Check("order", bool(np.any(signal <= 0)), 0, REFUSED,
              "every level of light must be brighter than the dark; one is not",
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
        _outlying_level(recording, top),
        Check("rounding", least_noise**0.5, LEAST_DARK_VARIANCE**0.5, DOUBTFUL,
              "rounding dominates in the dark: its effect is computed for normally distributed noise and pixels",
              "raise the gain until dark noise exceeds half a digital number", least=True),
    ]  # fmt: skip


def _outlying_level(recording: SensorRecording, top: int) -> Check:
    """Whether a level from 5 % of saturation upwards deviates from the line between its neighbours, and which most."""
    signal, light = recording.signal, column(one.light for one in recording.lights)
    below, above = light[:-2], light[2:]
    share = (light[1:-1] - below) / (above - below)
    between = (1 - share) * signal[:-2] + share * signal[2:]
    deviation = signal[1:-1] / between - 1
    considered = np.minimum(signal[1:-1], between) >= RANGE[0] * signal[top]
    considered[max(top - 1, 0) :] = False  # beyond saturation the response bends
    deviation = np.where(considered, deviation, 0.0)
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
