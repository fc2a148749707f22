"""A restoration held against a photograph of its scene that nothing blurred: the ground truth.

The photograph is laid on the restored picture, as bright as it. What they differ by, less the photograph's own noise,
is an error that shares nothing with the restoration; it is held against the error that the restoration tells of itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize_scalar

from procedures.numerics.registration import affine_between
from procedures.outcome import BadInput, Outcome, with_doubt
from procedures.raw import Plane
from procedures.restoration.colour.mosaic import COLOUR
from procedures.restoration.joint.picture_error import own_noise
from procedures.restoration.joint.result import GroundTruth, Restoration
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.checks import SATURATED

TAPS = 9
"""Side of what a sample is interpolated from, pixels."""
SOFTEST_PX, LOOKED_AT = 3.0, 512
"""Widest blur by which the ground truth may be softer than the restored picture, and the side of the frame's middle
where that is looked at, pixels."""


@dataclass(frozen=True)
class GroundTruthLimits:
    """From when on a ground truth is no witness, or witnesses against the restoration.

    Attributes
    ----------
    least_seen : float
        Part of the frame that it has to show.
    nothing_alike : float
        What differs over the contrast, from which it shows another scene; of two without likeness it is 1.4.
    most_over_told : float
        Error over the told one from which the restoration is doubted.
    """

    least_seen: float = 0.1
    nothing_alike: float = 0.7
    most_over_told: float = 2.0


Planes = Mapping[str, Plane]
T = TypeVar("T", bound=np.generic)


def held_against(
    outcome: Outcome[Restoration], photographs: Sequence[Planes], truth: Planes, limits: GroundTruthLimits | None = None
) -> Outcome[Restoration]:
    """The same with what the ground truth says of it; doubtful where that contradicts what the restoration tells.

    Parameters
    ----------
    photographs : the restored planes of each
    truth : the same planes of the ground truth

    Raises
    ------
    BadInput
        If the ground truth has other planes than the photographs, or another size, or is one of them.
    """
    check_ground_truth(photographs, truth)
    found, s = outcome.value, limits or GroundTruthLimits()
    if found is None:
        return outcome
    still = np.asarray(~_on_planes(found.moved, truth).any(axis=0))
    laid = _laid(_as_planes(found.sharp, truth), truth, still, s)
    if isinstance(laid, str):
        return with_doubt(
            outcome, laid, "take it of the same scene from the same place, everything at rest and in focus"
        )
    told = float(np.sqrt(np.mean(_on_planes(found.sharp_std, truth)[:, laid.both] ** 2)))
    noise = min(own_noise(_stack(truth)[None]), found.diagnostics.noise) / laid.light
    softer = _softer(laid)
    witness = GroundTruth(
        psnr_db=_psnr(laid.off), before_db=tuple(_before(one, truth, s) for one in photographs),
        error=_without(laid.off, noise), told=told, softer_px=softer,
        error_as_soft=_without(laid.softened(softer) - laid.truth[:, laid.both], noise), noise=noise,
        seen=float(laid.both.mean()), light=laid.light, matrix=laid.matrix, difference=laid.difference,
    )  # fmt: skip
    held = replace(outcome, value=replace(found, ground_truth=witness))
    least, before = min(witness.error, witness.error_as_soft), np.nanmax([*witness.before_db, 0.0])
    if least > 10 ** (-before / 20):
        nearest = 1 + int(np.nanargmax(witness.before_db))
        reason = (
            f"the ground truth is nearer to photograph {nearest} as it came ({before:.1f} dB) than to the restored "
            f"picture ({witness.psnr_db:.1f} dB): it is blurred itself, or the restoration is wrong"
        )
        return with_doubt(held, reason, "look at the ground truth; give one that is sharp everywhere")
    if least <= s.most_over_told * told:
        return held
    reason = (
        f"it differs from the ground truth by {witness.error:.1%} of white, {witness.error / max(told, 1e-9):.1f} "
        "times the error that it tells of itself"
    )
    return with_doubt(held, reason, "check shapes and ratios; look at difference.tiff, which tells where")


def check_ground_truth(photographs: Sequence[Planes], truth: Planes) -> None:
    """The ground truth has the photographs' planes and size, and is none of them. Raises BadInput."""
    first = photographs[0]

    def words(planes: Planes) -> str:
        rows, columns = next(iter(planes.values())).samples.shape
        return f"{', '.join(planes)} of {columns} x {rows} pixels"

    if [(k, one.samples.shape) for k, one in first.items()] != [(k, one.samples.shape) for k, one in truth.items()]:
        raise BadInput(
            f"the ground truth must be of the photographs' camera: they have {words(first)}, it has {words(truth)}",
            "give a photograph of the same camera, not cropped or turned",
        )
    for n, one in enumerate(photographs, start=1):
        if all(np.array_equal(plane.samples, truth[name].samples) for name, plane in one.items()):
            raise BadInput(f"the ground truth is photograph {n}", "give a photograph that nothing blurred")


