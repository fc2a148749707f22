"""Turn and zoom between photographs, told by how far their parts are shifted, and taken up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from procedures.restoration.masks.blur_operator import Array

Place = tuple[float, float]

FEWEST = 6
"""Parts of the frame from which a turn and a zoom are told: four numbers from twelve."""
LEAST_PX, LEAST_GAIN = 0.1, 2.0
"""Root mean square shift of the parts about their mean from which they are believed, and that over what is left: of
photographs in their places 0.01 to 0.04 pixel, all of it left."""


@dataclass(frozen=True)
class Similarity:
    """Photograph 2 over photograph 1: turn in radians from x to y, and zoom, about the frame's middle.

    spread, left : root mean square shift of parts of the frame about their mean, pixels, and what of it is left
    """

    turn: float
    zoom: float
    spread: float
    left: float

    @property
    def believed(self) -> bool:
        """Whether the photographs ask for it."""
        return self.spread > max(LEAST_PX, LEAST_GAIN * self.left)


def similarity(places: Sequence[Place], shifts: NDArray[np.float64], shape: tuple[int, int]) -> Similarity:
    """Turn and zoom by the shifts (n, 2), x and y in pixels, of parts of the frame.

    places : of their middles, y and x in parts of the frame's height and width
    """
    if len(places) < FEWEST:
        return Similarity(0.0, 1.0, 0.0, 0.0)
    y, x = ((np.array(at) - 0.5) * size for at, size in zip(zip(*places, strict=True), shape, strict=True))
    one, none = np.ones(len(x)), np.zeros(len(x))
    design = np.vstack([np.column_stack([one, none, -y, x]), np.column_stack([none, one, x, y])])
    found, wanted = np.zeros(4), shifts.T.ravel()
    # one part without texture shall not turn the frame
    weight: NDArray[np.floating] = np.ones(len(wanted))
    for _ in range(5):
        found = np.linalg.lstsq(design * weight[:, None], wanted * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(wanted - design @ found), 0.02))
    left = wanted - design @ found
    spread = shifts - np.median(shifts, axis=0)
    return Similarity(float(found[2]), 1 + float(found[3]), _rms(spread), _rms(left))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def turned_back(photograph: Array, trust: Array, found: Similarity) -> tuple[Array, Array]:
    """Photograph (C, H, W) and its trust (1, H, W) brought to the first's turn and zoom.

    What nobody saw is not trusted.
    """
    H, W = photograph.shape[1:]
    cos, sin = found.zoom * np.cos(found.turn), found.zoom * np.sin(found.turn)
    A, middle = np.array([[cos, -sin], [sin, cos]]), np.array([W - 1.0, H - 1.0]) / 2
    matrix = np.column_stack([A, middle - A @ middle])
    flags = cv2.WARP_INVERSE_MAP

    def brought(plane: Array, how: int, border: int) -> Array:
        return np.asarray(cv2.warpAffine(plane, matrix, (W, H), flags=flags | how, borderMode=border))

    z = np.stack([brought(plane, cv2.INTER_LANCZOS4, cv2.BORDER_REPLICATE) for plane in photograph])
    known = brought(trust[0].astype(np.float64), cv2.INTER_LINEAR, cv2.BORDER_CONSTANT) > 0.999
    return z, known[None].astype(trust.dtype)
