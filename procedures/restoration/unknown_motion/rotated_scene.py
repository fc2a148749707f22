"""Kernels of a flat scene whose photographs are rotated and zoomed relative to each other, as hand-held ones are.

Kernels estimated in spite of it reveal rotation and zoom by the residual shifts of the frame's parts; the kernels are
then estimated again from corrected photographs.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from procedures.outcome import Refused
from procedures.restoration.first_depth.registration import similarities
from procedures.restoration.first_depth.similarity import rotate_back
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.unknown_motion.blind import Report
from procedures.restoration.unknown_motion.flat_scene import FreeKernels, KernelEffort, kernels_of_flat_scene

MIDDLE = 128
"""Side of the frame's middle, pixels: rotation and zoom have little effect there, so that kernels exist."""


def kernels_of_rotated_scene(
    photographs: Array, largest: int | None = None, effort: KernelEffort | None = None, report: Report | None = None
) -> FreeKernels:
    """`kernels_of_flat_scene` for photographs (P, H, W) rotated and zoomed. Raises BadInput, Refused as there, and for
    another scene."""
    if odd := outlier_frames(photographs):
        which, show = ("photograph", "shows") if len(odd) == 1 else ("photographs", "show")
        raise Refused(
            f"{which} {', '.join(str(i + 1) for i in odd)} of {len(photographs)} {show} another scene than the others",
            "omit what does not belong to the scene",
        )
    s, refusal = effort or KernelEffort(), None
    try:
        kernels = kernels_of_flat_scene(photographs, largest, s, report)
    except Refused as error:
        refusal, kernels = error, _of_middle(photographs, largest, s, error)
    upright = _rotated_back(photographs, kernels)
    if upright is not None:
        again = kernels_of_flat_scene(upright, largest, s, report)
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


# --- photographs of another scene ------------------------------------------------------------------------------------

FINE_PX, COARSE_PX = 3.0, 9.0
"""Band of detail that is compared: blur of another form preserves it, another scene differs in it."""
UNLIKE, ALIKE = 0.35, 0.5
"""Correlation up to which a photograph differs from most others, and above which it agrees. Real shake leaves 0.65 and
more for one scene, 0.11 at most for two."""
MOST_COMPARED = 6
"""Maximum number of photographs that each is compared with."""


def outlier_frames(photographs: Array) -> list[int]:
    """Indices of those of three or more photographs (P, H, W) that show another scene than most; empty where
    undecidable."""
    count = len(photographs)
    if count < 3:
        return []
    detail = [gaussian_filter(one, FINE_PX) - gaussian_filter(one, COARSE_PX) for one in photographs]
    apart = range(1, count, max((count - 1) // MOST_COMPARED, 1))
    # the median; of two the higher, which among three photographs only the outlier lacks
    likenesses = [[_correlation(detail[i], detail[(i + n) % count]) for n in apart] for i in range(count)]
    typical = [float(np.quantile(those, 0.5, method="higher")) for those in likenesses]
    outliers = [i for i, likeness in enumerate(typical) if likeness < UNLIKE]
    rest = [correlation for correlation in typical if correlation >= UNLIKE]
    return outliers if 2 * len(outliers) < count and min(rest) > ALIKE else []


def _correlation(a: Array, b: Array) -> float:
    import cv2

    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_64F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(b), np.asarray(a), window)
    inner = tuple(slice(n // 8, n - n // 8) for n in a.shape)
    shifted = shift(b, (y, x), order=1, mode="nearest")
    return max(float(np.corrcoef(a[inner].ravel(), image[inner].ravel())[0, 1]) for image in (shifted, b))