# --- laid on each other --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Laid:
    """A picture (C, H, W), and the ground truth brought to its place and light; both : (H, W), where they are seen."""

    picture: Array
    truth: Array
    both: NDArray[np.bool_]
    light: float
    matrix: Array

    @property
    def off(self) -> Array:
        return (self.picture - self.truth)[:, self.both]

    @property
    def difference(self) -> NDArray[np.float32]:
        return np.where(self.both, self.picture - self.truth, np.nan).astype(np.float32)

    def softened(self, sigma_px: float) -> Array:
        if not sigma_px:
            return self.picture[:, self.both]
        return np.asarray(gaussian_filter(self.picture, (0, sigma_px, sigma_px)))[:, self.both]

    def middle(self) -> _Laid:
        """Of its middle, where that is enough."""
        y, x = (slice(max(0, (n - LOOKED_AT) // 2), max(0, (n - LOOKED_AT) // 2) + LOOKED_AT) for n in self.both.shape)
        return replace(self, picture=self.picture[:, y, x], truth=self.truth[:, y, x], both=self.both[y, x])


def _laid(picture: Array, truth: Planes, counts: NDArray[np.bool_], s: GroundTruthLimits) -> _Laid | str:
    """The ground truth on a picture of its planes, or why it is no witness."""
    planes = _stack(truth)
    grey = [np.minimum(one.mean(axis=0), SATURATED).astype(np.float32) for one in (picture, planes)]
    matrix = affine_between(grey[0], grey[1], counts)
    size = (picture.shape[2], picture.shape[1])
    if matrix is None:
        return ELSEWHERE
    clear = np.asarray((planes < SATURATED).all(axis=0), dtype=np.float32)
    flags = cv2.WARP_INVERSE_MAP
    brought: Array = np.stack([cv2.warpAffine(p, matrix, size, flags=flags | cv2.INTER_LANCZOS4) for p in planes])
    seen = cv2.warpAffine(clear, matrix, size, flags=flags | cv2.INTER_LINEAR) > 0.999
    both = cv2.erode((seen & counts).astype(np.uint8), np.ones((TAPS, TAPS), np.uint8), borderValue=0) > 0
    if both.mean() < s.least_seen:
        return f"{ELSEWHERE}: {both.mean():.0%} of the frame can be compared"
    light = float(brought[:, both].mean() / max(picture[:, both].mean(), 1e-9))
    laid = _Laid(picture, brought / max(light, 1e-9), both, light, matrix)
    contrast = float(laid.truth[:, both].std(axis=1).mean())
    if light <= 0 or float(np.sqrt(np.mean(laid.off**2))) > s.nothing_alike * contrast:
        return ELSEWHERE
    return laid


ELSEWHERE = "the ground truth shows another scene, or the scene from another place"


def _before(photograph: Planes, truth: Planes, s: GroundTruthLimits) -> float:
    """Peak signal over noise of a photograph as it came; NaN where the ground truth cannot be laid on it."""
    stack = _stack(photograph)
    laid = _laid(stack, truth, np.asarray((stack < SATURATED).all(axis=0)), s)
    return float("nan") if isinstance(laid, str) else _psnr(laid.off)


def _softer(laid: _Laid) -> float:
    """Standard deviation of the Gaussian, in pixels, after which the picture is most like the ground truth."""
    part = laid.middle()
    if not part.both.any():
        part = laid
    truth = part.truth[:, part.both]

    def differs(sigma_px: float) -> float:
        return float(np.mean((part.softened(sigma_px) - truth) ** 2))

    found = minimize_scalar(differs, bounds=(0.0, SOFTEST_PX), method="bounded", options={"xatol": 0.02})
    return float(found.x) if found.fun < differs(0.0) else 0.0


def _psnr(off: Array) -> float:
    return float(-10 * np.log10(max(float(np.mean(off.astype(np.float64) ** 2)), 1e-12)))


def _without(off: Array, noise: float) -> float:
    return float(np.sqrt(max(float(np.mean(off.astype(np.float64) ** 2)) - noise**2, 0.0)))


# --- a picture on its planes' grids --------------------------------------------------------------------------------


def _stack(planes: Planes) -> Array:
    return np.stack([one.samples.astype(np.float64) for one in planes.values()])


def _as_planes(picture: Array, planes: Planes) -> Array:
    """A picture (C, H, W) of the planes, or on their sensor's grid, as the planes show it, (P, rows, columns)."""
    if not _finer(picture.shape[-1], planes):
        return picture.astype(np.float64)
    return np.stack([_sampled(picture[COLOUR[name]], plane) for name, plane in planes.items()]).astype(np.float64)


def _on_planes(seen: NDArray[T], planes: Planes) -> NDArray[T]:
    """Of the picture's pixels (H, W), as the planes see them, (P, rows, columns), or (1, H, W) as they are."""
    if not _finer(seen.shape[-1], planes):
        return seen[None]
    return np.stack([_sampled(seen, plane) for plane in planes.values()])


def _sampled(picture: NDArray[T], plane: Plane) -> NDArray[T]:
    """What a plane of the mosaic sees of a picture on the sensor's grid."""
    rows, columns = plane.samples.shape
    (x, y), pitch = plane.origin, plane.pitch
    return picture[y % pitch :: pitch, x % pitch :: pitch][:rows, :columns]


def _finer(columns: int, planes: Planes) -> bool:
    return bool(columns > next(iter(planes.values())).samples.shape[1])
