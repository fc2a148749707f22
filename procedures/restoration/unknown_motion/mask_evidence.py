"""Evidence of two photographs on the masks of one w, for any picture: a quadratic form, to which curves are fitted.

Errors of the whole model are taken tile by tile. The part explained by a common picture is projected out (z1 * h2 =
z2 * h1 in the errors), and so is a change of the tile's depth. The rest is linear in the masks, so that a sum of
squares rates any other masks of that w. Curves are then fitted without the photographs.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft2

from procedures.numerics.compiled import jitted
from procedures.restoration.masks.blur_models import LINE
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.line_rasterisation import line_mask, line_mask_change
from procedures.restoration.unknown_motion.motion_splines import (
    POINTS,
    basis,
    moving,
    spline_mask,
    third_derivative_penalty,
)

BEYOND = 1.15
"""Largest reach of masks relative to those from which they are estimated."""
STEADY = 1e-6
"""Weight of a curve's mean squared third derivative, pixels per exposure, in squared noise: a rig has mass.
Oscillations of 2 pixels, four in an exposure, cost as much as a hundred samples wrong by the noise; kinks several times
as much."""
FLOOR = 1e-3
"""Relative magnitude of spectra below which division is avoided."""
FARTHEST = 20.0
"""Ratio to the least cost so far from which no descent has reached below it."""
PATIENCE = 4.0
"""A descent is abandoned if this many times its fall in two rounds does not suffice. Of 136 descents of two pairs of
motions 13 reached below the least cost so far, none of which either rule abandons; they save 40 % of all rounds."""
UNRELIABLE_TILE = 10.0
"""Mean squared error of a tile, relative to the noise, above which it probably has a depth edge or a wrong depth."""
DEPTH_KNOWN = np.diag([1e-3, 10.0, 10.0])
"""Prior precision of a tile's depth, its slope and slope across the tile, 1 / pixel^2."""


