"""The PSF from two photographs of one textured wall at different distances: a number with its error bar, or a refusal.

References
----------
Delbracio, Almansa, Muse, IPOL 2013, section 4; Delbracio's thesis, chapter 3 and appendix A.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.budget import with_convergence, with_parts
from procedures.choice import Trial, choose, remaining_change
from procedures.display import html, summary
from procedures.numbers import GAIN, NOISE, RESIDUAL_STD, SCALE
from procedures.numerics.solvers import cholesky_solve, solve_constrained
from procedures.numerics.warps import CubicWarp
from procedures.outcome import Outcome, Refused, Verdict, verdict_of
from procedures.psf import Psf, PsfTail, Sampling
from procedures.quality import Diffraction, Quality, assess, beyond_diffraction
from procedures.raw import Plane, PlaneLike, as_plane
from procedures.two_photo.diagnostics import diagnose
from procedures.two_photo.error_parts import error_parts, likely_errors, widened
from procedures.two_photo.inter_image import PairFit, fit_kernel
from procedures.two_photo.likeness import likeness
from procedures.two_photo.near_noise import Kernel, noise_at_most, without_near_noise
from procedures.two_photo.recursion import Recovered, psf_by_equation, psf_by_recursion
from procedures.two_photo.registration import PairSighting, register
from procedures.two_photo.trust import check_distance, check_light, checks_of, most_samples_per_pixel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]

START_S = 3
"""The first try: a finer grid asks for detail of the wall that few walls have."""


@dataclass(frozen=True)
class TwoPhotoParameters(Sampling):
    """How the PSF is sampled and solved for: see `Sampling`.

    The non-negative solution is the published algorithm's projection, made in the metric of the error bars instead
    of sample by sample.
    """

    s: int | None = None
    k: int | None = None
    solver: str = "ls"
    at: tuple[float, ...] = ()


@dataclass(frozen=True)
class TwoPhotoPsf:
    """The calibrated PSF of one plane, from two photographs.

    Attributes
    ----------
    psf : Psf
        Its centre is its centroid under a Gaussian window: two photographs of a wall know no other.
    quality : Quality
        MTF and the numbers drawn from the PSF, with the budgets of their uncertainties.
    inter_image : (k, k) float64
        The kernel from the near to the far photograph inside its support, sum 1.
    scale : (lambda_x, lambda_y)
        Near pixels per far pixel along x and y.
    swapped : bool
        Whether the second photograph given is the near one.
    gain : float
        Contrast of the far photograph over the near one's.
    noise : float
        Standard deviation of a pixel's noise, of the scale from black to white.
    residual_std : float
        Residual in units of the largest noise that the far photograph can hold.
    choice : tuple of Trial
        What was tried of s and k; the last one is this.
    warp : CubicWarp
        Far pixels -> near pixels.
    diagnostics : mapping of str to float
    """

    psf: Psf
    quality: Quality
    inter_image: Array
    scale: tuple[float, float]
    swapped: bool
    gain: float
    noise: float
    residual_std: float
    choice: tuple[Trial, ...]
    warp: CubicWarp
    diagnostics: Mapping[str, float]

    __repr__ = summary
    _repr_html_ = html

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the MTF; `psf.plot` draws the PSF."""
        return self.quality.plot(ax)

    @property
    def diffraction(self) -> None:
        """Whoever gives photographs knows what limits them."""

    @property
    def charts(self) -> tuple[()]:
        """A wall shows none."""
        return ()

    @property
    def variations(self) -> tuple[()]:
        """Nothing is told of the parts of a wall."""
        return ()

    @property
    def values(self) -> dict[str, float | tuple[float, float]]:
        """The numbers that have no uncertainty."""
        return {SCALE: self.scale, GAIN: self.gain, NOISE: self.noise, RESIDUAL_STD: self.residual_std}


def estimate_psf_of_pair(
    a: PlaneLike, b: PlaneLike, parameters: TwoPhotoParameters | None = None, diffraction: Diffraction | None = None
) -> Outcome[TwoPhotoPsf]:
    """The PSF of the plane's camera from two photographs of one wall, in any order, or the reason why there is none.

    Parameters
    ----------
    a, b : Plane, or (rows, columns) arrays
        Linear samples of the same plane, black 0, white 1.
    parameters : TwoPhotoParameters, optional
        s and k that are not given are chosen.
    diffraction : Diffraction, optional
        What limits this plane: where it is given, the Strehl ratio is reported too.

    Returns
    -------
    Outcome[TwoPhotoPsf]
        Refused outcomes carry the reason and the remedy and no value; poor photographs raise nothing.
    """
    a, b, parameters = as_plane(a), as_plane(b), parameters or TwoPhotoParameters()
    try:
        return _estimate(a, b, parameters, diffraction)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    except np.linalg.LinAlgError:
        return Outcome(
            None,
            Verdict.REFUSED,
            f"the wall's texture must determine the kernel's values at s = {parameters.s or 'auto'}, "
            f"k = {parameters.k or 'auto'}; it does not",
            "choose a rougher wall with detail of all sizes, expose longer, or lower s or k",
        )


@dataclass(frozen=True)
class _Attempt:
    """The joint fit at one s and k, the kernel without the near noise's bias, and the PSF drawn from it, free and as
    asked for."""

    fit: PairFit
    kernel: Kernel
    recovered: Recovered
    free: Psf
    psf: Psf


