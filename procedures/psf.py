"""Point spread function: samples on the 1/s grid, with their covariance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.display import axes_of, html, summary
from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import SHAPES, tail_border, tail_density, tail_kernels, tail_spectra, tail_sums
from procedures.numerics.solvers import SOLVERS
from procedures.outcome import BadParameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_PER_PX, MOST_SAMPLES = 16, 101
"""Largest s and k: the covariance of 101 x 101 samples takes 0.8 GB."""


@dataclass(frozen=True)
class Sampling:
    """Sampling of a PSF, and solver. Raises BadParameter if one of them is out of range.

    s : samples per pixel of the plane, 2 or more; None: automatic
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
        if (self.s or 0) > MOST_PER_PX or (self.k or 0) > MOST_SAMPLES:
            raise BadParameter(
                f"s must be at most {MOST_PER_PX} and k at most {MOST_SAMPLES}; got s = {self.s}, k = {self.k}",
                "give s = 4 and k = 17, or omit both for the automatic choice",
            )
        if self.s is not None and self.s < 2:
            raise BadParameter(f"s must be 2 or more; got s = {self.s}", "give s = 3 or 4")
        if self.k is not None and (self.k < 3 or self.k % 2 == 0):
            raise BadParameter(
                f"k must be odd and 3 or more, so that the support has a centre; got k = {self.k}",
                f"give k = {self.k + 1 if self.k > 3 else 17}",
            )
        if self.s is not None and self.k is not None and self.k < self.s:
            raise BadParameter(
                f"k must be at least s, so that the support is a pixel wide; got s = {self.s}, k = {self.k}",
                f"give k = {4 * self.s + 1}",
            )
        if self.solver not in SOLVERS:
            raise BadParameter(
                f"the solver must be one of {', '.join(SOLVERS)}; got {self.solver!r}", "give one of them"
            )

    def to_record(self) -> dict[str, int | float | str | list[float]]:
        """Entries of a record."""
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

    Attributes
    ----------
    h : (k, k) float64
        Samples [row, column], k odd, sum 1. The centre sample is the centre by the chart's marks, or the centroid
        without marks. The photograph is the *convolution* with h: a tail to larger columns smears light to larger
        columns.
    s : int
        Samples per sensor pixel of the plane: the pitch is 1/s pixel.
    covariance : (k^2, k^2) float64
        Covariance of `h.ravel()`, nuisance parameters included.
    tail : PsfTail
        Tail outside the support; none by default.
    lacking : (k^2, k^2) float64 or None
        Part of `covariance` that is model error instead of noise, as between the nodes of a field: unlike noise, it
        adds no energy to the samples. None: all of it is noise.

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
            raise ValueError(f"a PSF is an odd square of samples; got shape {self.h.shape}")
        if self.covariance.shape != (k * k, k * k):
            raise ValueError(f"the covariance of {k * k} samples is {k * k} square; got {self.covariance.shape}")
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

    def spectra(self, fx: Array, fy: Array) -> npt.NDArray[np.complex128]:
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
