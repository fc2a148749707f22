"""Which parts the data ask for: Schwarz's criterion among apertures, low-pass filters, diffusion, aberrations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from procedures.physics.fit import ModelFit, WhitenedPsf, fit_parts, start_near
from procedures.physics.sensor import Aperture, LowPass, Parts

ABERRATIONS: tuple[tuple[int, ...], ...] = ((), (0,), (7,), (0, 7), tuple(range(8)))
"""None, defocus, spherical, both, all."""


def choose(data: WhitenedPsf) -> tuple[ModelFit, list[ModelFit]]:
    """The best model, and all that were tried, the best first.

    One part after the other is exchanged: the low-pass filter and diffusion, then the aperture, and again the filter
    under the new aperture, with all aberrations free; then those that tell nothing are left out.
    """
    tried: dict[Parts, ModelFit] = {}

    def best_of(candidates: Iterable[Parts], near: Parts | None = None) -> Parts:
        candidates = list(candidates)
        for parts in candidates:
            if parts not in tried:
                tried[parts] = fit_parts(data, parts, start_near(tried[near], parts) if near else None)
        scale = scale_of(tried.values())
        return min(candidates, key=lambda parts: tried[parts].criterion(scale))

    still = [Parts(low_pass=filter_) for filter_ in LowPass]
    best_of(still)
    # spots can stand for charge that wanders, and two boxes half as wide for one: neither is settled before the other
    wandering = [best_of([replace(parts, diffusion=True)], near=parts) for parts in still]
    parts = best_of([*still, *wandering])
    square = parts
    parts = best_of([square, *(replace(square, aperture=shape) for shape in Aperture)], near=square)
    if parts.aperture is not Aperture.SQUARE:
        parts = best_of((replace(parts, low_pass=filter_) for filter_ in LowPass), near=parts)
    # diffusion is tried again: a little defocus can stand for it, and all aberrations together always can
    lenses = [replace(parts, aberrations=some) for some in ABERRATIONS]
    parts = best_of((replace(one, diffusion=wanders) for one in lenses for wanders in (False, True)), near=parts)
    scale = scale_of(tried.values())
    order = sorted(tried.values(), key=lambda fit: fit.criterion(scale))
    return tried[parts], order


def scale_of(fits: Iterable[ModelFit]) -> float:
    """What the best model leaves over its freedoms, 1 at least: where no model is perfect, differences count less."""
    return max(1.0, min(fit.chi2 / fit.freedom for fit in fits))
