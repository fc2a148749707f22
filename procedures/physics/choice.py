"""Model selection by Schwarz's criterion: aperture, low-pass filter, diffusion and aberrations that the data
support."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from procedures.physics.fit import ModelFit, WhitenedPsf, fit_parts, start_near
from procedures.physics.sensor import Aperture, LowPass, ModelParts

ABERRATIONS: tuple[tuple[int, ...], ...] = ((), (0,), (7,), (0, 7), tuple(range(8)))
"""None, defocus, spherical, both, all eight."""


def choose(data: WhitenedPsf, progress: Callable[[str], object] | None = None) -> tuple[ModelFit, list[ModelFit]]:
    """The best model, and all models tried in order of the criterion.

    One part is varied at a time: first the low-pass filter and diffusion, then the aperture, then the filter again
    under the new aperture, all with free aberrations. Aberrations that do not improve the criterion are then removed.
    `progress` is called after every fit.
    """
    tried: dict[ModelParts, ModelFit] = {}

    def best_of(candidates: Iterable[ModelParts], near: ModelParts | None = None) -> ModelParts:
        candidates = list(candidates)
        for parts in candidates:
            if parts not in tried:
                tried[parts] = fit_parts(data, parts, start_near(tried[near], parts) if near else None)
                if progress is not None:
                    progress(f"{len(tried)} models of sensor and lens fitted")
        scale = scale_of(tried.values())
        return min(candidates, key=lambda parts: tried[parts].criterion(scale))

    filters = [ModelParts(low_pass=filter_) for filter_ in LowPass]
    best_of(filters)
    # spots can mimic diffusion, and two boxes of half the width a single one: compare both before fixing either
    diffusing = [best_of([replace(parts, diffusion=True)], near=parts) for parts in filters]
    parts = best_of([*filters, *diffusing])
    square = parts
    parts = best_of([square, *(replace(square, aperture=shape) for shape in Aperture)], near=square)
    if parts.aperture is not Aperture.SQUARE:
        parts = best_of((replace(parts, low_pass=filter_) for filter_ in LowPass), near=parts)
    # diffusion is tried again: slight defocus can mimic it, and all aberrations together always can
    lenses = [replace(parts, aberrations=some) for some in ABERRATIONS]
    parts = best_of((replace(lens, diffusion=flag) for lens in lenses for flag in (False, True)), near=parts)
    scale = scale_of(tried.values())
    order = sorted(tried.values(), key=lambda fit: fit.criterion(scale))
    return tried[parts], order


def scale_of(fits: Iterable[ModelFit]) -> float:
    """Reduced chi-square of the best model, at least 1: where no model is perfect, differences count less."""
    return max(1.0, min(fit.chi2 / fit.freedom for fit in fits))
