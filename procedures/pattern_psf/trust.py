"""Whether a PSF can be trusted: what was measured on the way, and the verdict drawn from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.choice import Trial, band_edge
from procedures.numerics.solvers import cholesky_solve
from procedures.outcome import Refused, Rule, Verdict, verdict_of
from procedures.pattern_psf.error_parts import ErrorParts, Variation
from procedures.pattern_psf.radiometry import Light
from procedures.pattern_psf.refine import GEOMETRY, RESPONSE, SPREAD, TAIL, Fit, TailPrior
from procedures.pattern_psf.registration import Registration, map_distance, mark_residuals
from procedures.psf import Psf, Sampling
from procedures.quality import truncation
from procedures.sharpening import missing_light

Array = npt.NDArray[np.float64]

SEEN = 0.3
"""Share of the noise region that its own cells explain at the least."""
CORRELATED = 0.25
"""Correlation of neighbouring samples' noise from which a picture was processed."""
CURVED = 0.15
"""Curvature of the response from which it is no linear picture."""
SPREAD_OUT = 0.25
"""Spread of the ink, in cells, that the model of thin outlines does not describe any more."""
OTHER_APERTURE = 3.0
"""Standard uncertainties between the far tail and the f-number's, from which one of them is wrong."""
DUG_OUT = 3.5
"""Standard uncertainties of missing light from which a picture was sharpened."""
CRUSHED = 0.05
"""Share of black samples at one value from which black is cut off."""
LEFT_OVER = 2.0
"""Residual over noise from which a result is doubted."""
SCATTERED = 9.0
"""Variance of a number by the chart's parts, over that by noise, from which it is doubted."""
VARYING = 0.03
"""Difference of MTF50 in the chart's halves from which it is told."""


@dataclass(frozen=True)
class Diagnostics:
    """What tells a good photograph from a bad one.

    Attributes
    ----------
    agreement : float
        Share of the noise region's variance that the prediction explains, freedoms allowed for: near 1 with the
        right cells, 0 with any others.
    unexplained : float
        Share of the variance that is neither explained nor noise.
    residual_std : float
        Residual in units of the noise measured on the blocks.
    whiteness : float
        Largest correlation of the residual with itself one pixel further, along rows or columns: 0 when white.
    relative_uncertainty : float
        sqrt(trace of the covariance) over the norm of the PSF: the relative L2 error to expect.
    support_cut : float
        Share of the PSF's energy outside its support, by the amplitude of a 1/r^3 tail.
    marks_offset_px, marks_rms_px : float
        Mean distance of the marks, as found, from where the fit sees them, and their scatter.
    moved_px : float
        Largest distance between the marks' map and the refined one, inside the noise region.
    outliers : float
        Share of the samples left out because no noise explains them.
    saturated, flatness, contrast, noise : float
        Of the light: clipped share of the white blocks, smallest over largest white, white minus black, and the
        noise over that contrast.
    response_curvature : float
        beta of the response m + beta (m^2 - m).
    ink_spread : float
        By how much the edges moved from black to white in print, in cells.
    printed_edges_rms : float
        Root mean square offset of the printed lines of edges, in cells; 0 where they were not estimated.
    s_over_t : float
        Sampling ratio: s times pixels per cell.
    noise_correlation : float
        Of neighbouring samples in the flat blocks: 0 in a RAW plane, not in what was demosaiced, sharpened, compressed.
    mismatch : float
        Variance of MTF50 by the scatter of the chart's parts, over that by white noise.
    truncation, band_edge : float
        What the support may leave out of the OTF, and the OTF near the band's edge.
    tail_sigmas : float
        Far tail as fitted against what f-number and pitch tell, in standard uncertainties; 0 where they are not known.
    missing_light : float
        Of the rings around the core against what a lens leaves there, in standard uncertainties.
    crushed : float
        Share of the black blocks' samples that lie at one value.
    """

    agreement: float
    unexplained: float
    residual_std: float
    whiteness: float
    relative_uncertainty: float
    support_cut: float
    marks_offset_px: float
    marks_rms_px: float
    moved_px: float
    outliers: float
    saturated: float
    flatness: float
    contrast: float
    noise: float
    response_curvature: float
    ink_spread: float
    printed_edges_rms: float
    s_over_t: float
    noise_correlation: float
    mismatch: float
    truncation: float
    band_edge: float
    tail_sigmas: float
    missing_light: float
    crushed: float


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
    """

    parameters: Sampling
    chosen: bool
    tried: tuple[Trial, ...]
    variations: tuple[Variation, ...]


def check_cells(fit: Fit) -> None:
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


def unexplained(fit: Fit) -> float:
    """Share of the variance that is neither explained nor noise."""
    o = fit.observation
    return max(1 - fit.agreement - float(np.mean(1 / o.weight**2)) / float(np.var(o.y)), 0.0)


def diagnose(
    fit: Fit,
    psf: Psf,
    light: Light,
    corners: Array,
    marks_map: Registration,
    outliers: float,
    parts: ErrorParts,
    prior: TailPrior | None,
) -> Diagnostics:
    """Measure what the verdict needs.

    Parameters
    ----------
    fit : Fit
    psf : Psf
        The normalised answer.
    light : Light
    corners : (12, 2) float64
        The marks as found, NaN where hidden.
    marks_map : Registration
        The map that the marks alone gave.
    outliers : float
        Share of the samples left out.
    parts : ErrorParts
    prior : TailPrior or None
    """
    marks = mark_residuals(fit.registration, corners)
    pixels_per_cell = 1 / np.sqrt(abs(np.linalg.det(fit.registration.jacobian())))
    return Diagnostics(
        agreement=fit.agreement,
        unexplained=unexplained(fit),
        residual_std=fit.residual_std,
        whiteness=_neighbour_correlation(fit),
        relative_uncertainty=float(np.sqrt(np.trace(psf.covariance)) / np.linalg.norm(psf.h)),
        support_cut=fit.cut,
        marks_offset_px=float(np.linalg.norm(marks.mean(axis=0))),
        marks_rms_px=float(np.sqrt(np.mean(np.sum((marks - marks.mean(axis=0)) ** 2, axis=1)))),
        moved_px=map_distance(marks_map, fit.registration, fit.observation.points[::29]),
        outliers=outliers,
        saturated=light.saturated,
        flatness=light.flatness,
        contrast=light.contrast,
        noise=float(np.sqrt(light.variance_white) / light.contrast),
        response_curvature=float(fit.light[RESPONSE]),
        ink_spread=-float(fit.light[SPREAD]),
        printed_edges_rms=fit.edge_rms,
        s_over_t=float(psf.s * pixels_per_cell),
        noise_correlation=light.noise_correlation,
        mismatch=max(parts.mismatch.values(), default=1.0),
        truncation=truncation(psf),
        band_edge=band_edge(psf),
        tail_sigmas=_tail_sigmas(fit, psf.s, prior),
        missing_light=missing_light(psf),
        crushed=light.crushed,
    )


def _tail_sigmas(fit: Fit, s: int, prior: TailPrior | None) -> float:
    """How far the tail that the photograph alone tells lies from what the f-number tells, in standard uncertainties.

    With c the variance of the fitted amplitude t, for unit noise, and p, m the prior's variance and mean, the data
    alone have the variance d = c / (1 - c / p) and the amplitude t + d (t - m) / p.
    """
    if prior is None:
        return 0.0
    expected = prior.energy(s, round(len(fit.h) ** 0.5))
    known, found = (prior.share * expected) ** 2, float(fit.light[TAIL])
    of_tail = np.zeros(len(fit.equations.ZZ))
    of_tail[GEOMETRY + TAIL] = 1
    e = np.linalg.solve(fit.equations.ZZ, of_tail)
    through = fit.equations.AZ @ e
    c = float(e[GEOMETRY + TAIL] + through @ cholesky_solve(fit.equations.G, through))
    alone = c / max(1 - c / known, 1e-6)
    away = found + alone * (found - expected) / known - expected
    return float(away / np.sqrt(alone * fit.residual_std**2 + known))


def _neighbour_correlation(fit: Fit) -> float:
    """Largest correlation of the residual at lag one, along rows or columns."""
    o = fit.observation
    grid = np.zeros((o.rows.max() + 1, o.columns.max() + 1))
    grid[o.rows, o.columns] = fit.residual
    known = np.zeros_like(grid)
    known[o.rows, o.columns] = 1
    variance = float(np.var(fit.residual))
    pairs = ((grid[1:], grid[:-1], known[1:] * known[:-1]), (grid[:, 1:], grid[:, :-1], known[:, 1:] * known[:, :-1]))
    lags = [float(np.sum(a * b) / max(n.sum(), 1)) / variance for a, b, n in pairs]
    return max(lags, key=abs)


def judge(d: Diagnostics, fit: Fit, more: Doubts) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy: the first refusal, else all doubts together."""
    return verdict_of(_refusals(d) + _doubts(d, fit) + _left_out(more) + _processed(d) + _varying(more.variations))


