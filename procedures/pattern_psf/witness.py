"""A PSF witnessed by three further photographs of the chart: what a single photograph has to assume is measured.

- A shorter exposure, nothing else changed: a linear camera multiplies every signal by the ratio of the exposures. Scene
  and fixed pattern cancel in the difference, whose noise shows sharpening and smoothing of a per cent.
- A photograph from nearer: blur of the print grows with the chart, that of the lens does not; black in small blocks
  becomes darker where light strays farther than a block.
- A slight defocus: a lens leaves no light missing around its wider spot, a sharpening mask does.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter

from procedures.choice import with_modes
from procedures.corruption.family import Strength, nuisance, threshold
from procedures.corruption.noise import Variogram, mask_scores
from procedures.numbers import WITNESS_BLACK, WITNESS_CURVATURE, WITNESS_PRINT_BLUR, WITNESS_RATIO, WITNESS_SHARPENING
from procedures.numerics.arrays import Array, Mask
from procedures.outcome import Check, Outcome, Quantity, Refused, Verdict, verdict_of, with_causes
from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.corruptions import PRINT_UNKNOWN, print_blur_mode
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.pattern_psf.radiometry import measure_light
from procedures.quality import PRINT_BLUR, Diffraction
from procedures.raw import Plane

TILE = 5  # side of the tiles in which two exposures are compared, pixels
CLIPPED = 0.97
EXPOSURE_UNCERTAINTY = 0.005  # relative standard uncertainty of the ratio of two exposure times
LEVEL_UNCERTAINTY = 0.004
"""Standard uncertainty of black over white at two distances, by the far tail's part of it and by uneven light."""
CURVATURE_UNCERTAINTY = 0.001
"""Standard uncertainty of a curvature, over the range, by a slight motion between two exposures."""
MASKS_PX = (0.7, 1.0, 2.0)
LEAST_RATIO, LEAST_NEARER = 1.3, 1.2  # least ratio of the exposures, and of the chart's widths
FOCUS_UNCERTAINTY = 0.015  # relative standard uncertainty of the ratio of two distances' MTF, each focused in steps
LEAST_MTF = 0.2  # MTF down to which curves from two distances are compared


@dataclass(frozen=True, eq=False)
class Photographs:
    """One plane of the four photographs; `ratio` is the long exposure over the short one."""

    short: Plane
    long: Plane
    near: Plane
    defocused: Plane
    ratio: float


@dataclass(frozen=True, eq=False)
class WitnessedPsf:
    """The PSF of the long exposure, and what the others witness."""

    psf: PatternPsf
    numbers: Mapping[str, Quantity]


def witnessed_psf(
    photographs: Photographs,
    chart: Chart,
    parameters: PatternParameters | None = None,
    diffraction: Diffraction | None = None,
) -> Outcome[WitnessedPsf]:
    """The PSF of the long exposure; doubtful where a witness contradicts what the estimate assumes."""
    if not photographs.ratio >= LEAST_RATIO:
        return _refused(
            f"the long exposure must be at least {LEAST_RATIO:g} times the short one; it is {photographs.ratio:.3g} "
            "times",
            "take the first photograph with half the exposure time, and nothing else changed",
        )
    if photographs.short.samples.shape != photographs.long.samples.shape:
        return _refused("both exposures must have one size", "take both with one camera, and nothing moved")
    parameters = parameters or PatternParameters()
    sharp = replace(parameters, print_blur=0.0)
    main, near, defocused = (
        estimate_psf(plane, chart, sharp, diffraction)
        for plane in (photographs.long, photographs.near, photographs.defocused)
    )
    if main.value is None:
        return Outcome(None, main.verdict, main.reason, main.remedy, main.other_causes)
    numbers: dict[str, Quantity] = {}
    try:
        checks = [*_exposures(photographs, numbers), *_distances(photographs, main.value, near, numbers)]
    except Refused as refusal:
        return _refused(refusal.reason, refusal.remedy)
    checks.append(_defocus(defocused))
    prior = PRINT_UNKNOWN if parameters.print_blur is None else parameters.print_blur
    value = WitnessedPsf(_with_print_blur(main.value, numbers.get(WITNESS_PRINT_BLUR), prior), numbers)
    return with_causes(Outcome(value, main.verdict, main.reason, main.remedy, main.other_causes), verdict_of(checks))


