"""A depth map cut along its jumps into segments, each of one surface that can be continued beyond its own border."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    distance_transform_edt,
    find_objects,
    label,
    maximum_filter,
    minimum_filter,
    watershed_ift,
)

from procedures.restoration.first_depth.planes import fitted
from procedures.restoration.masks.blur_operator import Array

Labels = NDArray[np.int32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SegmentSettings:
    """What is a segment of a depth map, and what a blemish of one.

    Attributes
    ----------
    jump : float
        Change of w within two pixels, in pixels, that is taken for a depth step: at 0.35 small steps smeared by
        matching were missed.
    clear : tuple of int
        Distances from the nearest jump, pixels, at which parts that hang together are one: first the broad ones, so
        that a gap in a line of jumps does not join what lies on its two sides.
    least_pixels : int
        Fewer clear pixels are no segment.
    blemish_pixels : int
        A part of fewer, that leaves the surface around it, is a blemish of that.
    """

    jump: float = 0.28
    clear: tuple[int, ...] = (14, 9, 6, 4, 3)
    least_pixels: int = 40
    blemish_pixels: int = 400


def span(w: Array, size: int = 3) -> Array:
    """Greatest minus least w of every neighbourhood."""
    return np.asarray(maximum_filter(w, size) - minimum_filter(w, size))


def segments(w: Array, settings: SegmentSettings, doubt: int, known: Labels | None = None) -> Labels:
    """Segments 1, 2, ... of a depth map, (H, W): parts that differ by a jump where they meet.

    Cut at jumps, at the borders of segments already `known`, and at necks between them; then parts whose surfaces meet
    are joined again. doubt : pixels about a cut whose depth is not believed.
    """
    steep, jump = span(w), settings.jump
    cuts = steep > jump
    if known is not None:
        cuts |= _borders(known)
        steep = np.where(_borders(known), np.maximum(steep, jump), steep)
    markers = _markers(np.asarray(distance_transform_edt(~cuts)), settings)
    if markers.max() == 0:
        return np.ones(w.shape, np.int32)
    height = (steep * (60000 / max(float(steep.max()), 1e-6))).astype(np.uint16)
    labels = np.asarray(watershed_ift(height, markers), dtype=np.int32)
    # what floods along a cut from its far end belongs to the side it lies on
    nearest = distance_transform_edt(cuts, return_distances=False, return_indices=True)
    return _merged(w, labels[tuple(nearest)], jump / 2, doubt)


def _markers(distance: Array, settings: SegmentSettings) -> Labels:
    """Numbered cores of the parts: at every distance from the cuts, those that contain no core yet."""
    markers = np.zeros(distance.shape, np.int32)
    for clear in settings.clear:
        parts, n = label(distance > clear)
        taken = np.zeros(n + 1, bool)
        taken[np.unique(parts[markers > 0])] = True
        new = (np.bincount(parts.ravel(), minlength=n + 1) >= settings.least_pixels) & ~taken
        new[0] = False
        number = np.where(new, np.cumsum(new) + markers.max(), 0).astype(np.int32)
        markers += number[parts]
    return markers


def _merged(w: Array, labels: Labels, least: float, doubt: int) -> Labels:
    """Labels with the parts joined whose surfaces differ by less than `least` along three quarters of their border."""
    own = surfaces(w, labels, 0, doubt).own
    across = _meetings(labels, own)
    group = np.arange(labels.max() + 1)
    for (a, b), differences in across.items():
        if np.percentile(differences, 75) < least:
            group[group == group[b]] = group[a]
    return np.unique(group[labels], return_inverse=True)[1].reshape(labels.shape).astype(np.int32) + 1


def _meetings(labels: Labels, own: Array) -> dict[tuple[int, int], Array]:
    """For every two labels that meet, the difference of their surfaces along the border."""
    found: dict[tuple[int, int], list[Array]] = {}
    for before, after in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        a, b, d = labels[before], labels[after], np.abs(own[before] - own[after])
        meet = a != b
        pairs = np.stack([np.minimum(a, b)[meet], np.maximum(a, b)[meet]])
        kinds, which = np.unique(pairs, axis=1, return_inverse=True)
        for k, (i, j) in enumerate(kinds.T):
            found.setdefault((int(i), int(j)), []).append(d[meet][which.ravel() == k])
    return {pair: np.concatenate(parts) for pair, parts in found.items()}


def continued(w: Array, known: Array, sigma: float, scarce: float = 0.03) -> Array:
    """w continued from where `known` is 1: at each pixel, the plane that fits the known depths around it best.

    Gaussian window of `sigma` pixels, twice as wide and wider where it holds nearly nothing known; scarce : part of it
    that has to be known for its plane to be believed.
    """
    plane = fitted(w, known, sigma)
    found, mass = plane.value, plane.mass
    if mass.min() > scarce or min(w.shape) < 4 * sigma:
        return np.asarray(found)
    wider = _halved(w, known, sigma, scarce)
    return np.asarray(wider + mass / (mass + scarce) * (found - wider))


def _halved(w: Array, known: Array, sigma: float, scarce: float) -> Array:
    """The same from a picture of half the size, in which the window is twice as wide."""
    half = (w.shape[1] // 2, w.shape[0] // 2)
    k = cv2.resize(known, half, interpolation=cv2.INTER_AREA)
    v = cv2.resize(known * w, half, interpolation=cv2.INTER_AREA) / np.maximum(k, 1e-12)
    small = continued(np.asarray(v, w.dtype), np.asarray(k, w.dtype), sigma, scarce)
    return np.asarray(cv2.resize(small, w.shape[::-1], interpolation=cv2.INTER_LINEAR), dtype=w.dtype)


def mended(w: Array, labels: Labels, doubt: int, settings: SegmentSettings) -> Array:
    """w without blemishes: small parts cut out by jumps that leave the surface around them by more than a jump."""
    jump = settings.jump
    parts, n = label(span(w) <= jump)
    small = np.bincount(parts.ravel(), minlength=n + 1) < settings.blemish_pixels
    small[0] = True
    around = surfaces(w, np.where(small[parts], 0, labels), 3 * doubt, doubt)
    wrong = small[parts] & around.near & (np.abs(w - around.other) > jump)
    return np.where(wrong, around.other, w).astype(w.dtype)


@dataclass(frozen=True)
class Surfaces:
    """Every pixel's own surface, and that of another segment near it: w and label; where one is within reach."""

    own: Array
    other: Array
    other_label: Labels
    near: NDArray[np.bool_]


