"""Whether a PSF can be trusted: what was measured on the way, and the verdict drawn from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import Rule, Verdict, verdict_of
from procedures.pattern_psf.radiometry import Light
from procedures.pattern_psf.refine import RESPONSE, SPREAD, Fit
from procedures.pattern_psf.registration import Registration, map_distance, mark_residuals
from procedures.psf import Psf

Array = npt.NDArray[np.float64]


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


def diagnose(
    fit: Fit, psf: Psf, light: Light, corners: Array, marks_map: Registration, outliers: float, s: int
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
    s : int
    """
    o = fit.observation
    noise = float(np.mean(1 / o.weight**2)) / float(np.var(o.y))
    marks = mark_residuals(fit.registration, corners)
    pixels_per_cell = 1 / np.sqrt(abs(np.linalg.det(fit.registration.jacobian())))
    return Diagnostics(
        agreement=fit.agreement,
        unexplained=max(1 - fit.agreement - noise, 0.0),
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
        s_over_t=float(s * pixels_per_cell),
    )


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


def judge(d: Diagnostics, fit: Fit) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy: the first refusal, else all doubts together."""
    return verdict_of(_refusals(d) + _doubts(d, fit))


def _refusals(d: Diagnostics) -> list[Rule]:
    """What makes a PSF unusable, the most telling first."""
    refused = Verdict.REFUSED
    return [
        Rule(
            refused,
            d.agreement < 0.3 and d.unexplained > 0.1,
            f"the noise region shows other cells than expected: they explain {max(d.agreement, 0):.0%} of it",
            "give the chart's own cells (--bits or --seed, printed on the sheet) and photograph it unmirrored",
        ),
        Rule(
            refused,
            d.agreement < 0.3,
            f"the noise region is blurred or noisy beyond use: the cells explain {max(d.agreement, 0):.0%} of it",
            "focus, and expose longer",
        ),
        Rule(
            refused,
            d.unexplained > 0.15,
            f"{d.unexplained:.0%} of the noise region is neither the chart nor noise: the registration slipped, or "
            "something lies before the chart",
            "lay the chart flat, keep all its marks in view and free of reflections, and photograph it again",
        ),
        Rule(
            refused,
            d.support_cut > 0.2,
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
            d.support_cut > 0.08,
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
