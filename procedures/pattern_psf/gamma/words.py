"""gamma against s/t in words, as a table and as a curve, for the operator's own lens."""

from __future__ import annotations

import math
from collections.abc import Sequence

from procedures.pattern_psf.gamma.curve import View, gamma_curve
from procedures.pattern_psf.pose import Optics
from procedures.plan import Diagram
from procedures.quality import Diffraction

HEADINGS = ("s/t", "distance", "noise region", "gamma", "least possible", "error at 1 % noise")
TOLD = (0.7, 1.0)
"""What the aim is compared with."""


def gamma_diagram(optics: Optics, s: int, k: int, aim: float, diffraction: Diffraction | None = None) -> Diagram:
    """The curve for a lens and a print, with the distances that belong to it.

    Parameters
    ----------
    optics : Optics
    s, k : int
        How the PSF is sampled.
    aim : float
        The s/t that is aimed at.
    diffraction : Diffraction, optional
        Where it is known, it is told beside the band that s holds.
    """
    curve = gamma_curve(s, k)
    said = [_why(curve, optics, s, k, aim)]
    if diffraction is not None:
        said.append(_band(diffraction, s))
        if diffraction.cutoff > s / 2:
            said.append(_raised(s, k, aim))
    rows = (HEADINGS, *(_row(seen, optics, s) for seen in curve))
    x, y = zip(*((seen.s_over_t, seen.gamma) for seen in curve), strict=True)
    return Diagram(f"gamma over s/t, s = {s}, k = {k}", x, y, " ".join(said), rows)


def _row(seen: View, optics: Optics, s: int) -> tuple[str, ...]:
    return (
        f"{seen.s_over_t:.1f}",
        _distance(optics, seen.s_over_t, s),
        f"{seen.pixels} px",
        f"{seen.gamma:.2f}",
        f"{seen.bound:.2f}",
        f"{math.sqrt(seen.gamma) * 0.01:.4f}",
    )


def _why(curve: Sequence[View], optics: Optics, s: int, k: int, aim: float) -> str:
    """The aim, and what other distances cost."""
    (best,) = gamma_curve(s, k, (aim,))
    others = (
        f"{seen.gamma / best.gamma:.1f} times as much at {seen.s_over_t:g} ({_distance(optics, seen.s_over_t, s)})"
        for seen in (*gamma_curve(s, k, TOLD), curve[-1])
    )
    return (
        f"At s/t {aim:g} ({_distance(optics, aim, s)}) gamma is {best.gamma:.2f}: so much of the photograph's noise "
        f"goes into the PSF; {', '.join(others)}."
    )


def _band(diffraction: Diffraction, s: int) -> str:
    """What diffraction leaves of the band: gamma itself is of the chart, and knows no lens."""
    cutoff = diffraction.cutoff
    words = f"f/{diffraction.f_number:g} passes up to {cutoff:.2f} cycles/pixel, s = {s} holds up to {s / 2:g}"
    if cutoff <= (s - 1) / 2:
        return f"{words}: s = {max(math.ceil(2 * cutoff), 2)} would do."
    return f"{words}."


def _raised(s: int, k: int, aim: float) -> str:
    """What becomes of the aim where photosites and lens pass more than s holds: another s keeps the PSF's width."""
    ratio, wider = aim * (s + 1) / s, round(k * (s + 1) / s)
    (seen,) = gamma_curve(s + 1, wider - 1 + wider % 2, (ratio,))
    return (
        f"Where photosites and lens pass more, s is raised to {s + 1}: from the same distance s/t is then {ratio:.2f} "
        f"and gamma {seen.gamma:.2f}."
    )


def _distance(optics: Optics, s_over_t: float, s: int) -> str:
    return f"{optics.distance_mm(s_over_t / s) / 1000:.2f} m"
