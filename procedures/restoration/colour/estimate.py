"""From a restoration of a mosaic's planes to the colour picture at every pixel of the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift as moved_by

from procedures.raw import Plane
from procedures.restoration.colour.colour_error import error_of, spread_out
from procedures.restoration.colour.depth_search import searched
from procedures.restoration.colour.mosaic import Mosaics, depth_on_sensor, mosaics, spread
from procedures.restoration.colour.picture import MosaicTerm, alone, mixing, with_depth
from procedures.restoration.first_depth.segments import SegmentSettings
from procedures.restoration.joint.occlusion import OcclusionSettings
from procedures.restoration.joint.result import Restoration
from procedures.restoration.masks.blur_models import DepthUnit
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.mask_fields import MaskField, Masks, one_grid


@dataclass(frozen=True)
class Steps:
    """How often picture and depth are improved together, then the picture alone; iterations of each."""

    joint: int = 6
    joint_iterations: int = 30
    picture: int = 5
    picture_iterations: int = 20


def in_colour(
    found: Restoration, photographs: Sequence[Mapping[str, Plane]], masks: Sequence[Masks], steps: Steps | None = None
) -> Restoration:
    """The restoration with its picture in colour (3, H, W) and its w (H, W), both at every pixel of the sensor.

    Parameters
    ----------
    found : of the same photographs' planes, stacked in the order R, G1, G2, B.
    photographs : the planes of each.
    masks : of each photograph, as functions of w in pixels of the sensor.

    Raises
    ------
    BadInput
        If the photographs are no mosaics that lie alike.
    """
    known = mosaics(photographs, found.light)
    names = list(photographs[0])
    first = spread(dict(zip(names, found.sharp, strict=True)), known.origins) / known.gains[:, None, None]
    w = depth_on_sensor(found.w, SegmentSettings.jump)
    sigma = found.diagnostics.noise
    term = problem_of(known, shifted(masks, 2 * found.shifts), np.float32)
    u = unknowns_of(known, first, term.R, np.float32)
    chosen, off = steps or Steps(), np.zeros_like(w)
    if found.w_std.any():
        w, off = searched(term, u, w, sigma)
    else:  # a flat scene: its w is known
        chosen = replace(chosen, joint=0)
    u, w = descended(term, u, w, sigma, chosen)
    error = _seen_at(known, error_of(term, u, _wide(w, term), sigma, _left_over(term, u)), term.R)
    moved, occlusion = _on_sensor(found.moved), _on_sensor(found.occlusion)
    sharp, std = _seen_at(known, u, term.R), spread_out(error, 2 * term.R + 1)
    whole, d = float(np.sqrt(np.mean(std**2))), found.diagnostics
    std = std * np.where(occlusion, OcclusionSettings.picture, 1.0)
    return replace(
        found, sharp=sharp, sharp_std=np.where(moved, np.maximum(std, sharp.std()), std), w=w,
        w_std=np.hypot(_on_sensor(2 * found.w_std), off), residual=_residual(term, u), moved=moved,
        occlusion=occlusion,
        diagnostics=replace(d, picture_std=whole, gained=d.gained * d.picture_std / max(whole, 1e-9)),
        unit=DepthUnit(found.unit.name, found.unit.per_pixel / 2),
    )  # fmt: skip


def _on_sensor(plane: NDArray[Any]) -> NDArray[Any]:
    """What is of a plane's pixel, at the four of the sensor."""
    return np.repeat(np.repeat(plane, 2, axis=0), 2, axis=1)


def pair_at(
    known: Mosaics, w: Array, first: Array, masks: Sequence[Masks], sigma: float, steps: Steps,
    dtype: type[np.floating[Any]] = np.float32,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Picture (3, H, W) in the photographs' units, depth (H, W) and residuals (P, 1, H, W), from a first pair.

    first : (3, H, W) balanced; sigma : of the photographs' noise. Without joint steps w stays as it is.
    """
    term = problem_of(known, masks, dtype)
    u, w = descended(term, unknowns_of(known, first, term.R, dtype), w, sigma, steps)
    return _seen_at(known, u, term.R), w, _residual(term, u)


def problem_of(known: Mosaics, masks: Sequence[Masks], dtype: type[np.floating[Any]]) -> MosaicTerm:
    """The mosaics with the blurs that drew them."""
    blurs = [one.blur(known.shape, dtype) for one in one_grid(masks)]
    return MosaicTerm(known.z.astype(dtype), blurs, known.weight.astype(dtype))


def unknowns_of(known: Mosaics, balanced: Array, R: int, dtype: type[np.floating[Any]]) -> Array:
    """Lightness and differences of colour (3, H + 2 R, W + 2 R) of a balanced picture (3, H, W)."""
    wide = np.pad(balanced, ((0, 0), (R, R), (R, R)), mode="edge").astype(dtype)
    return np.asarray(np.tensordot(mixing().astype(dtype), wide, axes=1))


def descended(term: MosaicTerm, u: Array, w: Array, sigma: float, steps: Steps) -> tuple[Array, Array]:
    """Unknowns and depth (H, W) of least cost, from a pair."""
    wide = _wide(w, term).astype(u.dtype)
    u = alone(term, u, wide, sigma, 2, steps.picture_iterations)
    u, wide = with_depth(term, u, wide, sigma, steps.joint, steps.joint_iterations)
    u = alone(term, u, wide, sigma, steps.picture, steps.picture_iterations)
    return u, wide[term.R : -term.R, term.R : -term.R]


def _wide(w: Array, term: MosaicTerm) -> Array:
    return np.pad(w, term.R, mode="edge")


def _seen_at(known: Mosaics, u: Array, R: int) -> Array:
    """Red, green, blue (3, H, W) of unknowns, in the photographs' units."""
    picture = np.tensordot(np.linalg.inv(mixing().astype(u.dtype)), u[:, R:-R, R:-R], axes=1)
    return np.asarray((picture * known.gains[:, None, None]).astype(u.dtype))


def _residual(term: MosaicTerm, u: Array) -> Array:
    """What is left over, (P, 1, H, W): one colour of each pixel was sampled, its residual is the pixel's."""
    return np.asarray(term.residual(u).sum(axis=1, keepdims=True))


def _left_over(term: MosaicTerm, u: Array) -> float:
    """Root mean square of what is left of a sample."""
    return float(np.sqrt(np.sum(term.residual(u) ** 2) / max(1, int(np.count_nonzero(term.trust)))))


def shifted(masks: Sequence[Masks], shifts: Array) -> list[Masks]:
    """Masks that move what they draw by x, y pixels, (P, 2): photographs stay as they are, and their samples exact."""
    if not np.any(shifts):
        return list(masks)
    more = int(np.ceil(np.abs(shifts).max())) + 1
    return [
        MaskField(tuple(tuple(_moved(stack, x, y, more) for stack in row) for row in MaskField.of(one).stacks))
        for one, (x, y) in zip(masks, shifts, strict=True)
    ]


def _moved(stack: MaskStack, x: float, y: float, more: int) -> MaskStack:
    wide = np.pad(stack.masks, ((0, 0), (more, more), (more, more)))
    drawn = np.maximum(moved_by(wide, (0.0, y, x), order=3), 0) if x or y else wide
    return MaskStack(drawn / drawn.sum(axis=(1, 2), keepdims=True), stack.step)
