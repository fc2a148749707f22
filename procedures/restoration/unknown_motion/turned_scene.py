"""Kernels of a flat scene whose photographs are turned and zoomed against each other, as hands and lenses do.

Kernels that were found in spite of it tell the turn and the zoom, by where they leave the parts of the frame;
photographs brought to the first by these tell the kernels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from procedures.outcome import Refused
from procedures.restoration.first_depth.registration import similarities
from procedures.restoration.first_depth.similarity import turned_back
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.unknown_motion.flat_scene import FreeKernels, FreeKernelSettings, kernels_of_flat_scene
from procedures.restoration.unknown_motion.odd_photograph import odd_photographs

MIDDLE = 128
"""Side of the frame's middle, pixels: turn and zoom move little there, and it has kernels that the frame has not."""


def kernels_of_turned_scene(
    photographs: Array, largest: int | None = None, settings: FreeKernelSettings | None = None
) -> FreeKernels:
    """As `kernels_of_flat_scene`, of photographs (P, H, W) that may be turned and zoomed: against the first as it lies.

    Raises
    ------
    BadInput, Refused
        As that does, and where some of three photographs or more show another scene.
    """
    if odd := odd_photographs(photographs):
        which, show = ("photograph", "shows") if len(odd) == 1 else ("photographs", "show")
        raise Refused(
            f"{which} {', '.join(str(i + 1) for i in odd)} of {len(photographs)} {show} another scene than the others",
            "leave out what does not belong to the scene",
        )
    s, refusal = settings or FreeKernelSettings(), None
    try:
        found = kernels_of_flat_scene(photographs, largest, s)
    except Refused as error:
        refusal, found = error, _of_middle(photographs, largest, s, error)
    upright = _turned_back(photographs, found)
    if upright is not None:
        again = kernels_of_flat_scene(upright, largest, s)
        if refusal is not None or again.left < found.left:
            return again
    if refusal is not None:
        raise refusal
    return found


def _of_middle(photographs: Array, largest: int | None, s: FreeKernelSettings, refusal: Refused) -> FreeKernels:
    """Kernels of the frame's middle. Raises the refusal of all of it where there are none."""
    try:
        return kernels_of_flat_scene(photographs, largest, replace(s, most_pixels=MIDDLE**2))
    except Refused as error:
        raise refusal from error


def _turned_back(photographs: Array, found: FreeKernels) -> Array | None:
    """The photographs with turns and zooms taken back; None where these kernels tell none."""
    stacks = [MaskStack(np.stack([kernel, kernel]), 0.5) for kernel in found.kernels]
    alike = similarities(photographs[:, None], stacks)
    if not any(one.believed for one in alike):
        return None
    seen = np.ones((1, *photographs.shape[1:]))
    others = [
        turned_back(z[None], seen, one)[0][0] if one.believed else z
        for z, one in zip(photographs[1:], alike, strict=True)
    ]
    return np.stack([photographs[0], *others])
