"""Whether a PSF can be trusted: the verdict drawn from what was measured on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.choice import Trial
from procedures.outcome import Refused, Rule, Verdict, verdict_of
from procedures.pattern import AIM_S_OVER_T, GOOD_S_OVER_T
from procedures.pattern_psf.diagnostics import Diagnostics, unexplained
from procedures.pattern_psf.error_parts import Variation
from procedures.pattern_psf.radiometry import Light
from procedures.pattern_psf.refine import ChartFit
from procedures.psf import Sampling
from procedures.sensor_model import SensorModel

Array = npt.NDArray[np.float64]

SEEN = 0.3
"""Share of the noise region that its own cells explain at the least."""
UNEXPLAINED = 0.15
"""Share of the variance that is neither chart nor noise, at the most."""
CORRELATED = 0.25
"""Correlation of neighbouring samples' noise from which a picture was processed."""
CURVED = 0.15
"""Curvature of the response from which it is no linear picture."""
SPREAD_OUT = 0.25
"""Spread of the ink, in cells, that the model of thin outlines does not describe any more."""
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
    contradicted : list of Rule
        What f-number and pitch forbid, as far as they are known.
    sensor : SensorModel or None
        Its calibration, which tells the noise.
    """

    parameters: Sampling
    chosen: bool
    tried: tuple[Trial, ...]
    variations: tuple[Variation, ...]
    contradicted: list[Rule]
    sensor: SensorModel | None = None


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
    verdict, reason, remedy = verdict_of(_unseen(fit.agreement, unexplained(fit)))
    if verdict is Verdict.REFUSED:
        raise Refused(reason, remedy)


def _unseen(agreement: float, unexplained: float) -> list[Rule]:
    """Other cells, or none that can be seen."""
    return [
        Rule(
            Verdict.REFUSED,
            agreement < SEEN and unexplained > 0.1,
            f"the noise region shows other cells than expected: they explain {max(agreement, 0):.0%} of it",
            "give the chart's own cells (--bits or --seed, printed on the sheet) and photograph it unmirrored",
        ),
        Rule(
            Verdict.REFUSED,
            agreement < SEEN,
            f"the noise region is blurred or noisy beyond use: the cells explain {max(agreement, 0):.0%} of it",
            "focus, and expose longer",
        ),
    ]


def misfits(fit: ChartFit) -> bool:
    """Whether a fit would be refused for what it leaves over."""
    return fit.agreement < SEEN or unexplained(fit) > UNEXPLAINED


def judge(d: Diagnostics, fit: ChartFit, more: Doubts) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy: the first refusal, else all doubts together."""
    doubts = _doubts(d, fit) + _left_out(more) + _processed(d) + _other_noise(d, more.sensor)
    return verdict_of(_refusals(d) + doubts + _mismatched(d) + more.contradicted + _varying(more.variations))


def _refusals(d: Diagnostics) -> list[Rule]:
    """What makes a PSF unusable, the most telling first."""
    refused = Verdict.REFUSED
    return [
        *_unseen(d.agreement, d.unexplained),
        Rule(
            refused,
            d.unexplained > UNEXPLAINED and abs(d.noise_correlation) > CORRELATED,
            f"{d.unexplained:.0%} of the noise region is neither the chart nor noise, and its noise is correlated "
            f"by {d.noise_correlation:.2f}: the picture was demosaiced, smoothed, turned or resized",
            "use the RAW file",
        ),
        Rule(
            refused,
            d.unexplained > UNEXPLAINED,
            f"{d.unexplained:.0%} of the noise region is neither the chart nor noise: the registration slipped, or "
            "something lies before the chart",
            "lay the chart flat, keep all its marks in view and free of reflections, and photograph it again",
        ),
        Rule(
            refused,
            d.support_cut > 0.3,
            f"{d.support_cut:.0%} of the PSF's energy lies outside its support",
            "focus, or raise k",
        ),
        Rule(
            refused,
            d.relative_uncertainty > 1,
            f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
            "expose longer, or lower s or k",
        ),
        Rule(
            refused,
            d.marks_offset_px > 0.75,
            f"the marks lie {d.marks_offset_px:.2f} pixel from where the cells put them: the centre is not known",
            "keep the marks free of reflections and shadows",
        ),
    ]


