"""Consistency of both photographs: one wall, equal light and sharpness, no processing.

Four properties that the fit itself does not test:

- The residual must be noise, as strong at coarse detail as at fine detail. A coarse residual indicates another light,
  another response, or a far photograph whose noise was smoothed. An incoherent residual suggests a coherent one of
  about the same size, which is an error of the kernel.
- The near photograph's spectrum, divided by the estimated OTF, is that of the wall. Walls have detail of all sizes, a
  spectrum like a power of the frequency; a faster or slower decrease is another sharpness of the near photograph, or
  the wall itself. Two photographs do not distinguish the two, so it is an uncertainty.
- Rotated light on relief changes the contrast with the direction of the detail, equally at all scales. An OTF varies
  with the direction too, but as the square of the frequency: at the coarsest detail only the light can be the cause.
- Light is non-negative: its OTF satisfies 1 - H(2f) <= 4 (1 - H(f)), as cosines do. A sharpened OTF violates that.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter

from procedures.corruption.ring import missing_light
from procedures.numerics.arrays import Array, Array32
from procedures.psf import Psf
from procedures.two_photo.inter_image import PairFit
from procedures.two_photo.sharpness import patch_spectra

COARSE, FINE = (0.03, 0.15), (0.25, 0.5)
"""Bands of the far photograph's frequencies, in cycles/pixel, whose residuals are compared."""
SMOOTHED = ((0.15, 0.25), (0.35, 0.5))  # bands of middle detail and the finest
FAR_PATCH, NEAR_PATCH = 48, 256  # sides of the patches for spectra
COARSE_DETAIL = 0.05
"""Frequency in the far photograph, in cycles/pixel, at which the OTF does not vary with the direction."""
CORRELATED = (35 / 18) ** 2
"""Frequencies of a patch per independent one: a Hann window correlates the power of neighbours by 4/9, and of next
neighbours by 1/36, along either axis."""
CLEAR = 3.0  # standard deviations from which a difference is significant
LOWEST = 2.5  # cycles per patch above which the window does not distort the wall's spectrum
FINEST = 0.4  # cycles/pixel along both axes above which the near photograph is closest to noise alone
COARSEST, HIGHEST = 0.01, 0.47  # range of the near photograph's spectrum that is used, in cycles/pixel
MASK_PX = 1.0  # usual width of an unsharp mask, in pixels
MAX_ITERATIONS, CONVERGENCE_TOLERANCE = 25, 3e-5
"""Limits of the fit to that spectrum; below this change every parameter is within a hundredth of its scatter."""


@dataclass(frozen=True)
class NearSpectrum:
    """Difference of the near photograph's OTF from the estimated one, for a wall with detail of all sizes.

    softness : (2,), variance of a blur along x and y, in squared near pixels; negative where it is sharper
    sharpening : amplitude of unsharp masking of width `MASK_PX`
    turned : (2,), growth of the spectrum's variation with cos 2 and sin 2 of the direction, per logarithm of the
        frequency: another light, motion, or a wall whose fine detail has another direction than its coarse one
    wall_power : exponent of the wall's spectrum
    most_noise : standard deviation of noise as strong as the finest detail, along the diagonals
    """

    softness: Array
    sharpening: float
    turned: Array
    wall_power: float
    most_noise: float

    def log_modulus(self, fx: Array, fy: Array) -> Array:
        """Logarithm of the near photograph's |OTF| over the estimated one, by blur and by sharpening, at near
        frequencies (n,): (2, n). Each may be due to the wall itself, so they do not cancel."""
        blur = -2 * np.pi**2 * np.stack([fx**2, fy**2], axis=-1) @ self.softness
        mask = self.sharpening * (1 - np.exp(-2 * np.pi**2 * MASK_PX**2 * (fx**2 + fy**2)))
        return np.stack([blur, mask])


@dataclass(frozen=True)
class PairConsistency:
    """Consistency of both photographs.

    coarse_residual : amplitude of the residual at coarse detail without noise, over that of the wall there
    colour : power of the residual at coarse detail over that at fine detail: 1 for noise, within its scatter
    smoothing : the same at middle detail over the finest: a smoothed far photograph has less fine noise, while another
        light or response leaves a coarse residual
    streaks : power of the residual at fine detail along x over that along y: 1 for noise
    detail : power of the residual where the far photograph has detail, over that where it has none: 1 for noise
    near : fit to the near photograph's spectrum
    light_turned : amplitude of the OTF's variation with twice the direction at `COARSE_DETAIL`, without the part
        proportional to the square of the frequency, beyond twice its standard uncertainty
    missing_light : see `sharpening.missing_light`
    beyond_light : largest excess of 1 - H(2f) over 4 (1 - H(f)) beyond three standard uncertainties; 0 without one
    """

    coarse_residual: float
    colour: float
    smoothing: float
    streaks: float
    detail: float
    near: NearSpectrum
    light_turned: float
    missing_light: float
    beyond_light: float


