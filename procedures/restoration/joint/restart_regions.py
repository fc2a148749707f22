"""Parts that a restoration does not explain, begun again from the depths around them.

Descent does not leave a part whose depth is of the wrong surface: it bends that surface until the photographs nearly
fit, and picture and depth are wrong together. What is left over there stands out of the noise. So such parts are given
the surfaces that continue into them from where the photographs fit, and the steps between these are placed anew. A few
rounds later each place keeps the old or the new, whichever leaves less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label, uniform_filter

from procedures.restoration.first_depth.segments import LEAST_PIXELS, Labels, Mask, surfaces
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import layers_of, place_steps
from procedures.restoration.masks.blur_operator import Array

# window in which what is left over is compared with the rest of the frame, pixels
WINDOW = 7
# mean square left over, of the frame's median one, from which a window is not explained: noise alone varies by 0.15
UNEXPLAINED = 1.7
LEAST_PART = 30
# of the frame: without noise, errors of one part can be seen far around it
MOST = 0.2
# of a segment: with less of it explained, it is a blemish of those around
LEAST_EXPLAINED = 0.3
# pixels about a border whose depth is not believed
DOUBT = 2
SOFT = 1e-4
ROUNDS = 8


@dataclass(frozen=True)
class Pair:
    """Picture (C, H', W'), depth and segments (H', W') of one attempt."""

    u: Array
    w: Array
    labels: Labels


def left_over(e: Array) -> Array:
    """Mean square of the residuals e (P, C, H, W) about every pixel, of the frame's median one: (H, W)."""
    power = uniform_filter((e**2).mean(axis=(0, 1)), WINDOW)
    return np.asarray(power / max(float(np.median(power)), 1e-20))


def unexplained(data: DataTerm, u: Array) -> Mask:
    """Where the photographs are explained worse than elsewhere, (H', W'); data : focused on the picture's depth."""
    power = left_over(data.residual(u))
    wrong = np.pad(power > max(UNEXPLAINED, float(np.percentile(power, 100 * (1 - MOST)))), data.R, mode="edge")
    parts, n = label(wrong)
    large = np.bincount(parts.ravel(), minlength=n + 1) >= LEAST_PART
    large[0] = False
    return np.asarray(binary_dilation(large[parts], iterations=3))


def believed(labels: Labels, wrong: Mask) -> Labels:
    """Labels without the segments that are nearly all wrong: their pixels go to the nearest other one."""
    count = np.bincount(labels.ravel())
    right = np.bincount(labels[~wrong], minlength=len(count))
    lost = ((right < LEAST_PIXELS) | (right < LEAST_EXPLAINED * count))[labels]
    if lost.all() or not lost.any():
        return labels
    nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
    return np.asarray(labels[tuple(nearest)])


def begun_again(
    data: DataTerm, other: DataTerm, old: Pair, wrong: Mask, reach: int, jump: float, weight: float
) -> Pair:
    """The pair with its wrong parts begun again; leaves the terms focused elsewhere.

    reach : pixels from which a step may come; jump : change of w taken for one; weight : of the picture's prior.
    """
    R, soft = data.R, max(weight, SOFT)
    labels = believed(old.labels, wrong)
    w = np.where(wrong, surfaces(old.w, labels, 0, DOUBT, believed=~wrong).own, old.w).astype(old.w.dtype)
    layers = layers_of(w, labels, reach, DOUBT, jump, where=wrong, believed=~wrong)
    layers = replace(layers, share=np.where(layers.band, 0.5, layers.share))
    mean = (data.z * data.trust).sum(axis=0) / np.maximum(data.trust.sum(axis=0), 1e-6)
    blurred = np.pad(mean, ((0, 0), (R, R), (R, R)), mode="edge")
    data.focus(w)
    u = restore_picture(data, np.where(wrong, blurred, old.u).astype(old.u.dtype), soft, 15)
    return Pair(*place_steps(data, other, u, w, labels, layers, soft, ROUNDS))


def better_of(data: DataTerm, old: Pair, new: Pair, wrong: Mask) -> Pair:
    """At every place about the wrong parts the pair that leaves less within the masks' reach of it."""
    left = []
    for pair in (old, new):
        data.focus(pair.w)
        left.append(uniform_filter(np.pad((data.residual(pair.u) ** 2).sum(axis=(0, 1)), data.R), 2 * data.R + 1))
    take = binary_dilation(wrong, iterations=DOUBT) & (left[1] < left[0])
    return Pair(np.where(take, new.u, old.u), np.where(take, new.w, old.w), np.where(take, new.labels, old.labels))


def repaired(
    data: DataTerm, other: DataTerm, old: Pair, reach: int, jump: float, weight: float, onward: Callable[[Pair], Pair]
) -> Pair:
    """The pair some rounds on, its wrong parts begun again where that leaves less; onward : those rounds.

    See `begun_again` for the others.
    """
    data.focus(old.w)
    wrong = unexplained(data, old.u)
    if not wrong.any():
        return onward(old)
    new = begun_again(data, other, old, wrong, reach, jump, weight)
    return better_of(data, onward(old), onward(new), wrong)
