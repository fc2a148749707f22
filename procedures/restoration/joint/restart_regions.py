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

from procedures.restoration.first_depth.segments import Labels, Mask, surfaces
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import EdgeSettings, layers_of, place_steps
from procedures.restoration.masks.blur_operator import Array


@dataclass(frozen=True)
class RestartSettings:
    """What is begun again, and how.

    Attributes
    ----------
    window : int
        Side in which what is left over is compared with the rest of the frame, pixels.
    unexplained : float
        Mean square left over, of the frame's median one, from which a window is not explained: noise alone varies by
        0.15.
    least_part : int
        Pixels of a part that is worth it.
    most : float
        Part of the frame at most: without noise, errors of one part can be seen far around it.
    least_segment, least_explained : int, float
        Pixels and part of a segment that must be explained: with less it is a blemish of those around.
    doubt : int
        Pixels about a border whose depth is not believed.
    soft : float
        Least weight of the picture's prior while a part begins.
    rounds : int
        Of placing the steps in it, twice as many as elsewhere: they begin undecided.
    on_trial : int
        Joint steps after which a part begun again is compared with what was there.
    """

    window: int = 7
    unexplained: float = 1.7
    least_part: int = 30
    most: float = 0.2
    least_segment: int = 40
    least_explained: float = 0.3
    doubt: int = 2
    soft: float = 1e-4
    rounds: int = 8
    on_trial: int = 3


@dataclass(frozen=True)
class RegionAttempt:
    """Picture (C, H', W'), depth and segments (H', W') of one attempt."""

    u: Array
    w: Array
    labels: Labels


def left_over(e: Array, window: int = 7) -> Array:
    """Mean square of the residuals e (P, C, H, W) about every pixel, of the frame's median one: (H, W).

    window : its side, pixels.
    """
    power = uniform_filter((e**2).mean(axis=(0, 1)), window)
    return np.asarray(power / max(float(np.median(power)), 1e-20))


def unexplained(data: DataTerm, u: Array, s: RestartSettings) -> Mask:
    """Where the photographs are explained worse than elsewhere, (H', W'); data : focused on the picture's depth."""
    power = left_over(data.residual(u), s.window)
    wrong = np.pad(power > max(s.unexplained, float(np.percentile(power, 100 * (1 - s.most)))), data.R, mode="edge")
    parts, n = label(wrong)
    large = np.bincount(parts.ravel(), minlength=n + 1) >= s.least_part
    large[0] = False
    return np.asarray(binary_dilation(large[parts], iterations=3))


def believed(labels: Labels, wrong: Mask, s: RestartSettings) -> Labels:
    """Labels without the segments that are nearly all wrong: their pixels go to the nearest other one."""
    count = np.bincount(labels.ravel())
    right = np.bincount(labels[~wrong], minlength=len(count))
    lost = ((right < s.least_segment) | (right < s.least_explained * count))[labels]
    if lost.all() or not lost.any():
        return labels
    nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
    return np.asarray(labels[tuple(nearest)])


def begun_again(
    data: DataTerm,
    other: DataTerm,
    old: RegionAttempt,
    wrong: Mask,
    reach: int,
    jump: float,
    weight: float,
    s: RestartSettings,
    edges: EdgeSettings,
) -> RegionAttempt:
    """The pair with its wrong parts begun again; leaves the terms focused elsewhere.

    reach : pixels from which a step may come; jump : change of w taken for one; weight : of the picture's prior.
    """
    R, soft = data.R, max(weight, s.soft)
    labels = believed(old.labels, wrong, s)
    w = np.where(wrong, surfaces(old.w, labels, 0, s.doubt, believed=~wrong).own, old.w).astype(old.w.dtype)
    layers = layers_of(w, labels, reach, s.doubt, jump, where=wrong, believed=~wrong)
    layers = replace(layers, share=np.where(layers.band, 0.5, layers.share))
    mean = (data.z * data.trust).sum(axis=0) / np.maximum(data.trust.sum(axis=0), 1e-6)
    blurred = np.pad(mean, ((0, 0), (R, R), (R, R)), mode="edge")
    data.focus(w)
    u = restore_picture(data, np.where(wrong, blurred, old.u).astype(old.u.dtype), soft, 15)
    again = replace(edges, rounds=s.rounds)
    return RegionAttempt(*place_steps(data, other, u, w, labels, layers, soft, settings=again))


def better_of(data: DataTerm, old: RegionAttempt, new: RegionAttempt, wrong: Mask, doubt: int) -> RegionAttempt:
    """At every place about the wrong parts the pair that leaves less within the masks' reach of it."""
    left = []
    for pair in (old, new):
        data.focus(pair.w)
        left.append(uniform_filter(np.pad((data.residual(pair.u) ** 2).sum(axis=(0, 1)), data.R), 2 * data.R + 1))
    take = binary_dilation(wrong, iterations=doubt) & (left[1] < left[0])
    return RegionAttempt(
        np.where(take, new.u, old.u), np.where(take, new.w, old.w), np.where(take, new.labels, old.labels)
    )


def repaired(
    data: DataTerm,
    other: DataTerm,
    old: RegionAttempt,
    reach: int,
    jump: float,
    weight: float,
    onward: Callable[[RegionAttempt], RegionAttempt],
    settings: RestartSettings | None = None,
    edges: EdgeSettings | None = None,
) -> RegionAttempt:
    """The pair some rounds on, its wrong parts begun again where that leaves less; onward : those rounds.

    See `begun_again` for the others.
    """
    s = settings or RestartSettings()
    data.focus(old.w)
    wrong = unexplained(data, old.u, s)
    if not wrong.any():
        return onward(old)
    new = begun_again(data, other, old, wrong, reach, jump, weight, s, edges or EdgeSettings())
    return better_of(data, onward(old), onward(new), wrong, s.doubt)
