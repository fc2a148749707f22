"""Whether both photographs are of one wall in one light, equally sharp and left as the sensor gave them.

Four things tell, none of which the fit itself can see:

- what the near photograph does not explain of the far one must be noise, as strong at coarse detail as at fine detail.
  Coarse remains are another light, another response, or a far photograph whose noise was smoothed; where something
  incoherent remains, about as much may be wrong coherently, and that is an error of the kernel;
- the near photograph's own spectrum, divided by the OTF that was found, is the wall's. Walls have detail of all
  sizes, a spectrum like a power of the frequency: what falls off faster or slower is another sharpness of the near
  photograph, or the wall itself. Nothing in two photographs tells these two apart, so it counts as an uncertainty;
- light turned on relief changes the contrast by the direction of the detail, alike at all scales. An OTF varies with
  the direction too, but as the square of the frequency: at the coarsest detail only the light can be why;
- light only adds: an OTF of light has 1 - H(2f) <= 4 (1 - H(f)), as cosines have. A sharpened one breaks that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates, uniform_filter

from procedures.corruption.ring import missing_light
from procedures.psf import Psf
from procedures.two_photo.inter_image import PairFit
from procedures.two_photo.sharpness import patch_spectra

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

COARSE, FINE = (0.03, 0.15), (0.25, 0.5)
"""Bands of the far photograph's frequencies, in cycles/pixel, whose remains are compared."""
SMOOTHED = ((0.15, 0.25), (0.35, 0.5))
"""The same of middle detail and the finest."""
FAR_PATCH, NEAR_PATCH = 48, 256
"""Sides of the patches of which spectra are taken."""
COARSE_DETAIL = 0.05
"""Cycles/pixel of the far photograph at which the OTF cannot vary with the direction."""
ALIKE = (35 / 18) ** 2
"""Frequencies of a patch for each independent one: a Hann window correlates the power of neighbours by 4/9, and of next
neighbours by 1/36, along either axis."""
CLEAR = 3.0
"""Standard deviations from which a difference is not taken for scatter."""
LOWEST = 2.5
"""Cycles per patch from which the window does not smear the wall's spectrum."""
FINEST = 0.4
"""Cycles/pixel along both axes from which the near photograph is noise, or has less of it than any other place."""
HIGHEST = 0.47
"""Cycles/pixel up to which the near photograph's spectrum is used."""
COARSEST = 0.01
"""Cycles/pixel from which the near photograph's spectrum is used."""
MASK_PX = 1.0
"""Width of the masks of usual sharpening, in pixels."""
STEPS, SETTLED = 25, 3e-5
"""Of the fit to that spectrum: at most so many, and the change of its numbers under which none is farther from its end
than a hundredth of its scatter."""


@dataclass(frozen=True)
class NearLook:
    """How the near photograph's OTF differs from the one that was found, if the wall has detail of all sizes.

    Attributes
    ----------
    softness : (2,) float64
        Variance of a blur along x and y, in squared near pixels; negative where it is sharper.
    sharpening : float
        Amplitude of a sharpening by unsharp masking, as wide as `MASK_PX`.
    turned : (2,) float64
        How the spectrum's variation with cos 2 and sin 2 of the direction grows with the logarithm of the frequency:
        other light, motion, or a wall whose fine detail has another direction than its coarse one.
    wall_power : float
        Exponent of the wall's spectrum.
    most_noise : float
        Standard deviation of noise that is as strong as the finest detail of all, along the diagonals.
    """

    softness: Array
    sharpening: float
    turned: Array
    wall_power: float
    most_noise: float

    def log_modulus(self, fx: Array, fy: Array) -> Array:
        """The logarithm of the near photograph's |OTF| over that found, at near frequencies (n,): (2, n), what the blur
        and what the sharpening makes of it. The wall itself may be why for either, so they do not cancel."""
        blur = -2 * np.pi**2 * np.stack([fx**2, fy**2], axis=-1) @ self.softness
        mask = self.sharpening * (1 - np.exp(-2 * np.pi**2 * MASK_PX**2 * (fx**2 + fy**2)))
        return np.stack([blur, mask])


@dataclass(frozen=True)
class Likeness:
    """How alike both photographs are.

    Attributes
    ----------
    left_over : float
        Amplitude of what is left over at coarse detail beyond noise, over that of the wall there.
    colour : float
        Power of what is left over at coarse detail, over that at fine detail: 1 for noise, within its scatter.
    smoothing : float
        The same at middle detail over the finest: a smoothed far photograph has less noise the finer it is, while
        another light or response leaves coarse detail over.
    streaks : float
        Power of what is left over at fine detail along x, over that along y: 1 for noise.
    detail : float
        Power of what is left over where the far photograph has detail, over that where it has none: 1 for noise.
    near : NearLook
        What the near photograph's spectrum says.
    light_turned : float
        Amplitude of the OTF's variation with twice the direction at `COARSE_DETAIL`, without what grows as the square
        of the frequency, beyond twice its standard uncertainty.
    missing_light : float
        See `sharpening.missing_light`.
    beyond_light : float
        Largest excess of 1 - H(2f) over 4 (1 - H(f)) that is more than three standard uncertainties; 0 without one.
    """

    left_over: float
    colour: float
    smoothing: float
    streaks: float
    detail: float
    near: NearLook
    light_turned: float
    missing_light: float
    beyond_light: float


