"""The PSF from two photographs of one textured wall at different distances: a number with its error bar, or a refusal.

References
----------
Delbracio, Almansa, Muse, IPOL 2013, section 4; Delbracio's thesis, chapter 3 and appendix A.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from procedures.numerics.solvers import cholesky_solve, solve_constrained
from procedures.numerics.warps import CubicWarp
from procedures.outcome import Outcome, Refused, Verdict
from procedures.psf import Psf, Sampling, Tail
from procedures.quality import Diffraction, Quality, assess
from procedures.raw import Plane
from procedures.two_photo.diagnostics import diagnose
from procedures.two_photo.inter_image import Fit, fit_kernel
from procedures.two_photo.near_noise import Kernel, noise_at_most, without_near_noise
from procedures.two_photo.recursion import psf_by_equation, psf_by_recursion
from procedures.two_photo.registration import Sighting, register
from procedures.two_photo.trust import check_distance, check_light, judge

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class TwoPhotoParameters(Sampling):
    """How the PSF is sampled and solved for: see `Sampling`.

    The non-negative solution is the published algorithm's projection, made in the metric of the error bars instead
    of sample by sample.
    """

    s: int = 3
    k: int = 13
    solver: str = "nnls"


@dataclass(frozen=True)
class TwoPhotoPsf:
    """The calibrated PSF of one plane, from two photographs.

    Attributes
    ----------
    psf : Psf
        Its centre is its centroid under a Gaussian window: two photographs of a wall know no other.
    quality : Quality
    inter_image : (k, k) float64
        The kernel from the near to the far photograph, sum 1.
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
    warp: CubicWarp
    diagnostics: Mapping[str, float]


def estimate_psf(
    a: Plane, b: Plane, parameters: TwoPhotoParameters | None = None, diffraction: Diffraction | None = None
) -> Outcome[TwoPhotoPsf]:
    """The PSF of the plane's camera from two photographs of one wall, in any order, or the reason why there is none.

    Parameters
    ----------
    a, b : Plane
        Linear samples of the same plane, black 0, white 1.
    parameters : TwoPhotoParameters, optional
    diffraction : Diffraction, optional
        What limits this plane: where it is given, the Strehl ratio is reported too.

    Returns
    -------
    Outcome[TwoPhotoPsf]
        Refused outcomes carry the reason and the remedy and no value; poor photographs raise nothing.
    """
    parameters = parameters or TwoPhotoParameters()
    try:
        return _estimate(a.samples, b.samples, parameters, diffraction)
    except Refused as refusal:
        return Outcome(None, Verdict.REFUSED, refusal.reason, refusal.remedy)
    except np.linalg.LinAlgError:
        return Outcome(
            None,
            Verdict.REFUSED,
            f"the wall's texture must determine {parameters.k}^2 kernel values at s = {parameters.s}; it does not",
            "choose a rougher wall with detail of all sizes, expose longer, or lower s or k",
        )


def _estimate(
    a: Array32, b: Array32, parameters: TwoPhotoParameters, diffraction: Diffraction | None
) -> Outcome[TwoPhotoPsf]:
    """The chain itself; raises Refused."""
    s, k = parameters.s, parameters.k
    check_light(a, b)
    sighting = register(a, b)
    near, far = (b, a) if sighting.swapped else (a, b)
    check_distance(sighting.H_near_far, far.shape, s)
    fit = fit_kernel(near, far, sighting.H_near_far, s, k)
    J = fit.scale()
    limit = noise_at_most(near)
    kernel = without_near_noise(fit, limit)
    psf, check = _psf(kernel, s, k, J, parameters.solver)
    diagnostics = diagnose(fit, kernel, psf, sighting, near, far, limit, check)
    verdict, reason, remedy = judge(diagnostics, s)
    if verdict is Verdict.REFUSED:
        return Outcome(None, verdict, reason, remedy)
    return Outcome(_result(fit, kernel, psf, J, sighting, asdict(diagnostics), diffraction), verdict, reason, remedy)


def _psf(kernel: Kernel, s: int, k: int, J: Array, solver: str) -> tuple[Psf, float]:
    """The PSF as asked for, of sum 1, and how far the recursion is from the direct solution, over the PSF's norm.

    The covariance is that of the free solution; for "clip" and "nnls" it is an upper limit.
    """
    recovered = psf_by_recursion(kernel.total, s, J)
    check = float(np.linalg.norm(recovered.h - psf_by_equation(kernel.total, s, J).h) / np.linalg.norm(recovered.h))
    covariance = recovered.covariance(kernel.covariance)
    p = recovered.parameters
    if solver != "ls":
        information = cholesky_solve(covariance[: k * k, : k * k], np.eye(k * k))
        p = np.concatenate([solve_constrained(information, information @ p[: k * k], solver), p[k * k :]])
    return _psf_of(p, covariance, s, k), check


def _psf_of(p: Array, covariance: Array, s: int, k: int) -> Psf:
    """The PSF whose samples have the sum 1, to first order, from samples and tail (k^2 + q,) of any."""
    n = k * k
    total = p[:n].sum()
    p = p / total
    # J C J' with J = (I - p 1_n') / total
    covariance = covariance - np.outer(p, covariance[:n].sum(axis=0))
    covariance = (covariance - np.outer(covariance[:, :n].sum(axis=1), p)) / total**2
    tail = Tail(p[n:], covariance[n:, n:], covariance[:n, n:])
    return Psf(p[:n].reshape(k, k), s, covariance[:n, :n], tail)


def _result(
    fit: Fit,
    kernel: Kernel,
    psf: Psf,
    J: Array,
    sighting: Sighting,
    diagnostics: Mapping[str, float],
    diffraction: Diffraction | None,
) -> TwoPhotoPsf:
    """Everything that is reported, from the final fit."""
    scale_x, scale_y = np.linalg.norm(J, axis=0)
    return TwoPhotoPsf(
        psf=psf,
        quality=assess(psf, n=len(fit.residual), diffraction=diffraction),
        inter_image=kernel.k.reshape(psf.k, psf.k) / kernel.k.sum(),
        scale=(float(scale_x), float(scale_y)),
        swapped=sighting.swapped,
        gain=kernel.gain,
        noise=kernel.noise,
        residual_std=diagnostics["residual_std"],
        warp=fit.warp,
        diagnostics=diagnostics,
    )