def _estimate(
    a: Plane, b: Plane, parameters: TwoPhotoParameters, diffraction: Diffraction | None
) -> Outcome[TwoPhotoPsf]:
    """The chain itself; raises Refused."""
    saturated = check_light(a.samples, b.samples)
    sighting = register(a.samples, b.samples)
    near, far = (b.samples, a.samples) if sighting.swapped else (a.samples, b.samples)
    check_distance(sighting.H_near_far, far.shape, parameters.s or 2)
    most_s = most_samples_per_pixel(sighting.H_near_far, far.shape)
    limit = noise_at_most(near)
    found, tried = _chosen(near, far, sighting, limit, parameters, most_s)
    fit, kernel, J = found.fit, found.kernel, found.fit.scale()
    alike = likeness(fit, found.free, near)
    errors = likely_errors(alike, found.recovered, found.free, J)
    psf = widened(found.psf, errors)
    quality = assess(psf, n=len(fit.residual), diffraction=diffraction, at=parameters.at)
    parts = error_parts(fit, kernel, found.recovered, found.free, quality, errors)
    quality = with_parts(with_convergence(quality, remaining_change(tried)), parts.parts)
    check = psf_by_equation(kernel.total, psf.s, J)
    off = float(np.linalg.norm(found.recovered.h - check.h) / np.linalg.norm(check.h))
    diagnostics = diagnose(fit, kernel, psf, sighting, near, far, limit, off, saturated, alike, parts)
    contradicted, raw = beyond_diffraction(quality, diffraction), a.raw and b.raw
    result = _result(replace(found, psf=psf), quality, tried, sighting, asdict(diagnostics))
    return verdict_of(checks_of(diagnostics, parameters, tried, psf.s, contradicted, raw=raw), result)


def _chosen(
    near: Array32, far: Array32, sighting: PairSighting, limit: float, parameters: TwoPhotoParameters, most_s: int
) -> tuple[_Attempt, tuple[Trial, ...]]:
    """The result for the s and k that are given, or that do, and what was tried; raises Refused."""
    start: CubicWarp | None = None

    def attempt(s: int, k: int) -> _Attempt:
        nonlocal start
        fit = fit_kernel(near, far, sighting.H_near_far, s, k, start)
        start = fit.warp
        kernel = without_near_noise(fit, limit)
        recovered = psf_by_recursion(kernel.total, s, fit.scale())
        free, psf = (_psf(recovered, kernel, s, solver) for solver in ("ls", parameters.solver))
        return _Attempt(fit, kernel, recovered, free, psf)

    samples = min(int(np.prod(far.shape)), int(np.prod(near.shape) / most_s**2))

    def chosen_from(start_s: int) -> tuple[_Attempt, tuple[Trial, ...]]:
        return choose(attempt, lambda one: one.psf, samples, most_s, start_s=start_s, s=parameters.s, k=parameters.k)

    try:
        return chosen_from(START_S)
    except (Refused, np.linalg.LinAlgError):
        if parameters.s is not None or most_s <= 2:
            raise
        return chosen_from(2)  # a wall with little fine detail


def _psf(recovered: Recovered, kernel: Kernel, s: int, solver: str) -> Psf:
    """The PSF as asked for, of sum 1.

    The covariance is that of the free solution; for "clip" and "nnls" it is an upper limit.
    """
    covariance, p = recovered.covariance(kernel.covariance), recovered.parameters
    n = recovered.h.size
    if solver != "ls":
        information = cholesky_solve(covariance[:n, :n], np.eye(n))
        moved = solve_constrained(information, information @ p[:n], solver) - p[:n]
        # the tail goes with the samples as its covariance with them tells
        p = p + np.concatenate([moved, covariance[n:, :n] @ (information @ moved)])
    return _of_sum_one(p, covariance, s, len(recovered.h))


def _of_sum_one(p: Array, covariance: Array, s: int, k: int) -> Psf:
    """The PSF whose samples have the sum 1, from samples and tail (k^2 + q,) and their covariance, to first order."""
    n = k * k
    total = p[:n].sum()
    p = p / total
    # J C J' with J = (I - p 1_n') / total
    covariance = covariance - np.outer(p, covariance[:n].sum(axis=0))
    covariance = (covariance - np.outer(covariance[:, :n].sum(axis=1), p)) / total**2
    tail = PsfTail(p[n:], covariance[n:, n:], covariance[:n, n:])
    return Psf(p[:n].reshape(k, k), s, covariance[:n, :n], tail)


def _result(
    found: _Attempt,
    quality: Quality,
    tried: tuple[Trial, ...],
    sighting: PairSighting,
    diagnostics: Mapping[str, float],
) -> TwoPhotoPsf:
    """Everything that is reported, from the final fit."""
    kernel, k = found.kernel, found.psf.k
    scale_x, scale_y = np.linalg.norm(found.fit.scale(), axis=0)
    return TwoPhotoPsf(
        psf=found.psf,
        quality=quality,
        inter_image=kernel.k.reshape(k, k) / kernel.k.sum(),
        scale=(float(scale_x), float(scale_y)),
        swapped=sighting.swapped,
        gain=kernel.gain,
        noise=kernel.noise,
        residual_std=diagnostics[RESIDUAL_STD],
        choice=tried,
        warp=found.fit.warp,
        diagnostics=diagnostics,
    )
