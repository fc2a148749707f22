"""Rotation and zoom between photographs, estimated from the shifts of their parts, and their correction."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from procedures.restoration.masks.blur_operator import Array

Place = tuple[float, float]

FEWEST = 6
"""Smallest number of parts for estimating rotation and zoom: four unknowns from twelve numbers."""
LEAST_PX, LEAST_GAIN = 0.1, 2.0
"""Smallest significant root mean square shift of the parts about their mean, and its ratio to the residual: in
registered photographs it is 0.01 to 0.04 pixel, all of it residual."""


@dataclass(frozen=True)
class Similarity:
    """Photograph 2 relative to photograph 1: rotation in radians from x to y, and zoom, about the frame's centre.

    spread, residual : root mean square shift of parts of the frame about their mean, pixels, before and after the fit
    """

    turn: float
    zoom: float
    spread: float
    residual: float

    @property
    def significant(self) -> bool:
        """Whether rotation and zoom are significant."""
        return self.spread > max(LEAST_PX, LEAST_GAIN * self.residual)


def similarity(places: Sequence[Place], shifts: NDArray[np.float64], shape: tuple[int, int]) -> Similarity:
    """Rotation and zoom from the shifts (n, 2), pixels, of parts of the frame with centres at these fractions of height
    and width."""
    if len(places) < FEWEST:
        return Similarity(0.0, 1.0, 0.0, 0.0)
    y, x = ((np.array(at) - 0.5) * size for at, size in zip(zip(*places, strict=True), shape, strict=True))
    one, none = np.ones(len(x)), np.zeros(len(x))
    design = np.vstack([np.column_stack([one, none, -y, x]), np.column_stack([none, one, x, y])])
    fit, target = np.zeros(4), shifts.T.ravel()
    # robust weights, as one part without texture must not determine the result
    weight: NDArray[np.floating] = np.ones(len(target))
    for _ in range(5):
        fit = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(target - design @ fit), 0.02))
    residual = target - design @ fit
    spread = shifts - np.median(shifts, axis=0)
    return Similarity(float(fit[2]), 1 + float(fit[3]), _rms(spread), _rms(residual))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rotate_back(photograph: Array, trust: Array, similarity: Similarity) -> tuple[Array, Array]:
    """Photograph (C, H, W) and trust (1, H, W), rotation and zoom relative to the first corrected; 0 where nothing was
    photographed."""
    H, W = photograph.shape[1:]
    cos, sin = similarity.zoom * np.cos(similarity.turn), similarity.zoom * np.sin(similarity.turn)
    A, middle = np.array([[cos, -sin], [sin, cos]]), np.array([W - 1.0, H - 1.0]) / 2
    matrix = np.column_stack([A, middle - A @ middle])
    flags = cv2.WARP_INVERSE_MAP

    def warped(plane: Array, how: int, border: int) -> Array:
        return np.asarray(cv2.warpAffine(plane, matrix, (W, H), flags=flags | how, borderMode=border))

    z = np.stack([warped(plane, cv2.INTER_LANCZOS4, cv2.BORDER_REPLICATE) for plane in photograph])
    valid = warped(trust[0].astype(np.float64), cv2.INTER_LINEAR, cv2.BORDER_CONSTANT) > 0.999
    return z, valid[None].astype(trust.dtype)
