"""The point spread function as the station keeps it: samples on the 1/s grid, with their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import SOLVERS
from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sampling:
    """How a PSF is sampled and solved for.

    Attributes
    ----------
    s : int
        Samples per pixel of the plane, 2 or more.
    k : int
        Samples along one side of the support, odd.
    solver : str
        "ls" least squares, "clip" its negative part cut, "nnls" non-negative least squares.

    Raises
    ------
    BadParameter
        If one of them cannot be meant.
    """

    s: int
    k: int
    solver: str

    def __post_init__(self) -> None:
        if self.s < 2:
            raise BadParameter(f"a subpixel PSF needs s of 2 or more; got s = {self.s}", "choose s = 3 or 4")
        if self.k < 3 or self.k % 2 == 0:
            raise BadParameter(
                f"the support needs an odd number k of samples, so that it has a centre; got k = {self.k}",
                f"choose k = {max(self.k + 1, 3)}",
            )
        if self.solver not in SOLVERS:
            raise BadParameter(f"the solver is one of {', '.join(SOLVERS)}; got {self.solver!r}", "choose one of them")


@dataclass(frozen=True)
class Psf:
    """A PSF sampled s times per pixel of its plane.

    Attributes
    ----------
    h : (k, k) float64
        Samples [row, column], k odd, sum 1; the centre sample is the geometric centre as the chart's marks fix
        it, or the centroid where there were no marks. The photograph is the *convolution* with h: a tail to
        larger columns smears light to larger columns.
    s : int
        Samples per sensor pixel of the plane: the pitch is 1/s pixel.
    covariance : (k^2, k^2) float64
        Covariance of `h.ravel()`, nuisance parameters included.
    """

    h: Array
    s: int
    covariance: Array

    def __post_init__(self) -> None:
        k = self.h.shape[0]
        if self.h.shape != (k, k) or k % 2 == 0:
            raise ValueError(f"a PSF is an odd square of samples; got shape {self.h.shape}")
        if self.covariance.shape != (k * k, k * k):
            raise ValueError(f"the covariance of {k * k} samples is {k * k} square; got {self.covariance.shape}")

    @property
    def k(self) -> int:
        """Number of samples along one side."""
        return int(self.h.shape[0])

    @property
    def offsets_px(self) -> Array:
        """Distance of the samples from the centre along one axis, (k,), in pixels of the plane."""
        return (np.arange(self.k) - self.k // 2) / self.s
