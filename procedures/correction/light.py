"""The light that a lens loses towards the corners, given back to a picture whose blur was undone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.correction.estimate import Correction
from procedures.outcome import BadInput
from procedures.raw import Plane

Array = npt.NDArray[np.float64]
Light = Callable[[Array], Array]
"""Light at points (n, 2) of a plane over that at its centre."""

SHOWN = {1: ("Y",), 3: ("R", "G1", "B")}
"""The planes whose light a picture's colours have, by their number."""
ROWS = 64
"""Of the picture that are evened at once: what is in between stays small."""


def evened(found: Correction, planes: Mapping[str, Plane], lights: Mapping[str, Light]) -> Correction:
    """The same picture in even light, its noise told as much larger.

    Parameters
    ----------
    planes : mapping of name to Plane
        Of the photograph: where they lie on the sensor.
    lights : mapping of plane to Light

    Raises
    ------
    BadInput
        If the light of one of the picture's colours is not known.
    """
    names = SHOWN[len(found.picture)]
    missing = [name for name in names if name not in lights]
    if missing:
        raise BadInput(
            f"the field tells the light of {', '.join(lights)}, not of {', '.join(missing)}",
            "measure vignetting of all planes, and the field again with it",
        )
    columns = np.arange(found.picture.shape[2], dtype=np.float64)
    picture = found.picture.copy()
    for colour, name in zip(picture, names, strict=True):
        for top in range(0, len(colour), ROWS):
            band = colour[top : top + ROWS]
            band /= _over(lights[name], planes[name], columns, np.arange(top, top + len(band), dtype=np.float64))
    told = found.prediction
    loss = _over(lights[names[len(names) // 2]], planes[names[len(names) // 2]], told.x, told.y)
    return replace(found, picture=picture, prediction=replace(told, noise_gain=told.noise_gain / loss))


def _over(light: Light, plane: Plane, x: Array, y: Array) -> Array:
    """The light at columns x (m,) and rows y (n,) of the sensor, (n, m)."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(light((points - plane.origin) / plane.pitch)).reshape(len(y), len(x))
