"""Requirements of a restoration on photographs and blur."""

from collections.abc import Sequence
from itertools import combinations, product

import cv2
import numpy as np
from scipy.ndimage import convolve1d, gaussian_filter

from procedures.outcome import BadInput, BadParameter, Refused, checked_type
from procedures.raw import Plane
from procedures.reading.arrays import checked_array
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import Masks, alike

SATURATED = 0.99
"""Fraction of white above which a sample counts as saturated, noise included."""
MOST_SATURATED = 0.2
DEFECT = 8.0
"""Standard deviations of the finest noise above which a single pixel is no noise."""
LEAST_ALIKE = 0.5
"""Correlation with a photograph turned by 180 degrees above which it is one: 0.9 of shaken and defocused scenes."""
LARGEST_W = 40.0
"""Half-width in pixels; memory for masks grows as its third power."""


def as_channels(photographs: Sequence[object]) -> list[Array]:
    """Photographs as arrays (C, H, W); planes and arrays (H, W) have one channel. Raises TypeError for other types."""
    remedy = "pass photographs (H, W) or (C, H, W), linear, white = 1, or planes, as read_frame(path).planes['G1']"
    each = (one.samples if isinstance(one, Plane) else checked_type(one, np.ndarray, remedy) for one in photographs)
    return [np.asarray(one[None] if one.ndim == 2 else one, dtype=np.float64) for one in each]


def check_photographs(photographs: list[Array]) -> Array:
    """The photographs as one array, without hot and dead pixels. Raises BadInput for fewer than two, other sizes, two
    identical or turned by 180 degrees, or non-finite numbers."""
    if len(photographs) < 2:
        raise BadInput(f"restoration needs two photographs or more, got {len(photographs)}", "take another photograph")
    for n, one in enumerate(photographs, 1):
        checked_array(one, f"samples of photograph {n}", (None, None, None), dtype=None, remedy="export it again")
    shapes = [p.shape for p in photographs]
    if len({shape[0] for shape in shapes}) > 1:
        channels = ", ".join(str(shape[0]) for shape in shapes)
        raise BadInput(f"photographs must have as many colours, got {channels}", "give all in grey or all in colour")
    if len(set(shapes)) > 1:
        sizes = ", ".join(f"{s[-1]} x {s[-2]}" for s in shapes)
        turned = len({frozenset(s[-2:]) for s in shapes}) == 1
        remedy = "turn them to one orientation" if turned else "crop photographs of one camera equally"
        raise BadInput(f"photographs must be of one size, got {sizes}", remedy)
    for a, b in combinations(range(len(photographs)), 2):
        if np.array_equal(photographs[a], photographs[b]):
            raise BadInput(
                f"photographs {a + 1} and {b + 1} are identical", "give two exposures with different motion or aperture"
            )
    for n, one in enumerate(photographs[1:], 2):
        if _is_turned(photographs[0], one):
            raise BadInput(f"photograph {n} is turned by 180 degrees from photograph 1", "turn it back")
    return without_defects(np.stack(photographs))


def _is_turned(a: Array, b: Array) -> bool:
    """Whether a photograph correlates with another turned by 180 degrees, and not as it is."""
    spectra = []
    for photograph in (a, b):
        small = cv2.resize(photograph.mean(axis=0), (256, 256), interpolation=cv2.INTER_AREA)
        detail = (cv2.GaussianBlur(small, (0, 0), 1) - cv2.GaussianBlur(small, (0, 0), 16)) * np.hanning(256)
        detail *= np.hanning(256)[:, None]
        spectra.append(np.fft.rfft2(detail / max(float(np.linalg.norm(detail)), 1e-12)))
    turned, upright = (float(np.fft.irfft2(spectra[0] * other).max()) for other in (spectra[1], spectra[1].conj()))
    return turned > max(LEAST_ALIKE, 2 * upright)


