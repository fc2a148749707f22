"""Contradiction of two motion paths by the frame around a flat part, for any picture and depths.

z1 * h2 = z2 * h1 holds at the best depth of each place. Changes of depth within the masks' reach violate it by several
times the noise, wrong paths by more.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import uniform_filter

from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.mask_evidence import FLOOR, MaskEvidence, masks_at

INSTANTS = 150
"""Instants of a curve when many are compared: a third of the final number, and a third of its time."""


SIZES, SIZE_STEP, BEYOND = (0.4, 2.0), 0.05, 0.2
"""Smallest and largest depth tried relative to the flat part's, their step, and the margin beyond the depths of a rough
matching."""
OUTLYING = 2.0
"""Per cent of the surroundings excluded from the limits of the rough depth."""
WINDOW, CAP = 5, 20.0
"""Side of the window for mean squared disagreement, pixels, and mean, for noise 1, at which a place is taken as a depth
edge."""
PLACES, SIDE = 12, 48
"""Number of places that are compared, those with most contrast, and their side without periodic boundary, pixels."""
SLOPES = 0.3
"""Weight of the places' evidence of masks: changes of depth leave three times the noise even with true masks."""
FEWEST = 30
"""Smallest number of pixels of a depth that determine its masks."""


@dataclass(frozen=True)
class FrameCut:
    """Spectra of both photographs' cuts (2, n, n / 2 + 1), and mask of its pixels outside the flat part."""

    spectra: Array
    outside: NDArray[np.bool_]


class Disagreement:
    """Disagreement of photographs (2, H, W) of noise 1 for curves of half-width `half` in the flat part, at sizes by a
    rough w (H, W)."""

    def __init__(self, z: Array, flat: tuple[slice, slice], half: float, w: Array) -> None:
        self.half = half
        self.sizes = _sizes(w, flat, half)
        self.R = int(np.ceil(self.sizes[-1] * half + 1))
        self.n = next_fast_len(SIDE + 4 * self.R, True)
        # near the frame's border the photographs contain light from outside
        outside = np.pad(np.ones([n - 2 * self.R for n in z.shape[1:]], bool), self.R)
        outside[flat] = False
        margin = (2 * self.R, self.n - 2 * self.R)
        wide = np.pad(z, ((0, 0), margin, margin), mode="reflect").astype(np.float32)
        self.places = [
            FrameCut(rfft2(wide[:, y : y + self.n, x : x + self.n]), outside[y : y + SIDE, x : x + SIDE])
            for y, x in _detailed(z, outside)
        ]

    def spectra(self, points: Array) -> Array:
        """Spectra of one curve's masks (POINTS, 2) at every size."""
        masks = np.stack([masks_at(points[None], self.half, s * self.half, self.R, INSTANTS)[0] for s in self.sizes])
        wrapped = np.zeros((len(self.sizes), self.n, self.n), np.float32)
        wrapped[:, : masks.shape[1], : masks.shape[2]] = masks
        return np.asarray(rfft2(np.roll(wrapped, (-self.R, -self.R), (1, 2))))

    def of(self, first: Array, second: Array) -> float:
        """Mean over the places, from the `spectra` of both curves: 1 for constant depths and true curves."""
        costs = [least[place.outside] for place, _, _, least in self._by_size(first, second)]
        return float(np.mean(-CAP * np.expm1(-np.concatenate(costs) / CAP))) if costs else 0.0

    def _by_size(self, first: Array, second: Array) -> Iterator[tuple[FrameCut, Array, Array, Array]]:
        """For every place: disagreement at every size, (sizes, h, w), size of least mean, and that mean."""
        noise = _noise(first, second)
        first, second = first / noise, second / noise
        for place in self.places:
            a, b = place.spectra
            d = self._cut(irfft2(a * second - b * first, (self.n, self.n)), place.outside.shape)
            mean = uniform_filter(d**2, (0, WINDOW, WINDOW))
            yield place, d, mean.argmin(axis=0), mean.min(axis=0)

    def _cut(self, wide: Array, shape: tuple[int, ...], rim: int = 0) -> Array:
        """The part of a place of this shape without periodic boundary, with a margin of `rim` pixels."""
        begin = 2 * self.R - rim
        part: Array = wide[..., begin : begin + shape[0] + 2 * rim, begin : begin + shape[1] + 2 * rim]
        return part

    def evidence(self, points: Array) -> list[MaskEvidence]:
        """Evidence of the places on the masks of every size, each pixel at its best size."""
        first, second = (self.spectra(curve) for curve in points)
        noise = _noise(first, second)
        by_size: dict[int, MaskEvidence] = {}
        for place, d, best, least in self._by_size(first, second):
            weight = SLOPES * np.exp(-least / CAP)
            for size in np.unique(best[place.outside]):
                at = (best == size) & place.outside
                if at.sum() < FEWEST:
                    continue
                evidence = by_size.get(size) or by_size.setdefault(
                    size, MaskEvidence.about(points, self.half, self.sizes[size] * self.half, self.R)
                )
                evidence.add(self._patches(place, noise[size], at, evidence.R), -d[size][at], weight[at])
        return list(by_size.values())

    def _patches(self, place: FrameCut, noise: Array, at: NDArray[np.bool_], R: int) -> Array:
        """Derivatives of the disagreement at given pixels with respect to both masks, (2 (2R + 1)^2, pixels)."""
        K, rows = 2 * R + 1, []
        for sign, spectrum in zip((-1, 1), place.spectra[::-1], strict=True):
            wide = self._cut(sign * irfft2(spectrum / noise, (self.n, self.n)), place.outside.shape, R)
            views = np.lib.stride_tricks.sliding_window_view(wide, (K, K))[at]
            rows.append(views[:, ::-1, ::-1].reshape(len(views), -1).T)
        return np.concatenate(rows)


def _sizes(w: Array, flat: tuple[slice, slice], half: float) -> Array:
    """Depths to try relative to the flat part's: those of a rough matching around it, with a margin."""
    outside = np.ones(w.shape, bool)
    outside[flat] = False
    if not outside.any():
        return np.ones(1)
    low, high = np.clip(np.percentile(w[outside] / half, (OUTLYING, 100 - OUTLYING)), *SIZES)
    return np.arange(low - BEYOND, high + BEYOND + SIZE_STEP / 2, SIZE_STEP)


def _noise(first: Array, second: Array) -> Array:
    """Standard deviation of z1 * h2 - z2 * h1 at every frequency."""
    return np.asarray(np.sqrt(np.abs(first) ** 2 + np.abs(second) ** 2 + np.float32(FLOOR)))


def _detailed(z: Array, outside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Upper left corners of the places with most contrast outside the flat part."""
    detail = np.zeros(outside.shape)
    detail[1:, 1:] = sum(np.diff(a, axis=0)[:, 1:] ** 2 + np.diff(a, axis=1)[1:] ** 2 for a in z)
    detail *= outside
    H, W = outside.shape
    corners = [(y, x) for y in range(0, H, SIDE) for x in range(0, W, SIDE)]
    contrast = {(y, x): float(detail[y : y + SIDE, x : x + SIDE].sum()) for y, x in corners}
    return [at for at in sorted(corners, key=lambda at: -contrast[at])[:PLACES] if contrast[at] > 0]