def pair_consistency(fit: PairFit, psf: Psf, near: Array32) -> PairConsistency:
    """Consistency of the photographs, by the final fit and the unconstrained PSF."""
    coarse_residual, colour, smoothing, streaks = residual_spectrum(fit)
    spectrum = near_spectrum(fit.common_part(near), psf)
    light = light_turned(psf), missing_light(psf), beyond_light(psf)
    return PairConsistency(coarse_residual, colour, smoothing, streaks, residual_at_detail(fit), spectrum, *light)


def residual_spectrum(fit: PairFit) -> tuple[float, float, float, float]:
    """`coarse_residual`, `colour`, `smoothing` and `streaks` of `PairConsistency`."""
    residual, prediction = fit.as_image(fit.residual, 0.0), fit.as_image(fit.prediction, fit.prediction.mean())
    rows, columns = (min(n, FAR_PATCH) for n in fit.near.shape)
    noise, patches = patch_spectra(residual.astype(np.float32), rows, columns)
    wall, _ = patch_spectra(prediction.astype(np.float32), rows, columns)
    fy, fx = np.broadcast_arrays(np.abs(np.fft.fftfreq(rows))[:, None], np.fft.rfftfreq(columns))
    r = np.hypot(fx, fy)
    coarse, fine, middle, finest = ((r >= low) & (r < high) for low, high in (COARSE, FINE, *SMOOTHED))
    along_x, along_y = ((a >= FINE[0]) & (b < COARSE[1]) for a, b in ((fx, fy), (fy, fx)))
    floor = float(noise[fine].mean())
    independent = patches / CORRELATED
    excess = float(noise[coarse].mean()) - floor * (1 + 2 / np.sqrt(independent * coarse.sum()))
    share = max(excess, 0.0) / max(float(wall[coarse].mean()), 1e-12)
    pairs = ((coarse, fine), (middle, finest), (along_x, along_y))
    colour, smoothing, streaks = (power_ratio(noise[one], noise[other], independent) for one, other in pairs)
    return float(np.sqrt(share)), colour, smoothing, streaks


def power_ratio(one: Array, other: Array, independent: float) -> float:
    """Mean of one band's power over another's; 1 where the difference is consistent with scatter.

    one, other : (m,), (n,); power at the frequencies of each band, averaged over patches
    independent : independent values of a frequency's power. The power of noise is exponentially distributed: its
        standard deviation is its mean.
    """
    ratio = max(float(one.mean()), 1e-15) / max(float(other.mean()), 1e-15)
    scatter = np.sqrt((1 / one.size + 1 / other.size) / independent)
    return ratio if abs(np.log(ratio)) > CLEAR * scatter else 1.0


def residual_at_detail(fit: PairFit) -> float:
    """`detail` of `PairConsistency`: the quarter of the samples that differ most from their neighbours, over the
    quarter that differs least, relative to the noise at their level."""
    prediction = fit.as_image(fit.prediction, fit.prediction.mean())
    contrast = np.abs(prediction - uniform_filter(prediction, 3))[fit.samples.rows, fit.samples.columns]
    power = fit.residual**2
    by_light = np.polyval(np.polyfit(fit.prediction, power, 1), fit.prediction)
    power = power / np.maximum(by_light, 0.1 * power.mean())
    low, high = np.quantile(contrast, (0.25, 0.75))
    return float(power[contrast > high].mean() / power[contrast < low].mean())