def likeness(fit: PairFit, psf: Psf, near: Array32) -> Likeness:
    """How alike the photographs are, by the final fit and the PSF drawn from it without constraint."""
    left_over, colour, smoothing, streaks = remains(fit)
    look = near_look(_common(fit, near), psf)
    return Likeness(
        *(left_over, colour, smoothing, streaks, at_detail(fit), look),
        *(light_turned(psf), missing_light(psf), beyond_light(psf)),
    )


def remains(fit: PairFit) -> tuple[float, float, float, float]:
    """`left_over`, `colour`, `smoothing` and `streaks` of `Likeness`, from the spectra of residual and prediction."""
    residual, prediction = np.zeros(fit.near.shape), np.full(fit.near.shape, fit.prediction.mean())
    residual[fit.samples.rows, fit.samples.columns] = fit.residual
    prediction[fit.samples.rows, fit.samples.columns] = fit.prediction
    rows, columns = (min(n, FAR_PATCH) for n in fit.near.shape)
    noise, patches = patch_spectra(residual.astype(np.float32), rows, columns)
    wall, _ = patch_spectra(prediction.astype(np.float32), rows, columns)
    fy, fx = np.broadcast_arrays(np.abs(np.fft.fftfreq(rows))[:, None], np.fft.rfftfreq(columns))
    r = np.hypot(fx, fy)
    coarse, fine, middle, finest = ((r >= low) & (r < high) for low, high in (COARSE, FINE, *SMOOTHED))
    along_x, along_y = ((a >= FINE[0]) & (b < COARSE[1]) for a, b in ((fx, fy), (fy, fx)))
    floor = float(noise[fine].mean())
    independent = patches / ALIKE
    excess = float(noise[coarse].mean()) - floor * (1 + 2 / np.sqrt(independent * coarse.sum()))
    share = max(excess, 0.0) / max(float(wall[coarse].mean()), 1e-12)
    pairs = ((coarse, fine), (middle, finest), (along_x, along_y))
    colour, smoothing, streaks = (clear_ratio(noise[one], noise[other], independent) for one, other in pairs)
    return float(np.sqrt(share)), colour, smoothing, streaks


def clear_ratio(one: Array, other: Array, independent: float) -> float:
    """Mean of one band's power over another's; 1 where scatter explains the difference.

    Parameters
    ----------
    one, other : (m,), (n,) float64
        Power at the frequencies of each band, a mean over patches.
    independent : float
        Independent values of a frequency's power. Noise has an exponential distribution of power: its standard
        deviation is its mean.
    """
    ratio = max(float(one.mean()), 1e-15) / max(float(other.mean()), 1e-15)
    scatter = np.sqrt((1 / one.size + 1 / other.size) / independent)
    return ratio if abs(np.log(ratio)) > CLEAR * scatter else 1.0


def at_detail(fit: PairFit) -> float:
    """`detail` of `Likeness`: the quarter of the samples that stand out most from their neighbours, over the quarter
    that does least, once what grows with the light is taken out."""
    prediction = np.full(fit.near.shape, fit.prediction.mean())
    prediction[fit.samples.rows, fit.samples.columns] = fit.prediction
    stands_out = np.abs(prediction - uniform_filter(prediction, 3))[fit.samples.rows, fit.samples.columns]
    power = fit.residual**2
    by_light = np.polyval(np.polyfit(fit.prediction, power, 1), fit.prediction)
    power = power / np.maximum(by_light, 0.1 * power.mean())
    low, high = np.quantile(stands_out, (0.25, 0.75))
    return float(power[stands_out > high].mean() / power[stands_out < low].mean())


def _common(fit: PairFit, near: Array32) -> Array32:
    """The part of the near photograph that the far one shows too."""
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    rim = fit.warp.forward(np.array([[x, y], [x + columns, y], [x + columns, y + rows], [x, y + rows]], dtype=float))
    low, high = np.maximum(rim.min(axis=0), 0).astype(int), rim.max(axis=0).astype(int)
    return near[low[1] : high[1], low[0] : high[0]]