def _doubts(d: Diagnostics, fit: ChartFit) -> list[Rule]:
    """What leaves a PSF usable but less than the photograph could have given."""
    doubtful, stray = Verdict.DOUBTFUL, d.stray_samples
    return [
        Rule(doubtful, not fit.still, "the registration did not come to rest", "photograph the chart more squarely"),
        Rule(
            doubtful,
            d.unexplained > 0.03,
            f"{d.unexplained:.1%} of the noise region is neither the chart nor noise",
            "lay the chart flat and light it evenly",
        ),
        Rule(
            doubtful,
            abs(d.whiteness) > 0.3,
            f"what the fit leaves is not white: neighbouring pixels share {d.whiteness:.0%} of it",
            "raise k, lay the chart flat, and keep reflections off it",
        ),
        Rule(
            doubtful,
            d.support_cut > 0.15,
            f"about {d.support_cut:.0%} of the PSF's energy lies outside its support",
            "focus, or raise k",
        ),
        Rule(
            doubtful,
            d.relative_uncertainty > 0.3,
            f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
            "expose longer, take more shots, or lower s or k",
        ),
        Rule(
            doubtful,
            not GOOD_S_OVER_T[0] <= d.s_over_t <= GOOD_S_OVER_T[1],
            f"the sampling ratio s/t is {d.s_over_t:.2f}; {GOOD_S_OVER_T[0]:g} to {GOOD_S_OVER_T[1]:g} is good",
            f"photograph from {d.s_over_t / AIM_S_OVER_T:.2g} times the distance",
        ),
        Rule(
            doubtful,
            d.outliers > 0.02,
            f"{d.outliers:.1%} of the samples do not fit the chart",
            "clean the chart and keep everything out of its way",
        ),
        Rule(
            doubtful,
            stray > STRAY * (stray + len(fit.observation)),
            f"{stray:.0f} samples of the sensor do not follow the light (hot or dead)",
            "expose less long or at a lower gain, with the camera cool",
        ),
        Rule(
            doubtful,
            d.flatness < 0.5,
            f"the darkest white block has {d.flatness:.0%} of the brightest's light",
            "light the chart evenly",
        ),
    ]


def _left_out(more: Doubts) -> list[Rule]:
    """What s and k as they were given leave out."""
    last, chosen = more.tried[-1], more.chosen
    would = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else ""
    farther = "raise s, from a distance at which the cells allow it"
    return [
        Rule(
            Verdict.DOUBTFUL,
            more.parameters.k is not None and not chosen and last.support_short,
            f"k = {last.k} may leave out {last.truncation:.4f} of the OTF, which is known to {last.uncertainty:.4f}",
            would or "raise k",
        ),
        Rule(
            Verdict.DOUBTFUL,
            more.parameters.s is not None and not chosen and last.band_open,
            f"s = {last.s} ends the band where the OTF is still {last.band_edge:.2f}",
            would if last.better and last.better[0] > last.s else farther,
        ),
        Rule(
            Verdict.DOUBTFUL,
            None in last.mtf50,
            f"MTF50 lies beyond the band of s = {last.s}",
            farther,
        ),
    ]


