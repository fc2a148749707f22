"""Verdict on a PSF: checks of the diagnostics against their thresholds."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procedures.choice import OPEN, Trial
from procedures.clipping import SensorModel
from procedures.corruption.family import threshold
from procedures.numerics.arrays import Array
from procedures.outcome import SYMPTOM, Check, Refused, Verdict, verdict_of
from procedures.pattern import AIM_S_OVER_T, GOOD_S_OVER_T
from procedures.pattern_psf.diagnostics import Diagnostics, unexplained
from procedures.pattern_psf.error_parts import Variation
from procedures.pattern_psf.radiometry import LightLevels
from procedures.pattern_psf.refine import ChartFit
from procedures.pattern_psf.registration import mark_residuals
from procedures.psf import Psf, Sampling
from procedures.raw import UNLIKELY_IN_RAW, unprocessed

MIN_AGREEMENT = 0.3  # least share of the noise region's variance that the expected cells must explain
MAX_UNEXPLAINED = 0.15  # greatest share of the variance that is neither chart nor noise; above it the result is refused
DOUBTFUL_UNEXPLAINED = 0.03  # share of the variance that is neither chart nor noise above which a result is doubtful
MAX_RESIDUAL_CORRELATION = 0.3  # correlation of the residual at neighbouring pixels above which a result is doubtful
MAX_NOISE_CORRELATION = 0.25  # noise correlation of neighbouring samples above which the picture was processed
MAX_CURVATURE = 0.15  # curvature of the response above which, and beyond its own uncertainty, the picture is not linear
MAX_INK_SPREAD = 0.25  # ink spread, in cells, above which the model of thin outlines fails
MAX_SUPPORT_CUT = 0.15  # share of the PSF's energy outside its support above which a result is doubtful
MIN_CONTRAST_STEPS = 16  # digital numbers between black and white above which rounding is no worse than noise
TAIL_SIGMAS = 3.0
"""Standard uncertainties between the fitted far tail and that of the f-number above which one of them is wrong."""
MAX_UNCERTAINTY = 0.5  # relative uncertainty of the PSF above which it is doubtful; Gaussians of 2 px have 0.3 to 0.4
MISSING_LIGHT_SIGMAS = 3.0  # standard uncertainties of missing light above which the picture was sharpened
MAX_NOISE_DIFFERENCE, NOISE_DIFFERENCE_SIGMAS = 0.1, 4.0
"""Relative difference of the finest noise's variance from the sensor's calibration, and its significance, above which
the picture was processed or taken at another gain."""
MAX_BLACK_CLIPPING = 0.05  # share of black samples at one value above which black is clipped
MAX_RESIDUAL = 2.0  # residual in units of the noise above which a result is doubtful
MAX_MISMATCH = 9.0  # variance of a number over the chart's tiles, relative to that by noise, above which it is doubtful
MAX_STRAY = 0.03  # share of hot or dead samples above which a result is doubtful
MAX_VARIATION = 0.03  # relative difference of MTF50 between the chart's halves above which it is reported


@dataclass(frozen=True)
class VerdictInputs:
    """Inputs of the verdict in addition to the diagnostics.

    parameters : as requested. Given values of s and k are used, and flagged where they truncate the PSF or its band.
    chosen : whether the program chose s and k
    contradicted : violations of the diffraction limit, where f-number and pitch are known
    sensor : the sensor's calibration, which gives the noise
    raw : whether the photograph is a RAW file
    """

    parameters: Sampling
    chosen: bool
    tried: tuple[Trial, ...]
    variations: tuple[Variation, ...]
    contradicted: list[Check]
    sensor: SensorModel | None = None
    raw: bool = False


def check_light(light: LightLevels, quantisation: float) -> None:
    """Raise Refused for photographs without an estimate: clipped white, too dark, or contrast below the noise."""
    if light.saturated > 0.01:
        raise Refused(
            f"at most 1 % of the chart's white samples may be clipped; {light.saturated:.0%} are",
            "reduce the exposure until white lies at 80 % of full scale",
        )
    steps = light.contrast / quantisation
    if steps < MIN_CONTRAST_STEPS:
        raise Refused(
            f"the photograph is too dark: white must lie at least {MIN_CONTRAST_STEPS} digital numbers above black; "
            f"it lies {steps:.0f} above",
            "expose longer, or add light to the chart",
        )
    noise = float(np.sqrt(max(light.variance_white, light.variance_black)))
    if light.contrast < 0.01 or light.contrast < 4 * noise:
        raise Refused(
            "the photograph is too dark: the contrast of the chart must be at least 0.01 of full scale and 4 times the "
            f"noise; it is {light.contrast:.3f}, with noise of {noise:.3f}",
            "expose longer, or add light to the chart",
        )


def check_cells(fit: ChartFit) -> None:
    """Raise Refused where the noise region does not show the expected cells; no other check is meaningful then."""
    verdict_of(_cell_checks(fit.agreement, unexplained(fit)), fit).result()


def _cell_checks(agreement: float, unexplained: float) -> list[Check]:
    refused, other_cells = Verdict.REFUSED, unexplained > 0.1
    return [
        Check("cells", agreement, MIN_AGREEMENT, refused,
              f"the chart shows other cells than expected: those explain {max(agreement, 0):.0%} of the noise region",
              "give the seed printed on the sheet (--seed) or the file of its cells (--bits)",
              least=True, given=other_cells),
        Check("cells", agreement, MIN_AGREEMENT, refused,
              "the noise region is too blurred or too noisy: the cells explain "
              f"{max(agreement, 0):.0%} of its variance",
              "focus, and expose longer", least=True, given=not other_cells),
    ]  # fmt: skip


def is_misfit(fit: ChartFit) -> bool:
    """Whether a fit would be refused for its residual."""
    return fit.agreement < MIN_AGREEMENT or unexplained(fit) > MAX_UNEXPLAINED


def checks_of(d: Diagnostics, fit: ChartFit, inputs: VerdictInputs) -> list[Check]:
    """All checks on a PSF but those that refuse it."""
    return [
        *_doubtful_checks(d, fit), *_truncation_checks(inputs, d.unexplained),
        *_processing_checks(d, inputs), *_noise_checks(d, inputs.sensor, inputs.raw),
        *_model_checks(d, inputs.raw), *inputs.contradicted,
        *_variation_checks(inputs.variations),
    ]  # fmt: skip


def refusal_checks(fit: ChartFit, psf: Psf, light: LightLevels, corners: Array, *, raw: bool) -> list[Check]:
    """Checks that refuse a normalised PSF; `corners` (12, 2) are the detected marks."""
    refused, left, correlation = Verdict.REFUSED, unexplained(fit), light.noise_correlation
    uncertainty = psf.relative_uncertainty
    offset_px = float(np.linalg.norm(mark_residuals(fit.registration, corners).mean(axis=0)))
    return [
        *_cell_checks(fit.agreement, left),
        Check("noise correlation", abs(correlation), MAX_NOISE_CORRELATION, refused,
              f"{left:.0%} of the noise region's variance is neither chart nor noise, and the noise of "
              f"neighbouring samples is correlated by {correlation:.2f}: "
              + (IN_RAW if raw else "the picture was demosaiced, smoothed, rotated or resized"),
              unprocessed(raw, "use the RAW file"), given=left > MAX_UNEXPLAINED, prior=_processing(raw)),
        Check("unexplained", left, MAX_UNEXPLAINED, refused,
              f"{left:.0%} of the noise region's variance is neither chart nor noise: the registration "
              "failed, or something covers the chart",
              "flatten the chart, keep all its marks visible and free of reflections, and photograph it again",
              prior=SYMPTOM),
        Check("support", fit.cut, 0.3, refused,
              f"about {fit.cut:.0%} of the PSF's energy lies outside its support", "focus, or raise k"),
        Check("uncertainty", uncertainty, 1.0, refused,
              f"the PSF's uncertainty is {uncertainty:.0%} of the PSF",
              "expose longer, or lower s or k"),
        Check("marks", offset_px, 0.75, refused,
              f"the PSF's centre is not determined: the marks lie {offset_px:.2f} px from their positions by "
              "the cells",
              "keep the marks free of reflections and shadows"),
    ]  # fmt: skip


IN_RAW = "the camera applied noise reduction, or the light flickered"  # cause of correlated noise in a RAW file


def _processing(raw: bool) -> float:
    return UNLIKELY_IN_RAW if raw else 1.0


def _doubtful_checks(d: Diagnostics, fit: ChartFit) -> list[Check]:
    doubtful, stray = Verdict.DOUBTFUL, d.stray_samples
    low, high = GOOD_S_OVER_T
    return [
        Check("convergence", not fit.converged, 0, doubtful,
              "the registration did not converge", "square the chart to the camera"),
        Check("unexplained", d.unexplained, DOUBTFUL_UNEXPLAINED, doubtful,
              f"{d.unexplained:.1%} of the noise region's variance is neither chart nor noise",
              "flatten the chart and light it evenly", prior=SYMPTOM),
        Check("whiteness", abs(d.whiteness), MAX_RESIDUAL_CORRELATION, doubtful,
              f"the residual is not white: its correlation at neighbouring pixels is {d.whiteness:.2f}",
              "raise k, flatten the chart, and keep reflections off it", prior=SYMPTOM),
        Check("support", d.support_cut, MAX_SUPPORT_CUT, doubtful,
              f"about {d.support_cut:.0%} of the PSF's energy lies outside its support", "focus, or raise k"),
        Check("uncertainty", d.relative_uncertainty, MAX_UNCERTAINTY, doubtful,
              f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
              "expose longer, take more shots, or lower s or k"),
        Check("sampling ratio", max(low / d.s_over_t, d.s_over_t / high), 1.0, doubtful,
              f"the sampling ratio s/t must be {low:g} to {high:g}; it is {d.s_over_t:.2f}",
              f"photograph from {d.s_over_t / AIM_S_OVER_T:.2g} times the distance"),
        Check("outliers", d.outliers, 0.02, doubtful,
              f"{d.outliers:.1%} of the samples are outliers",
              "clean the chart, and clear what covers it"),
        Check("stray samples", stray, MAX_STRAY * (stray + len(fit.observation)), doubtful,
              f"{stray:.0f} pixels of the sensor are hot or dead",
              "use a shorter exposure or a lower gain, with the camera cool"),
        Check("flatness", d.flatness, 0.5, doubtful,
              f"the lighting is uneven: the darkest white block has {d.flatness:.0%} of the brightest's level",
              "light the chart evenly",
              least=True),
    ]  # fmt: skip


def _truncation_checks(inputs: VerdictInputs, unexplained: float) -> list[Check]:
    """Checks of the PSF's energy and band that the given s and k exclude."""
    doubtful, last, obeyed = Verdict.DOUBTFUL, inputs.tried[-1], not inputs.chosen
    would = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else ""
    undersampled = Verdict.REFUSED if unexplained > MAX_UNEXPLAINED else doubtful  # what the band excludes remains
    farther = "raise s, and photograph from a distance where s/t stays near its best"
    return [
        Check("truncation", last.truncation, last.most_truncated, doubtful,
              f"k = {last.k} may truncate {last.truncation:.4f} of the OTF, with uncertainty {last.uncertainty:.4f}",
              would or "raise k", given=inputs.parameters.k is not None and obeyed),
        Check("band edge", last.band_edge, OPEN, undersampled,
              f"s = {last.s} undersamples the PSF: the OTF is still {last.band_edge:.2f} at the band's edge",
              would if last.better and last.better[0] > last.s else farther,
              given=inputs.parameters.s is not None and obeyed),
        Check("MTF50", None in last.mtf50, 0, doubtful, f"MTF50 lies beyond the band of s = {last.s}", farther),
    ]  # fmt: skip


