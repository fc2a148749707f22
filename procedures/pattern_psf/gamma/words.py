"""gamma as a function of s/t for the operator's lens: sentence, table and curve."""

from __future__ import annotations

import math
from collections.abc import Sequence

from procedures.pattern_psf.gamma.curve import NoiseRegionView, gamma_curve
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Diagram
from procedures.quality import Diffraction

HEADINGS = ("s/t", "distance", "noise region", "gamma", "lower bound", "error at 1 % noise")
COMPARED_RATIOS = (0.7, 1.0)
"""Values of s/t with which the target is compared."""


def gamma_diagram(
    optics: ImagingGeometry, s: int, k: int, aim: float, diffraction: Diffraction | None = None
) -> Diagram:
    """Diagram of gamma for a lens and a print, with the corresponding distances.

    Parameters
    ----------
    s, k : sampling of the PSF
    aim : target s/t
    diffraction : if given, its cutoff is compared with the band of s
    """
    curve = gamma_curve(s, k)
    sentences = [_comparison(curve, optics, s, k, aim)]
    if diffraction is not None:
        sentences.append(_band(diffraction, s))
        if diffraction.cutoff > s / 2:
            sentences.append(_raised(s, k, aim))
    rows = (HEADINGS, *(_row(view, optics, s) for view in curve))
    x, y = zip(*((view.s_over_t, view.gamma) for view in curve), strict=True)
    return Diagram(f"gamma over s/t, s = {s}, k = {k}", x, y, " ".join(sentences), rows)


def _row(view: NoiseRegionView, optics: ImagingGeometry, s: int) -> tuple[str, ...]:
    return (
        f"{view.s_over_t:.1f}",
        _distance(optics, view.s_over_t, s),
        f"{view.pixels} px",
        f"{view.gamma:.2f}",
        f"{view.bound:.2f}",
        f"{math.sqrt(view.gamma) * 0.01:.4f}",
    )


def _comparison(curve: Sequence[NoiseRegionView], optics: ImagingGeometry, s: int, k: int, aim: float) -> str:
    """Sentence on gamma at the target and at other distances."""
    (best,) = gamma_curve(s, k, (aim,))
    comparisons = (
        f"{view.gamma / best.gamma:.1f} times as much at {view.s_over_t:g} ({_distance(optics, view.s_over_t, s)})"
        for view in (*gamma_curve(s, k, COMPARED_RATIOS), curve[-1])
    )
    return (
        f"At s/t {aim:g} ({_distance(optics, aim, s)}) the noise amplification gamma is {best.gamma:.2f}; "
        f"it is {', '.join(comparisons)}."
    )


def _band(diffraction: Diffraction, s: int) -> str:
    """Sentence on the diffraction cutoff relative to the band; gamma itself is independent of the lens."""
    cutoff = diffraction.cutoff
    words = f"The cutoff of f/{diffraction.f_number:g} is {cutoff:.2f} cycles/pixel, the band of s = {s} is {s / 2:g}"
    if cutoff <= (s - 1) / 2:
        return f"{words}: s = {max(math.ceil(2 * cutoff), 2)} suffices."
    return f"{words}."


def _raised(s: int, k: int, aim: float) -> str:
    """Sentence on s/t after s is raised because lens and photosites pass more; the PSF's width stays."""
    ratio, wider = aim * (s + 1) / s, round(k * (s + 1) / s)
    (view,) = gamma_curve(s + 1, wider - 1 + wider % 2, (ratio,))
    return (
        f"If lens and photosites pass higher frequencies, s is raised to {s + 1}: at the same distance s/t is then "
        f"{ratio:.2f} and gamma {view.gamma:.2f}."
    )


def _distance(optics: ImagingGeometry, s_over_t: float, s: int) -> str:
    return f"{optics.distance_mm(s_over_t / s) / 1000:.2f} m"
