"""Segmentation of a depth map along its edges; each segment is one surface that can be extrapolated beyond its
border."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects, label, maximum_filter, minimum_filter, watershed_ift

from procedures.numerics.arrays import Mask
from procedures.restoration.masks.array_loops import gaussian
from procedures.restoration.masks.blur_operator import Array

Labels = NDArray[np.int32]


JUMP_PX = 0.28
"""Change of w within two pixels that is taken as a depth edge: at 0.35 small edges smeared by matching were missed."""
CLEAR_PX = (14, 9, 6, 4, 3)
"""Distances from the nearest edge at which connected parts are one: large ones first, so that a gap in an edge does not
join its two sides."""
LEAST_PIXELS, BLEMISH_PIXELS = 40, 400
"""Smallest number of clear pixels of a segment, and size below which a part that differs from the surface around it is
a blemish."""


def span(w: Array) -> Array:
    """Maximum minus minimum of w in every neighbourhood of 3 x 3."""
    return np.asarray(maximum_filter(w, 3) - minimum_filter(w, 3))


def segments(w: Array, margin: int, known: Labels | None = None, jump: float = JUMP_PX) -> Labels:
    """Segments 1, 2, ... (H, W) of a depth map, cut at edges, borders of `known` ones and necks, and merged where
    surfaces match; depths near a cut, in `margin`, are ignored."""
    steep = span(w)
    cuts = steep > jump
    if known is not None:
        cuts |= _borders(known)
        steep = np.where(_borders(known), np.maximum(steep, jump), steep)
    markers = _markers(np.asarray(distance_transform_edt(~cuts)))
    if markers.max() == 0:
        return np.ones(w.shape, np.int32)
    height = (steep * (60000 / max(float(steep.max()), 1e-6))).astype(np.uint16)
    labels = np.asarray(watershed_ift(height, markers), dtype=np.int32)
    # flooding along a cut from its far end is assigned to the side where it lies
    nearest = distance_transform_edt(cuts, return_distances=False, return_indices=True)
    return _merged(w, labels[tuple(nearest)], jump / 2, margin)


def _markers(distance: Array) -> Labels:
    """Numbered cores of the parts: at every distance from the cuts, those that contain no core yet."""
    markers = np.zeros(distance.shape, np.int32)
    for clear in CLEAR_PX:
        parts, n = label(distance > clear)
        occupied = np.zeros(n + 1, bool)
        occupied[np.unique(parts[markers > 0])] = True
        new = (np.bincount(parts.ravel(), minlength=n + 1) >= LEAST_PIXELS) & ~occupied
        new[0] = False
        number = np.where(new, np.cumsum(new) + markers.max(), 0).astype(np.int32)
        markers += number[parts]
    return markers


def _merged(w: Array, labels: Labels, least: float, margin: int) -> Labels:
    """Labels with parts merged whose surfaces differ by less than `least` along three quarters of their border."""
    surface = surfaces(w, labels, 0, margin).surface
    across = _meetings(labels, surface)
    group = np.arange(labels.max() + 1)
    for (a, b), differences in across.items():
        if np.percentile(differences, 75) < least:
            group[group == group[b]] = group[a]
    return np.unique(group[labels], return_inverse=True)[1].reshape(labels.shape).astype(np.int32) + 1


def _meetings(labels: Labels, surface: Array) -> dict[tuple[int, int], Array]:
    differences: dict[tuple[int, int], list[Array]] = {}
    for before, after in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        a, b, d = labels[before], labels[after], np.abs(surface[before] - surface[after])
        meet = a != b
        pairs = np.stack([np.minimum(a, b)[meet], np.maximum(a, b)[meet]])
        kinds, which = np.unique(pairs, axis=1, return_inverse=True)
        for k, (i, j) in enumerate(kinds.T):
            differences.setdefault((int(i), int(j)), []).append(d[meet][which.ravel() == k])
    return {pair: np.concatenate(parts) for pair, parts in differences.items()}


def extrapolate(w: Array, known: Array, sigma: float, scarce: float = 0.03) -> Array:
    """w extrapolated by the plane that fits the known depths in a Gaussian window, enlarged where nearly nothing is
    known: less than `scarce` makes a plane unreliable."""
    value, mass = fit_planes(w, known, sigma)
    if mass.min() > scarce or min(w.shape) < 4 * sigma:
        return value
    half = (w.shape[1] // 2, w.shape[0] // 2)  # in half the size, the window is twice as wide
    k = cv2.resize(known, half, interpolation=cv2.INTER_AREA)
    v = cv2.resize(known * w, half, interpolation=cv2.INTER_AREA) / np.maximum(k, 1e-12)
    small = extrapolate(np.asarray(v, w.dtype), np.asarray(k, w.dtype), sigma, scarce)
    wider = np.asarray(cv2.resize(small, w.shape[::-1], interpolation=cv2.INTER_LINEAR), dtype=w.dtype)
    return np.asarray(wider + mass / (mass + scarce) * (value - wider))


def remove_blemishes(w: Array, labels: Labels, margin: int) -> Array:
    """w without small parts that are bounded by edges and differ from the surface around them by more than an edge."""
    parts, n = label(span(w) <= JUMP_PX)
    small = np.bincount(parts.ravel(), minlength=n + 1) < BLEMISH_PIXELS
    small[0] = True
    around = surfaces(w, np.where(small[parts], 0, labels), 3 * margin, margin)
    wrong = small[parts] & around.near & (np.abs(w - around.other) > JUMP_PX)
    return np.where(wrong, around.other, w).astype(w.dtype)


@dataclass(frozen=True)
class Surfaces:
    """Surface of every pixel's segment, and w and label of another segment near it; near : where one is in reach."""

    surface: Array
    other: Array
    other_label: Labels
    near: NDArray[np.bool_]


