"""Point spread function: samples on the 1/s grid, with their covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from procedures.display import axes_of, html, summary
from procedures.numerics.arrays import Array, Complex
from procedures.numerics.kernel_tail import (
    DIFFERS,
    LEAST_TAIL,
    SHAPES,
    tail_border,
    tail_density,
    tail_kernels,
    tail_spectra,
    tail_sums,
)
from procedures.numerics.normal_equations import SOLVERS
from procedures.numerics.transforms import j0, j1
from procedures.outcome import BadParameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PER_PX, MOST_SAMPLES = 16, 101  # largest s and k: the covariance of 101 x 101 samples takes 0.8 GB


@dataclass(frozen=True)
class Sampling:
    """Sampling of a PSF, and solver. Raises BadParameter if one of them is out of range.

    s : samples per pixel of the plane; None: automatic
    k : samples along one side of the support, odd; None: automatic
    solver : "ls" least squares, "clip" with its negative part set to 0, "nnls" non-negative least squares (with the
        chart: under a prior of amplitude, width and smoothness estimated from the photograph)
    at : frequencies in cycles per pixel of the plane at which the MTF is reported
    """

    s: int | None
    k: int | None
    solver: str
    at: tuple[float, ...]

    def __post_init__(self) -> None:
        s, k, got = self.s, self.k, f"got s = {self.s or 'auto'}, k = {self.k or 'auto'}"
        refusals = (
            (any(number is not None and number != int(number) for number in (s, k)),
             f"s and k must be whole numbers; {got}", "give s = 4 and k = 17"),
            ((s or 0) > MOST_PER_PX or (k or 0) > MOST_SAMPLES,
             f"s must be at most {MOST_PER_PX} and k at most {MOST_SAMPLES}; {got}",
             "give s = 4 and k = 17, or omit both for the automatic choice"),
            (s is not None and s < 1, f"s must be 1 or more; got s = {s}", "give s = 3 or 4"),
            (k is not None and (k < 3 or k % 2 == 0),
             f"k must be odd and 3 or more, so that the support has a centre; got k = {k}",
             f"give k = {k + 1 if k is not None and k > 3 else 17}"),
            (s is not None and k is not None and k < s,
             f"k must be at least s, so that the support is a pixel wide; {got}", f"give k = {4 * (s or 4) + 1}"),
            (self.solver not in SOLVERS, f"the solver must be one of {', '.join(SOLVERS)}; got {self.solver!r}",
             "give one of them"),
            (not all(0 <= frequency < np.inf for frequency in self.at),
             f"frequencies must be finite, 0 or more; got {self.at}", "give 0.1 and 0.25, for example"),
        )  # fmt: skip
        for wrong, reason, remedy in refusals:
            if wrong:
                raise BadParameter(reason, remedy)

    def to_record(self) -> dict[str, int | float | str | list[float]]:
        at = {"at": list(self.at)} if self.at else {}
        return {"s": self.s or "auto", "k": self.k or "auto", "solver": self.solver, **at}


@dataclass(frozen=True)
class PsfTail:
    """Tail of a PSF outside its support: amplitudes of the shapes of `numerics.kernel_tail`, for samples of sum 1.

    amplitudes : (q,) amplitudes of the first q shapes; the first is the energy of the mean tail over that inside the
        support
    covariance : (q, q) float64
    cross : (k^2, q) covariance of the samples with the amplitudes
    """

    amplitudes: Array
    covariance: Array
    cross: Array

    @classmethod
    def none(cls, samples: int) -> PsfTail:
        """Tail of a PSF of `samples` samples that ends with its support."""
        return cls(np.zeros(0), np.zeros((0, 0)), np.zeros((samples, 0)))


@dataclass(frozen=True)
class Psf:
    """A PSF sampled s times per pixel of its plane: its support, and the tail outside it.

    h : (k, k) float64, samples [row, column], k odd, sum 1. The centre sample is the centre by the chart's marks, or
        the centroid without marks. The photograph is the *convolution* with h: a tail to larger columns smears light to
        larger columns.
    s : int, samples per sensor pixel of the plane: the pitch is 1/s pixel
    covariance : (k^2, k^2) float64, covariance of `h.ravel()`, nuisance parameters included
    tail : PsfTail, tail outside the support; none by default
    lacking : (k^2, k^2) float64 or None, part of `covariance` that is model error instead of noise, as between the
        nodes of a field: unlike noise, it adds no energy to the samples. None: all of it is noise.

    Notes
    -----
    Every number of the whole PSF is a function of `parameters`, the samples and then the tail's amplitudes, with the
    one covariance `parameter_covariance`.
    """

    h: Array
    s: int
    covariance: Array
    tail: PsfTail = field(default_factory=lambda: PsfTail.none(0))
    lacking: Array | None = None

    def __post_init__(self) -> None:
        k = self.h.shape[0]
        if self.h.shape != (k, k) or k % 2 == 0:
            raise BadParameter(f"a PSF is an odd square of samples; got shape {self.h.shape}", "give 17 x 17 of them")
        if self.covariance.shape != (k * k, k * k):
            shape = self.covariance.shape
            raise BadParameter(f"the covariance of {k * k} samples is {k * k} square; got {shape}", "give all pairs")
        if self.s < 1 or self.s != int(self.s) or not np.isfinite(self.h).all():
            raise BadParameter(f"a PSF has finite samples, s a pixel; got s = {self.s}", "give s = 1 or more, whole")
        if not 0 <= np.trace(self.covariance) < np.inf:
            raise BadParameter("the variances of a PSF must be finite, 0 or more", "give their covariance")
        q = len(self.tail.amplitudes)
        if q > len(SHAPES) or (q and self.tail.cross.shape != (k * k, q)) or self.tail.covariance.shape != (q, q):
            raise ValueError(f"the tail's covariances must fit {k * k} samples and {q} of {len(SHAPES)} shapes")

    __repr__ = summary
    _repr_html_ = html

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the samples, in pixels of the plane about the centre."""
        ax, end = axes_of(ax), self.k / 2 / self.s
        picture = ax.imshow(self.h, cmap="gray", extent=(-end, end, end, -end))
        ax.figure.colorbar(picture, ax=ax, label="share of the light per sample")
        ax.set(xlabel="x / pixel", ylabel="y / pixel")
        return ax

    @classmethod
    def of(cls, parameters: Array, covariance: Array, k: int, s: int, lacking: Array | None = None) -> Psf:
        """PSF of k x k samples with these `parameters` (k^2 + q,) and their covariance.

        `lacking` (k^2 + q, k^2 + q) is the part of the covariance that is not noise.
        """
        n = k * k
        tail = PsfTail(parameters[n:], covariance[n:, n:], covariance[:n, n:])
        lacking_samples = None if lacking is None else lacking[:n, :n]
        return cls(parameters[:n].reshape(k, k), s, covariance[:n, :n], tail, lacking_samples)

    @classmethod
    def of_unit_sum(cls, parameters: Array, covariance: Array, k: int, s: int) -> Psf:
        """`of`, after normalisation of the samples to sum 1, to first order in the covariance."""
        n = k * k
        total = parameters[:n].sum()
        p = parameters / total
        # J C J' with J = (I - p 1_n') / total
        covariance = covariance - np.outer(p, covariance[:n].sum(axis=0))
        covariance = (covariance - np.outer(covariance[:, :n].sum(axis=1), p)) / total**2
        return cls.of(p, covariance, k, s)

    @property
    def relative_uncertainty(self) -> float:
        """Relative L2 error to expect: the root of the covariance's trace over the norm of the samples."""
        return float(np.sqrt(np.trace(self.covariance)) / np.linalg.norm(self.h))

    @property
    def k(self) -> int:
        """Number of samples along one side."""
        return int(self.h.shape[0])

    @property
    def offsets_px(self) -> Array:
        """Distance of the samples from the centre along one axis, (k,), in pixels of the plane."""
        return (np.arange(self.k) - self.k // 2) / self.s

    @cached_property
    def parameters(self) -> Array:
        """Samples, then the tail's amplitudes, (k^2 + q,)."""
        return _read_only(np.concatenate([self.h.ravel(), self.tail.amplitudes]))

    @property
    def parameter_covariance(self) -> Array:
        """Covariance of `parameters`, (k^2 + q, k^2 + q)."""
        if not len(self.tail.amplitudes):
            return self.covariance
        n, size = self.k**2, self.k**2 + len(self.tail.amplitudes)
        whole = np.empty((size, size))
        whole[:n, :n], whole[n:, n:] = self.covariance, self.tail.covariance
        whole[:n, n:], whole[n:, :n] = self.tail.cross, self.tail.cross.T
        return whole

    @cached_property
    def weights(self) -> Array:
        """Energy of unit parameters, (k^2 + q,): 1 for a sample, a shape's energy for an amplitude."""
        sums = tail_sums(self.k)[: len(self.tail.amplitudes)] if len(self.tail.amplitudes) else np.zeros(0)
        return _read_only(np.concatenate([np.ones(self.k**2), sums]))

    @cached_property
    def light(self) -> float:
        """Total energy, relative to that inside the support."""
        return float(self.weights @ self.parameters)

    @property
    def share_outside(self) -> float:
        """Share of the energy outside the support."""
        return 1 - float(self.h.sum()) / self.light

    @property
    def energy_outside(self) -> tuple[float, float]:
        """Share of the energy outside the support, and its standard uncertainty."""
        share = self.share_outside
        slope = self.weights * (1 - share) - np.concatenate([np.ones(self.k**2), np.zeros_like(self.tail.amplitudes)])
        slope = slope / self.light
        return share, float(np.sqrt(max(slope @ self.parameter_covariance @ slope, 0.0)))

    def narrowed(self, share: float) -> Psf:
        """PSF with its samples low-passed to a share of the band; the covariance is unchanged."""
        n = np.arange(self.k)
        low = share * np.sinc(share * (n[:, None] - n))
        return Psf(low @ self.h @ low.T, self.s, self.covariance, self.tail)

    @property
    def tail_density_px(self) -> float:
        """Coefficient A of the mean far tail A / r^3 per square pixel, r in pixels, for total energy 1."""
        if not len(self.tail.amplitudes):
            return 0.0
        return float(self.tail.amplitudes[0]) * tail_density(self.k) / self.s / self.light

    def spectra(self, fx: Array, fy: Array) -> Complex:
        """Spectra of unit parameters at frequencies (n,) in cycles/pixel: (n, k^2 + q)."""
        ex = np.exp(-2j * np.pi * np.asarray(fx)[:, None] * self.offsets_px)
        ey = np.exp(-2j * np.pi * np.asarray(fy)[:, None] * self.offsets_px)
        inside = (ey[:, :, None] * ex[:, None, :]).reshape(-1, self.k**2)
        q = len(self.tail.amplitudes)
        if not q:
            return np.asarray(inside)
        return np.hstack([inside, tail_spectra(np.asarray(fx) / self.s, np.asarray(fy) / self.s, self.k)[:, :q]])

    def extended(self) -> Array:
        """Image (K, K) of the support and the tail within the range of its shapes; (k, k) without a tail."""
        return extended(self.parameters, self.k)

    def contract(self, image: Array) -> Array:
        """Derivative (k^2 + q,) by the parameters, given the derivative `image` by `extended()`."""
        q = len(self.tail.amplitudes)
        if not q:
            return np.asarray(image.ravel())
        rim = tail_border(self.k) - self.k // 2
        outside = np.tensordot(tail_kernels(self.k)[:q], image, axes=2)
        return np.concatenate([image[rim:-rim, rim:-rim].ravel(), outside])


def _read_only(array: Array) -> Array:
    """Make an array read-only, as it is cached and shared."""
    array.flags.writeable = False
    return array


def extended(parameters: Array, k: int) -> Array:
    """Samples and tail (K, K) of parameters (k^2 + q,), as `Psf.extended`."""
    h, amplitudes = parameters[: k * k].reshape(k, k), parameters[k * k :]
    if not len(amplitudes):
        return h
    image = np.tensordot(amplitudes, tail_kernels(k)[: len(amplitudes)], axes=1)
    rim = tail_border(k) - k // 2
    image[rim:-rim, rim:-rim] = h
    return np.asarray(image)


# --- Model error of a PSF's tail: departure of the true tail from its few shapes, and the effect on OTF and energy ---

ROUGHNESS = 0.25
"""Relative deviation of a true tail's density from the fitted one: rings of a small aperture, spikes of an iris. For
Airy discs, defocus, coma and polygons it was 0.1 to 0.3, for spikes up to 1."""
RINGS = 0.25
"""Effect of a pupil's rings on the energy outside a square support, over (f_c R)^-3/2 of it.

The phase is stationary at the middles of the four sides: 1 / (8^1/2 pi) = 0.11 for the rings 1 - sin(2 pi f_c r) of a
clear circle, 0.46 for the slower beat, of period 2 / ((1 - 0.3) f_c), of a pupil obstructed to 0.3 of its diameter."""
CUT_OFF = 0.25
"""Energy beyond the support over that in its outer half pixel, for Gaussians and discs that it cuts off: 0.1 to 0.5."""
RING_FREQUENCIES = np.linspace(0.25, 1.0, 13)
"""Frequencies of rings, over f_c: from the beat of a pupil obstructed to a half to the rings of a clear one."""
RING_RADII = np.arange(1.02, 9.0, 0.04)
"""Radii over that of the support at which rings are summed; they are tapered towards the end."""
WAVE_STEP = 0.1  # of the table's arguments
FINEST_RINGS = 8.0  # greatest f_c R that is distinguished: finer rings have no effect


def truncation(psf: Psf) -> float:
    """Standard uncertainty of the OTF by the model error of the tail, at frequencies resolved by the support.

    A tail of energy E outside a radius R has the density E R / (2 pi r^3). A relative deviation of `ROUGHNESS`,
    constant over a square pixel and independent between pixels, changes the OTF by ROUGHNESS E sqrt(pi / 2) / (2 pi R).
    It is larger where the PSF's own shape extends beyond the support: see `tail_energy_uncertainty`.
    """
    radius = psf.k / 2 / psf.s
    rough = _excess_factor(psf) * ROUGHNESS
    return rough * abs(psf.share_outside) * float(np.sqrt(np.pi / 2)) / (2 * np.pi * radius)


def cut_off(psf: Psf) -> float:
    """Energy of the PSF's own shape that the support may cut off: `CUT_OFF` of that in the outer half pixel of the
    support, less the tail continued inwards and less noise.

    Of a lens in focus the tail continues smoothly. Where a broad blur, a halo or a disc of defocus reaches the border,
    the tail has the wrong shape: up to 0.02 of the OTF at 0.05 cycles/pixel. Where a Gaussian's flank does,
    the mean tail is negative and a steeper one positive.
    """
    amplitudes = psf.tail.amplitudes
    if not len(amplitudes):
        return 0.0
    n, first = np.arange(psf.k) - psf.k // 2, psf.k // 2 + 1
    outer = np.maximum(np.abs(n), np.abs(n[:, None])) > psf.k // 2 - psf.s / 2
    r, border = np.maximum(np.hypot(n, n[:, None]), 1)[outer] / first, tail_border(psf.k)
    inwards = np.zeros(len(amplitudes))
    for i in range(min(len(amplitudes), 2)):
        inwards[i] = tail_kernels(psf.k)[i, border, border + first] * (r ** -(3 + 2 * i)).sum()
    excess = np.concatenate([outer.ravel(), -inwards]) / psf.light
    value = float(excess @ psf.parameters)
    variance = float(excess @ psf.parameter_covariance @ excess)
    lacking = -float(amplitudes[0])
    squares = (value * abs(value) - variance, lacking * abs(lacking) - float(psf.tail.covariance[0, 0]), 0.0)
    return CUT_OFF * math.sqrt(max(squares))


def tail_energy_uncertainty(psf: Psf) -> float:
    """Standard uncertainty of the share outside the support by the model error: ROUGHNESS E / (R sqrt(8 pi)).

    At small apertures rings are wider than pixels and coherent: RINGS E / (f_c R)^3/2, f_c from the far tail. Where the
    amplitudes of the shapes exceed those of a lens in focus (coma and astigmatism in the corner of a field, extending
    beyond the support), the model error is scaled by the same factor.
    """
    radius = psf.k / 2 / psf.s
    rings = float(np.pi**3 * max(psf.tail_density_px, 0.0) / radius) ** 1.5
    rough = _excess_factor(psf) * ROUGHNESS / (radius * float(np.sqrt(8 * np.pi)))
    return float(np.hypot(abs(psf.share_outside) * np.hypot(rough, RINGS * rings), cut_off(psf)))


def _excess_factor(psf: Psf) -> float:
    """Rms ratio of the amplitudes after the mean tail's to those expected, at least 1; a large one counts 1 less."""
    first, *others = psf.tail.amplitudes.tolist() or [0.0]
    ratios = np.abs(others) / (DIFFERS[: len(others)] * max(abs(first), LEAST_TAIL))
    return max(1.0, float(np.sqrt(np.mean(ratios**2))), float(ratios.max()) - 1) if others else 1.0


def curve_model_error(psf: Psf, f: Array, mtf: Array, slope: Array, passed: Array | float = 1.0) -> Array:
    """Standard uncertainty (n,) of an MTF curve by the model error of the tail.

    Three independent parts: the tail's roughness, its rings, and the energy outside the support, by which the OTF is
    normalised. All vanish at frequency 0.

    f : (n,) in cycles/pixel
    mtf : (n,) the PSF's MTF
    slope : (n, k^2 + q or more); derivative of the curve by the PSF's parameters
    passed : (n,) float64 or float; factor by which the MTF was divided to give the curve
    """
    if not len(psf.tail.amplitudes):
        return np.zeros(len(f))
    radius, mean_tail = psf.k / 2 / psf.s, psf.k**2
    rough = truncation(psf) * (1 - np.exp(-((np.pi * f * radius) ** 2)))
    rings = abs(psf.share_outside) * _rings_at(psf, f, mtf)
    energy = tail_energy_uncertainty(psf) * psf.light / float(psf.weights[mean_tail]) * slope[:, mean_tail]
    return np.asarray(np.hypot(np.hypot(rough, rings) / passed, energy))


def _rings_at(psf: Psf, f: Array, mtf: Array) -> Array:
    """Rms change (n,) of an MTF by rings of unknown phase and frequency, over the energy outside.

    Rings 1 + cos(2 pi v r + phase) of the mean tail 1 / r^3 have the spectrum

        G(f, v) = integral of w(r) r^-2 exp(2 pi i v r) J0(2 pi f r) dr,

    r and 1 / f in units of the support's half side, w(r) the share of a circle outside the square. The OTF is divided
    by the whole energy, so that its change is G(f, v) - H(f) G(0, v).
    """
    radius = psf.k / 2 / psf.s
    cutoff = 1 / (np.pi**3 * max(psf.tail_density_px, 1e-9))
    rings = np.exp(2j * np.pi * RING_FREQUENCIES[:, None] * min(cutoff * radius, FINEST_RINGS) * RING_RADII)
    outside = 4 / np.pi * np.arccos(1 / np.minimum(RING_RADII, 2**0.5))
    rings = rings * outside / RING_RADII**2 * np.exp(-((RING_RADII / 5) ** 2)) * float(np.diff(RING_RADII[:2])[0])
    change = rings @ _waves(tuple((f * radius).tolist())) - mtf * rings.sum(axis=1)[:, None]
    return np.asarray(np.sqrt(np.mean(np.abs(change) ** 2, axis=0) / 2))


@lru_cache(maxsize=16)
def _waves(fR: tuple[float, ...]) -> Array:
    """J0(2 pi f r) at the radii of the rings (m,) and frequencies (n,), both in units of the support: (m, n), to 3e-7
    by cubics with the values and slopes of a table."""
    steps = 2 * np.pi / WAVE_STEP * RING_RADII[:, None] * np.array(fR)
    table = WAVE_STEP * np.arange(steps.max() + 2)
    value, slope = j0(table), -WAVE_STEP * j1(table)
    i = steps.astype(int)
    t, rise = steps - i, value[i + 1] - value[i]
    a, b = slope[i] - rise, rise - slope[i + 1]
    return np.asarray(value[i] + t * (rise + (1 - t) * (a * (1 - t) + b * t)))
