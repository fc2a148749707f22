"""From a restoration of a mosaic's planes to the colour picture at every pixel of the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift as moved

from procedures.raw import Plane
from procedures.restoration.colour.mosaic import Mosaics, depth_on_sensor, mosaics, spread
from procedures.restoration.colour.picture import MosaicTerm, alone, mixing, with_depth
from procedures.restoration.first_depth.segments import SegmentSettings
from procedures.restoration.joint.estimate import Restoration
from procedures.restoration.masks.blur_models import DepthUnit
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.mask_fields import MaskField, Masks, one_grid


@dataclass(frozen=True)
class Steps:
    """How often picture and depth are improved together, then the picture alone; iterations of each."""

    joint: int = 12
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
    sharp, w, residual = pair_at(
        known, w, first, shifted(masks, 2 * found.shifts), found.diagnostics.noise, steps or Steps()
    )
    unit = DepthUnit(found.unit.name, found.unit.per_pixel / 2)
    return replace(
        found, sharp=sharp, sharp_std=_on_sensor(found.sharp_std), w=w, w_std=_on_sensor(2 * found.w_std),
        residual=residual, moved=_on_sensor(found.moved), unit=unit,
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
    blurs = [one.blur(known.shape, dtype) for one in one_grid(masks)]
    data = MosaicTerm(known.z.astype(dtype), blurs, known.weight.astype(dtype))
    R, M = data.R, mixing().astype(dtype)
    wide = np.pad(w, R, mode="edge").astype(dtype)
    u = np.tensordot(M, np.pad(first, ((0, 0), (R, R), (R, R)), mode="edge").astype(dtype), axes=1)
    u = alone(data, u, wide, sigma, 2, steps.picture_iterations)
    u, wide = with_depth(data, u, wide, sigma, steps.joint, steps.joint_iterations)
    u = alone(data, u, wide, sigma, steps.picture, steps.picture_iterations)
    # one colour of each pixel was sampled: its residual is the pixel's
    residual = data.residual(u).sum(axis=1, keepdims=True)
    picture = np.tensordot(np.linalg.inv(M), u[:, R:-R, R:-R], axes=1) * known.gains[:, None, None]
    return picture.astype(dtype), wide[R:-R, R:-R], residual


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
    drawn = np.maximum(moved(wide, (0.0, y, x), order=3), 0) if x or y else wide
    return MaskStack(drawn / drawn.sum(axis=(1, 2), keepdims=True), stack.step)