def surfaces(w: Array, labels: Labels, reach: int, doubt: int, rank: int = 1, believed: Mask | None = None) -> Surfaces:
    """Surfaces within `reach` pixels of another segment, from depths farther than `doubt` pixels from any border.

    rank : 1 for the nearest other segment, 2 for the second nearest; believed : the only depths to go by, if given.
    """
    w = np.asarray(w, dtype=np.float64)
    border = distance_transform_edt(~_borders(labels))
    own = w.copy()
    others = [(np.full(w.shape, np.inf), w.copy(), np.zeros(w.shape, np.int32)) for _ in range(rank)]
    sigma = 1.5 + 0.7 * max(reach, doubt)
    wide = int(3.5 * sigma) + 1
    for k, box in enumerate(find_objects(labels), start=1):
        if box is None:
            continue
        box = tuple(slice(max(0, s.start - wide), s.stop + wide) for s in box)
        mine = labels[box] == k
        sure = mine & (border[box] >= min(doubt, 0.7 * float(border[box][mine].max())))
        if believed is not None and (sure & believed[box]).any():
            sure &= believed[box]
        surface = continued(w[box], sure.astype(np.float64), sigma)
        surface = np.clip(surface, w[box][sure].min() - 0.3, w[box][sure].max() + 0.3)
        own[box] = np.where(mine, surface, own[box])
        if reach:
            distance = np.where(mine, np.inf, distance_transform_edt(~mine))
            _insert([[a[box] for a in other] for other in others], distance, surface, k)
    distance, other, other_label = others[-1]
    return Surfaces(own, other, other_label, distance <= reach)


def _insert(others: list[list[Array]], distance: Array, surface: Array, k: int) -> None:
    """Put a segment where it belongs among the nearest ones of each pixel, in place."""
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
