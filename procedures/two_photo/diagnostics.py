"""Diagnostics of a pair of photographs, measured on the final fit and the PSF derived from it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from procedures.clipping import find_clipping
from procedures.numbers import EDGE_MTF50
from procedures.numerics.arrays import Array32
from procedures.psf import Psf
from procedures.two_photo.error_parts import PairErrorParts, near_errors
from procedures.two_photo.inter_image import PairFit
from procedures.two_photo.near_noise import InterImageKernel, noise_at_most
from procedures.two_photo.pair_consistency import PairConsistency
from procedures.two_photo.registration import PairSighting
from procedures.two_photo.sharpness import sharpness_ratio

TILES = 8  # tiles along each side of the common region whose local shifts are estimated
CLEAR = 0.1  # A frequency is determined where the MTF's standard uncertainty is below this


@dataclass(frozen=True)
class PairDiagnostics:
    """Diagnostics of a pair of photographs.

    Attributes
    ----------
    matches : matches consistent with the first homography
    match_rms_px : their scatter, in far pixels
    samples : far samples used
    scale : geometric mean zoom: far over near distance
    scale_spread : largest over smallest local zoom in the common region, minus 1
    agreement : share of the far photograph's variance that the near one explains
    residual_std : float
        Pixel noise implied by the residual, over the upper limit of a near pixel's noise; at most 1 for noise alone.
    whiteness : largest correlation of the residual at a lag of one pixel: 0 when white
    local_shift_px : root mean square shift, in far pixels, of parts of the wall from the map, without noise
    local_shift_significance : float
        The same shifts as a chi-square per degree of freedom, minus 1, in its standard deviations.
    relief_px : random shift from pixel to pixel that explains the growth of the residual with the gradient
    gain : contrast of the far photograph over the near one's
    light_change : root mean square of the gain's variation over the region
    passed : largest excess of the kernel's transfer over 1, in its standard uncertainties
    excess : largest such excess beyond three standard uncertainties; 0 if there is none
    relative_uncertainty : float
        sqrt(trace of the covariance) over the norm of the PSF: an upper limit of the expected relative L2 error.
    determined_horizontal, determined_vertical : float
        Frequency in cycles/pixel up to which the MTF along x and y is known to 0.1.
    near_noise_bias : bias of the kernel by the near photograph's noise before its correction, over the kernel's norm
    recursion_check : distance of the recursion from the direct solution, over the PSF's norm
    support_cut : share of the kernel beyond its support, by the amplitude of a 1/r^3 tail
    sharpness_ratio : fine contrast of the near photograph over the far one's; see `sharpness`
    saturated : larger clipped share of the two photographs
    outliers : share of the common region's samples excluded as outliers
    travelled_px, moved_px : moves of the map from the first homography and in the last iteration, in far pixels
    coarse_residual, colour, smoothing, streaks, detail, light_turned, missing_light, beyond_light : float
        See `pair_consistency.PairConsistency`.
    softness_x, softness_y, sharpening, turned, wall_power : see `pair_consistency.NearSpectrum`
    near_noise : float
        Upper limit of the near photograph's noise, by its finest detail, over the noise implied by the residual.
    focus_effect : relative change of the MTF at Nyquist if `softness` is due to focus: the larger of x and y
    mismatch : variance of MTF50 by the scatter of the region's parts, over that by white noise
    """

    matches: float
    match_rms_px: float
    samples: float
    scale: float
    scale_spread: float
    agreement: float
    residual_std: float
    whiteness: float
    local_shift_px: float
    local_shift_significance: float
    relief_px: float
    gain: float
    light_change: float
    passed: float
    excess: float
    relative_uncertainty: float
    determined_horizontal: float
    determined_vertical: float
    near_noise_bias: float
    recursion_check: float
    support_cut: float
    sharpness_ratio: float
    saturated: float
    outliers: float
    travelled_px: float
    moved_px: float
    coarse_residual: float
    colour: float
    smoothing: float
    streaks: float
    detail: float
    light_turned: float
    beyond_light: float
    softness_x: float
    softness_y: float
    sharpening: float
    turned: float
    wall_power: float
    missing_light: float
    near_noise: float
    focus_effect: float
    mismatch: float


def diagnose(
    fit: PairFit, kernel: InterImageKernel, psf: Psf, sighting: PairSighting, near: Array32, far: Array32,
    near_noise_limit: float, recursion_check: float, saturated: float, consistency: PairConsistency,
    parts: PairErrorParts,
) -> PairDiagnostics:  # fmt: skip
    """Diagnostics of the final fit and of the PSF derived from it."""
    zoom = np.sqrt(np.abs(np.linalg.det(fit.warp.derivative(fit.samples.points[::29]))))
    shift, significance = local_shifts(fit)
    passed, excess = transfer_above_one(kernel, psf)
    determined_horizontal, determined_vertical = (determined_to(psf, axis) for axis in (0, 1))
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    common: dict[str, Any] = {name: value for name, value in vars(consistency).items() if name != "near"}
    spectrum = consistency.near
    return PairDiagnostics(
        matches=float(sighting.matches),
        match_rms_px=sighting.rms_far_px,
        samples=float(len(fit.residual)),
        scale=float(zoom.mean()),
        scale_spread=float(zoom.max() / zoom.min() - 1),
        agreement=fit.agreement,
        residual_std=kernel.noise / max(near_noise_limit, 1e-9),
        whiteness=_neighbour_correlation(fit),
        local_shift_px=shift,
        local_shift_significance=significance,
        relief_px=relief(fit),
        gain=kernel.gain,
        light_change=_light_change(fit),
        passed=passed,
        excess=excess,
        relative_uncertainty=psf.relative_uncertainty,
        determined_horizontal=determined_horizontal,
        determined_vertical=determined_vertical,
        near_noise_bias=kernel.bias,
        recursion_check=recursion_check,
        support_cut=kernel.cut,
        sharpness_ratio=sharpness_ratio(fit.common_part(near), far[y : y + rows, x : x + columns], kernel.noise),
        saturated=saturated,
        outliers=fit.outliers,
        travelled_px=fit.travelled_px,
        moved_px=fit.moved_px,
        **common,
        softness_x=float(spectrum.softness[0]),
        softness_y=float(spectrum.softness[1]),
        sharpening=spectrum.sharpening,
        turned=float(np.hypot(*spectrum.turned)),
        wall_power=spectrum.wall_power,
        near_noise=spectrum.most_noise / kernel.noise,
        focus_effect=float(np.hypot(*near_errors(spectrum, fit.scale(), *(0.5 * np.eye(2)))).max()),
        mismatch=max((ratio for name, ratio in parts.mismatch.items() if name.startswith(EDGE_MTF50)), default=1.0),
    )


def clipped_share(photograph: Array32) -> float:
    """Share of a photograph's samples that are clipped, at the limits of its range or at white."""
    noise = noise_at_most(photograph)
    clipping = find_clipping(photograph, dark_noise=noise, bright_noise=noise)
    return max(clipping.black, clipping.white)


