"""Cameras of several colour planes with a common model, so that they differ by wavelength and not by formula."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry, is_too_simple
from procedures.geometry.views import ChartView
from procedures.outcome import Outcome

Array = npt.NDArray[np.float64]


def calibrate_planes(
    views: Mapping[str, Sequence[ChartView]],
    size: tuple[int, int],
    parameters: GeometryParameters,
    nodes: Array | None = None,
) -> dict[str, Outcome[Geometry]]:
    """The camera of every plane from its views by `calibrate_geometry`.

    Without a given model, it is chosen in G1, or else in the first plane. The other planes use the same model unless
    it is too simple for them.
    """
    guide = "G1" if "G1" in views else next(iter(views))
    first = calibrate_geometry(views[guide], size, parameters, nodes)
    return {name: first if name == guide else _like(first, views[name], size, parameters, nodes) for name in views}


def _like(
    first: Outcome[Geometry],
    views: Sequence[ChartView],
    size: tuple[int, int],
    parameters: GeometryParameters,
    nodes: Array | None,
) -> Outcome[Geometry]:
    """A plane's camera with the model of another plane."""
    if first.value is not None and parameters.model is None:
        outcome = calibrate_geometry(views, size, replace(parameters, model=first.value.camera.model), nodes)
        if outcome.value is not None and not is_too_simple(outcome.value):
            return outcome
    return calibrate_geometry(views, size, parameters, nodes)
