"""Corruptions of a photograph of the chart: tests of them, and terms of the budget by those that are not excluded."""

import math
from dataclasses import replace

import numpy as np

from procedures.choice import OPEN, Trial
from procedures.corruption.directions import RIM, ZOOM
from procedures.corruption.evidence import TextureEvidence
from procedures.numerics.arrays import Array
from procedures.outcome import SYMPTOM, Check
from procedures.pattern import AIM_S_OVER_T, BLOCK
from procedures.pattern_psf.registration import Registration, block_size_px
from procedures.quality import PRINT_BLUR

VARIED = 3.5  # standard uncertainties above which a variation of the PSF over the chart counts
PRINT_UNKNOWN = 0.36  # prior standard deviation of the print's blur, in cells, where nothing is known of the print
PRINTED_DOTS = 1.44  # prior standard deviation of the blur in dots of the printer
MOST_EXPONENT = 1.0  # largest exponent of the change of a transfer function by the print's blur
DOTS_VISIBLE = 0.008
"""Root mean square of the printed lines' offsets, in cells, above which they are those of the printer's dots."""


def corruption_checks(
    evidence: TextureEvidence, last: Trial, s_over_t: float, *, raw: bool, structured: bool
) -> list[Check]:
    """Tests of the corruptions that a photograph shows; a `structured` residual may have other causes.

    Detail beyond the band of a too coarse grid remains in the residual, where it looks like sharpening.
    """
    checks = evidence.checks(raw=raw)
    if raw and last.band_edge > OPEN:
        sentence = f"s = {last.s} undersamples the PSF: the OTF is still {last.band_edge:.2f} at the band's edge"
        farther = s_over_t * (last.s + 1) / last.s / AIM_S_OVER_T
        remedy = f"photograph from {farther:.2g} times the distance, which allows s = {last.s + 1}"
        checks[0] = replace(checks[0], sentence=sentence, remedy=remedy, prior=1.0)
    return [replace(check, prior=SYMPTOM * check.prior) for check in checks] if structured else checks


def print_prior(edges: Array) -> float:
    """Prior standard deviation of the print's blur, in cells, by the offsets (514,) or (0,) of the printed lines: a
    printer rounds both axes to its dots."""
    offsets = [float(np.std(one)) for one in np.split(edges, 2)] if len(edges) else [0.0]
    dot = 12**0.5 * float(np.mean(np.square(offsets))) ** 0.5
    return min(PRINTED_DOTS * dot, PRINT_UNKNOWN) if min(offsets) > DOTS_VISIBLE else PRINT_UNKNOWN


def print_blur_mode(f: Array, variance_px: float) -> Array:
    """Relative change of the transfer function (n,) by a print's blur of a variance in square pixels."""
    return np.asarray(np.expm1(np.minimum(2 * (np.pi * f) ** 2 * variance_px, MOST_EXPONENT)))


def modes_of(
    evidence: TextureEvidence, f: Array, registration: Registration, print_blur: float, *, raw: bool
) -> dict[str, Array]:
    """Relative changes of the transfer function at frequencies (n,) by one standard deviation of each corruption not
    excluded; `print_blur` in cells."""
    cell_px, square = block_size_px(registration) / BLOCK, 2 * (np.pi * f) ** 2
    kinds = [evidence.strengths[name] for name in (ZOOM, RIM)]
    # of the variance x^2 along x over a disk of radius 1, the mean is 1/4
    varied = math.hypot(*(kind.value for kind in kinds if abs(kind.score) > VARIED)) / 4
    modes = {PRINT_BLUR: print_blur_mode(f, (print_blur * cell_px) ** 2), "variation": square * varied}
    return modes | evidence.modes(f, raw=raw)