def _refusals(d: Diagnostics) -> list[Rule]:
    """What makes a PSF unusable, the most telling first."""
    refused = Verdict.REFUSED
    return [
        *_unseen(d.agreement, d.unexplained),
        Rule(
            refused,
            d.unexplained > 0.15,
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


def _doubts(d: Diagnostics, fit: Fit) -> list[Rule]:
    """What leaves a PSF usable but less than the photograph could have given."""
    doubtful = Verdict.DOUBTFUL
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
            not 0.7 <= d.s_over_t <= 2,
            f"the sampling ratio s/t is {d.s_over_t:.2f}; 0.7 to 2 is good",
            f"photograph from {d.s_over_t:.2g} times the distance",
        ),
        Rule(
            doubtful,
            d.outliers > 0.02,
            f"{d.outliers:.1%} of the samples do not fit the chart",
            "clean the chart and keep everything out of its way",
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
    would = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else "raise k"
    return [
        Rule(
            Verdict.DOUBTFUL,
            more.parameters.k is not None and not chosen and last.support_short,
            f"k = {last.k} may leave out {last.truncation:.4f} of the OTF, which is known to {last.uncertainty:.4f}",
            would,
        ),
        Rule(
            Verdict.DOUBTFUL,
            more.parameters.s is not None and not chosen and last.band_open,
            f"s = {last.s} ends the band where the OTF is still {last.band_edge:.2f}",
            would,
        ),
        Rule(
            Verdict.DOUBTFUL,
            None in last.mtf50,
            f"MTF50 lies beyond the band of s = {last.s}",
            "raise s, from a distance at which the cells allow it",
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
        Rule(
            doubtful,
            abs(d.tail_sigmas) > OTHER_APERTURE,
            f"the far tail lies {abs(d.tail_sigmas):.0f} standard uncertainties from what the f-number tells",
            "check f-number and pixel pitch",
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