def without_defects(z: Array) -> Array:
    """Photographs (P, C, H, W), pixels that are hot or dead in all of them replaced by their neighbours' prediction.

    Second differences along both axes annihilate what varies linearly along one; a single pixel leaves a known pattern.
    """
    step, around = np.array([0.5, -1.0, 0.5]), ((0, 0), (0, 0), (2, 2), (2, 2))
    e = convolve1d(convolve1d(np.pad(z, around, mode="reflect"), step, axis=-1), step, axis=-2)
    defective = np.abs(e) > DEFECT * 1.4826 * np.median(np.abs(e), axis=(-2, -1), keepdims=True)
    for y, x in product((-1, 0, 1), repeat=2):
        defective &= np.abs(np.roll(e, (y, x), axis=(-2, -1)) - step[y + 1] * step[x + 1] * e) <= np.abs(e) / 4
    return z - np.where(defective.all(axis=0), e, 0.0)[..., 2:-2, 2:-2]


def check_blurs(stacks: Sequence[Masks], shape: tuple[int, int]) -> None:
    """Refuse blurs that do not determine depth, all alike or on different grids, or too large for the photographs.
    Raises BadParameter."""
    if alike(stacks):
        raise BadParameter(
            "ratio 1 with equal shapes blurs all photographs equally, which does not determine depth",
            "give the ratio of the apertures, or the shape of each motion",
        )
    check_extent(stacks[0].R, shape)


def check_extent(R: float, shape: tuple[int, int]) -> None:
    """Raise BadParameter, before they are computed, for masks of half-size R wider than half of the photograph."""
    if not min(shape) >= 4 * R + 1:  # nor where R is NaN
        raise BadParameter(
            f"masks of half-size {R:.6g} pixels are too large for photographs of {shape[1]} x {shape[0]}",
            "lower --max-w, or give larger photographs",
        )


def trust_of(z: Array) -> Array:
    """Weights (P, 1, H, W): 0 where saturated. Raises Refused if that is more than `MOST_SATURATED` of a photograph."""
    saturated = (z >= SATURATED).any(axis=1, keepdims=True)
    worst = float(saturated.mean(axis=(1, 2, 3)).max())
    if worst > MOST_SATURATED:
        raise Refused(
            f"{worst:.0%} of a photograph is saturated; at most {MOST_SATURATED:.0%} is allowed", "expose less"
        )
    return np.asarray(~saturated, dtype=z.dtype)


def check_texture(z: Array, sigma: float) -> None:
    """Raise Refused for photographs whose variation within a few pixels does not exceed the noise."""
    smooth = gaussian_filter(z, (0, 0, 1, 1))
    texture = float((smooth - gaussian_filter(z, (0, 0, 5, 5))).std())
    # a Gaussian of sigma 1 leaves 0.28 of white noise
    if texture < max(0.4 * sigma, 5e-4):
        raise Refused(
            f"the photographs need texture; they vary by {texture:.2g} of white where the noise is {sigma:.2g}",
            "put structure into the scene, or light it from the side",
        )


def check_registered(z: Array, R: int) -> None:
    """Raise Refused where phase correlation finds a clear shift of photographs larger than the masks."""
    grey = z.mean(axis=1)
    soft = [np.ascontiguousarray(gaussian_filter(g, max(1.0, R / 3)), dtype=np.float64) for g in grey]
    window = cv2.createHanningWindow(soft[0].shape[::-1], cv2.CV_64F)
    for n, other in enumerate(soft[1:], start=2):
        (dx, dy), response = cv2.phaseCorrelate(soft[0] - soft[0].mean(), other - other.mean(), window)
        if response > 0.05 and np.hypot(dx, dy) > 2 * R:
            check_shift(n, dx, dy, R)


def check_shift(n: int, dx: float, dy: float, R: int) -> None:
    """Refuse a shift of photograph `n` that exceeds the masks' half-size R. Raises Refused if it does."""
    if max(abs(dx), abs(dy)) > R:
        raise Refused(
            f"photograph {n} is shifted by ({round(dx)}, {round(dy)}) pixels, more than the masks' {R}",
            "register the photographs first, or raise --max-w",
        )


def check_max_w(max_w: float) -> None:
    """Refuse ranges of w beyond any application. Raises BadParameter if not within (0.5, 40] pixels."""
    if not 0.5 < max_w <= LARGEST_W:
        raise BadParameter(
            f"max w must be between 0.5 and {LARGEST_W:g} pixels, got {max_w:g}", "give the blur's half-width"
        )