def _processed(d: Diagnostics) -> list[Rule]:
    """What a camera's processing leaves in a photograph."""
    doubtful = Verdict.DOUBTFUL
    return [
        Rule(
            doubtful,
            abs(d.noise_correlation) > CORRELATED and abs(d.whiteness) > CORRELATED / 2,
            f"the noise of neighbouring samples is correlated by {d.noise_correlation:.2f}: the picture was "
            "demosaiced, sharpened or compressed",
            "use the RAW file",
        ),
        Rule(
            doubtful,
            d.missing_light > DUG_OUT,
            f"a ring around the PSF's core has less light than a lens leaves, by {d.missing_light:.0f} standard "
            "uncertainties: the picture was sharpened",
            "use the RAW file, or switch sharpening off",
        ),
        Rule(
            doubtful,
            d.sharpened_sigmas > HINT and np.hypot(d.sharpened_sigmas, max(d.missing_light, 0.0)) > COLOURED,
            f"the noise of neighbouring pixels goes apart, by {d.sharpened_sigmas:.1f} standard uncertainties, as a "
            f"mask of {d.sharpened_by:.0%} and {d.sharpened_radius_px:g} px makes it: the picture was sharpened",
            "use the RAW file, or switch sharpening off",
        ),
        Rule(
            doubtful,
            d.crushed > CRUSHED,
            f"black is cut off: {d.crushed:.0%} of its samples lie at one value",
            "use the RAW file, or raise the black level",
        ),
        Rule(
            doubtful,
            abs(d.response_curvature) > CURVED,
            f"the response is curved by {d.response_curvature:.2f}: a tone curve, or light that is not linear",
            "use the RAW file, or a linear picture",
        ),
        Rule(
            doubtful,
            abs(d.ink_spread) > SPREAD_OUT,
            f"the cells' edges moved by {d.ink_spread:.2f} cells in print",
            "print with less ink, on paper that does not take it up, or print a larger chart",
        ),
    ]


def _other_noise(d: Diagnostics, sensor: SensorModel | None) -> list[Rule]:
    """Noise that the sensor's calibration does not know."""
    if sensor is None:
        return []
    off = abs(d.finest_noise - 1)
    uncertainty = float(np.hypot(d.finest_noise * d.finest_noise_uncertainty, sensor.gain_uncertainty / sensor.gain))
    what = "sharpened" if d.finest_noise > 1 else "smoothed"
    return [
        Rule(
            Verdict.DOUBTFUL,
            off > max(OTHER_NOISE, SURELY * uncertainty),
            f"noise from pixel to pixel has {d.finest_noise:.2f} ± {uncertainty:.2f} times the variance that the "
            f"sensor's calibration tells: the picture was {what}, or taken at another gain",
            "use the RAW file, at the gain of the calibration",
        )
    ]


def _mismatched(d: Diagnostics) -> list[Rule]:
    """What the model leaves over, and what contradicts it."""
    doubtful = Verdict.DOUBTFUL
    return [
        Rule(
            doubtful,
            abs(d.tail_sigmas) > OTHER_APERTURE,
            f"the far tail lies {abs(d.tail_sigmas):.0f} standard uncertainties from what the f-number tells"
            + (": there is less light, as where a picture was sharpened" if d.tail_sigmas < 0 else ""),
            "check f-number and pixel pitch" + (", or use the RAW file" if d.tail_sigmas < 0 else ""),
        ),
        Rule(
            doubtful,
            d.residual_std > LEFT_OVER,
            f"what the fit leaves is {d.residual_std:.1f} times the noise",
            "lay the chart flat, light it evenly, let nothing move, and keep the picture unprocessed",
        ),
        Rule(
            doubtful,
            d.mismatch > SCATTERED,
            f"parts of the chart disagree: {d.mismatch**0.5:.1f} times as far as noise explains",
            "lay the chart flat, square to the camera, and light it evenly",
        ),
    ]


def _varying(variations: tuple[Variation, ...]) -> list[Rule]:
    """A PSF that is not the same all over the chart."""
    rules = []
    for one in variations:
        a, b = one.values
        reason = f"the PSF varies over the chart: {one.name} is {a:.4f} {one.halves[0]} and {b:.4f} {one.halves[1]}"
        varies = abs(one.sigmas) > 5 and abs(a - b) > VARYING * (a + b) / 2
        rules.append(
            Rule(Verdict.DOUBTFUL, varies, reason, "square the camera to the chart, or let it fill less of the frame")
        )
    return rules
