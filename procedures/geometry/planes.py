"""The cameras of several colour planes: of one formula, so that they differ by light and not by how it is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry, too_poor
from procedures.geometry.views import ChartView
from procedures.outcome import Outcome

Array = npt.NDArray[np.float64]


def calibrate_planes(
    views: Mapping[str, Sequence[ChartView]],
    size: tuple[int, int],
    parameters: GeometryParameters,
    nodes: Array | None = None,
) -> dict[str, Outcome[Geometry]]:
    """The camera of every plane, as `calibrate_geometry` has it from the plane's views.

    A model that is to be chosen is chosen in one plane, G1 where there is one; another plane takes it too, or chooses
    for itself where it is too poor there.
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
    """A plane's camera of the model that another plane has."""
    if first.value is not None and parameters.model is None:
        found = calibrate_geometry(views, size, replace(parameters, model=first.value.camera.model), nodes)
        if found.value is not None and not too_poor(found.value):
            return found
    return calibrate_geometry(views, size, parameters, nodes)
