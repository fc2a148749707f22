"""Whether a PSF can be trusted: the verdict drawn from what was measured on the way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.choice import OPEN, Trial
from procedures.outcome import SYMPTOM, Check, Outcome, Refused, Verdict, verdict_of
from procedures.pattern import AIM_S_OVER_T, GOOD_S_OVER_T
from procedures.pattern_psf.diagnostics import Diagnostics, unexplained
from procedures.pattern_psf.error_parts import Variation
from procedures.pattern_psf.radiometry import Light
from procedures.pattern_psf.refine import ChartFit
from procedures.psf import Sampling
from procedures.raw import UNLIKELY_IN_RAW, unprocessed
from procedures.sensor_model import SensorModel

Array = npt.NDArray[np.float64]

SEEN = 0.3
"""Share of the noise region that its own cells explain at the least."""
UNEXPLAINED = 0.15
"""Share of the variance that is neither chart nor noise, at the most."""
UNMODELLED = 0.03
"""The same share from which a result is doubted."""
COLOURED_RESIDUAL = 0.3
"""Correlation of neighbouring pixels' residual from which a result is doubted."""
CORRELATED = 0.25
"""Correlation of neighbouring samples' noise from which a picture was processed."""
CURVED = 0.15
"""Curvature of the response from which it is no linear picture."""
SPREAD_OUT = 0.25
"""Spread of the ink, in cells, that the model of thin outlines does not describe any more."""
CUT_OFF = 0.15
"""Share of the PSF's energy outside its support from which a result is doubted."""
LEAST_STEPS = 16
"""Digital numbers between black and white from which rounding is no worse than noise."""
OTHER_APERTURE = 3.0
"""Standard uncertainties between the far tail and the f-number's, from which one of them is wrong."""
DUG_OUT = 3.0
"""Standard uncertainties of missing light from which a picture was sharpened."""
COLOURED = 3.0
"""The same of noise whose neighbours go apart and of missing light together. White noise goes 2.6 in one photograph of
a hundred, and what a lens leaves around its core is mostly many below 0."""
HINT = 1.0
"""Of the noise alone, from which it has a say in that."""
OTHER_NOISE, SURELY = 0.1, 4.0
"""Share by which the finest noise's variance differs from the sensor's calibration, and standard uncertainties of that,
from which the picture was processed or taken at another gain."""
CRUSHED = 0.05
"""Share of black samples at one value from which black is cut off."""
LEFT_OVER = 2.0
"""Residual over noise from which a result is doubted."""
SCATTERED = 9.0
"""Variance of a number by the chart's parts, over that by noise, from which it is doubted."""
STRAY = 0.03
"""Share of the samples that are hot or dead from which a result is doubted."""
VARYING = 0.03
"""Difference of MTF50 in the chart's halves from which it is told."""


@dataclass(frozen=True)
class Doubts:
    """What a verdict looks at beside the diagnostics.

    Attributes
    ----------
    parameters : Sampling
        As asked for: what was given is obeyed, and doubted where it leaves too much out.
    chosen : bool
        Whether it was the program that chose.
    tried : tuple of Trial
    variations : tuple of Variation
    contradicted : list of Check
        What f-number and pitch forbid, as far as they are known.
    sensor : SensorModel or None
        Its calibration, which tells the noise.
    raw : bool
        Whether the photograph is a RAW file.
    """

    parameters: Sampling
    chosen: bool
    tried: tuple[Trial, ...]
    variations: tuple[Variation, ...]
    contradicted: list[Check]
    sensor: SensorModel | None = None
    raw: bool = False


def check_light(light: Light, quantisation: float) -> None:
    """Refuse what no estimate can come of: clipped white, no light, no contrast over the noise."""
    if light.saturated > 0.01:
        raise Refused(
            f"the chart's white must not be clipped; {light.saturated:.0%} of its white samples are",
            "expose less: white at 80 % of the scale is right",
        )
    steps = light.contrast / quantisation
    if steps < LEAST_STEPS:
        raise Refused(
            f"white must lie at least {LEAST_STEPS} digital numbers above black; it is {steps:.0f}",
            "expose longer or light the chart: the photograph is too dark",
        )
    noise = float(np.sqrt(max(light.variance_white, light.variance_black)))
    if light.contrast < 0.01 or light.contrast < 4 * noise:
        raise Refused(
            f"white must stand clear of black and noise; it is {light.contrast:.3f} of the scale above black, with "
            f"noise of {noise:.3f}",
            "expose longer or light the chart: the photograph is too dark",
        )


