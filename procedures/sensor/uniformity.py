"""Spatial non-uniformity in the dark (DSNU) and of the response (PRNU), split into rows, columns and pixels.

EMVA 1288 release 4.0 linear, sections 4 and 8.2. The numbers describe this sensor, not its type: their uncertainty is
due to temporal noise in the mean pictures, not to differences between sensors.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.numbers import DSNU, PRNU
from procedures.numerics.arrays import Array, Mask
from procedures.sensor.defects import IntervalNumber, find_defects, root, with_share
from procedures.sensor.rounding import NEGLIGIBLE, finite_pixels, unrounded
from procedures.sensor.stacks import FrameStack, least_spread

LEAST_SLOPE = 0.1
"""Least slope of the pixels' rounded means over their true ones by which a pattern of lines is divided."""
PARTS = ("total", "row", "column", "pixel")


@dataclass(frozen=True)
class Variances:
    """Spatial variances of a mean picture without temporal noise, and their standard uncertainties.

    value, uncertainty : DN^2; a value may be negative where the pattern is below the noise.
    """

    value: Mapping[str, float]
    uncertainty: Mapping[str, float]


@dataclass(frozen=True)
class Rounding:
    """Spatial variance that rounding adds to a mean picture, in DN^2, the standard uncertainty of the variance before
    it, and the mean slope of the pixels' rounded means over their true ones."""

    added: float
    uncertainty: float
    slope: float


def spatial_variances(
    picture: Array, residual_variance: tuple[float, float, float], count: int, excluded: Mask | None = None
) -> Variances:
    """Variance over all pixels, and its parts by rows, columns and pixels.

    picture : (rows, columns), a stack's mean picture
    residual_variance : (pixels, rows, columns) temporal variance in it, DN^2: of pixels, of averages of rows, and of
        columns. The standard derives the second and third from the first; noise common to a row would then appear as
        its pattern.
    count : pictures of the stack
    excluded : (rows, columns) bool, optional; defect pixels, replaced by the averages of their row and column
    """
    field = picture - picture.mean()
    kept = 1.0
    if excluded is not None and excluded.any():
        field, kept = _filled(field, excluded), 1 - float(excluded.mean())
    rows, columns = field.shape
    n = rows * columns
    of_rows, of_columns = field.mean(axis=1), field.mean(axis=0)
    # measured: all pixels, averages of rows, averages of columns, each less noise
    total = float(np.vdot(field, field)) / (n - 1) - residual_variance[0] * kept
    row_averages = float(np.mean(of_rows**2)) - residual_variance[1]
    column_averages = float(np.mean(of_columns**2)) - residual_variance[2]
    pixel = n / (n - rows - columns) * (total - row_averages - column_averages) / kept
    value = {
        "total": total + (1 - kept) * pixel,
        "row": row_averages - pixel / columns,
        "column": column_averages - pixel / rows,
        "pixel": pixel,
    }
    of_pixels, of_row, of_column = residual_variance
    noise = {"total": (of_pixels, n), "row": (of_row, rows), "column": (of_column, columns), "pixel": (of_pixels, n)}
    uncertainty = {part: _uncertainty(value[part], of, size, count) for part, (of, size) in noise.items()}
    # common noise of rows and columns adds to that of the whole
    uncertainty["total"] = float(np.sqrt(sum(uncertainty[part] ** 2 for part in PARTS[1:])))
    for part, size in (("row", rows), ("column", columns)):
        # random differences of the averages of pixels
        by_chance = max(pixel, 0.0) * size / n
        uncertainty[part] = float(np.hypot(uncertainty[part], by_chance * np.sqrt(2 / size)))
    return Variances(value, uncertainty)


def core_variance(stack: FrameStack) -> tuple[float, float]:
    """Spatial variance of a stack's mean picture without its defects, and its standard uncertainty."""
    field, noise = stack.mean_picture - stack.mean, stack.residual_variance[0] ** 0.5
    defects = find_defects(field, noise, least_spread=least_spread(stack))
    excluded = defects.mask(stack.mean_picture.shape)
    variances = spatial_variances(stack.mean_picture, stack.residual_variance, stack.count, excluded)
    return variances.value["total"], variances.uncertainty["total"]


def before_rounding(stack: FrameStack, rng: np.random.Generator, draws: int = 500) -> Rounding:
    """The effect of rounding on a stack's spatial variances; none where its noise is large."""
    if stack.variance > NEGLIGIBLE:
        return Rounding(0.0, 0.0, 1.0)
    core, uncertainty = core_variance(stack)
    n = stack.mean_picture.size
    variances = finite_pixels(stack.variance, core, n)
    variances += stack.variance / (n * stack.count), 2 * stack.variance**2 / (n * (stack.count - 1)), uncertainty**2
    centre = np.array([stack.mean, stack.variance, core])[:, None]
    measured = centre + np.sqrt(variances)[:, None] * np.column_stack([np.zeros(3), rng.standard_normal((3, draws))])
    before = unrounded(measured, variances, rng)
    return Rounding(
        core - float(before.spatial[0]), float(np.std(before.spatial[1:])), max(float(before.slope[0]), LEAST_SLOPE)
    )


