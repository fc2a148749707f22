"""Whether a picture was sharpened, by its noise: that of pixels is white, and an unsharp mask colours it.

A mask of amount a and radius r makes x + a (x - g * x) of a picture x, g the Gaussian of standard deviation r. White
noise, seen through it, has the covariance of that kernel with itself: neighbours go apart. What paper, light and a poor
fit leave in a picture holds neighbours together, as a lens made it: it can hide a mask and not feign one. Of a picture
that goes on slowly the differences of pixels tell covariances without its level (a variogram), and a constant and a
square of the distance take what changes slowly out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numerics import transforms

Array = npt.NDArray[np.float64]

REACH = 5
"""Pixels up to which pairs are looked at."""
RADII = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Of the masks that are tried, in pixels; wider ones change next to nothing within the reach."""
AMOUNTS = np.concatenate([np.arange(0.01, 0.3, 0.01), np.geomspace(0.3, 2.0, 20)])
USUAL = RADII.index(1.0)
FEWEST = 500
"""Pairs at one distance from which anything is told."""
GRID = 12
"""Pixels to which the Gaussians are drawn."""

_y, _x = (one.ravel() for one in np.mgrid[0 : REACH + 1, -REACH : REACH + 1])
_kept = ((_y > 0) | (_x > 0)) & (_x**2 + _y**2 <= REACH**2)
LAG_X, LAG_Y = _x[_kept], _y[_kept]
"""One of each pair of opposite distances."""


@dataclass(frozen=True)
class Variogram:
    """Half the mean square of differences at the distances `LAG_X`, `LAG_Y`.

    Attributes
    ----------
    half_square : (l,) float64
    pairs : (l,) float64
        How many there are.
    left : bool
        Whether it is of what a fit left: the finest detail of that is the model's, too.
    """

    half_square: Array
    pairs: Array
    left: bool = False

    @classmethod
    def of(cls, picture: Array, known: npt.NDArray[np.bool_], *, left: bool = False) -> Variogram:
        """Of a picture (rows, columns) where it is known; its level should be near 0."""
        rows, columns = (transforms.next_fast_len(n + REACH) for n in picture.shape)
        values = np.where(known, picture, 0.0)
        one, first, second = (
            transforms.rfft2(part, (rows, columns)) for part in (known.astype(np.float64), values, values * values)
        )
        pairs = np.rint(transforms.irfft2(np.abs(one) ** 2, (rows, columns)))[LAG_Y, LAG_X]
        squares = transforms.irfft2((second * one.conj()).real - np.abs(first) ** 2, (rows, columns))[LAG_Y, LAG_X]
        return cls(squares / np.maximum(pairs, 1), pairs, left)

    @property
    def finest(self) -> float:
        """Variance of white noise of the same power where both frequencies are highest: no lens passes detail there."""
        near = {(x, y): v for x, y, v in zip(LAG_X.tolist(), LAG_Y.tolist(), self.half_square.tolist(), strict=True)}
        return float(near[1, 0] + near[0, 1] - (near[1, 1] + near[-1, 1]) / 2)


@dataclass(frozen=True)
class Sharpening:
    """The unsharp mask that explains noise best.

    Attributes
    ----------
    amount, radius_px : float
        0 where none explains it better than white noise.
    sigmas : float
        Root of twice the gain of the log-likelihood over white noise.
    uncertainty : float
        Standard uncertainty of the amount of a mask of one pixel; infinite where there is nothing to look at.
    """

    amount: float
    radius_px: float
    sigmas: float
    uncertainty: float


def find_sharpening(variograms: Sequence[Variogram]) -> Sharpening:
    """The unsharp mask that the noise of several fields tells, by the largest likelihood.

    Correlations found of white noise scatter by one over the root of the number of pairs.
    """
    gain, information = np.zeros((2, len(RADII), len(AMOUNTS)))
    for one in variograms:
        if one.pairs.min() < FEWEST:
            continue
        weight = np.sqrt(one.pairs)
        basis = np.linalg.qr(_slow(one.left) * weight[:, None])[0]
        found = weight * (1 - one.half_square / np.average(one.half_square, weights=one.pairs))
        masked = _correlations() * weight
        masked = masked - masked @ basis @ basis.T
        power = np.sum(masked**2, axis=-1)
        gain += 2 * masked @ (found - basis @ (basis.T @ found)) - power
        information += power
    if not information.any():
        return Sharpening(0.0, 0.0, 0.0, np.inf)
    uncertainty = float(AMOUNTS[0] / np.sqrt(information[USUAL, 0]))
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    if gain[i, j] <= 0:
        return Sharpening(0.0, 0.0, 0.0, uncertainty)
    return Sharpening(float(AMOUNTS[j]), RADII[i], float(np.sqrt(gain[i, j])), uncertainty)


def _slow(left: bool) -> Array:
    """What else the correlations may be made of, (l, 2 or 3)."""
    square = LAG_X**2 + LAG_Y**2
    columns = [np.ones(len(square)), square / REACH**2]
    return np.column_stack([*columns, square == 1] if left else columns)


@lru_cache(maxsize=1)
def _correlations() -> Array:
    """Correlations of sharpened white noise at the distances, (radii, amounts, l)."""
    x = np.arange(-GRID, GRID + 1)
    found = np.empty((len(RADII), len(AMOUNTS), len(LAG_X)))
    for i, radius in enumerate(RADII):
        once = np.exp(-(x**2) / (2 * radius**2))
        once = once / once.sum()
        twice = np.convolve(once, once)[GRID:-GRID]
        for j, a in enumerate(AMOUNTS.tolist()):
            apart = a * a * twice[GRID + LAG_X] * twice[GRID + LAG_Y]
            apart -= 2 * a * (1 + a) * once[GRID + LAG_X] * once[GRID + LAG_Y]
            found[i, j] = apart / ((1 + a) ** 2 - 2 * a * (1 + a) * once[GRID] ** 2 + a * a * twice[GRID] ** 2)
    return found