@dataclass
class MaskEvidence:
    """Chi-square c - 2 g.d + d'G d of a change d of both masks (2, K, K) of half-width w; G : (2 K^2, 2 K^2)."""

    w: float
    masks: Array
    G: Array
    g: Array
    c: float = 0.0

    @classmethod
    def about(cls, points: Array, half: float, w: float, R: int) -> "MaskEvidence":
        """No evidence yet, for the masks of curves of half-width `half`."""
        r = min(int(np.ceil(BEYOND * w + 1)), R)
        masks = masks_at(points, half, w, r)
        return cls(w, masks, np.zeros((masks.size, masks.size)), np.zeros(masks.size))

    @property
    def R(self) -> int:
        """Half-size of the masks."""
        return int(self.masks.shape[1] // 2)

    def add(self, A: Array, r: Array, weight: Array | float = 1.0) -> None:
        """Add samples r (m,) with derivatives -A', A (2 K^2, m), and their weights."""
        root = np.sqrt(weight)
        weighted, rest = (root * A).astype(A.dtype, copy=False), (root * r).astype(A.dtype, copy=False)
        self.G += weighted @ weighted.T
        self.g += weighted @ rest
        self.c += float(np.sum(weight * r**2))

    def chi_square(self, masks: Array) -> float:
        """Chi-square of other masks, (2, K, K)."""
        d = (masks - self.masks).ravel()
        return float(self.c + d @ (self.G @ d - 2 * self.g))


def masks_at(points: Array, half: float, w: float, R: int, instants: int = 400) -> Array:
    """Masks (n, 2R + 1, 2R + 1) of curves (n, POINTS, 2) of half-width `half`, stretched to w."""
    return np.stack([spline_mask(curve * (w / half), R, LINE * w, instants) for curve in points])


def filters(masks: Array, size: int) -> Array:
    """Filters of both errors of a tile, (2, size, size // 2 + 1), to (e1 * h2 - e2 * h1) over its noise: the part by no
    common picture, white."""
    R = masks.shape[1] // 2
    offsets = np.arange(-R, R + 1) % size
    wrapped = np.zeros((2, size, size))
    for out, mask in zip(wrapped, masks, strict=True):
        np.add.at(out, np.ix_(offsets, offsets), mask)
    first, second = rfft2(wrapped)
    gain = 1 / np.sqrt(np.abs(first) ** 2 + np.abs(second) ** 2 + FLOOR)
    return np.stack([second * gain, -first * gain])


def rows(spectra: Array) -> Array:
    """Spectra (..., n, n // 2 + 1) of real tiles as real rows with the tiles' scalar products."""
    n = spectra.shape[-2]
    share = np.full(spectra.shape[-1], 2.0, spectra.real.dtype)
    share[[0, -1]] = 1.0
    weighted = (spectra * (np.sqrt(share) / n)).reshape(*spectra.shape[:-2], -1)
    return np.concatenate([weighted.real, weighted.imag], axis=-1)


def unexplained(errors: Array, filtering: Array) -> Array:
    """The part of a tile's errors (2, n, n) that no common picture explains, as a row."""
    return rows((rfft2(errors) * filtering).sum(axis=0))


@dataclass(frozen=True)
class EvidenceTile:
    """Errors (2, n, n) of both photographs, in units of noise, and the picture (n + 2R, n + 2R) around, likewise."""

    errors: Array
    around: Array
    flat: bool


def gather(evidence: MaskEvidence, slope: Array, tiles: Iterable[EvidenceTile]) -> list[float]:
    """Add the evidence of tiles of one w, and give the mean squares of their unexplained errors; slope : of both masks
    by w."""
    filtering: Array | None = None
    residuals = []
    for tile in tiles:
        n, K = tile.errors.shape[1], evidence.masks.shape[1]
        filtering = filters(evidence.masks, n).astype(np.complex64) if filtering is None else filtering
        trim = (tile.around.shape[0] - n - K + 1) // 2
        picture = tile.around[trim : trim + n + K - 1, trim : trim + n + K - 1]
        patches = np.lib.stride_tricks.sliding_window_view(picture, (n, n))[::-1, ::-1].reshape(-1, n, n)
        spectra = rfft2(patches)
        A = np.concatenate([rows(spectra * one) for one in filtering])
        r = unexplained(tile.errors.astype(np.float32), filtering)
        residuals.append(float(r @ r) / n**2)
        if tile.flat:
            weight, V = 1.0, r[None][:0]
        else:
            weight, V = 1 / (1 + residuals[-1] / UNRELIABLE_TILE) ** 2, _depth_changes(patches, slope, filtering)
        AV, inner = A @ V.T, V @ V.T + DEPTH_KNOWN[: len(V), : len(V)]
        solution = np.linalg.solve(inner, np.concatenate([AV.T, (V @ r)[:, None]], axis=1))
        evidence.G += weight * (A @ A.T - AV @ solution[:, :-1])
        evidence.g += weight * (A @ r - AV @ solution[:, -1])
        evidence.c += weight * float(r @ r - (V @ r) @ solution[:, -1])
    return residuals


def _depth_changes(patches: Array, slope: Array, filtering: Array) -> Array:
    """Derivatives of a tile's filtered errors with respect to its depth and the depth's slopes, rows (3, ...)."""
    n = patches.shape[1]
    t = (np.arange(n) - n / 2) / n
    planes = np.stack([np.ones((n, n)), *np.meshgrid(t, t)])
    return np.asarray(
        sum(
            rows(rfft2(planes * np.tensordot(one.ravel(), patches, 1)) * by)
            for one, by in zip(slope, filtering, strict=True)
        )
    )


def cost(evidence: Sequence[MaskEvidence], points: Array, half: float, instants: int = 200) -> float:
    """Chi-square of curves (2, POINTS, 2) of half-width `half`, with the penalty on their third derivative."""
    paths = basis(instants) @ points
    terms = (e.c + curves_chi_square(e.masks, e.G, e.g, paths * (e.w / half), LINE * e.w) for e in evidence)
    return STEADY * float(np.sum(points * (third_derivative_penalty() @ points))) + sum(terms)


def _equations(
    evidence: Sequence[MaskEvidence], points: Array, half: float, free: Sequence[int], instants: int
) -> tuple[Array, Array]:
    """Normal matrix and gradient of the cost over the points of the free curves, x before y."""
    H = np.kron(np.eye(2 * len(free)), STEADY * third_derivative_penalty())
    gradient = H @ points[list(free)].swapaxes(1, 2).ravel()
    paths, chosen = basis(instants) @ points, np.array(free, np.int64)
    for e in evidence:
        scale = e.w / half
        quadratic = (e.masks, e.G, e.g, paths * scale, LINE * e.w)
        add_curves(H, gradient, *quadratic, chosen, scale, *moving(instants), POINTS)
    unknowns = 2 * POINTS
    H[unknowns:, :unknowns] = H[:unknowns, unknowns:].T
    return H, gradient


def fit_curves(
    evidence: Sequence[MaskEvidence],
    points: Array,
    half: float,
    free: Sequence[int] = (0, 1),
    instants: int = 200,
    rounds: int = 30,
    least: float = 1e-4,
    below: float = np.inf,
) -> tuple[float, Array]:
    """Cost and points of the curves of least cost near `points`, `free` ones varied, by Levenberg and Marquardt;
    abandoned where `below` is hardly reachable."""
    values, damping = [cost(evidence, points, half, instants)], 1e-3
    while len(values) <= rounds and not _hopeless(values, below):
        H, gradient = _equations(evidence, points, half, free, instants)
        diagonal, value = np.eye(len(H)) * np.trace(H) / len(H), values[-1]
        for _ in range(7):
            step = np.linalg.solve(H + damping * diagonal, gradient)
            tried = points.copy()
            tried[list(free)] -= step.reshape(len(free), 2, POINTS).swapaxes(1, 2)
            new = cost(evidence, tried, half, instants)
            if new < value:
                points, value, damping = tried, new, max(damping / 5, 1e-9)
                break
            damping *= 5
        values.append(value)
        if values[-2] - value < least * values[-2]:
            break
    return values[-1], points


def _hopeless(values: list[float], below: float) -> bool:
    """Whether costs that fall like these will hardly reach a target."""
    if values[0] > FARTHEST * below:
        return True
    return len(values) > 3 and values[-1] - below > PATIENCE * (values[-3] - values[-1])


# --- evidence on curves, compiled ------------------------------------------------------------------------------------
# Curves touch few pixels of their masks, so that most of a matrix over all pixels is not read.


@jitted(nogil=True, fastmath=True, error_model="numpy")
def curves_chi_square(masks: Array, G: Array, g: Array, paths: Array, sigma: float) -> float:
    """d'G d - 2 g.d of the masks of paths (2, T, 2) at this size, of width `sigma`, less `masks` (2, K, K)."""
    size = masks.shape[1]
    difference, at, count = np.empty(masks.size), np.empty(masks.size, np.int64), 0
    for k in range(2):
        mask = line_mask(paths[k], size // 2, sigma)
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    difference[count], at[count] = change, (k * size + i) * size + j
                    count += 1
    value = 0.0
    for m in range(count):
        value += difference[m] * (_times(G, at[m], at, difference, count) - 2 * g[at[m]])
    return value


@jitted(nogil=True, fastmath=True, error_model="numpy")
def add_curves(
    H: Array, gradient: Array, masks: Array, G: Array, g: Array, paths: Array, sigma: float,
    free: NDArray[np.int64], scale: float, begins: NDArray[np.int64], values: Array, points: int,
) -> None:  # fmt: skip
    """Add to normal matrix and gradient, over the x, then the y of the points of each free curve, at their own size.

    Entries below the matrix's diagonal blocks are omitted, as it is symmetric.
    scale : of `paths` relative to the curves; begins, values : see `line_mask_change`.
    """
    size, unknowns = masks.shape[1], 2 * points
    area, half = size * size, size // 2
    lines = (
        line_mask_change(paths[0], half, sigma, begins, values, points),
        line_mask_change(paths[1], half, sigma, begins, values, points),
    )
    difference, at, total = np.empty(2 * area), np.empty(2 * area, np.int64), 0
    for k in range(2):
        mask = lines[k][0]
        for i in range(size):
            for j in range(size):
                change = mask[i, j] - masks[k, i, j]
                if change != 0:
                    difference[total], at[total] = change, (k * size + i) * size + j
                    total += 1
    for a in range(len(free)):
        _, pixels, changes = lines[free[a]]
        mine = slice(a * unknowns, (a + 1) * unknowns)
        downhill = np.empty(len(pixels))
        for n in range(len(pixels)):
            pixel = free[a] * area + pixels[n]
            downhill[n] = scale * (_times(G, pixel, at, difference, total) - g[pixel])
        gradient[mine] += np.dot(changes.T, downhill)
        for b in range(a, len(free)):
            _, others, of_others = lines[free[b]]
            both = np.empty((len(pixels), len(others)))
            for n in range(len(pixels)):
                for q in range(len(others)):
                    both[n, q] = scale**2 * G[free[a] * area + pixels[n], free[b] * area + others[q]]
            H[mine, b * unknowns : (b + 1) * unknowns] += np.dot(changes.T, np.dot(both, of_others))


@numba.njit(fastmath=True, error_model="numpy")
def _times(G: Array, row: int, at: NDArray[np.int64], values: Array, number: int) -> float:
    """A row of G times values (number,) in the columns `at`."""
    total = 0.0
    for m in range(number):
        total += G[row, at[m]] * values[m]
    return total