def variances_before(stack: FrameStack, rounding: Rounding, excluded: Mask | None) -> Variances:
    """`spatial_variances` of a stack, before rounding: the linear response to a pattern is divided out."""
    after = spatial_variances(stack.mean_picture, stack.residual_variance, stack.count, excluded)
    lines = {part: after.value[part] / rounding.slope**2 for part in ("row", "column")}
    total = after.value["total"] - rounding.added
    pixel = after.value["pixel"] - rounding.added - sum(lines[part] - after.value[part] for part in lines)
    uncertainty = {part: max(one, rounding.uncertainty) for part, one in after.uncertainty.items()}
    uncertainty |= {part: after.uncertainty[part] / rounding.slope**2 for part in lines}
    return Variances({**lines, "total": total, "pixel": pixel}, uncertainty)


def _uncertainty(pattern: float, noise: float, size: int, count: int) -> float:
    """Standard uncertainty of a fixed pattern's variance from `size` values: that of 2 x pattern x noise and noise^2;
    the subtracted one is of count - 1 pictures."""
    own = 4 * max(pattern, 0.0) * noise + 2 * noise**2
    return float(np.sqrt(own / size + 2 * noise**2 / (size * max(count - 1, 1))))


def _filled(field: Array, excluded: Mask) -> Array:
    """The field with excluded pixels replaced by the averages of their row and column, less the others' mean."""
    kept = np.where(excluded, np.nan, field)
    kept = kept - np.nanmean(kept)
    of_rows, of_columns = np.nanmean(kept, axis=1), np.nanmean(kept, axis=0)
    return np.asarray(np.where(excluded, of_rows[:, None] + of_columns[None, :], kept))


def dark_numbers(
    stack: FrameStack, rounding: Rounding, gain: IntervalNumber, excluded: Mask | None = None, *, suffix: str = ""
) -> Mapping[str, IntervalNumber]:
    """DSNU in digital numbers and, by the gain, in electrons: of all pixels, by row, by column, by pixel."""
    variances, n = variances_before(stack, rounding, excluded), stack.mean_picture.size
    numbers: dict[str, IntervalNumber] = {}
    for part in PARTS:
        name, method = _named(DSNU, part, suffix), f"{_words(part)} of the mean dark picture"
        in_dn = root(variances.value[part], variances.uncertainty[part], 1.0, "DN", method, n)
        in_e = root(variances.value[part], variances.uncertainty[part], 1 / gain.value, "e-", f"{method}, over K", n)
        numbers[f"{name}_dn"], numbers[name] = in_dn, with_share(in_e, gain.uncertainty / gain.value)
    return numbers


def response_numbers(
    dark: FrameStack, flat: FrameStack, rounding: tuple[Rounding, Rounding], curvature: float,
    excluded: Mask | None = None, *, suffix: str = "",
) -> Mapping[str, IntervalNumber]:  # fmt: skip
    """PRNU in per cent of the signal, of all pixels, rows, columns, pixels; rounding : of dark and flat stack;
    curvature : relative uncertainty by that of the response."""
    in_dark = variances_before(dark, rounding[0], excluded)
    in_flat = variances_before(flat, rounding[1], excluded)
    signal, n = flat.mean - dark.mean, flat.mean_picture.size
    lines = {"row": flat.mean_picture.shape[0], "column": flat.mean_picture.shape[1]}
    numbers = {}
    for part in PARTS:
        variance = in_flat.value[part] - in_dark.value[part]
        # random correlation of few lines of dark and response
        chance = 4 * max(in_dark.value[part], 0.0) * max(variance, 0.0) / lines.get(part, n)
        spread = float(np.sqrt(in_flat.uncertainty[part] ** 2 + in_dark.uncertainty[part] ** 2 + chance))
        number = root(variance, spread, 100 / signal, "%", f"{_words(part)} of the mean flat picture, less dark", n)
        numbers[_named(PRNU, part, suffix)] = with_share(number, curvature)
    return numbers


def _named(name: str, part: str, suffix: str) -> str:
    return name + ("" if part == "total" else f"_{part}") + suffix


def _words(part: str) -> str:
    return "deviation over all pixels" if part == "total" else f"deviation by {part}"


def unevenness(smooth: Array) -> float:
    """Largest less smallest over mean, of a smoothed flat picture (rows, columns): EMVA allows 0.03."""
    low, high = np.percentile(smooth, (0.1, 99.9))
    return float((high - low) / smooth.mean())
