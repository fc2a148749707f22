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

from procedures.restoration.first_depth.segments import Labels, Mask, surfaces
from procedures.restoration.joint.data_term import DataTerm, restore_picture
from procedures.restoration.joint.depth_edges import EdgeSettings, layers_of, place_steps
from procedures.restoration.masks.blur_operator import Array


@dataclass(frozen=True)
class RestartSettings:
    """Which regions are restarted, and how.

    Attributes
    ----------
    window : int
        Side of the window in which the residual is compared with the rest of the frame, pixels.
    unexplained : float
        Mean square residual, relative to the frame's median, above which a window is unexplained: noise alone varies by
        0.15.
    least_part : int
        Smallest number of pixels of a region.
    most : float
        Largest fraction of the frame: without noise, errors of one region affect a wide surrounding.
    least_segment, least_explained : int, float
        Smallest number of pixels and fraction of a segment that must be explained; otherwise it is a blemish.
    doubt : int
        Pixels about a border whose depth is ignored.
    soft : float
        Smallest weight of the picture's prior at the start of a region.
    rounds : int
        Rounds of edge localisation, twice as many as elsewhere, as they start undecided.
    on_trial : int
        Joint steps before a restarted region is compared with its previous state.
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


def relative_residual(e: Array, window: int = 7) -> Array:
    """Local mean square of the residuals e (P, C, H, W), relative to the frame's median: (H, W).

    window : its side, pixels.
    """
    power = uniform_filter((e**2).mean(axis=(0, 1)), window)
    return np.asarray(power / max(float(np.median(power)), 1e-20))


def unexplained(data: DataTerm, u: Array, s: RestartSettings) -> Mask:
    """Where the residual is larger than elsewhere, (H', W'); data : focused on the picture's depth."""
    power = relative_residual(data.residual(u), s.window)
    wrong = np.pad(power > max(s.unexplained, float(np.percentile(power, 100 * (1 - s.most)))), data.R, mode="edge")
    parts, n = label(wrong)
    large = np.bincount(parts.ravel(), minlength=n + 1) >= s.least_part
    large[0] = False
    return np.asarray(binary_dilation(large[parts], iterations=3))


def reliable_segments(labels: Labels, wrong: Mask, s: RestartSettings) -> Labels:
    """Labels without the segments that are nearly all wrong; their pixels join the nearest other segment."""
    count = np.bincount(labels.ravel())
    right = np.bincount(labels[~wrong], minlength=len(count))
    lost = ((right < s.least_segment) | (right < s.least_explained * count))[labels]
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
    jump: float,
    weight: float,
    s: RestartSettings,
    edges: EdgeSettings,
) -> RegionAttempt:
    """The pair with its wrong regions restarted; leaves the terms focused elsewhere.

    reach : pixels within which edges are localised; jump : change of w taken as an edge; weight : of the picture's
    prior.
    """
    R, soft = data.R, max(weight, s.soft)
    labels = reliable_segments(old.labels, wrong, s)
    w = np.where(wrong, surfaces(old.w, labels, 0, s.doubt, valid=~wrong).surface, old.w).astype(old.w.dtype)
    layers = layers_of(w, labels, reach, s.doubt, jump, where=wrong, valid=~wrong)
    layers = replace(layers, share=np.where(layers.band, 0.5, layers.share))
    mean = (data.z * data.trust).sum(axis=0) / np.maximum(data.trust.sum(axis=0), 1e-6)
    blurred = np.pad(mean, ((0, 0), (R, R), (R, R)), mode="edge")
    data.focus(w)
    u = restore_picture(data, np.where(wrong, blurred, old.u).astype(old.u.dtype), soft, 15)
    again = replace(edges, rounds=s.rounds)
    return RegionAttempt(*place_steps(data, other, u, w, labels, layers, soft, settings=again))


def better_of(data: DataTerm, old: RegionAttempt, new: RegionAttempt, wrong: Mask, doubt: int) -> RegionAttempt:
    """At every place near the wrong regions the pair with the smaller residual within the masks' reach."""
    residuals = []
    for pair in (old, new):
        data.focus(pair.w)
        power = np.pad((data.residual(pair.u) ** 2).sum(axis=(0, 1)), data.R)
        residuals.append(uniform_filter(power, 2 * data.R + 1))
    take = binary_dilation(wrong, iterations=doubt) & (residuals[1] < residuals[0])
    return RegionAttempt(
        np.where(take, new.u, old.u), np.where(take, new.w, old.w), np.where(take, new.labels, old.labels)
    )


def restart(
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
    """The pair after some rounds, with regions restarted where that lowers the residual; onward : those rounds.

    See `restarted` for the other parameters.
    """
    s = settings or RestartSettings()
    data.focus(old.w)
    wrong = unexplained(data, old.u, s)
    if not wrong.any():
        return onward(old)
    new = restarted(data, other, old, wrong, reach, jump, weight, s, edges or EdgeSettings())
    return better_of(data, onward(old), onward(new), wrong, s.doubt)