def check_cells(fit: ChartFit) -> None:
    """Raises Refused where the noise region does not show the cells: nothing else can be told then."""
    seen: Outcome[ChartFit] = verdict_of(_unseen(fit.agreement, unexplained(fit)), fit)
    seen.result()


def _unseen(agreement: float, unexplained: float) -> list[Check]:
    """Other cells, or none that can be seen."""
    refused, other_cells = Verdict.REFUSED, unexplained > 0.1
    return [
        Check("cells", agreement, SEEN, refused,
              f"the noise region shows other cells than expected: they explain {max(agreement, 0):.0%} of it",
              "give the chart's own cells (--bits or --seed, printed on the sheet) and photograph it unmirrored",
              least=True, given=other_cells),
        Check("cells", agreement, SEEN, refused,
              f"the noise region is blurred or noisy beyond use: the cells explain {max(agreement, 0):.0%} of it",
              "focus, and expose longer", least=True, given=not other_cells),
    ]  # fmt: skip


def misfits(fit: ChartFit) -> bool:
    """Whether a fit would be refused for what it leaves over."""
    return fit.agreement < SEEN or unexplained(fit) > UNEXPLAINED


def checks_of(d: Diagnostics, fit: ChartFit, more: Doubts) -> list[Check]:
    """All checks on a PSF."""
    return [
        *_refusals(d, more.raw), *_doubts(d, fit), *_left_out(more), *_processed(d, more),
        *_other_noise(d, more.sensor, more.raw), *_mismatched(d, more.raw), *more.contradicted,
        *_varying(more.variations),
    ]  # fmt: skip


def _refusals(d: Diagnostics, raw: bool) -> list[Check]:
    """What makes a PSF unusable."""
    refused = Verdict.REFUSED
    return [
        *_unseen(d.agreement, d.unexplained),
        Check("noise correlation", abs(d.noise_correlation), CORRELATED, refused,
              f"{d.unexplained:.0%} of the noise region is neither the chart nor noise, and its noise is correlated "
              f"by {d.noise_correlation:.2f}: "
              + (IN_RAW if raw else "the picture was demosaiced, smoothed, turned or resized"),
              unprocessed(raw, "use the RAW file"), given=d.unexplained > UNEXPLAINED, prior=_processing(raw)),
        Check("unexplained", d.unexplained, UNEXPLAINED, refused,
              f"{d.unexplained:.0%} of the noise region is neither the chart nor noise: the registration slipped, or "
              "something lies before the chart",
              "lay the chart flat, keep all its marks in view and free of reflections, and photograph it again",
              prior=SYMPTOM),
        Check("support", d.support_cut, 0.3, refused,
              f"{d.support_cut:.0%} of the PSF's energy lies outside its support", "focus, or raise k"),
        Check("uncertainty", d.relative_uncertainty, 1.0, refused,
              f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
              "expose longer, or lower s or k"),
        Check("marks", d.marks_offset_px, 0.75, refused,
              f"the marks lie {d.marks_offset_px:.2f} pixel from where the cells put them: the centre is not known",
              "keep the marks free of reflections and shadows"),
    ]  # fmt: skip


IN_RAW = "the camera reduced the noise, or the light flickered"
"""What correlates the noise of a RAW file."""


def _processing(raw: bool) -> float:
    """Prior of processing as the cause."""
    return UNLIKELY_IN_RAW if raw else 1.0


