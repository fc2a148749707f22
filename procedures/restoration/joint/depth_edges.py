"""Localisation of depth edges: the border between two layers within a band is estimated from the photographs.

At a depth edge, windowed matching errs by several pixels, and descent on w does not move the edge, as intermediate
depths fit nothing. Therefore the depth of each side is extrapolated across the band, and the picture is shared between
the two layers by b in [0, 1]: z = (b u) *v h(high) + ((1 - b) u) *v h(low). This is linear in b for any depth
difference; Gauss-Newton over (u, b) finds the border, and b > 1/2 is the new labelling.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, maximum_filter, median_filter

from procedures.numerics.arrays import Mask
from procedures.restoration.first_depth.segments import JUMP_PX, Labels, surfaces
from procedures.restoration.joint.data_term import CONVERGENCE_TOLERANCE, DataTerm, conjugate_gradients
from procedures.restoration.joint.priors import diffuse
from procedures.restoration.masks.blur_operator import Array

PICTURE_CURVATURE, SHARE_CURVATURE = 0.3, 0.05
"""Hessian of the data term per pixel, over the picture and over the share of a white picture, in the preconditioner:
typical of pillboxes and paths of 3 to 11 pixels. They affect the speed of convergence only."""
SHARE_WEIGHT = 1e-4
"""Weight of the share's squared differences, photographs in [0, 1]: smooths it where there is no detail."""
WORTH_CUTTING = 0.7
"""Fraction of the frame up to which the part that a band reaches is solved separately."""
LONGEST = 0.3
"""Largest change of a share per round: the model is linear in it, but the picture is not known yet."""


@dataclass(frozen=True)
class Effort:
    """Gauss-Newton rounds of the share's estimation, and conjugate gradients in each."""

    rounds: int = 4
    iterations: int = 40


FULL = Effort()


@dataclass(frozen=True)
class Layers:
    """Depth of two competing layers: high, low (H', W'), band bool, share of the high layer, segments."""

    high: Array
    low: Array
    band: NDArray[np.bool_]
    share: Array
    high_label: Labels
    low_label: Labels


def layers_of(
    w: Array, labels: Labels, reach: int, margin: int, jump: float = JUMP_PX, rank: int = 1,
    where: Mask | None = None, valid: Mask | None = None,
) -> Layers:  # fmt: skip
    """Layers within `reach` of every border between segments: the pixel's surface and its neighbour's.

    Depths within `margin` pixels of a border are ignored. rank : 1 for the nearest neighbour, 2 for the next, which may
    lie between two others; valid : pixels whose depth may be used.
    """
    pair = surfaces(w, labels, reach, margin, rank, valid)
    rises = pair.surface > pair.other
    # beyond the band as at its edge, so that nothing outside affects the share
    nearest = distance_transform_edt(~pair.near, return_distances=False, return_indices=True)
    up = rises[tuple(nearest)] if pair.near.any() else rises
    high, low = np.where(rises, pair.surface, pair.other), np.where(rises, pair.other, pair.surface)
    band = pair.near & (high - low > jump / 2)
    if where is not None:
        band &= where
    if not band.any():
        return Layers(w, w, np.zeros(w.shape, bool), np.zeros_like(w), labels, labels)
    # undecided where the rough map was wrong: a share that starts at 0 or 1 changes slowly
    share = gaussian_filter(np.where(up, 1.0, 0.0), reach / 3 if margin > 4 else 1.0)
    share = np.where(band, share, up)
    return Layers(
        np.where(band, high, w), np.where(band, low, w), band, share,
        np.where(rises, labels, pair.other_label), np.where(rises, pair.other_label, labels),
    )  # fmt: skip


def shared(
    high: DataTerm, low: DataTerm, u: Array, layers: Layers, weight: float, effort: Effort
) -> tuple[Array, Array]:
    """Picture and share (H', W') that fit the photographs best, by Gauss-Newton over both, near the band; high, low :
    the data term for each layer; weight : of the prior."""
    band, b = layers.band.astype(u.dtype), layers.share.astype(u.dtype)
    around = surroundings(layers.band, high.R)
    for _ in range(effort.rounds):
        e = _residual_of_layers(high, low, u, layers, b)
        x = _share_step(high, low, (u, b, band, around.astype(u.dtype)), e, weight, effort)
        b = np.where(layers.band, np.clip(b + np.clip(x[-1], -LONGEST, LONGEST), 0, 1), b).astype(u.dtype)
        u = u + x[:-1]
    return u, b