def local_shifts(fit: PairFit) -> tuple[float, float]:
    """Root mean square shift of parts of the wall from the map, in far pixels without noise, and its significance.

    The residual of each tile is fitted by a shift of its own; a plane wall leaves noise of known variance.
    """
    s = fit.samples
    rows, columns = fit.near.shape
    tile = (s.rows * TILES // rows) * TILES + s.columns * TILES // columns
    moments = [fit.slopes[:, 0] ** 2, fit.slopes[:, 0] * fit.slopes[:, 1], fit.slopes[:, 1] ** 2]
    xx, xy, yy, xr, yr, n = (
        np.bincount(tile, weights, TILES**2)
        for weights in (*moments, fit.slopes[:, 0] * fit.residual, fit.slopes[:, 1] * fit.residual, None)
    )
    determinant = xx * yy - xy**2
    used = (n >= 50) & (determinant > 1e-6 * (xx + yy) ** 2)
    if used.sum() < 4:
        return 0.0, 0.0
    xx, xy, yy, xr, yr, determinant = (v[used] for v in (xx, xy, yy, xr, yr, determinant))
    x, y = (yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant
    noise = fit.variance * (xx + yy) / determinant
    chi2 = (x * xr + y * yr) / fit.variance
    freedom = 2 * len(x)
    beyond = float(np.mean(x**2 + y**2 - noise))
    return float(np.sqrt(max(beyond, 0.0))), float((chi2.sum() - freedom) / np.sqrt(2 * freedom))


def relief(fit: PairFit) -> float:
    """Root mean square of a random shift, in far pixels, that explains the growth of the residual with the gradient.

    Squared residuals are fitted by a constant, a linear function of the level (noise), and the squared gradient.
    """
    squared = np.sum(fit.slopes**2, axis=1) / 2
    model = np.column_stack([np.ones_like(squared), fit.prediction, squared])
    share = np.linalg.lstsq(model, fit.residual**2, rcond=None)[0][2]
    return float(np.sqrt(max(share, 0.0)))


def _neighbour_correlation(fit: PairFit) -> float:
    """Largest correlation of the residual at lag one, along rows or columns."""
    grid = fit.as_image(fit.residual, np.nan)
    pairs = (grid[1:] * grid[:-1], grid[:, 1:] * grid[:, :-1])
    return max((float(np.nanmean(pair)) / fit.variance for pair in pairs), key=abs)


def _light_change(fit: PairFit) -> float:
    """Root mean square of the multiplicative quadratics, over the samples."""
    x, y = ((fit.samples.points - fit.warp.centre) / fit.warp.radius).T
    return float(np.std(np.stack([x, y, x * x, x * y, y * y], axis=-1) @ fit.light[6:]))


def transfer_above_one(kernel: InterImageKernel, psf: Psf) -> tuple[float, float]:
    """Largest excess of |K| over 1 in standard uncertainties, and its value where that is more than three of them.

    K(f) = H(f) / H(f / lambda) is below 1 for any decreasing MTF; above, the near photograph is the less sharp.
    """
    n = np.arange(psf.k) - psf.k // 2
    f = np.linspace(0.05, 0.5, 10) * psf.s
    along = np.exp(-2j * np.pi * np.outer(f / psf.s, n))
    flat = np.ones((len(f), psf.k))
    waves = np.concatenate([(flat[:, :, None] * along[:, None, :]), (along[:, :, None] * flat[:, None, :])])
    waves = waves.reshape(len(waves), -1)
    gain = kernel.k.sum()
    K = waves @ kernel.k / gain
    slope = np.real((np.conj(K) / np.maximum(np.abs(K), 1e-12))[:, None] * (waves - K[:, None])) / gain
    uncertainty = np.sqrt(
        np.maximum(np.einsum("ij,jk,ik->i", slope, kernel.covariance[: psf.k**2, : psf.k**2], slope), 1e-24)
    )
    above = np.abs(K) - 1
    significant = above[above > 3 * uncertainty]
    return float((above / uncertainty).max()), float(significant.max(initial=0.0))


def determined_to(psf: Psf, axis: int) -> float:
    """Frequency in cycles/pixel up to which the MTF along x (0) or y (1) has a standard uncertainty below `CLEAR`."""
    n = (np.arange(psf.k) - psf.k // 2) / psf.s
    f = np.linspace(0, psf.s / 2, 31)
    C = psf.covariance.reshape(psf.k, psf.k, psf.k, psf.k).sum(axis=(0, 2) if axis == 0 else (1, 3))
    waves = np.exp(-2j * np.pi * np.outer(f, n))
    profile = waves @ psf.h.sum(axis=axis)
    slope = np.real((np.conj(profile) / np.maximum(np.abs(profile), 1e-12))[:, None] * waves)
    unclear = np.flatnonzero(np.einsum("ij,jk,ik->i", slope, C, slope) > CLEAR**2)
    return float(f[unclear[0]]) if len(unclear) else float(f[-1])