def _doubts(d: Diagnostics, fit: ChartFit) -> list[Check]:
    """What leaves a PSF usable but less than the photograph could have given."""
    doubtful, stray = Verdict.DOUBTFUL, d.stray_samples
    low, high = GOOD_S_OVER_T
    return [
        Check("convergence", not fit.still, 0, doubtful,
              "the registration did not converge", "photograph the chart more squarely"),
        Check("unexplained", d.unexplained, UNMODELLED, doubtful,
              f"{d.unexplained:.1%} of the noise region is neither the chart nor noise",
              "lay the chart flat and light it evenly", prior=SYMPTOM),
        Check("whiteness", abs(d.whiteness), COLOURED_RESIDUAL, doubtful,
              f"the residual is not white: neighbouring pixels are correlated by {d.whiteness:.0%}",
              "raise k, lay the chart flat, and keep reflections off it", prior=SYMPTOM),
        Check("support", d.support_cut, CUT_OFF, doubtful,
              f"about {d.support_cut:.0%} of the PSF's energy lies outside its support", "focus, or raise k"),
        Check("uncertainty", d.relative_uncertainty, 0.3, doubtful,
              f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
              "expose longer, take more shots, or lower s or k"),
        Check("sampling ratio", max(low / d.s_over_t, d.s_over_t / high), 1.0, doubtful,
              f"the sampling ratio s/t is {d.s_over_t:.2f}; {low:g} to {high:g} is good",
              f"photograph from {d.s_over_t / AIM_S_OVER_T:.2g} times the distance"),
        Check("outliers", d.outliers, 0.02, doubtful,
              f"{d.outliers:.1%} of the samples do not fit the chart",
              "clean the chart and keep everything out of its way"),
        Check("stray samples", stray, STRAY * (stray + len(fit.observation)), doubtful,
              f"{stray:.0f} samples of the sensor do not follow the light (hot or dead)",
              "expose less long or at a lower gain, with the camera cool"),
        Check("flatness", d.flatness, 0.5, doubtful,
              f"the darkest white block has {d.flatness:.0%} of the brightest's light", "light the chart evenly",
              least=True),
    ]  # fmt: skip


def _left_out(more: Doubts) -> list[Check]:
    """What s and k as they were given leave out."""
    doubtful, last, obeyed = Verdict.DOUBTFUL, more.tried[-1], not more.chosen
    would = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else ""
    farther = "raise s, from a distance at which the cells allow it"
    return [
        Check("truncation", last.truncation, last.most_truncated, doubtful,
              f"k = {last.k} may leave out {last.truncation:.4f} of the OTF, which is known to {last.uncertainty:.4f}",
              would or "raise k", given=more.parameters.k is not None and obeyed),
        Check("band edge", last.band_edge, OPEN, doubtful,
              f"s = {last.s} ends the band where the OTF is still {last.band_edge:.2f}",
              would if last.better and last.better[0] > last.s else farther,
              given=more.parameters.s is not None and obeyed),
        Check("MTF50", None in last.mtf50, 0, doubtful, f"MTF50 lies beyond the band of s = {last.s}", farther),
    ]  # fmt: skip