def is_structured(d: Diagnostics) -> bool:
    """Whether uneven light, reflections or a small support structure the residual, and imitate processing."""
    coloured = d.unexplained > DOUBTFUL_UNEXPLAINED or abs(d.whiteness) > MAX_RESIDUAL_CORRELATION
    return coloured or d.support_cut > MAX_SUPPORT_CUT


def _processing_checks(d: Diagnostics, inputs: VerdictInputs) -> list[Check]:
    doubtful, raw, prior = Verdict.DOUBTFUL, inputs.raw, _processing(inputs.raw)
    less = "expose less" if inputs.sensor else "expose less, or calibrate the sensor's response"
    sharpened = SYMPTOM if raw or is_structured(d) else 1.0
    origin = "uneven light or a reflection" if raw else "the picture was sharpened"
    remedy = (
        "light the chart evenly, and keep reflections and shadows off it"
        if raw
        else "use the RAW file, or switch sharpening off"
    )
    return [
        Check("noise correlation", abs(d.noise_correlation), MAX_NOISE_CORRELATION, doubtful,
              f"the noise of neighbouring samples is correlated by {d.noise_correlation:.2f}: "
              + (IN_RAW if raw else "the picture was demosaiced, sharpened or compressed"),
              unprocessed(raw, "use the RAW file"), given=abs(d.whiteness) > MAX_NOISE_CORRELATION / 2, prior=prior),
        Check("sharpening", d.missing_light, MISSING_LIGHT_SIGMAS, doubtful,
              f"a ring around the PSF's core is darker than any lens makes it, by {d.missing_light:.0f} standard "
              f"uncertainties: {origin}", remedy, prior=sharpened),
        Check("black", d.crushed, MAX_BLACK_CLIPPING, doubtful,
              f"black is clipped: {d.crushed:.0%} of its samples have one value",
              "raise the black level (offset) of the camera" if raw else "use the RAW file, or raise the black level"),
        Check("response", abs(d.response_curvature), MAX_CURVATURE + threshold() * d.response_uncertainty, doubtful,
              f"the response is not linear: its curvature is {d.response_curvature:.2f} ± {d.response_uncertainty:.2f}"
              + ("" if raw else ", as of a tone curve"),
              less if raw else "use the RAW file, or a linear picture"),
        Check("ink spread", abs(d.ink_spread), MAX_INK_SPREAD, doubtful,
              f"the ink spread by {d.ink_spread:.2f} cells",
              "print with less ink, on coated paper, or print a larger chart"),
    ]  # fmt: skip


