"""gamma as a function of s/t for the operator's lens: sentence, table and curve."""

import math
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.normal_equations import NormalEquations
from procedures.pattern import CELLS
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Diagram
from procedures.quality import Diffraction

HEADINGS = ("s/t", "distance", "noise region", "gamma", "lower bound", "error at 1 % noise")
COMPARED_RATIOS = (0.7, 1.0)  # values of s/t with which the target is compared


def gamma_diagram(
    optics: ImagingGeometry, s: int, k: int, aim: float, diffraction: Diffraction | None = None
) -> Diagram:
    """Diagram of gamma for a lens and a print, with the corresponding distances.

    s, k : sampling of the PSF
    aim : target s/t
    diffraction : if given, its cutoff is compared with the band of s
    """
    curve = gamma_curve(s, k)
    # sentence on gamma at the target and at other distances
    (best,) = gamma_curve(s, k, (aim,))
    comparisons = (
        f"{view.gamma / best.gamma:.1f} times as much at {view.s_over_t:g} ({_distance(optics, view.s_over_t, s)})"
        for view in (*gamma_curve(s, k, COMPARED_RATIOS), curve[-1])
    )
    comparison = (
        f"At s/t {aim:g} ({_distance(optics, aim, s)}) the noise amplification gamma is {best.gamma:.2f}; "
        f"it is {', '.join(comparisons)}."
    )
    sentences = [(comparison)]
    if diffraction is not None:
        sentences.append(_band(diffraction, s))
        if diffraction.cutoff > s / 2:
            ratio, wider = aim * (s + 1) / s, round(k * (s + 1) / s)
            (view,) = gamma_curve(s + 1, wider - 1 + wider % 2, (ratio,))
            sentences.append(
                f"If lens and photosites pass higher frequencies, s is raised to {s + 1}: at the same distance s/t is "
                f"then {ratio:.2f} and gamma {view.gamma:.2f}."
            )
    rows = (HEADINGS, *(_row(view, optics, s) for view in curve))
    x, y = zip(*((view.s_over_t, view.gamma) for view in curve), strict=True)
    return Diagram(f"gamma over s/t, s = {s}, k = {k}", x, y, " ".join(sentences), rows)


def _row(view: "NoiseRegionView", optics: ImagingGeometry, s: int) -> tuple[str, ...]:
    return (
        f"{view.s_over_t:.1f}",
        _distance(optics, view.s_over_t, s),
        f"{view.pixels} px",
        f"{view.gamma:.2f}",
        f"{view.bound:.2f}",
        f"{math.sqrt(view.gamma) * 0.01:.4f}",
    )


def _band(diffraction: Diffraction, s: int) -> str:
    """Sentence on the diffraction cutoff relative to the band; gamma itself is independent of the lens."""
    cutoff = diffraction.cutoff
    words = f"The cutoff of f/{diffraction.f_number:g} is {cutoff:.2f} cycles/pixel, the band of s = {s} is {s / 2:g}"
    if cutoff <= (s - 1) / 2:
        return f"{words}: s = {max(math.ceil(2 * cutoff), 2)} suffices."
    return f"{words}."


def _distance(optics: ImagingGeometry, s_over_t: float, s: int) -> str:
    return f"{optics.distance_mm(s_over_t / s) / 1000:.2f} m"


# --- gamma over the distance ---
# The whole chart is imaged squarely by an ideal sensor. No lens is included, since gamma is defined for the chart on
# the s grid, band-limited to it. Closer than s/t = 1 more samples cover the noise region, and the chart's spectrum
# falls, to zero at the band's edge for s/t = 2; farther away the cells average to grey.

RATIOS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9)  # sampling ratios of the curve
NODES = 200  # nodes of the quadrature over the band, in which the spectra oscillate about ten times at most


@dataclass(frozen=True)
class NoiseRegionView:
    """Square view of the noise region.

    s_over_t : samples of the PSF per cell of the chart
    pixels : pixels of the plane along one side
    gamma, bound : gamma of this view, and its lower bound for as many pixels
    """

    s_over_t: float
    pixels: int
    gamma: float
    bound: float


def gamma_curve(s: int, k: int, ratios: tuple[float, ...] = RATIOS) -> tuple[NoiseRegionView, ...]:
    """Expected gamma over s/t for random cells, where pixels determine the PSF; a chart's differs by a few per cent."""
    views = []
    for ratio in ratios:
        pixels = int(CELLS * ratio / s + 1e-9)
        if pixels > 1.2 * k:
            m = pixels**2
            views.append(NoiseRegionView(ratio, pixels, expected_gamma(ratio, k, m), gamma_bound(m, k * k)))
    return tuple(views)


def expected_gamma(s_over_t: float, k: int, m: int) -> float:
    """Expected gamma of m samples of random cells, half of them white, each s/t samples wide, for k x k PSF values.

    The expected A'A of stationary noise is m (C x C / 4 + 1 1' / 4), C (k, k) the covariance of cells along one axis
    limited to the band. The inverse of a sum of m products is larger than that of its mean by m / (m - k^2 - 1) for
    independent samples. Source: thesis, section 2.3.2, whose cells are one sample wide and not band-limited.
    """
    import scipy.linalg  # now: it is slow to load, and a PSF needs none of it

    # covariance (k,) at whole samples of a line of independent cells of variance 1, limited to the samples' band
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    f, df = nodes / 2, weights / 2  # cycles per sample
    power = s_over_t * np.sinc(s_over_t * f) ** 2
    covariance = np.asarray(np.cos(2 * np.pi * np.arange(k)[:, None] * f) @ (power * df))
    inverse = scipy.linalg.inv(scipy.linalg.toeplitz(covariance))
    level = inverse.sum(axis=0)
    spread = 4 * float(np.trace(inverse)) ** 2
    known_better = 4 * float(level @ level) ** 2 / (1 + float(level.sum()) ** 2)
    return (spread - known_better) / (m - k * k - 1)


# --- gamma of a view ---
# gamma = sum 1 / sigma_i^2 over the singular values of S_s C[u], the chart on the sensor's s grid, black 0, white 1.
# Noise of variance sigma^2 causes an expected squared error of the PSF of gamma sigma^2, so sqrt(gamma) times the noise
# is the norm of the error. gamma depends on the view alone; the contributions of light, geometry, print and tail are in
# the uncertainties. Source: Delbracio's thesis, section 2.3: gamma in 2.3.1, Proposition 1 in 2.3.2.


def gamma_of_fit(equations: NormalEquations, constant: int, weight: Array) -> float:
    """Compute gamma of a photograph, independent of the scale of its weights.

    equations : normal equations of a chart from black -1/2 to white 1/2
    constant : index of the nuisance column that is 1 for every sample
    weight : (m,) reciprocal of each sample's noise
    """
    # adding 1/2 to every entry of A adds l 1' + 1 l' + c, of rank 2, to A'A; Woodbury's identity gives the inverse
    squares = float(weight @ weight)
    level = equations.AZ[:, constant] / 2
    C, gained = equations.inverse_where_known, np.column_stack([level, np.ones_like(level)])
    through = C @ gained
    inner = np.array([[-squares / 4, 1.0], [1.0, 0.0]]) + gained.T @ through
    trace = np.trace(C) - np.trace(np.linalg.solve(inner, through.T @ through))
    return float(trace) * squares / len(weight)


def gamma_bound(m: int, n: int) -> float:
    """Lower bound of gamma for any chart in [0, 1], m samples, n PSF values. Source: thesis, Proposition 1, a = 0, b =
    1."""
    return (1 + 4 * (n - 1) ** 2) / (m * n)
