"""Information content of a camera's pictures, independent of later processing: NEQ and information capacity.

With the large-area signal S, the modulation transfer function MTF and the noise power NPS of the same linear plane,

    NEQ(u, v) = S^2 MTF(u, v)^2 / NPS(u, v)

is the number of quanta per pixel that an ideal counter requires for that signal-to-noise ratio at (u, v). A filter,
such as sharpening, multiplies MTF^2 and NPS by the same factor, so that NEQ and numbers derived from it do not change.
NPS includes aliasing, as the picture does.

Source: Dainty, Shaw, Image Science, 1974, chapter 8; Shannon, A mathematical theory of communication, 1948, section 25.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.numbers import DSNU, GENERAL_DYNAMIC_RANGE, GENERAL_SNR_MAX, GENERAL_THRESHOLD, PRNU
from procedures.numerics.arrays import Array
from procedures.psf import Psf
from procedures.sensor.curves import Curves
from procedures.sensor.defects import IntervalNumber, from_draws, measured
from procedures.sensor.photon_transfer import Transfer
from procedures.sensor.spectrograms import NEIGHBOURS, NoisePower

SCENE = 1 / 3
"""Variance of the scene over the square of its mean: independent pixels with uniformly distributed levels from black to
twice the mean. Less varied scenes contain less information."""
DRAWS = 200


@dataclass(frozen=True, eq=False)
class Information:
    """Information content of one plane at one position.

    frequencies : (n,), along one axis, cycles per pixel, in the order of `numpy.fft.fftfreq`
    mtf, nps, neq, neq_uncertainty : (n, n), [fy, fx]
    equivalent_mtf, equivalent_mtf_uncertainty : (n, n) sqrt(NEQ / NEQ at 0): the MTF of an equivalent camera with white
        noise
    """

    frequencies: Array
    mtf: Array
    nps: Array
    neq: Array
    neq_uncertainty: Array
    equivalent_mtf: Array
    equivalent_mtf_uncertainty: Array
    numbers: Mapping[str, IntervalNumber]


def information(psf: Psf, noise: NoisePower, rng: np.random.Generator) -> Information:
    """NEQ, noise-equivalent MTF and information capacity with uncertainties; psf : in pixels of the noise's plane."""
    f = noise.frequencies
    mtf = _drawn_mtf(psf, f, rng)
    neq = noise.signal**2 * mtf**2 / noise.power
    # at frequency 0, where changes of the light disturb, the value of a paraboloid through the places around
    places = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if i or j]
    weights = np.linalg.pinv(np.array([[1.0, i * i + j * j] for i, j in places]))[0]
    neq[:, 0, 0] = sum(w * neq[:, i, j] for w, (i, j) in zip(weights, places, strict=True))
    of_zero = float(np.linalg.norm(weights))
    share = 1 / np.sqrt(noise.blocks)  # of the NPS at each frequency
    spread = np.hypot(np.std(neq[1:], axis=0), neq[0] * share)
    base = neq[:, :1, :1]
    equivalent = np.sqrt(neq / base)
    of_equivalent = np.hypot(np.std(equivalent[1:], axis=0), equivalent[0] * share / 2 * np.hypot(1, of_zero))
    numbers = _numbers(neq, noise, share, of_zero)
    return Information(f, mtf[0], noise.power, neq[0], spread, equivalent[0], of_equivalent, numbers)


def _drawn_mtf(psf: Psf, f: Array, rng: np.random.Generator) -> Array:
    """|OTF| over the band of the PSF and of draws of it, (1 + draws, n, n)."""
    fx, fy = np.meshgrid(f, f)
    waves = psf.spectra(fx.ravel(), fy.ravel())
    values, vectors = np.linalg.eigh(psf.parameter_covariance)
    steps = vectors * np.sqrt(np.maximum(values, 0))
    drawn = np.vstack([psf.parameters, psf.parameters + rng.standard_normal((DRAWS, len(values))) @ steps.T])
    mtf = np.abs(waves @ drawn.T) / (drawn @ psf.weights)
    # the modulus of noise has a positive mean: subtract it
    lift = np.maximum(np.mean(mtf[:, 1:] ** 2, axis=1) - mtf[:, 0] ** 2, 0)
    mtf = np.sqrt(np.maximum(mtf**2 - lift[:, None], 0))
    return np.asarray(mtf.T.reshape(-1, len(f), len(f)))