def near_look(near: Array32, psf: Psf) -> NearLook:
    """A fit to the logarithm of the near photograph's spectrum.

    With S the wall's spectrum, a power of the frequency whose factor may vary with twice the direction, the model is
    the sum over aliases of S(f) |H(f)|^2 times the square of what `NearLook` describes, plus noise that is white. Every
    octave of frequencies counts alike. What is within its scatter is left out.
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
    for _ in range(STEPS):
        parts = np.exp(np.clip(X @ theta, -60, 30)) * H2
        total = parts.sum(axis=0) + noise
        J = np.column_stack([np.einsum("an,anp->np", parts, X) / total[:, None], noise / total])
        left = y - np.log(total)
        robust = weight / (1 + (left / 0.5) ** 2)  # a pattern's peaks are no power of the frequency
        JW = J * robust[:, None]
        G = JW.T @ J
        step = np.linalg.solve(G + 1e-3 * np.diag(np.diag(G)) + 1e-9 * np.eye(len(G)), JW.T @ left)
        theta = theta + np.clip(step[:-1], -1, 1)
        if np.abs(step[:-1]).max() < SETTLED:
            break
        noise = float(np.clip(noise * np.exp(np.clip(step[-1], -1, 1)), 1e-3 * most, most))
    inverted = np.linalg.inv(G + 1e-9 * np.eye(len(G)))
    scatter = np.sqrt(np.diag(inverted @ (JW.T @ JW) @ inverted)[:-1]) * float(np.std(left))
    told = np.sign(theta) * np.maximum(np.abs(theta) - scatter, 0)
    told[7:9][np.abs(theta[7:9]) < CLEAR * scatter[7:9]] = 0.0
    return NearLook(told[2:4], float(told[4]), told[7:9], float(-theta[1]), most_noise)


def _wall_terms(fx: Array, fy: Array) -> Array:
    """What the logarithm of the near photograph's spectrum over |H|^2 is a combination of: (n, 9)."""
    turn, r = 2 * np.arctan2(fy, fx), np.hypot(fx, fy)
    blur_x, blur_y = (-4 * np.pi**2 * np.minimum(f * f, 0.3) for f in (fx, fy))
    mask = 2 * (1 - np.exp(-2 * np.pi**2 * MASK_PX**2 * r**2))
    cos, sin, log = np.cos(turn), np.sin(turn), np.log(r)
    return np.stack([np.ones_like(fx), log, blur_x, blur_y, mask, cos, sin, log * cos, log * sin], axis=-1)


def _squared_modulus(psf: Psf, at: list[tuple[Array, Array]]) -> Array:
    """|OTF|^2 at lists of frequencies in |fx|, |fy| < 1.5, between those of a grid; 0 beyond the band."""
    grid = np.arange(-48, 49) / 32
    x, y = (f.ravel() for f in np.meshgrid(grid[48:], grid))
    band = np.maximum(np.abs(x), np.abs(y)) <= psf.s / 2
    values = np.zeros(len(x))
    values[band] = np.abs(psf.spectra(x[band], y[band]) @ psf.parameters / psf.light) ** 2
    table = values.reshape(97, 49)
    found = []
    for fx, fy in at:
        sign = np.where(fx < 0, -1, 1)
        found.append(map_coordinates(table, [sign * fy * 32 + 48, np.abs(fx) * 32], order=1))
    return np.stack(found)


def light_turned(psf: Psf) -> float:
    """`light_turned` of `Likeness`."""
    turn = np.pi * np.arange(16) / 16
    waves = np.stack([np.cos(2 * turn), np.sin(2 * turn)]) / 8
    told = np.zeros(2)
    slope = np.zeros((2, len(psf.parameters)))
    for f, share in ((COARSE_DETAIL, 1.0), (2 * COARSE_DETAIL, -0.25)):
        spectra = psf.spectra(f * np.cos(turn), f * np.sin(turn))
        H = spectra @ psf.parameters
        told += share * waves @ np.log(np.abs(H))
        slope += share * waves @ np.real(spectra / H[:, None])
    variance = np.einsum("ij,jk,ik->i", slope, psf.parameter_covariance, slope).sum()
    return max(float(np.hypot(*told)) - 2 * float(np.sqrt(max(variance, 0))), 0.0)


def beyond_light(psf: Psf) -> float:
    """`beyond_light` of `Likeness`: along x, y and the diagonals, to half of the band."""
    worst = 0.0
    f = np.linspace(0.04, psf.s / 4, 12)
    for x, y in ((1, 0), (0, 1), (0.7071, 0.7071), (0.7071, -0.7071)):
        slope = (4 * psf.spectra(x * f, y * f).real - psf.spectra(2 * x * f, 2 * y * f).real) / psf.light
        value = slope @ psf.parameters - 3
        slope = slope - (value + 3)[:, None] * psf.weights / psf.light
        uncertainty = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slope, psf.parameter_covariance, slope), 0))
        sure = value[value > 3 * uncertainty]
        worst = max(worst, float(sure.max(initial=0.0)))
    return worst
