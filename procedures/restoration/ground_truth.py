"""Comparison of a restoration with a sharp photograph of its scene: the ground truth.

The photograph is aligned to the restored picture in position and brightness. Their difference, corrected for the
photograph's noise, is an independent error, which is compared with the error estimated by the restoration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize_scalar

from procedures.numerics.warps import affine_between
from procedures.outcome import BadInput, Outcome, mark_doubtful
from procedures.raw import Plane, PlaneLike, as_frame
from procedures.restoration.colour.mosaic import COLOUR
from procedures.restoration.joint.picture_error import noise_upper_bound
from procedures.restoration.joint.result import GroundTruth, Restoration
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.checks import SATURATED

TAPS = 9
"""Side of the interpolation kernel, pixels."""
SOFTEST_PX, CENTRE_PX = 3.0, 512
"""Largest blur by which the ground truth may be softer than the restored picture, and side of the central part of the
frame in which it is estimated, pixels."""
LEAST_SEEN = 0.1
"""Smallest fraction of the frame that a ground truth must show."""
NOTHING_ALIKE = 0.7
"""Residual over contrast above which it shows another scene; for two unrelated scenes it is 1.4."""
MOST_OVER_STATED = 2.0
"""Ratio of error and estimated error above which the restoration is doubtful."""
Planes = Mapping[str, Plane]
T = TypeVar("T", bound=np.generic)


def compare_to_ground_truth(
    outcome: Outcome[Restoration], photographs: Sequence[Planes | PlaneLike], truth: Planes | PlaneLike
) -> Outcome[Restoration]:
    """Add the comparison with the ground truth; doubtful where it contradicts the estimated error.

    photographs, truth : the planes of each by name, or its one plane, also as an array (H, W). Raises BadInput if the
    ground truth has other planes than the photographs, or another size, or is one of them.
    """
    each, truth = [_planes_of(photograph) for photograph in photographs], _planes_of(truth)
    check_ground_truth(each, truth)
    restoration = outcome.value
    if restoration is None:
        return outcome
    static = np.asarray(~_on_planes(restoration.moved, truth).any(axis=0))
    aligned = _align(_as_planes(restoration.sharp, truth), truth, static)
    if isinstance(aligned, str):
        return mark_doubtful(
            outcome, aligned, "take it of the same scene from the same place, without motion and in focus"
        )
    stated = float(np.sqrt(np.mean(_on_planes(restoration.sharp_std, truth)[:, aligned.valid] ** 2)))
    noise = min(noise_upper_bound(_stack(truth)[None]), restoration.diagnostics.noise) / aligned.light
    softer = _softer(aligned)
    witness = GroundTruth(
        psnr_db=_psnr(aligned.error), before_db=tuple(_before(planes, truth) for planes in each),
        error=_without_noise(aligned.error, noise), stated_error=stated, softer_px=softer,
        error_as_soft=_without_noise(aligned.softened(softer) - aligned.truth[:, aligned.valid], noise), noise=noise,
        compared=float(aligned.valid.mean()), light=aligned.light, matrix=aligned.matrix,
        difference=aligned.difference,
    )  # fmt: skip
    compared = replace(outcome, value=replace(restoration, ground_truth=witness))
    least, before = min(witness.error, witness.error_as_soft), np.nanmax([*witness.before_db, 0.0])
    if least > 10 ** (-before / 20):
        nearest = 1 + int(np.nanargmax(witness.before_db))
        reason = (
            f"the ground truth is closer to photograph {nearest} before restoration ({before:.1f} dB) than to the "
            f"restored picture ({witness.psnr_db:.1f} dB): it is blurred itself, or the restoration is wrong"
        )
        return mark_doubtful(compared, reason, "look at the ground truth; give one that is sharp everywhere")
    if least <= MOST_OVER_STATED * stated:
        return compared
    reason = (
        f"the restoration differs from the ground truth by {witness.error:.1%} of white, "
        f"{witness.error / max(stated, 1e-9):.1f} times its estimated error"
    )
    return mark_doubtful(compared, reason, "check shapes and ratios; see difference.tiff")


def _planes_of(photograph: Planes | PlaneLike) -> Planes:
    return photograph if isinstance(photograph, Mapping) else as_frame(photograph).planes


def check_ground_truth(photographs: Sequence[Planes], truth: Planes) -> None:
    """Require the photographs' planes and size of a ground truth that is none of them. Raises BadInput."""
    first = photographs[0]

    def words(planes: Planes) -> str:
        rows, columns = next(iter(planes.values())).samples.shape
        return f"{', '.join(planes)} of {columns} x {rows} pixels"

    if [(k, one.samples.shape) for k, one in first.items()] != [(k, one.samples.shape) for k, one in truth.items()]:
        raise BadInput(
            f"the ground truth must be of the photographs' camera: they have {words(first)}, it has {words(truth)}",
            "give a photograph of the same camera, neither cropped nor rotated",
        )
    for n, photograph in enumerate(photographs, start=1):
        if all(np.array_equal(plane.samples, truth[name].samples) for name, plane in photograph.items()):
            raise BadInput(f"the ground truth is photograph {n}", "give a sharp photograph")