def _noise_checks(d: Diagnostics, sensor: SensorModel | None, raw: bool) -> list[Check]:
    if sensor is None:
        return []
    off = abs(d.finest_noise - 1)
    uncertainty = float(np.hypot(d.finest_noise * d.finest_noise_uncertainty, sensor.gain_uncertainty / sensor.gain))
    threshold = max(MAX_NOISE_DIFFERENCE, NOISE_DIFFERENCE_SIGMAS * uncertainty)
    what = "sharpened" if d.finest_noise > 1 else "smoothed"
    return [
        Check("noise of the sensor", off, threshold, Verdict.DOUBTFUL,
              f"the noise variance is {d.finest_noise:.2f} ± {uncertainty:.2f} times that of the sensor's calibration: "
              f"the picture was {'' if raw else f'{what}, or '}taken at another gain",
              f"{'photograph' if raw else 'use the RAW file,'} at the gain of the calibration"),
    ]  # fmt: skip


def _model_checks(d: Diagnostics, raw: bool) -> list[Check]:
    """Checks of the residual, and of contradictions to the model."""
    doubtful, less = Verdict.DOUBTFUL, d.tail_sigmas < 0
    plain = "flatten the chart, light it evenly, and keep everything still"
    return [
        Check("tail", abs(d.tail_sigmas), TAIL_SIGMAS, doubtful,
              f"the PSF's far tail lies {abs(d.tail_sigmas):.0f} standard uncertainties "
              f"{'below' if less else 'above'} that of the f-number"
              + (", as in a sharpened picture" if less and not raw else ""),
              "check f-number and pixel pitch" + (", or use the RAW file" if less and not raw else "")),
        Check("residual", d.residual_std, MAX_RESIDUAL, doubtful,
              f"the residual is {d.residual_std:.1f} times the noise",
              plain if raw else f"{plain}; use the unprocessed picture", prior=SYMPTOM),
        Check("parts", d.mismatch**0.5, MAX_MISMATCH**0.5, doubtful,
              f"parts of the chart disagree: their scatter is {d.mismatch**0.5:.1f} times that expected from noise",
              "flatten the chart, square it to the camera, and light it evenly", prior=SYMPTOM),
    ]  # fmt: skip


def _variation_checks(variations: tuple[Variation, ...]) -> Iterator[Check]:
    for one in variations:
        a, b = one.values
        yield Check("variation", abs(a - b), MAX_VARIATION * (a + b) / 2, Verdict.DOUBTFUL,
                    f"the PSF varies over the chart: {one.name} is {a:.4f} {one.halves[0]} and {b:.4f} {one.halves[1]}",
                    "square the camera to the chart, or let it fill less of the frame",
                    given=abs(one.sigmas) > 5)  # fmt: skip
