"""Kernels of a flat scene whose photographs are rotated and zoomed relative to each other, as hand-held ones are.

Kernels estimated in spite of it reveal rotation and zoom by the residual shifts of the frame's parts; the kernels are
then estimated again from corrected photographs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from procedures.outcome import Refused
from procedures.restoration.first_depth.registration import similarities
from procedures.restoration.first_depth.similarity import rotate_back
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.unknown_motion.flat_scene import FreeKernels, KernelEffort, kernels_of_flat_scene
from procedures.restoration.unknown_motion.outlier_frames import outlier_frames

MIDDLE = 128
"""Side of the frame's middle, pixels: rotation and zoom have little effect there, so that kernels exist."""


def kernels_of_rotated_scene(
    photographs: Array, largest: int | None = None, effort: KernelEffort | None = None
) -> FreeKernels:
    """`kernels_of_flat_scene` for photographs (P, H, W) that may be rotated and zoomed relative to the first.

    Raises BadInput, Refused as there, and where some of three photographs or more show another scene.
    """
    if odd := outlier_frames(photographs):
        which, show = ("photograph", "shows") if len(odd) == 1 else ("photographs", "show")
        raise Refused(
            f"{which} {', '.join(str(i + 1) for i in odd)} of {len(photographs)} {show} another scene than the others",
            "omit what does not belong to the scene",
        )
    s, refusal = effort or KernelEffort(), None
    try:
        kernels = kernels_of_flat_scene(photographs, largest, s)
    except Refused as error:
        refusal, kernels = error, _of_middle(photographs, largest, s, error)
    upright = _rotated_back(photographs, kernels)
    if upright is not None:
        again = kernels_of_flat_scene(upright, largest, s)
        if refusal is not None or again.residual < kernels.residual:
            return again
    if refusal is not None:
        raise refusal
    return kernels


def _of_middle(photographs: Array, largest: int | None, s: KernelEffort, refusal: Refused) -> FreeKernels:
    try:
        return kernels_of_flat_scene(photographs, largest, replace(s, most_pixels=MIDDLE**2))
    except Refused as error:
        raise refusal from error


def _rotated_back(photographs: Array, kernels: FreeKernels) -> Array | None:
    """The photographs with rotations and zooms corrected; None where they are not significant."""
    stacks = [MaskStack(np.stack([kernel, kernel]), 0.5) for kernel in kernels.kernels]
    rotations = similarities(photographs[:, None], stacks)
    if not any(rotation.significant for rotation in rotations):
        return None
    trust = np.ones((1, *photographs.shape[1:]))
    others = [
        rotate_back(z[None], trust, rotation)[0][0] if rotation.significant else z
        for z, rotation in zip(photographs[1:], rotations, strict=True)
    ]
    return np.stack([photographs[0], *others])
