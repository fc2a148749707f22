"""Spatial non-uniformity in the dark (DSNU) and of the response (PRNU), split into rows, columns and pixels.

EMVA 1288 release 4.0 linear, sections 4 and 8.2. The numbers are of this sensor, not of its kind: their uncertainty is
what temporal noise leaves in the mean pictures, not how another sensor of the same make would differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numbers import DSNU, PRNU
from procedures.sensor.measured import IntervalNumber, root, with_share
from procedures.sensor.stacks import FrameStack

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PARTS = ("total", "row", "column", "pixel")


@dataclass(frozen=True)
class Variances:
    """Spatial variances of a mean picture, what temporal noise adds subtracted, and their standard uncertainties.

    Attributes
    ----------
    value, uncertainty : mapping of each of PARTS to float
        DN^2; a value may be negative where there is no pattern above the noise.
    """

    value: Mapping[str, float]
    uncertainty: Mapping[str, float]


def spatial_variances(
    picture: Array, left_over: tuple[float, float, float], count: int, left_out: Mask | None = None
) -> Variances:
    """The variance over all pixels, and how rows, columns and pixels share in it.

    Parameters
    ----------
    picture : (rows, columns) float64
        A stack's mean picture.
    left_over : (pixels, rows, columns)
        Temporal variance that is still in it, DN^2: of pixels, of averages of rows, and of columns. The standard takes
        the second and third from the first; noise that a whole row shares would then be told as its pattern.
    count : int
        Pictures of the stack.
    left_out : (rows, columns) bool, optional
        Defect pixels, which then count as what their row and column are on average.
    """
    field = picture - picture.mean()
    kept = 1.0
    if left_out is not None and left_out.any():
        field, kept = _filled(field, left_out), 1 - float(left_out.mean())
    rows, columns = field.shape
    n = rows * columns
    of_rows, of_columns = field.mean(axis=1), field.mean(axis=0)
    # what is measured: all pixels, averages of rows, averages of columns, each less what noise adds
    total = float(np.vdot(field, field)) / (n - 1) - left_over[0] * kept
    row_averages = float(np.mean(of_rows**2)) - left_over[1]
    column_averages = float(np.mean(of_columns**2)) - left_over[2]
    pixel = n / (n - rows - columns) * (total - row_averages - column_averages) / kept
    value = {
        "total": total + (1 - kept) * pixel,
        "row": row_averages - pixel / columns,
        "column": column_averages - pixel / rows,
        "pixel": pixel,
    }
    noise = {"total": (left_over[0], n), "row": (left_over[1], rows), "column": (left_over[2], columns),
             "pixel": (left_over[0], n)}  # fmt: skip
    uncertainty = {part: _uncertainty(value[part], of, size, count) for part, (of, size) in noise.items()}
    # rows and columns whose noise is shared make that of the whole
    uncertainty["total"] = float(np.sqrt(sum(uncertainty[part] ** 2 for part in PARTS[1:])))
    for part, size in (("row", rows), ("column", columns)):
        # averages of pixels differ by chance, too: that is told from rows and columns no better than this
        by_chance = max(pixel, 0.0) * size / n
        uncertainty[part] = float(np.hypot(uncertainty[part], by_chance * np.sqrt(2 / size)))
    return Variances(value, uncertainty)


def _uncertainty(pattern: float, noise: float, size: int, count: int) -> float:
    """Standard uncertainty of a pattern's variance that was measured in noise of a variance, from so many values.

    The pattern is fixed; noise is added to it, so its variance is that of 2 x pattern x noise and of noise^2; that of
    the noise subtracted was measured in count - 1 pictures.
    """
    own = 4 * max(pattern, 0.0) * noise + 2 * noise**2
    return float(np.sqrt(own / size + 2 * noise**2 / (size * max(count - 1, 1))))


def _filled(field: Array, left_out: Mask) -> Array:
    """The field with some pixels replaced by what their row and column are on average, the others' mean taken off."""
    kept = np.where(left_out, np.nan, field)
    kept = kept - np.nanmean(kept)
    of_rows, of_columns = np.nanmean(kept, axis=1), np.nanmean(kept, axis=0)
    return np.asarray(np.where(left_out, of_rows[:, None] + of_columns[None, :], kept))


def dark_numbers(
    stack: FrameStack, gain: IntervalNumber, left_out: Mask | None = None, *, suffix: str = ""
) -> Mapping[str, IntervalNumber]:
    """DSNU in digital numbers and, by the gain, in electrons: of all pixels, by row, by column, by pixel."""
    found = spatial_variances(stack.mean_picture, stack.left_over, stack.count, left_out)
    n = stack.mean_picture.size
    numbers: dict[str, IntervalNumber] = {}
    for part in PARTS:
        name, method = _named(DSNU, part, suffix), f"{_words(part)} of the mean dark picture"
        in_dn = root(found.value[part], found.uncertainty[part], 1.0, "DN", method, n)
        in_e = root(found.value[part], found.uncertainty[part], 1 / gain.value, "e-", f"{method}, over K", n)
        numbers[f"{name}_dn"], numbers[name] = in_dn, with_share(in_e, gain.uncertainty / gain.value)
    return numbers


def response_numbers(
    dark: FrameStack, flat: FrameStack, bent: float, left_out: Mask | None = None, *, suffix: str = ""
) -> Mapping[str, IntervalNumber]:
    """PRNU in per cent of the signal: of all pixels, by row, by column, by pixel.

    Parameters
    ----------
    bent : float
        Relative standard uncertainty from the curvature of the response at the flat stack's signal.
    """
    in_flat = spatial_variances(flat.mean_picture, flat.left_over, flat.count, left_out)
    in_dark = spatial_variances(dark.mean_picture, dark.left_over, dark.count, left_out)
    signal, n = flat.mean - dark.mean, flat.mean_picture.size
    lines = {"row": flat.mean_picture.shape[0], "column": flat.mean_picture.shape[1]}
    numbers = {}
    for part in PARTS:
        variance = in_flat.value[part] - in_dark.value[part]
        # patterns of dark and response agree by chance where there are few of them
        chance = 4 * max(in_dark.value[part], 0.0) * max(variance, 0.0) / lines.get(part, n)
        spread = float(np.sqrt(in_flat.uncertainty[part] ** 2 + in_dark.uncertainty[part] ** 2 + chance))
        found = root(variance, spread, 100 / signal, "%", f"{_words(part)} of the mean flat picture, less dark", n)
        numbers[_named(PRNU, part, suffix)] = with_share(found, bent)
    return numbers


def _named(name: str, part: str, suffix: str) -> str:
    return name + ("" if part == "total" else f"_{part}") + suffix


def _words(part: str) -> str:
    return "deviation over all pixels" if part == "total" else f"deviation by {part}"


def unevenness(smooth: Array) -> float:
    """Largest less smallest over mean, of a smoothed flat picture (rows, columns): EMVA allows 0.03."""
    low, high = np.percentile(smooth, (0.1, 99.9))
    return float((high - low) / smooth.mean())