def near_spectrum(near: Array32, psf: Psf) -> NearSpectrum:
    """Fit to the logarithm of the near photograph's spectrum.

    With S the wall's spectrum, a power of the frequency whose factor may vary with twice the direction, the model is
    the sum over aliases of S(f) |H(f)|^2 times the square of the factor that `NearSpectrum` describes, plus white
    noise. Every octave of frequencies has the same weight. Parameters are reduced by their scatter.
    """
    rows, columns = (min(n, NEAR_PATCH) for n in near.shape)
    power, _ = patch_spectra(near, rows, columns)
    fy, fx = np.broadcast_arrays(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    r = np.hypot(fx, fy)
    finest = (np.abs(fx) > FINEST) & (np.abs(fy) > FINEST)
    most_noise = float(np.sqrt(power[finest].mean()))
    used = (r > max(COARSEST, LOWEST / min(rows, columns))) & (np.maximum(np.abs(fx), np.abs(fy)) <= HIGHEST) & (fx > 0)
    fx, fy, r, power = fx[used], fy[used], r[used], np.maximum(power[used], 1e-15)
    aliases = [(fx + i, fy + j) for i in (0, -1) for j in (0, -1, 1)]
    H2 = _squared_modulus(psf, aliases)
    X = np.stack([_wall_terms(*f) for f in aliases])
    y, weight = np.log(power), 1 / r
    theta = np.zeros(X.shape[-1])
    theta[:2] = float(np.mean(y[r < 0.1] + 2 * np.log(r[r < 0.1]))), -2.0
    most = 0.98 * float(power.min())
    noise = 0.5 * most
    for _ in range(MAX_ITERATIONS):
        parts = np.exp(np.clip(X @ theta, -60, 30)) * H2
        total = parts.sum(axis=0) + noise
        J = np.column_stack([np.einsum("an,anp->np", parts, X) / total[:, None], noise / total])
        residual = y - np.log(total)
        robust = weight / (1 + (residual / 0.5) ** 2)  # the peaks of a pattern follow no power of the frequency
        JW = J * robust[:, None]
        G = JW.T @ J
        step = np.linalg.solve(G + 1e-3 * np.diag(np.diag(G)) + 1e-9 * np.eye(len(G)), JW.T @ residual)
        theta = theta + np.clip(step[:-1], -1, 1)
        if np.abs(step[:-1]).max() < CONVERGENCE_TOLERANCE:
            break
        noise = float(np.clip(noise * np.exp(np.clip(step[-1], -1, 1)), 1e-3 * most, most))
    inverted = np.linalg.inv(G + 1e-9 * np.eye(len(G)))
    scatter = np.sqrt(np.diag(inverted @ (JW.T @ JW) @ inverted)[:-1]) * float(np.std(residual))
    reduced = np.sign(theta) * np.maximum(np.abs(theta) - scatter, 0)
    reduced[7:9][np.abs(theta[7:9]) < CLEAR * scatter[7:9]] = 0.0
    return NearSpectrum(reduced[2:4], float(reduced[4]), reduced[7:9], float(-theta[1]), most_noise)


def _wall_terms(fx: Array, fy: Array) -> Array:
    """Terms of the logarithm of the near photograph's spectrum over |H|^2: (n, 9)."""
    turn, r = 2 * np.arctan2(fy, fx), np.hypot(fx, fy)
    blur_x, blur_y = (-4 * np.pi**2 * np.minimum(f * f, 0.3) for f in (fx, fy))
    mask = 2 * (1 - np.exp(-2 * np.pi**2 * MASK_PX**2 * r**2))
    cos, sin, log = np.cos(turn), np.sin(turn), np.log(r)
    return np.stack([np.ones_like(fx), log, blur_x, blur_y, mask, cos, sin, log * cos, log * sin], axis=-1)


def _squared_modulus(psf: Psf, at: list[tuple[Array, Array]]) -> Array:
    """|OTF|^2 at lists of frequencies in |fx|, |fy| < 1.5, interpolated; 0 beyond the band."""
    grid = np.arange(-48, 49) / 32
    x, y = (f.ravel() for f in np.meshgrid(grid[48:], grid))
    band = np.maximum(np.abs(x), np.abs(y)) <= psf.s / 2
    values = np.zeros(len(x))
    values[band] = np.abs(psf.spectra(x[band], y[band]) @ psf.parameters / psf.light) ** 2
    table = values.reshape(97, 49)
    signs = [np.where(fx < 0, -1, 1) for fx, _ in at]
    places = [[sign * fy * 32 + 48, np.abs(fx) * 32] for sign, (fx, fy) in zip(signs, at, strict=True)]
    return np.stack([map_coordinates(table, place, order=1) for place in places])


def light_turned(psf: Psf) -> float:
    """`light_turned` of `PairConsistency`."""
    turn = np.pi * np.arange(16) / 16
    waves = np.stack([np.cos(2 * turn), np.sin(2 * turn)]) / 8
    variation = np.zeros(2)
    slope = np.zeros((2, len(psf.parameters)))
    for f, share in ((COARSE_DETAIL, 1.0), (2 * COARSE_DETAIL, -0.25)):
        spectra = psf.spectra(f * np.cos(turn), f * np.sin(turn))
        H = spectra @ psf.parameters
        variation += share * waves @ np.log(np.abs(H))
        slope += share * waves @ np.real(spectra / H[:, None])
    variance = np.einsum("ij,jk,ik->i", slope, psf.parameter_covariance, slope).sum()
    return max(float(np.hypot(*variation)) - 2 * float(np.sqrt(max(variance, 0))), 0.0)


def beyond_light(psf: Psf) -> float:
    """`beyond_light` of `PairConsistency`: along x, y and the diagonals, to half of the band."""
    worst = 0.0
    f = np.linspace(0.04, psf.s / 4, 12)
    for x, y in ((1, 0), (0, 1), (0.7071, 0.7071), (0.7071, -0.7071)):
        slope = (4 * psf.spectra(x * f, y * f).real - psf.spectra(2 * x * f, 2 * y * f).real) / psf.light
        value = slope @ psf.parameters - 3
        slope = slope - (value + 3)[:, None] * psf.weights / psf.light
        uncertainty = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slope, psf.parameter_covariance, slope), 0))
        worst = max(worst, float(value[value > 3 * uncertainty].max(initial=0.0)))
    return worst
