"""Restart of regions that a restoration does not explain, from the depths around them.

Descent does not leave a region whose depth belongs to the wrong surface: it bends that surface until the photographs
nearly fit, and picture and depth are wrong together. Its residual exceeds the noise. Such regions are restarted from
the surfaces extrapolated into them from where the photographs fit, and the edges between these are localised again.
After a few rounds each place keeps the version with the smaller residual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label, uniform_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.first_depth.segments import Labels, surfaces
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import FULL, Effort, layers_of, place_steps
from procedures.restoration.masks.blur_operator import Array

WINDOW = 7
"""Side of the window in which the residual is compared with the rest of the frame, pixels."""
UNEXPLAINED = 1.7
"""Mean square residual, relative to the frame's median, above which a window is unexplained: noise alone varies by
0.15."""
LEAST_PART, MOST = 30, 0.2
"""Smallest number of pixels of a region, and largest fraction of the frame: without noise, errors of one region affect
a wide surrounding."""
LEAST_SEGMENT, LEAST_EXPLAINED = 40, 0.3
"""Smallest number of pixels and fraction of a segment that must be explained; otherwise it is a blemish."""
DOUBT = 2
"""Pixels about a border whose depth is ignored."""
SOFT = 1e-4
"""Smallest weight of the picture's prior at the start of a region."""
ROUNDS = 8
"""Rounds of edge localisation, twice as many as elsewhere, as they start undecided."""


@dataclass(frozen=True)
class RegionAttempt:
    """Picture (C, H', W'), depth and segments (H', W') of one attempt."""

    u: Array
    w: Array
    labels: Labels


def relative_residual(e: Array) -> Array:
    """Local mean square of the residuals e (P, C, H, W), relative to the frame's median: (H, W)."""
    power = uniform_filter((e**2).mean(axis=(0, 1)), WINDOW)
    return np.asarray(power / max(float(np.median(power)), 1e-20))


def unexplained(data: DataTerm, u: Array) -> Mask:
    """Where the residual is larger than elsewhere, (H', W'); data : focused on the picture's depth."""
    power = relative_residual(data.residual(u))
    wrong = np.pad(power > max(UNEXPLAINED, float(np.percentile(power, 100 * (1 - MOST)))), data.R, mode="edge")
    parts, n = label(wrong)
    large = np.bincount(parts.ravel(), minlength=n + 1) >= LEAST_PART
    large[0] = False
    return np.asarray(binary_dilation(large[parts], iterations=3))


def reliable_segments(labels: Labels, wrong: Mask) -> Labels:
    """Labels without the segments that are nearly all wrong; their pixels join the nearest other segment."""
    count = np.bincount(labels.ravel())
    right = np.bincount(labels[~wrong], minlength=len(count))
    lost = ((right < LEAST_SEGMENT) | (right < LEAST_EXPLAINED * count))[labels]
    if lost.all() or not lost.any():
        return labels
    nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
    return np.asarray(labels[tuple(nearest)])


def restarted(
    data: DataTerm,
    other: DataTerm,
    old: RegionAttempt,
    wrong: Mask,
    reach: int,
    weight: float,
    iterations: int = FULL.iterations,
) -> RegionAttempt:
    """The pair with its wrong regions restarted; leaves the terms focused elsewhere.

    reach : pixels within which edges are localised; weight : of the picture's prior; iterations : of `Effort`.
    """
    soft = max(weight, SOFT)
    labels = reliable_segments(old.labels, wrong)
    w = np.where(wrong, surfaces(old.w, labels, 0, DOUBT, valid=~wrong).surface, old.w).astype(old.w.dtype)
    layers = layers_of(w, labels, reach, DOUBT, where=wrong, valid=~wrong)
    layers = replace(layers, share=np.where(layers.band, 0.5, layers.share))
    data.focus(w)
    u = restore_picture(data, np.where(wrong, data.mean(), old.u).astype(old.u.dtype), soft, 15)
    return RegionAttempt(*place_steps(data, other, u, w, labels, layers, soft, effort=Effort(ROUNDS, iterations)))


def better_of(data: DataTerm, old: RegionAttempt, new: RegionAttempt, wrong: Mask) -> RegionAttempt:
    """At every place near the wrong regions the pair with the smaller residual within the masks' reach."""
    residuals = []
    for pair in (old, new):
        data.focus(pair.w)
        power = np.pad((data.residual(pair.u) ** 2).sum(axis=(0, 1)), data.R)
        residuals.append(uniform_filter(power, 2 * data.R + 1))
    take = binary_dilation(wrong, iterations=DOUBT) & (residuals[1] < residuals[0])
    return RegionAttempt(
        np.where(take, new.u, old.u), np.where(take, new.w, old.w), np.where(take, new.labels, old.labels)
    )


def restart(
    data: DataTerm,
    other: DataTerm,
    old: RegionAttempt,
    reach: int,
    weight: float,
    onward: Callable[[RegionAttempt], RegionAttempt],
    iterations: int = FULL.iterations,
) -> RegionAttempt:
    """The pair after some rounds, with regions restarted where that lowers the residual; onward : those rounds.

    See `restarted` for the other parameters.
    """
    data.focus(old.w)
    wrong = unexplained(data, old.u)
    if not wrong.any():
        return onward(old)
    new = restarted(data, other, old, wrong, reach, weight, iterations)
    return better_of(data, onward(old), onward(new), wrong)
