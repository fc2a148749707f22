"""Mosaics of one camera on its sensor's grid: every sample at its position, the others missing."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from procedures.outcome import BadInput
from procedures.raw import Plane
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.checks import SATURATED

COLOUR = {"R": 0, "G1": 1, "G2": 1, "B": 2}
MOST_GAIN = 8.0
"""Limit of a colour's gain relative to green: beyond it the scene is of one colour and is not balanced by its mean."""


@dataclass(frozen=True, eq=False)
class Mosaics:
    """Photographs of one mosaic.

    z : (P, 3, H, W) samples, balanced so that a grey scene is grey; 0 where a colour was not sampled.
    weight : (P, 3, H, W) of residuals: the colour's gain, which restores the noise's uniformity; 0 where missing.
    gains : (3,) divisors of the samples.
    """

    z: Array
    weight: Array
    gains: Array
    origins: Mapping[str, tuple[int, int]]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the sensor."""
        return int(self.z.shape[2]), int(self.z.shape[3])


def is_mosaic(planes: Collection[str]) -> bool:
    """Whether these are all planes of a mosaic."""
    return set(planes) == set(COLOUR)


def mosaics(photographs: Sequence[Mapping[str, Plane]], light: Array) -> Mosaics:
    """The photographs' planes on one grid; light : (P,) relative to the first. Raises BadInput for other planes than a
    mosaic's, or layouts that differ."""
    origins = {name: plane.origin for name, plane in photographs[0].items()}
    for planes in photographs:
        if not is_mosaic(planes):
            raise BadInput("colour needs mosaics of one layout; one photograph has none", "give RAW files of all")
        if {name: plane.origin for name, plane in planes.items()} != origins:
            raise BadInput("colour needs mosaics of one layout", "give photographs of one camera, not rotated")
    gains = _gains(photographs[0])
    rows, columns = (2 * size for size in photographs[0]["R"].samples.shape)
    z, weight = np.zeros((2, len(photographs), 3, rows, columns))
    for n, planes in enumerate(photographs):
        for name, plane in planes.items():
            (x, y), c = plane.origin, COLOUR[name]
            z[n, c, y::2, x::2] = plane.samples / light[n] / gains[c]
            weight[n, c, y::2, x::2] = gains[c] * (plane.samples < SATURATED)
    return Mosaics(z, weight, gains, origins)


def _gains(planes: Mapping[str, Plane]) -> Array:
    means = {name: float(plane.samples.mean()) for name, plane in planes.items()}
    green = max((means["G1"] + means["G2"]) / 2, 1e-6)
    return np.clip([means["R"] / green, 1.0, means["B"] / green], 1 / MOST_GAIN, MOST_GAIN)


def spread(planes: Mapping[str, Array], origins: Mapping[str, tuple[int, int]]) -> Array:
    """Planes (h, w) interpolated linearly to all pixels of the sensor: red, green, blue, (3, 2 h, 2 w)."""
    each = {name: _on_sensor(plane, origins[name]) for name, plane in planes.items()}
    return np.stack([each["R"], (each["G1"] + each["G2"]) / 2, each["B"]])


def _on_sensor(plane: Array, origin: tuple[int, int]) -> Array:
    rows, columns = plane.shape
    to_plane = np.array([[0.5, 0, -origin[0] / 2], [0, 0.5, -origin[1] / 2]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (2 * columns, 2 * rows)
    return np.asarray(
        cv2.warpAffine(plane.astype(np.float64), to_plane, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def depth_on_sensor(w: Array, jump: float) -> NDArray[np.floating]:
    """w (h, w) of the planes at all pixels of the sensor, in its pixels: linear between samples of the planes' grid,
    half a pixel off, but for edges of more than `jump`."""
    size = (2 * w.shape[1], 2 * w.shape[0])
    wide = np.asarray(w, dtype=np.float64)
    smooth, steps = (cv2.resize(wide, size, interpolation=how) for how in (cv2.INTER_LINEAR, cv2.INTER_NEAREST))
    return np.asarray(2 * np.where(np.abs(smooth - steps) > jump / 2, steps, smooth))
