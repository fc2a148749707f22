"""Whether both photographs are of one wall in one light, equally sharp and left as the sensor gave them.

Three things tell, none of which the fit itself can see:

- what the near photograph does not explain of the far one must be noise, as strong at coarse detail as at fine detail.
  Coarse remains are another light, another response, or a far photograph whose noise was smoothed; where something
  incoherent remains, about as much may be wrong coherently, and that is an error of the kernel;
- the near photograph's own spectrum, divided by the OTF that was found, is the wall's. Walls have detail of all sizes, a
  spectrum like a power of the frequency: what falls off faster or slower is another sharpness of the near photograph,
  or the wall itself. Nothing in two photographs tells these two apart, so it counts as an uncertainty;
- light only adds: an OTF of light has 1 - H(2f) <= 4 (1 - H(f)), as cosines have. A sharpened one breaks that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from procedures.psf import Psf
from procedures.two_photo.inter_image import Fit
from procedures.two_photo.sharpness import patch_spectra

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

COARSE, FINE = (0.03, 0.15), (0.25, 0.5)
"""Bands of the far photograph's frequencies, in cycles/pixel, whose remains are compared."""
FAR_PATCH, NEAR_PATCH = 48, 128
"""Sides of the patches of which spectra are taken."""
LOWEST = 2.5
"""Cycles per patch from which the window does not smear the wall's spectrum."""
HIGHEST = 0.47
"""Cycles/pixel up to which the near photograph's spectrum is used."""
STEPS = 25


@dataclass(frozen=True)
class Likeness:
    """How alike both photographs are.

    Attributes
    ----------
    left_over : float
        Amplitude of what is left over at coarse detail beyond noise, over that of the wall there.
    colour : float
        Power of what is left over at coarse detail, over that at fine detail: 1 for noise.
    softness : (2,) float64
        Variance of the blur along x and y, in squared near pixels, by which the near photograph is softer than a wall of
        all sizes would be; negative where it is sharper.
    wall_power : float
        Exponent of the wall's spectrum.
    beyond_light : float
        Largest excess of 1 - H(2f) over 4 (1 - H(f)) that is more than three standard uncertainties; 0 without one.
    """

    left_over: float
    colour: float
    softness: Array
    wall_power: float
    beyond_light: float


def likeness(fit: Fit, psf: Psf, near: Array32) -> Likeness:
    """How alike the photographs are, by the final fit and the PSF drawn from it without constraint."""
    left_over, colour = remains(fit)
    softness, power = near_softness(_common(fit, near), psf)
    return Likeness(left_over, colour, softness, power, beyond_light(psf))


def remains(fit: Fit) -> tuple[float, float]:
    """`left_over` and `colour` of `Likeness`, from the spectra of residual and prediction."""
    residual, prediction = np.zeros(fit.near.shape), np.full(fit.near.shape, fit.prediction.mean())
    residual[fit.samples.rows, fit.samples.columns] = fit.residual
    prediction[fit.samples.rows, fit.samples.columns] = fit.prediction
    rows, columns = (min(n, FAR_PATCH) for n in fit.near.shape)
    noise, patches = patch_spectra(residual.astype(np.float32), rows, columns)
    wall, _ = patch_spectra(prediction.astype(np.float32), rows, columns)
    f = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    coarse, fine = ((f >= low) & (f < high) for low, high in (COARSE, FINE))
    floor = float(noise[fine].mean())
    scatter = 1 / np.sqrt(0.4 * patches * coarse.sum())  # overlapping windows: two fifths of them are independent
    excess = float(noise[coarse].mean()) - floor * (1 + 2 * scatter)
    share = max(excess, 0.0) / max(float(wall[coarse].mean()), 1e-12)
    return float(np.sqrt(share)), float(noise[coarse].mean()) / max(floor, 1e-15)


def _common(fit: Fit, near: Array32) -> Array32:
    """The part of the near photograph that the far one shows too."""
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    rim = fit.warp.forward(np.array([[x, y], [x + columns, y], [x + columns, y + rows], [x, y + rows]], dtype=float))
    low, high = np.maximum(rim.min(axis=0), 0).astype(int), rim.max(axis=0).astype(int)
    return near[low[1] : high[1], low[0] : high[0]]


def near_softness(near: Array32, psf: Psf) -> tuple[Array, float]:
    """`softness` and `wall_power` of `Likeness`: a fit to the logarithm of the near photograph's spectrum.

    With S the wall's spectrum, a power of the frequency whose factor may vary with twice the direction, the model is
    sum over aliases of S(f) H(f)^2 exp(-4 pi^2 (b_x f_x^2 + b_y f_y^2)), plus noise that is white. Every octave of
    frequencies counts alike.
    """
    rows, columns = (min(n, NEAR_PATCH) for n in near.shape)
    power, _ = patch_spectra(near, rows, columns)
    fy, fx = np.broadcast_arrays(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    r = np.hypot(fx, fy)
    used = (r > LOWEST / min(rows, columns)) & (np.maximum(np.abs(fx), np.abs(fy)) <= HIGHEST) & (fx > 0)
    fx, fy, r, power = fx[used], fy[used], r[used], np.maximum(power[used], 1e-15)
    aliases = [(fx + i, fy + j) for i in (0, -1) for j in (0, -1, 1)]
    H2 = _squared_modulus(psf, aliases)
    X = np.stack([_wall_terms(*f) for f in aliases])
    y, weight = np.log(power), 1 / r
    theta = np.array([float(np.mean(y[r < 0.1] + 2 * np.log(r[r < 0.1]))), -2.0, 0, 0, 0, 0])
    most = 0.98 * float(power.min())
    noise = 0.5 * most
    for _ in range(STEPS):
        parts = np.exp(np.clip(X @ theta, -60, 30)) * H2
        total = parts.sum(axis=0) + noise
        J = np.column_stack([np.einsum("an,anp->np", parts, X) / total[:, None], noise / total])
        left = y - np.log(total)
        robust = weight / (1 + (left / 0.5) ** 2)  # a pattern's peaks are no power of the frequency
        JW = J * robust[:, None]
        damping = 1e-3 * np.diag(np.diag(JW.T @ J)) + 1e-9 * np.eye(J.shape[1])
        step = np.linalg.solve(JW.T @ J + damping, JW.T @ left)
        theta = theta + np.clip(step[:-1], -1, 1)
        noise = float(np.clip(noise * np.exp(np.clip(step[-1], -1, 1)), 1e-3 * most, most))
    return theta[2:4], float(-theta[1])


def _wall_terms(fx: Array, fy: Array) -> Array:
    """What the logarithm of the wall's spectrum, blurred, is a combination of: (n, 6)."""
    turn = 2 * np.arctan2(fy, fx)
    blur_x, blur_y = (-4 * np.pi**2 * np.minimum(f * f, 0.3) for f in (fx, fy))
    return np.stack([np.ones_like(fx), np.log(np.hypot(fx, fy)), blur_x, blur_y, np.cos(turn), np.sin(turn)], axis=-1)


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