def _numbers(neq: Array, noise: NoisePower, share: float, of_zero: float) -> Mapping[str, IntervalNumber]:
    snr = SCENE * neq
    capacity = np.mean(np.log2(1 + snr), axis=(1, 2)) / 2
    slope = snr[0] / (1 + snr[0]) / (2 * np.log(2) * snr[0].size)
    # frequencies of opposite sign are equal
    from_noise = share * np.sqrt(2 * NEIGHBOURS * np.sum(slope**2))
    n = noise.blocks * noise.power.size
    quarter = len(noise.power) // 4
    zero, half = neq[0, 0, 0], np.sqrt(neq[:, 0, quarter] * neq[:, quarter, 0])
    return {
        "information_capacity": measured(
            float(capacity[0]), float(np.hypot(np.std(capacity[1:]), from_noise)), "bit/pixel",
            "Shannon, of a scene of levels evenly spread from black to twice the mean", n, least=0.0,
        ),
        "neq_zero": measured(float(zero), float(zero * share * of_zero * np.sqrt(NEIGHBOURS)), "quanta/pixel",
                             "noise-equivalent quanta at low frequency", n, least=0.0),
        "neq_quarter": measured(
            float(half[0]), float(np.hypot(np.std(half[1:]), half[0] * share / np.sqrt(2))), "quanta/pixel",
            "noise-equivalent quanta at 1/4 cycles/pixel, of rows and columns the geometric mean", n, least=0.0,
        ),
    }  # fmt: skip


# --- Signal-to-noise ratios by the general model, and by the linear one ---
# EMVA 1288 release 4.0 general, sections 2 and 6: without gain and electrons. Noise of the output, divided by the slope
# of the characteristic curve, is noise of the light; the light over that is the signal-to-noise ratio. Release 4.0
# linear, sections 2.4 and 4.3.


def input_snr(curves: Curves) -> Array:
    """Light over its noise derived from the output, (1 + draws, levels); 0 where the output no longer rises."""
    slope = np.gradient(curves.signal, curves.light[0], axis=1)
    return np.asarray(curves.light[:1] * np.maximum(slope, 0) / np.sqrt(np.maximum(curves.variance, 1 / 12)))


def threshold(curves: Curves) -> Array:
    """Light equal to its noise, (1 + draws,), with noise linear in the light from dark to the first level."""
    light, signal = curves.light[0, 0], curves.signal[:, 0]
    slope = signal / light
    growth = curves.excess[:, 0] / light
    dark = curves.variance[:, 0] - curves.excess[:, 0]
    return np.asarray((growth + np.sqrt(growth**2 + 4 * slope**2 * dark)) / (2 * slope**2))


def general_numbers(curves: Curves, saturation: int, *, photons_known: bool) -> Mapping[str, IntervalNumber]:
    """Largest SNR, threshold and dynamic range of the general model."""
    snr = input_snr(curves)[:, : saturation + 1]
    best = int(np.argmax(snr[0]))
    least, n = threshold(curves), curves.samples
    unit = "photons" if photons_known else "unit of light"
    dynamic_range = curves.light[:, saturation] / least
    return {
        GENERAL_SNR_MAX: from_draws(snr[:, best], "1", "largest ratio of light to its noise at a level", n),
        GENERAL_THRESHOLD: from_draws(least, unit, "light that is its own noise, from dark to the first level", n),
        GENERAL_DYNAMIC_RANGE: from_draws(dynamic_range, "1", "light at saturation over threshold", n),
    }


def linear_snr(transfer: Transfer, light: Array) -> Array:
    """Temporal SNR of one pixel at light (n,): electrons over dark noise, rounding and photon noise."""
    e, variance = _electrons(transfer, light)
    return np.asarray(e / np.sqrt(variance))


def total_snr(transfer: Transfer, numbers: Mapping[str, IntervalNumber], light: Array) -> Array:
    """SNR of one picture at light (n,), including DSNU and PRNU; NaN where these are not known."""
    if PRNU not in numbers:
        return np.full(len(light), np.nan)
    e, variance = _electrons(transfer, light)
    dsnu_e, prnu = numbers[DSNU].value, numbers[PRNU].value / 100
    return np.asarray(e / np.sqrt(variance + dsnu_e**2 + (prnu * e) ** 2))


def _electrons(transfer: Transfer, light: Array) -> tuple[Array, Array]:
    """Mean electrons at light (n,), and their temporal variance."""
    e, dark_e = light * transfer.responsivity[0] / transfer.gain[0], transfer.dark_deviation[0] / transfer.gain[0]
    return e, e + dark_e**2
