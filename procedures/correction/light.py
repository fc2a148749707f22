"""Vignetting correction of a deblurred picture."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.correction.estimate import Correction
from procedures.outcome import BadInput
from procedures.raw import Plane

Array = npt.NDArray[np.float64]
Light = Callable[[Array], Array]
"""Relative illumination at points (n, 2) of a plane."""

SHOWN = {1: ("Y",), 3: ("R", "G1", "B")}
"""The planes whose illumination applies to a picture's colours, by their number."""
ROWS = 64
"""Rows of the picture corrected at once, to limit memory."""


def evened(correction: Correction, planes: Mapping[str, Plane], lights: Mapping[str, Light]) -> Correction:
    """The picture corrected for vignetting, with its noise gain raised accordingly.

    Raises BadInput if the illumination of one of the picture's colours is not known.

    planes : mapping of name to Plane
        The photograph's planes, for their positions on the sensor.
    lights : mapping of plane to Light
    """
    names = SHOWN[len(correction.picture)]
    missing = [name for name in names if name not in lights]
    if missing:
        raise BadInput(
            f"the illumination of {', '.join(missing)} is needed; the field has that of {', '.join(lights)}",
            "measure vignetting of all planes, and the field again with it",
        )
    columns = np.arange(correction.picture.shape[2], dtype=np.float64)
    picture = correction.picture.copy()
    for colour, name in zip(picture, names, strict=True):
        for top in range(0, len(colour), ROWS):
            band = colour[top : top + ROWS]
            band /= _over(lights[name], planes[name], columns, np.arange(top, top + len(band), dtype=np.float64))
    maps = correction.prediction
    loss = _over(lights[names[len(names) // 2]], planes[names[len(names) // 2]], maps.x, maps.y)
    return replace(correction, picture=picture, prediction=replace(maps, noise_gain=maps.noise_gain / loss))


def _over(light: Light, plane: Plane, x: Array, y: Array) -> Array:
    """Relative illumination at columns x (m,) and rows y (n,) of the sensor, (n, m)."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.asarray(light((points - plane.origin) / plane.pitch)).reshape(len(y), len(x))