def _refused(reason: str, remedy: str) -> Outcome[WitnessedPsf]:
    return Outcome(None, Verdict.REFUSED, reason, remedy)


def _flag(name: str, score: float, sentence: str, remedy: str) -> Check:
    return Check(name, score, threshold(), Verdict.DOUBTFUL, sentence, remedy)


def _exposures(photographs: Photographs, numbers: dict[str, Quantity]) -> Iterator[Check]:
    short, long = (one.samples.astype(np.float64) for one in (photographs.short, photographs.long))
    known = (long < CLIPPED) & (short < CLIPPED)
    s, y, whole = (
        uniform_filter(one, TILE)[TILE // 2 :: TILE, TILE // 2 :: TILE] for one in (short, long, 1.0 * known)
    )
    s, y = s[whole > 0.999], y[whole > 0.999]
    if len(s) < 100:
        raise Refused("the exposures must not be clipped; they are", "reduce the longer exposure")
    low, high = np.percentile(s, (2, 98))
    x = (s - (low + high) / 2) / (high - low)  # -1/2 to 1/2
    A = np.column_stack([np.ones_like(x), x, x * x - 1 / 12])
    covariance = np.linalg.inv(A.T @ A)
    c = covariance @ (A.T @ y)
    rest = y - A @ c
    u = np.sqrt(np.diag(covariance) * float(rest @ rest) / (len(y) - 3))
    slope = float(c[1] / (high - low))
    # noise of the short exposure flattens the line; it has 1 / (slope + slope^2) of the residual's variance
    slope /= 1 - float(np.var(rest)) / (slope + slope**2) / float(np.var(s))
    ratio, of_ratio = slope / photographs.ratio, float(np.hypot(u[1] / c[1], EXPOSURE_UNCERTAINTY))
    curvature, of_curvature = float(c[2] / c[1] / 4), float(np.hypot(u[2] / c[1] / 4, CURVATURE_UNCERTAINTY))
    numbers[WITNESS_RATIO] = Quantity(ratio, "1", of_ratio, "slope of long over short exposure", len(s))
    numbers[WITNESS_CURVATURE] = Quantity(curvature, "1", of_curvature, "curvature of long over short exposure", len(s))
    raw = "use the RAW file, or a linear picture"
    yield _flag("response", abs(ratio - 1) / of_ratio,
                 f"the response is not linear: {photographs.ratio:.3g} times the exposure gives "
                 f"{slope:.3g} times the signal", raw)  # fmt: skip
    yield _flag("response", abs(curvature) / of_curvature,
                 f"the response is not linear: signals of two exposures lie on a curve, {curvature:+.1%} of the range "
                 "from a line at its middle", raw)  # fmt: skip
    bend = c[0] + c[1] * _scaled(short, low, high) + c[2] * (_scaled(short, low, high) ** 2 - 1 / 12)
    radius, worst = _strongest(long - bend, known)
    numbers[WITNESS_SHARPENING] = Quantity(
        worst.value, "1", worst.uncertainty, f"unsharp mask of {radius:g} px, by noise", int(known.sum())
    )
    correlated, cause = ("anticorrelated", "an unsharp mask") if worst.value > 0 else ("correlated", "smoothing")
    yield _flag("processing", abs(worst.score),
                 f"the noise of two exposures' difference is {correlated} by {abs(worst.score):.1f} standard "
                 f"uncertainties, as by {cause} of {abs(worst.value):.1%} and {radius:g} px",
                 "use the RAW file, or switch it off")  # fmt: skip


def _scaled(samples: Array, low: float, high: float) -> Array:
    return np.asarray((samples - (low + high) / 2) / (high - low))


def _strongest(difference: Array, known: Mask) -> tuple[float, Strength]:
    """Radius and strength of the mask with the largest score in noise whose variance is made equal over the picture."""
    local = uniform_filter(difference**2, 4 * TILE + 1)
    white = difference / np.sqrt(np.maximum(local, 1e-3 * float(local.mean())))
    scores = mask_scores([Variogram.of(white - white[known].mean(), known)], MASKS_PX)
    return max(zip(MASKS_PX, scores, strict=True), key=lambda one: abs(one[1].score))


def _distances(
    photographs: Photographs, main: PatternPsf, near: Outcome[PatternPsf], numbers: dict[str, Quantity]
) -> Iterator[Check]:
    again = "focus on the chart from nearer, and photograph it again"
    if near.value is None:
        yield Check("near", True, 0, Verdict.DOUBTFUL, f"the near photograph gives no PSF: {near.reason}", near.remedy)
        return
    nearer = near.value.pixels_per_pattern / main.pixels_per_pattern
    if nearer < LEAST_NEARER:
        raise Refused(
            f"the chart must be at least {LEAST_NEARER:g} times as wide in the near photograph; it is {nearer:.2f} "
            "times",
            "photograph it from two thirds of the distance",
        )
    blur = _print_blur(main, near.value)
    numbers[WITNESS_PRINT_BLUR] = blur
    yield _flag("print", blur.value / blur.uncertainty,
                 f"the print is blurred by {np.sqrt(max(blur.value, 0)):.2f} cells, or the near photograph is out of "
                 "focus: its MTF is lower", f"print a larger chart; {again}")  # fmt: skip
    yield _flag("focus", -blur.value / blur.uncertainty,
                 "the PSF is sharper from nearer: the long exposure is out of focus, or light strays",
                 again)  # fmt: skip
    far, close = (_black(plane, one) for plane, one in ((photographs.long, main), (photographs.near, near.value)))
    change = Quantity(far - close, "1", 2**0.5 * LEVEL_UNCERTAINTY, "black over white, far less near", main.n)
    numbers[WITNESS_BLACK] = change
    yield _flag("stray light", abs(change.value) / change.uncertainty,
                 f"black over white is {far:.3f} from the distance and {close:.3f} from nearer: light strays from the "
                 "chart's white into its black",
                 "clean the lens, shade it, and keep reflections off the chart")  # fmt: skip


def _print_blur(main: PatternPsf, near: PatternPsf) -> Quantity:
    """Variance of the print's blur in squared cells, at the frequency where two distances give it best."""
    f = main.quality.frequencies
    curves = [
        (one.quality.mtf_radial, one.quality.uncertainty("radial"), one.quality.frequencies) for one in (main, near)
    ]
    (H, u), (Hn, un) = ((np.interp(f, at, mtf), np.interp(f, at, spread)) for mtf, spread, at in curves)
    cells = [(one.pixels_per_pattern / CELLS) ** 2 for one in (main, near)]
    used = (f > 0) & (np.minimum(H, Hn) > LEAST_MTF)
    scale = 1 / (2 * np.pi**2 * f[used] ** 2 * (cells[1] - cells[0]))
    uncertainty = np.sqrt((u[used] / H[used]) ** 2 + (un[used] / Hn[used]) ** 2 + FOCUS_UNCERTAINTY**2) * scale
    best = int(np.argmin(uncertainty))
    value = float(np.log(H[used][best] / Hn[used][best]) * scale[best])
    method = f"ratio of two distances' MTF at {f[used][best]:.2f} cycles/pixel"
    return Quantity(value, "1", float(uncertainty[best]), method, near.n)


def _with_print_blur(main: PatternPsf, measured: Quantity | None, prior: float) -> PatternPsf:
    """The PSF with the term of the print's blur, by its measured variance or, without one, by its prior in cells."""
    quality, variance = main.quality, prior**2
    if measured is not None and prior:
        unseen = min(measured.value, threshold() * measured.uncertainty)
        variance = nuisance(unseen, measured.uncertainty, variance)
    change = print_blur_mode(quality.frequencies, variance * (main.pixels_per_pattern / CELLS) ** 2)
    return replace(main, quality=with_modes(quality, main.psf, {PRINT_BLUR: change}))


def _black(plane: Plane, psf: PatternPsf) -> float:
    light = measure_light(plane.samples, psf.registration, plane.quantisation)
    return float(light.black[0] / light.white[0])


def _defocus(defocused: Outcome[PatternPsf]) -> Check:
    remedy = "use the RAW file, or switch sharpening off"
    if defocused.value is None:
        reason = f"the defocused photograph gives no PSF: {defocused.reason}"
        return Check("defocus", True, 0, Verdict.DOUBTFUL, reason, "defocus less, and photograph it again")
    missing = defocused.value.diagnostics["missing_light"]
    return _flag("processing", missing,
                  f"light is missing around the defocused spot, by {missing:.1f} standard uncertainties: the picture "
                  "was sharpened", remedy)  # fmt: skip
