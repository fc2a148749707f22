"""Origin of a PSF: the point about which widths, encircled energies and the Strehl ratio are taken.

The image of an asymmetric PSF has no natural centre: the chart's marks, the centroid and the peak lie apart. The MTF
does not depend on the origin.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from procedures.numerics.arrays import Array
from procedures.psf import Psf
from procedures.spatial_numbers import DrawnNumber, first_moments

Origin = Literal["centre", "marks", "centroid", "peak"]
"""The PSF's centre, whatever it is; the same where it is given by the chart's marks; and points of the PSF itself."""

WORDS = {"marks": "the centre by the marks", "centroid": "the PSF's centroid", "peak": "the PSF's peak"}
STEP_PX = 1e-3  # change of the origin by which derivatives are taken, in pixels
ITERATIONS = 30
START = 8  # points per sample among which the peak is searched before Newton's iteration


def about_origin(psf: Psf, origin: Origin, numbers: Callable[[Psf], list[DrawnNumber]]) -> list[DrawnNumber]:
    """Numbers of the PSF about its origin, with their gradients by the parameters, the origin's among them."""
    if origin not in PLACES:
        return [replace(number, method=_method(number, origin)) for number in numbers(psf)]
    point, by_parameters = PLACES[origin](psf)
    moved = numbers(_about(psf, point))
    ways = [[numbers(_about(psf, point + way * step)) for way in (1, -1)] for step in STEP_PX * np.eye(2)]
    results = []
    for i, one in enumerate(moved):
        slope = np.array([(more[i].value - less[i].value) / (2 * STEP_PX) for more, less in ways])
        # gradient by the PSF's parameters of a number whose gradient by those of the displaced PSF is given
        Ax, Ay = (_between(psf, float(x)) for x in point)
        n = psf.k**2
        pulled_back = np.concatenate([(Ay.T @ one.gradient[:n].reshape(psf.k, psf.k) @ Ax).ravel(), one.gradient[n:]])
        gradient = pulled_back + slope @ by_parameters
        results.append(replace(one, method=_method(one, origin), gradient=gradient))
    return results


def _method(number: DrawnNumber, origin: Origin) -> str:
    words, method = WORDS.get(origin, ""), number.method
    if "the centre" in method and words:
        return method.replace("the centre", words)
    return f"{method}, about {words}" if words else method


def about(psf: Psf, origin: Origin) -> Psf:
    """The PSF with its origin as its centre; the covariance and the tail stay."""
    return psf if origin not in PLACES else _about(psf, PLACES[origin](psf)[0])


def _between(psf: Psf, x: float) -> Array:
    """Band-limited interpolation of the samples along one axis at points displaced by x pixels, (k, k)."""
    n = np.arange(psf.k)
    return np.asarray(np.sinc(n[:, None] + x * psf.s - n))


def _about(psf: Psf, point: Array) -> Psf:
    """The PSF with a point (x, y) as its centre; the covariance and the tail, which are smooth there, stay."""
    Ax, Ay = (_between(psf, float(x)) for x in point)
    return Psf(Ay @ psf.h @ Ax.T, psf.s, psf.covariance, psf.tail)


def _centroid(psf: Psf) -> tuple[Array, Array]:
    x, y = first_moments(psf)
    return np.array([x.value, y.value]), np.stack([x.gradient, y.gradient])


def _peak(psf: Psf) -> tuple[Array, Array]:
    """Place (2,) of the band-limited PSF's greatest value, and its derivative (2, k^2 + q)."""
    fine = np.sinc(np.arange((psf.k - 1) * START + 1)[:, None] / START - np.arange(psf.k))
    row, column = np.unravel_index(int(np.argmax(fine @ psf.h @ fine.T)), (len(fine),) * 2)
    point = np.array([column, row]) / START / psf.s - psf.k // 2 / psf.s
    for _ in range(ITERATIONS):
        slope, bend, _ = _derivatives(psf, point)
        step = np.linalg.solve(bend, slope)
        point = point - step
        if np.abs(step).max() < 1e-9:
            break
    _, bend, by_samples = _derivatives(psf, point)
    gradient = np.zeros((2, len(psf.parameters)))
    gradient[:, : psf.k**2] = -np.linalg.solve(bend, by_samples)
    return point, gradient


def _derivatives(psf: Psf, point: Array) -> tuple[Array, Array, Array]:
    """Gradient (2,) and Hessian (2, 2) of the band-limited PSF at a point, and the gradient by the samples (2, k^2)."""
    rows = []
    for x in point:
        t = float(x) * psf.s + psf.k // 2 - np.arange(psf.k)
        value, step = np.sinc(t), 1e-4
        more, less = np.sinc(t + step), np.sinc(t - step)
        first, second = (more - less) / (2 * step), (more - 2 * value + less) / step**2
        rows.append((value, first * psf.s, second * psf.s**2))
    (x0, x1, x2), (y0, y1, y2) = rows
    slope = np.array([y0 @ psf.h @ x1, y1 @ psf.h @ x0])
    mixed = y1 @ psf.h @ x1
    bend = np.array([[y0 @ psf.h @ x2, mixed], [mixed, y2 @ psf.h @ x0]])
    return slope, bend, np.stack([np.outer(y0, x1).ravel(), np.outer(y1, x0).ravel()])


PLACES: dict[str, Callable[[Psf], tuple[Array, Array]]] = {"centroid": _centroid, "peak": _peak}
"""Places of the origins that follow from the PSF, with their derivatives."""
