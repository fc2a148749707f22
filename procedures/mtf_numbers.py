"""Numbers read from an MTF curve: where it first falls to a level, what it is at a frequency, with their gradients.

Between the frequencies of a curve it is a parabola through three of them: a straight line errs by up to 5e-4.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from procedures.spatial_numbers import Found

Array = npt.NDArray[np.float64]

LEVELS = (50, 30, 20, 10)
"""Per cent of contrast at which frequencies are told."""
NYQUIST = 0.5
"""Cycles per pixel."""
_AT = re.compile(r"mtf_at_(?P<frequency>[0-9.e+-]+?)(?:_(?P<direction>horizontal|vertical|radial))?")


def name_at(frequency: float, direction: str = "") -> str:
    """The name of the MTF at a frequency, along a direction where there are several: mtf_at_0.25_horizontal."""
    return f"mtf_at_{frequency:.6g}" + (f"_{direction}" if direction else "")


def frequency_of(name: str) -> tuple[float, str] | None:
    """The frequency and the direction in the name of an MTF at a frequency; None where it is another number's."""
    found = _AT.fullmatch(name)
    return (float(found["frequency"]), found["direction"] or "") if found else None


def curve_numbers(f: Array, mtf: Array, slope: Array, name: str, at: Sequence[float] = ()) -> Iterator[Found]:
    """The numbers of one curve.

    Parameters
    ----------
    f, mtf : (n,) float64
        Cycles per pixel, equally spaced from 0, and the moduli.
    slope : (n, m) float64
        Derivative of the moduli by the PSF's parameters.
    name : str
        Of the direction.
    at : sequence of float
        Frequencies at which the MTF is told; those beyond the curve are left out.
    """
    i = int(np.searchsorted(f, NYQUIST))
    yield Found(f"mtf_nyquist_{name}", float(mtf[i]), "1", "|OTF| at 0.5 cycles/pixel", slope[i])
    for level in LEVELS:
        if (found := crossing(f, mtf, slope, level / 100)) is not None:
            method = f"first crossing of |OTF| = {level / 100:g}"
            yield Found(f"mtf{level}_{name}", found[0], "cycles/pixel", method, found[1])
    for frequency in at:
        if 0 <= frequency <= f[-1]:
            value, gradient = _at(f, mtf, slope, frequency)
            yield Found(name_at(frequency, name), value, "1", f"|OTF| at {frequency:.6g} cycles/pixel", gradient)


def crossing(f: Array, mtf: Array, slope: Array, level: float = 0.5) -> tuple[float, Array] | None:
    """Where a curve first falls below a level, and the derivative of that; None where it stays above."""
    below = np.flatnonzero(mtf < level)
    if not len(below):
        return None
    i = max(int(below[0]), 2)
    step = f[1] - f[0]
    a, b, c = mtf[i - 2 : i + 1]
    bend, tilt = (a - 2 * b + c) / 2, (c - a) / 2
    t = 0.0 if b == level else _root(bend, tilt, b - level)
    steepness = -(tilt + 2 * bend * t) / step
    return float(f[i - 1] + t * step), np.asarray(_parabola(t) @ slope[i - 2 : i + 1] / steepness)


def _at(f: Array, mtf: Array, slope: Array, frequency: float) -> tuple[float, Array]:
    """A curve's value at a frequency, and its derivative."""
    step = f[1] - f[0]
    i = int(np.clip(round(frequency / step), 1, len(f) - 2))
    weights = _parabola((frequency - f[i]) / step)
    return float(weights @ mtf[i - 1 : i + 2]), np.asarray(weights @ slope[i - 1 : i + 2])


def _parabola(t: float) -> Array:
    """Weights of three values at -1, 0, 1 in the parabola through them, at t."""
    return np.array([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2])


def _root(bend: float, tilt: float, above: float) -> float:
    """The root of bend t^2 + tilt t + above that is nearest to 0, on a falling curve."""
    discriminant = max(tilt * tilt - 4 * bend * above, 0.0)
    return float(2 * above / (-tilt + np.sqrt(discriminant)))
