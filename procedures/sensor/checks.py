"""Whether a recording can tell what it is asked: rules with reason and remedy."""

from __future__ import annotations

import numpy as np

from procedures.outcome import Rule, Verdict
from procedures.sensor.curves import light_spread
from procedures.sensor.linearity import LEAST_LEVELS as LEAST_LEVELS_OF_LINE
from procedures.sensor.linearity import RANGE
from procedures.sensor.photon_transfer import LEAST_DARK_VARIANCE, REGRESSION, saturation_index
from procedures.sensor.recording import SensorRecording, column
from procedures.sensor.stacks import slow_part
from procedures.sensor.uniformity import unevenness

LEAST_LEVELS, ENOUGH_LEVELS = 8, 20
"""Levels of light that a ladder needs, and from which on it is not doubted; EMVA asks for 50."""
LEAST_FITTED = 4
LONG_S = 1.0
"""Exposure from which dark current may count."""
FLICKER_REFUSED, FLICKER_DOUBTED = 0.03, 0.005
"""Relative change of the light between two pictures of a level."""
CRUSHED = 0.005
"""Share of the dark samples that may be cut off."""
PAST_THE_TOP = 0.9
"""Of the largest temporal variance, below which the last level's must have fallen: then it was the largest."""
UNEVEN_REFUSED, UNEVEN_DOUBTED = 0.2, 0.03
"""Largest less smallest light over the mean; the standard allows 0.03."""
ENOUGH_PICTURES = 16
FLAT_RANGE = (0.2, 0.8)
"""Of saturation, where the flat stack should lie; the standard asks for a half."""
NOT_LINEAR = 1.0
"""Per cent of linearity error from which the linear model is doubted."""


def _refuse(applies: bool, reason: str, remedy: str) -> Rule:
    return Rule(Verdict.REFUSED, bool(applies), reason, remedy)


def _doubt(applies: bool, reason: str, remedy: str) -> Rule:
    return Rule(Verdict.DOUBTFUL, bool(applies), reason, remedy)


def count_rules(recording: SensorRecording) -> list[Rule]:
    """What must be there before anything is computed."""
    lights, darks = len(recording.lights), len(recording.darks)
    return [
        _refuse(darks == 0, "a pair of dark pictures is needed; there is none",
                "cover the lens and take two pictures at each exposure time of the ladder"),
        _refuse(lights < LEAST_LEVELS, f"the ladder needs at least {LEAST_LEVELS} levels of light; it has {lights}",
                "take pairs of pictures at more exposure times, from near dark to beyond saturation"),
    ]  # fmt: skip


def ladder_rules(recording: SensorRecording) -> list[Rule]:
    """What the pictures themselves must be like."""
    variance = column(one.variance for one in recording.lights)
    signal = recording.signal
    top = saturation_index(variance)
    fitted = int(np.sum(signal <= REGRESSION * signal[top]))
    judged = int(np.sum((signal >= RANGE[0] * signal[top]) & (signal <= RANGE[1] * signal[top])))
    falls = variance[-1] < PAST_THE_TOP * variance[top]
    spread = light_spread(recording)
    longest = float(column(one.exposure_s for one in recording.lights).max())
    crushed = float(np.max(column(one.bottom for one in recording.darks)))
    steady = "let the lamp warm up, use direct current, and exposure times of whole periods of the mains"
    return [
        _refuse(crushed > CRUSHED, f"dark numbers must not be cut off; {crushed:.1%} are piled up at the lowest",
                "raise the camera's black level (offset), and switch its black correction off"),
        _refuse(spread > FLICKER_REFUSED, f"light must not change between pictures; it does by {spread:.1%}", steady),
        _refuse(bool(np.any(signal <= 0)), "every level of light must be brighter than the dark; one is not",
                "check which pictures are dark ones, and begin the ladder at more light"),
        _refuse(not falls, "the ladder must go beyond saturation, where temporal noise falls; it does not",
                "add levels of more light, until the numbers no longer rise"),
        _refuse(fitted < LEAST_FITTED, f"at least {LEAST_FITTED} levels must lie below {REGRESSION:.0%} of saturation; "
                f"{fitted} do", "take more levels of little light"),
        _refuse(judged < LEAST_LEVELS_OF_LINE, f"linearity needs {LEAST_LEVELS_OF_LINE} levels from {RANGE[0]:.0%} to "
                f"{RANGE[1]:.0%} of saturation; there are {judged}", "spread the levels evenly up to saturation"),
        _doubt(longest > LONG_S and longest > 1.01 * float(column(one.exposure_s for one in recording.darks).max()),
               f"no dark pictures were as long as the ladder's {longest:g} s: their dark current is not taken off",
               "take a pair of dark pictures at the ladder's longest exposure too"),
        _doubt(spread > FLICKER_DOUBTED, f"light changes by {spread:.2%} between two pictures", steady),
        _doubt(len(variance) < ENOUGH_LEVELS, f"the ladder has {len(variance)} levels; the standard asks for 50",
               f"take at least {ENOUGH_LEVELS} levels, evenly spaced"),
        _doubt(bool(column(one.variance for one in recording.darks).min() < LEAST_DARK_VARIANCE),
               "in the dark rounding rules: temporal dark noise is only known to be less than what is told",
               "raise the gain until dark noise exceeds half a digital number"),
    ]  # fmt: skip


def stack_rules(recording: SensorRecording, saturation_signal: float) -> list[Rule]:
    """What the stacks must be like, or what is missing without them."""
    dark, flat = recording.dark_stack, recording.flat_stack
    if dark is None or flat is None:
        missing = " and ".join(name for name, one in (("dark", dark), ("flat", flat)) if one is None)
        remedy = f"take {ENOUGH_PICTURES} pictures or more in the dark, and as many at half of saturation"
        return [_doubt(True, f"without a {missing} stack non-uniformity is not known or not wholly", remedy)]
    share = (flat.mean - dark.mean) / saturation_signal
    uneven = unevenness(slow_part(flat.mean_picture - dark.mean_picture))
    few = min(dark.count, flat.count)
    even = "use an integrating sphere, or a diffuser far from the sensor, without a lens"
    return [
        _refuse(uneven > UNEVEN_REFUSED, f"light must be even over the sensor; it differs by {uneven:.0%}", even),
        _doubt(uneven > UNEVEN_DOUBTED, f"light differs by {uneven:.1%} over the sensor, the standard allows 3 %: PRNU "
               "holds that, prnu_highpass does not", even),
        _doubt(not FLAT_RANGE[0] <= share <= FLAT_RANGE[1], f"the flat stack lies at {share:.0%} of saturation",
               "take it at half of saturation"),
        _doubt(few < ENOUGH_PICTURES, f"a stack has only {few} pictures",
               f"take {ENOUGH_PICTURES} or more; the standard asks for 100"),
    ]  # fmt: skip


def linearity_rules(error: float) -> list[Rule]:
    """Whether the linear model may be used at all."""
    return [_doubt(error > NOT_LINEAR, f"the response is off a line by {error:.1f} % on average; the linear model's "
                   "numbers carry what that may do to them", "prefer the numbers of the general model")]  # fmt: skip