@dataclass(frozen=True, eq=False)
class _Aligned:
    """A picture (C, H, W), and the ground truth aligned in position and light; valid : (H, W), where both are known."""

    picture: Array
    truth: Array
    valid: NDArray[np.bool_]
    light: float
    matrix: Array

    @property
    def error(self) -> Array:
        return (self.picture - self.truth)[:, self.valid]

    @property
    def difference(self) -> NDArray[np.float32]:
        return np.where(self.valid, self.picture - self.truth, np.nan).astype(np.float32)

    def softened(self, sigma_px: float) -> Array:
        if not sigma_px:
            return self.picture[:, self.valid]
        return np.asarray(gaussian_filter(self.picture, (0, sigma_px, sigma_px)))[:, self.valid]

    def centre(self) -> "_Aligned":
        """The central part, where that is sufficient."""
        y, x = (slice(max(0, (n - CENTRE_PX) // 2), max(0, (n - CENTRE_PX) // 2) + CENTRE_PX) for n in self.valid.shape)
        return replace(self, picture=self.picture[:, y, x], truth=self.truth[:, y, x], valid=self.valid[y, x])


def _align(picture: Array, truth: Planes, counts: NDArray[np.bool_]) -> _Aligned | str:
    """The ground truth aligned to a picture of its planes, or the reason why it is invalid."""
    planes = _stack(truth)
    grey = [np.minimum(one.mean(axis=0), SATURATED).astype(np.float32) for one in (picture, planes)]
    matrix = affine_between(grey[0], grey[1], counts)
    size = (picture.shape[2], picture.shape[1])
    if matrix is None:
        return ELSEWHERE
    clear = np.asarray((planes < SATURATED).all(axis=0), dtype=np.float32)
    flags = cv2.WARP_INVERSE_MAP
    warped: Array = np.stack([cv2.warpAffine(p, matrix, size, flags=flags | cv2.INTER_LANCZOS4) for p in planes])
    inside = cv2.warpAffine(clear, matrix, size, flags=flags | cv2.INTER_LINEAR) > 0.999
    valid = cv2.erode((inside & counts).astype(np.uint8), np.ones((TAPS, TAPS), np.uint8), borderValue=0) > 0
    if valid.mean() < LEAST_SEEN:
        return f"{ELSEWHERE}: {valid.mean():.0%} of the frame can be compared"
    light = float(warped[:, valid].mean() / max(picture[:, valid].mean(), 1e-9))
    aligned = _Aligned(picture, warped / max(light, 1e-9), valid, light, matrix)
    contrast = float(aligned.truth[:, valid].std(axis=1).mean())
    if light <= 0 or float(np.sqrt(np.mean(aligned.error**2))) > NOTHING_ALIKE * contrast:
        return ELSEWHERE
    return aligned


ELSEWHERE = "the ground truth shows another scene, or the scene from another place"


def _before(photograph: Planes, truth: Planes) -> float:
    """PSNR of a photograph before restoration; NaN where the ground truth cannot be aligned to it."""
    stack = _stack(photograph)
    aligned = _align(stack, truth, np.asarray((stack < SATURATED).all(axis=0)))
    return float("nan") if isinstance(aligned, str) else _psnr(aligned.error)


def _softer(aligned: _Aligned) -> float:
    part = aligned.centre()
    if not part.valid.any():
        part = aligned
    truth = part.truth[:, part.valid]

    def differs(sigma_px: float) -> float:
        return float(np.mean((part.softened(sigma_px) - truth) ** 2))

    minimum = minimize_scalar(differs, bounds=(0.0, SOFTEST_PX), method="bounded", options={"xatol": 0.02})
    return float(minimum.x) if minimum.fun < differs(0.0) else 0.0


def _psnr(error: Array) -> float:
    return float(-10 * np.log10(max(float(np.mean(error.astype(np.float64) ** 2)), 1e-12)))


def _without_noise(error: Array, noise: float) -> float:
    return float(np.sqrt(max(float(np.mean(error.astype(np.float64) ** 2)) - noise**2, 0.0)))


def _stack(planes: Planes) -> Array:
    return np.stack([plane.samples.astype(np.float64) for plane in planes.values()])


def _as_planes(picture: Array, planes: Planes) -> Array:
    """A picture (C, H, W) of the planes, or on their sensor's grid, at the planes' pixels, (P, rows, columns)."""
    if not _finer(picture.shape[-1], planes):
        return picture.astype(np.float64)
    return np.stack([_sampled(picture[COLOUR[name]], plane) for name, plane in planes.items()]).astype(np.float64)


def _on_planes(image: NDArray[T], planes: Planes) -> NDArray[T]:
    """An image (H, W) at the planes' pixels, (P, rows, columns), or (1, H, W) unchanged if it has their grid."""
    if not _finer(image.shape[-1], planes):
        return image[None]
    return np.stack([_sampled(image, plane) for plane in planes.values()])


def _sampled(picture: NDArray[T], plane: Plane) -> NDArray[T]:
    rows, columns = plane.samples.shape
    (x, y), pitch = plane.origin, plane.pitch
    return picture[y % pitch :: pitch, x % pitch :: pitch][:rows, :columns]


def _finer(columns: int, planes: Planes) -> bool:
    return bool(columns > next(iter(planes.values())).samples.shape[1])
