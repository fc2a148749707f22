"""The curves among those a flat part cannot tell apart that other depths agree with, by walking from one to the next.

A bend is moved at random, the flat part pulls the curve back to those that draw its masks, and the step is kept if the
frame around the flat part agrees better: z1 * h2 = z2 * h1 at the depth where each place agrees best (basin hopping,
after Wales and Doye 1997). Neither a picture nor a depth map is needed for that, so a step takes a thirtieth of a
second and hundreds are tried; wrong turns, which descent cannot leave, are left.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import uniform_filter

from procedures.restoration.forward import Array
from procedures.restoration.mask_evidence import MaskEvidence, fitted, masks_at
from procedures.restoration.paths import POINTS

# depths tried, over the flat part's own
SIZES = np.arange(0.6, 1.35, 0.05)
# side of the mean of squared disagreement, pixels, and mean at which a place merely has a depth step
WINDOW, CAP = 5, 20.0
# places looked at, and their side without what wraps around, pixels
PLACES, INSIDE = 12, 48
# a bend is moved by so many pixels, and is so wide, of the exposure
MOVED, WIDE = 0.5, (0.06, 0.25)
# instants of a curve while walking; chi-square by which the flat part may like a step less than where the walk began
INSTANTS, LIKED = 150, 100.0


class Disagreement:
    """How much two photographs (2, H, W), of noise 1, contradict two curves of half-width `half` in the flat part.

    Mean over the places with most contrast outside the flat part; 1 where depth is even and the curves are right.
    """

    def __init__(self, z: Array, flat: tuple[slice, slice], half: float) -> None:
        self.half = half
        self.R = int(np.ceil(SIZES[-1] * half + 1))
        self.n = next_fast_len(INSIDE + 4 * self.R, True)
        outside = np.ones(z.shape[1:], bool)
        outside[flat] = False
        places = _places(z, outside)
        margin = (2 * self.R, self.n - 2 * self.R)
        wide = np.pad(z, ((0, 0), margin, margin), mode="reflect")
        cuts = [wide[:, y : y + self.n, x : x + self.n] for y, x in places]
        self._spectra = [rfft2(cut.astype(np.float32)) for cut in cuts]
        self._outside = [outside[y : y + INSIDE, x : x + INSIDE] for y, x in places]

    def seen(self, points: Array) -> Array:
        """Spectra of one curve's masks (POINTS, 2) at every size."""
        masks = np.stack([masks_at(points[None], self.half, s * self.half, self.R, INSTANTS)[0] for s in SIZES])
        wrapped = np.zeros((len(SIZES), self.n, self.n), np.float32)
        wrapped[:, : masks.shape[1], : masks.shape[2]] = masks
        return np.asarray(rfft2(np.roll(wrapped, (-self.R, -self.R), (1, 2))))

    def of(self, first: Array, second: Array) -> float:
        """From what was `seen` of both curves."""
        noise = np.sqrt(np.abs(first) ** 2 + np.abs(second) ** 2 + np.float32(1e-3))
        first, second = first / noise, second / noise
        inside = slice(2 * self.R, 2 * self.R + INSIDE)
        least = []
        for (a, b), outside in zip(self._spectra, self._outside, strict=True):
            d = irfft2(a * second - b * first, (self.n, self.n))[:, inside, inside]
            mean = uniform_filter(d[:, : outside.shape[0], : outside.shape[1]] ** 2, (0, WINDOW, WINDOW))
            least.append(mean.min(axis=0)[outside])
        return float(np.mean(-CAP * np.expm1(-np.concatenate(least) / CAP))) if least else 0.0


def _places(z: Array, outside: Array) -> list[tuple[int, int]]:
    """Upper left corners of the places with most contrast outside the flat part."""
    H, W = outside.shape
    corners = [(y, x) for y in range(0, H, INSIDE) for x in range(0, W, INSIDE)]
    detail = np.zeros((H, W))
    detail[1:, 1:] = sum(np.diff(a, axis=0)[:, 1:] ** 2 + np.diff(a, axis=1)[1:] ** 2 for a in z)
    detail = detail * outside
    contrast = {(y, x): float(detail[y : y + INSIDE, x : x + INSIDE].sum()) for y, x in corners}
    return [at for at in sorted(corners, key=lambda at: -contrast[at])[:PLACES] if contrast[at] > 0]


def begun(
    disagreement: Disagreement, evidence: Sequence[MaskEvidence], points: Array, pools: Sequence[Sequence[Array]]
) -> Array:
    """The pair of curves, one of each pool, that the flat part draws and other depths contradict least."""
    half = disagreement.half
    curves = []
    for k, pool in enumerate(pools):
        found = []
        for one in pool:
            pair = points.copy()
            pair[k] = one
            value, pair = fitted(evidence, pair, half, (k,), INSTANTS)
            found.append((value, pair[k]))
        found.sort(key=lambda one: one[0])
        curves.append([one for _, one in found[: len(found) // 3]])
    seen = [[disagreement.seen(one) for one in those] for those in curves]
    pairs = [(a, b) for a in range(len(curves[0])) for b in range(len(curves[1]))]
    a, b = min(pairs, key=lambda pair: disagreement.of(seen[0][pair[0]], seen[1][pair[1]]))
    return np.stack([curves[0][a], curves[1][b]])


def _bent(points: Array, rng: np.random.Generator) -> Array:
    """A curve (POINTS, 2) with one bend moved, anywhere along it."""
    at, width = rng.uniform(-0.1, 1.1), rng.uniform(*WIDE)
    bump = np.exp(-(((np.linspace(0, 1, POINTS) - at) / width) ** 2) / 2)
    return np.asarray(points + bump[:, None] * rng.normal(0, MOVED, 2))


def walked(
    disagreement: Disagreement,
    evidence: Sequence[MaskEvidence],
    points: Array,
    rng: np.random.Generator,
    steps: int,
) -> tuple[float, Array]:
    """Least disagreement met, and the curves (2, POINTS, 2) there; evidence : of the flat part."""
    half = disagreement.half
    liked, points = fitted(evidence, points, half, instants=INSTANTS)
    seen = [disagreement.seen(one) for one in points]
    least = disagreement.of(*seen)
    for n in range(steps):
        k = n % 2
        pair = points.copy()
        pair[k] = _bent(points[k], rng)
        value, pair = fitted(evidence, pair, half, (k,), INSTANTS, 15, 1e-3)
        if value > liked + LIKED:
            continue
        new = list(seen)
        new[k] = disagreement.seen(pair[k])
        there = disagreement.of(*new)
        if there < least:
            points, seen, least, liked = pair, new, there, min(liked, value)
    return least, points