def surfaces(w: Array, labels: Labels, reach: int, margin: int, rank: int = 1, valid: Mask | None = None) -> Surfaces:
    """Surfaces within `reach` pixels of another segment, from depths farther than `margin` pixels from any border.

    rank : 1 for the nearest other segment, 2 for the second nearest; valid : the depths to be used, all if None.
    """
    w = np.asarray(w, dtype=np.float64)
    border = distance_transform_edt(~_borders(labels))
    result = w.copy()
    others = [(np.full(w.shape, np.inf), w.copy(), np.zeros(w.shape, np.int32)) for _ in range(rank)]
    sigma = 1.5 + 0.7 * max(reach, margin)
    wide = int(3.5 * sigma) + 1
    for k, box in enumerate(find_objects(labels), start=1):
        if box is None:
            continue
        box = tuple(slice(max(0, s.start - wide), s.stop + wide) for s in box)
        mine = labels[box] == k
        reliable = mine & (border[box] >= min(margin, 0.7 * float(border[box][mine].max())))
        if valid is not None and (reliable & valid[box]).any():
            reliable &= valid[box]
        surface = extrapolate(w[box], reliable.astype(np.float64), sigma)
        surface = np.clip(surface, w[box][reliable].min() - 0.3, w[box][reliable].max() + 0.3)
        result[box] = np.where(mine, surface, result[box])
        if reach:
            distance = np.where(mine, np.inf, distance_transform_edt(~mine))
            _insert([[a[box] for a in other] for other in others], distance, surface, k)
    distance, other, other_label = others[-1]
    return Surfaces(result, other, other_label, distance <= reach)


def _insert(others: list[list[Array]], distance: Array, surface: Array, k: int) -> None:
    """Insert a segment among the nearest ones of each pixel by its distance, in place."""
    coming = [distance, surface, np.full(distance.shape, k, np.int32)]
    for other in others:
        closer = coming[0] < other[0]
        for n, array in enumerate(other):
            leaving = np.where(closer, array, coming[n])
            array[...] = np.where(closer, coming[n], array)
            coming[n] = leaving


def _borders(labels: Labels) -> NDArray[np.bool_]:
    return np.asarray(maximum_filter(labels, 3) != minimum_filter(labels, 3))


def joined(labels: Labels) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether neighbours down and across belong to one segment: (H - 1, W), (H, W - 1)."""
    return labels[1:] == labels[:-1], labels[:, 1:] == labels[:, :-1]


# --- local planes ---

TRUNCATE = 3.5
"""Extent of the windows in sigma, where a Gaussian has 0.2 % of its height."""


def fit_planes(w: Array, known: Array, sigma: float) -> tuple[Array, Array]:
    """Values of least-squares planes of w (H, W) in a Gaussian window about every pixel, weighted by `known`, and the
    known mass in it; regularised, so that far from depths a plane is a mean."""

    def mean(a: Array) -> Array:
        return gaussian(a, sigma, TRUNCATE)

    y, x = np.indices(w.shape).astype(w.dtype)
    mass = mean(known)
    m = mass + 1e-12
    mx, my, mw = mean(known * x) / m, mean(known * y) / m, mean(known * w) / m
    xx = mean(known * x * x) / m - mx**2 + sigma / 4
    yy = mean(known * y * y) / m - my**2 + sigma / 4
    xy = mean(known * x * y) / m - mx * my
    xw, yw = mean(known * x * w) / m - mx * mw, mean(known * y * w) / m - my * mw
    det = xx * yy - xy**2
    across, down = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
    return np.asarray(mw + across * (x - mx) + down * (y - my)), mass
