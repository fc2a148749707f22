"""Diagnostics of a PSF estimate: statistics that distinguish a good photograph from a bad one."""

from dataclasses import dataclass

import numpy as np

from procedures.choice import Trial
from procedures.corruption.family import Strength
from procedures.corruption.paper import NoiseMeasurement
from procedures.corruption.ring import missing_light
from procedures.numerics.arrays import Array
from procedures.pattern_psf.error_parts import ErrorParts
from procedures.pattern_psf.outliers import ExcludedSamples
from procedures.pattern_psf.radiometry import LightLevels
from procedures.pattern_psf.refine import GEOMETRY, RESPONSE, SPREAD, TAIL, ChartFit, TailPrior
from procedures.pattern_psf.registration import Registration, map_distance, mark_residuals
from procedures.psf import Psf

OBSTRUCTED = 0.67  # relative excess of the far tail behind a central obstruction of 0.4 of the pupil: 1 / (1 - 0.4) - 1


@dataclass(frozen=True)
class Diagnostics:
    """Statistics of a PSF estimate on which its verdict rests.

    Attributes
    ----------
    agreement : share of the noise region's variance that the prediction explains, corrected for the degrees of freedom:
        near 1 with the right cells, 0 with any others
    unexplained : share of the variance that is neither explained nor noise
    residual_std : residual in units of the noise measured on the blocks
    whiteness : largest correlation of the residual at a lag of one pixel, along rows or columns; 0 if white
    relative_uncertainty : sqrt(trace of the covariance) over the norm of the PSF: the relative L2 error to expect
    support_cut : share of the PSF's energy outside its support, by the amplitude of a 1/r^3 tail
    marks_offset_px, marks_rms_px : mean offset of the detected marks from their fitted positions, and their scatter
        about it
    moved_px : largest distance between the marks' map and the refined one, inside the noise region
    outliers : share of the samples excluded as connected outliers that noise does not explain
    stray_samples : number of isolated samples excluded although their neighbours fit: hot or dead pixels
    saturated, flatness, contrast, noise : clipped share of the white blocks, smallest over largest white, white minus
        black, and noise over that contrast
    response_curvature, response_uncertainty : beta of the response m + beta (m^2 - m), and its standard uncertainty
    ink_spread : displacement of the printed edges from black towards white, in cells
    printed_edges_rms : root mean square offset of the printed lines of edges, in cells; 0 where they were not estimated
    s_over_t : sampling ratio: s times pixels per cell
    noise_correlation : noise correlation of neighbouring samples in the flat blocks: 0 in a RAW plane, not after
        demosaicing, sharpening or compression
    mismatch : variance of MTF50 from the scatter of the chart's tiles, over that from white noise
    truncation, band_edge : part of the OTF that the support may truncate, and the OTF near the band's edge
    tail_sigmas : difference of the fitted far tail from that expected from f-number and pitch, in standard
        uncertainties, less what an obstructed pupil adds; 0 where these are not known
    missing_light : light missing in the rings around the core, relative to the least a lens leaves there, in standard
        uncertainties
    crushed : share of the black blocks' samples that lie at one value
    sharpened_by, sharpening_uncertainty : amount of an unsharp mask of one pixel by the noise of paper and residual
    finest_noise, finest_noise_uncertainty : noise variance at the paper's finest detail over that of the sensor's
        calibration, or of the white blocks
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
    stray_samples: float
    saturated: float
    flatness: float
    contrast: float
    noise: float
    response_curvature: float
    response_uncertainty: float
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
    sharpened_by: float
    sharpening_uncertainty: float
    finest_noise: float
    finest_noise_uncertainty: float


def unexplained(fit: ChartFit) -> float:
    """Share of the variance that is neither explained nor noise."""
    return max(1 - fit.agreement - float(np.mean(1 / fit.observation.weight**2)) / fit.variance, 0.0)


def diagnose(
    fit: ChartFit,
    psf: Psf,
    narrow: Psf,
    light: LightLevels,
    corners: Array,
    marks_map: Registration,
    excluded: ExcludedSamples,
    parts: ErrorParts,
    prior: TailPrior | None,
    trial: Trial,
    noise: NoiseMeasurement,
    fine: Strength,
) -> Diagnostics:
    """Compute the diagnostics of a fit.

    psf : the normalised PSF
    narrow : that of the narrowest support which is wide enough for the tail
    corners : (12, 2) the detected marks, NaN where hidden
    marks_map : the map fitted to the marks alone
    trial : the trial of s and k that gave the PSF
    fine : unsharp mask of one pixel by the noise
    """
    marks = mark_residuals(fit.registration, corners)
    pixels_per_cell = 1 / np.sqrt(abs(np.linalg.det(fit.registration.jacobian())))
    return Diagnostics(
        agreement=fit.agreement,
        unexplained=unexplained(fit),
        residual_std=fit.residual_std,
        whiteness=fit.neighbour_correlation,
        relative_uncertainty=psf.relative_uncertainty,
        support_cut=fit.cut,
        marks_offset_px=float(np.linalg.norm(marks.mean(axis=0))),
        marks_rms_px=float(np.sqrt(np.mean(np.sum((marks - marks.mean(axis=0)) ** 2, axis=1)))),
        moved_px=map_distance(marks_map, fit.registration, fit.observation.points[::29]),
        outliers=excluded.connected,
        stray_samples=float(excluded.stray),
        saturated=light.saturated,
        flatness=light.flatness,
        contrast=light.contrast,
        noise=float(np.sqrt(light.variance_white) / light.contrast),
        response_curvature=float(fit.light[RESPONSE]),
        response_uncertainty=_variance_of(fit, GEOMETRY + RESPONSE) ** 0.5 * fit.residual_std,
        ink_spread=-float(fit.light[SPREAD]),
        printed_edges_rms=fit.edge_rms,
        s_over_t=float(psf.s * pixels_per_cell),
        noise_correlation=light.noise_correlation,
        mismatch=max(parts.mismatch.values(), default=1.0),
        truncation=trial.truncation,
        band_edge=trial.band_edge,
        tail_sigmas=_tail_sigmas(fit, psf.s, prior),
        missing_light=max(missing_light(support) for support in (psf, narrow)),
        crushed=light.crushed,
        sharpened_by=fine.value,
        sharpening_uncertainty=fine.uncertainty,
        finest_noise=noise.finest,
        finest_noise_uncertainty=noise.uncertainty,
    )


def _tail_sigmas(fit: ChartFit, s: int, prior: TailPrior | None) -> float:
    """Tail without prior less that of the f-number, in standard uncertainties: of variance c and amplitude t with a
    prior p, m, the data have d = c / (1 - c / p) and t + d (t - m) / p."""
    if prior is None:
        return 0.0
    expected = prior.energy(s, round(len(fit.h) ** 0.5))
    known, fitted = (prior.share * expected) ** 2, float(fit.light[TAIL])
    c = _variance_of(fit, GEOMETRY + TAIL)
    alone = c / max(1 - c / known, 1e-9)
    away = fitted + alone * (fitted - expected) / known - expected
    if away > 0:  # an obstructed pupil has more edge for its area
        away = max(away - OBSTRUCTED * expected, 0.0)
    return float(away / np.sqrt(alone * fit.residual_std**2 + known))


def _variance_of(fit: ChartFit, place: int) -> float:
    """Variance of a nuisance parameter, for unit noise."""
    equations = fit.equations
    through = equations.E[place]
    return float(np.linalg.inv(equations.ZZ)[place, place] + through @ equations.inverse @ through)