def _shared_in_window(
    high: DataTerm, low: DataTerm, u: Array, layers: Layers, weight: float, effort: Effort
) -> tuple[Array, Array]:
    """`shared`, restricted to the part of the frame that the band's surroundings reach, where that is smaller."""
    shape = high.z.shape[2:]
    around = surroundings(layers.band, high.R)
    y, x = (_reached(np.any(around, axis=1 - n), high.R, shape[n]) for n in (0, 1))
    if (y.stop - y.start) * (x.stop - x.start) > WORTH_CUTTING * shape[0] * shape[1]:
        return shared(high, low, u, layers, weight, effort)
    at = (slice(y.start, y.stop + 2 * high.R), slice(x.start, x.stop + 2 * high.R))
    part = Layers(*(whole[at] for whole in vars(layers).values()))
    sharper, share = u.copy(), layers.share.astype(u.dtype)
    sharper[:, *at], share[at] = shared(
        high.windowed(y, x), low.windowed(y, x), np.ascontiguousarray(u[:, *at]), part, weight, effort
    )
    return sharper, share


def _reached(rows: Any, R: int, size: int) -> slice:
    """Rows of the photograph within reach of the marked extended rows."""
    inside = np.flatnonzero(rows)
    return slice(max(0, int(inside[0]) - 2 * R), min(size, int(inside[-1]) + 1))


def surroundings(band: NDArray[np.bool_], R: int) -> NDArray[np.bool_]:
    """The pixels whose light may mix with the band's."""
    return np.asarray(maximum_filter(band, 4 * R + 1))


def _residual_of_layers(high: DataTerm, low: DataTerm, u: Array, layers: Layers, b: Array) -> Array:
    """Residual of both layers; leaves the terms focused on the band's surroundings."""
    around = surroundings(layers.band, high.R)
    above, below = layers.high.astype(u.dtype), layers.low.astype(u.dtype)
    low.focus(below)
    high.focus(above, layers.band)
    b = b * layers.band
    e = high.z * high.trust - high.blur(u * b) - low.blur(u * (1 - b))
    high.focus(above, around)
    low.focus(below, around)
    return e


def _share_step(
    high: DataTerm, low: DataTerm, at: tuple[Array, Array, Array, Array], e: Array, weight: float, effort: Effort
) -> Array:
    """Change of picture and share (C + 1, H', W') for the residuals e. at : u, share, band, surroundings."""
    u, b, band, around = at

    def add_smoothing(out: Array, v: Array, share: Array, sign: int) -> Array:
        out[:-1] += around * (u.dtype.type(sign * weight) * diffuse(v))
        out[-1] += band * (u.dtype.type(sign * SHARE_WEIGHT) * diffuse(share))
        return out

    def gradients(e: Array) -> Array:
        below, out = low.blur_adjoint(e), np.empty((len(u) + 1, *b.shape), u.dtype)
        difference = high.blur_adjoint(e)
        difference -= below
        np.einsum("chw,chw->hw", u, difference, out=out[-1])
        out[-1] *= band
        difference *= b
        np.add(difference, below, out=out[:-1])
        return out

    def apply(x: Array) -> Array:
        du, db = x[:-1], x[-1] * band
        above = du * b
        above += u * db
        e = high.blur(above)
        e += low.blur(du - above)
        return add_smoothing(gradients(e), du, db, 1)

    divide = np.full((len(u) + 1, *b.shape), PICTURE_CURVATURE, u.dtype)
    divide[-1] = SHARE_CURVATURE * (u**2).sum(axis=0) + 4 * SHARE_WEIGHT
    return conjugate_gradients(
        apply, add_smoothing(gradients(e), u, b, -1), effort.iterations, divide, CONVERGENCE_TOLERANCE
    )


def place_steps(
    high: DataTerm, low: DataTerm, u: Array, w: Array, labels: Labels, layers: Layers, weight: float,
    decided: float = 1.0, effort: Effort = FULL,
) -> tuple[Array, Array, Labels]:  # fmt: skip
    """Picture, depth and segments with depth edges at the border of the median-filtered share, or of the share where
    `decided`."""
    if not layers.band.any():
        return u, w, labels
    sharper, b = _shared_in_window(high, low, u, layers, weight, effort)
    border = np.where(np.abs(b - 0.5) > decided, b, median_filter(b, 3)) > 0.5
    placed = np.where(layers.band, np.where(border, layers.high, layers.low), w).astype(w.dtype)
    relabelled = np.where(border, layers.high_label, layers.low_label)
    return sharper, placed, np.where(layers.band, relabelled, labels).astype(np.int32)