def _processed(d: Diagnostics, more: Doubts) -> list[Check]:
    """What a camera's processing leaves in a photograph."""
    doubtful, raw, prior = Verdict.DOUBTFUL, more.raw, _processing(more.raw)
    less = "expose less" if more.sensor else "expose less, or calibrate the sensor's response"
    structured = d.unexplained > UNMODELLED or abs(d.whiteness) > COLOURED_RESIDUAL
    # uneven light, reflections and a support that is too small leave such rings as well
    sharpened = SYMPTOM if raw or structured or d.support_cut > CUT_OFF else 1.0
    by = "uneven light or a reflection" if raw else "the picture was sharpened"
    unsharpened = (
        "light the chart evenly, and keep reflections and shadows off it"
        if raw
        else "use the RAW file, or switch sharpening off"
    )
    masked = float(np.hypot(d.sharpened_sigmas, max(d.missing_light, 0.0)))
    return [
        Check("noise correlation", abs(d.noise_correlation), CORRELATED, doubtful,
              f"the noise of neighbouring samples is correlated by {d.noise_correlation:.2f}: "
              + (IN_RAW if raw else "the picture was demosaiced, sharpened or compressed"),
              unprocessed(raw, "use the RAW file"), given=abs(d.whiteness) > CORRELATED / 2, prior=prior),
        Check("sharpening", d.missing_light, DUG_OUT, doubtful,
              f"a ring around the PSF's core has less light than a lens leaves, by {d.missing_light:.0f} standard "
              f"uncertainties: {by}", unsharpened, prior=sharpened),
        Check("sharpening", masked, COLOURED, doubtful,
              f"the noise of neighbouring pixels is anticorrelated, by {d.sharpened_sigmas:.1f} standard "
              f"uncertainties, as by an unsharp mask of {d.sharpened_by:.0%} and {d.sharpened_radius_px:g} px: {by}",
              unsharpened, given=d.sharpened_sigmas > HINT, prior=sharpened),
        Check("black", d.crushed, CRUSHED, doubtful,
              f"black is cut off: {d.crushed:.0%} of its samples lie at one value",
              "raise the black level (offset) of the camera" if raw else "use the RAW file, or raise the black level"),
        Check("response", abs(d.response_curvature), CURVED, doubtful,
              f"the response is curved by {d.response_curvature:.2f}"
              + ("" if raw else ": a tone curve, or light that is not linear"),
              less if raw else "use the RAW file, or a linear picture"),
        Check("ink spread", abs(d.ink_spread), SPREAD_OUT, doubtful,
              f"the cells' edges moved by {d.ink_spread:.2f} cells in print",
              "print with less ink, on paper that does not take it up, or print a larger chart"),
    ]  # fmt: skip


def _other_noise(d: Diagnostics, sensor: SensorModel | None, raw: bool) -> list[Check]:
    """Noise that the sensor's calibration does not know."""
    if sensor is None:
        return []
    off = abs(d.finest_noise - 1)
    uncertainty = float(np.hypot(d.finest_noise * d.finest_noise_uncertainty, sensor.gain_uncertainty / sensor.gain))
    what = "sharpened" if d.finest_noise > 1 else "smoothed"
    return [
        Check("noise of the sensor", off, max(OTHER_NOISE, SURELY * uncertainty), Verdict.DOUBTFUL,
              f"noise from pixel to pixel has {d.finest_noise:.2f} ± {uncertainty:.2f} times the variance that the "
              f"sensor's calibration tells: the picture was {'' if raw else f'{what}, or '}taken at another gain",
              f"{'take it' if raw else 'use the RAW file,'} at the gain of the calibration"),
    ]  # fmt: skip


def _mismatched(d: Diagnostics, raw: bool) -> list[Check]:
    """What the model leaves over, and what contradicts it."""
    doubtful, less = Verdict.DOUBTFUL, d.tail_sigmas < 0
    plain = "lay the chart flat, light it evenly, and let nothing move"
    return [
        Check("tail", abs(d.tail_sigmas), OTHER_APERTURE, doubtful,
              f"the far tail lies {abs(d.tail_sigmas):.0f} standard uncertainties from what the f-number tells"
              + (": there is less light, as where a picture was sharpened" if less else ""),
              "check f-number and pixel pitch" + (", or use the RAW file" if less and not raw else "")),
        Check("residual", d.residual_std, LEFT_OVER, doubtful,
              f"the residual is {d.residual_std:.1f} times the noise",
              plain if raw else f"{plain}; keep the picture unprocessed", prior=SYMPTOM),
        Check("parts", d.mismatch**0.5, SCATTERED**0.5, doubtful,
              f"parts of the chart disagree: {d.mismatch**0.5:.1f} times as far as noise explains",
              "lay the chart flat, square to the camera, and light it evenly", prior=SYMPTOM),
    ]  # fmt: skip


def _varying(variations: tuple[Variation, ...]) -> Iterator[Check]:
    """A PSF that is not the same all over the chart."""
    for one in variations:
        a, b = one.values
        yield Check("variation", abs(a - b), VARYING * (a + b) / 2, Verdict.DOUBTFUL,
                    f"the PSF varies over the chart: {one.name} is {a:.4f} {one.halves[0]} and {b:.4f} {one.halves[1]}",
                    "square the camera to the chart, or let it fill less of the frame",
                    given=abs(one.sigmas) > 5)  # fmt: skip
