"""Order and registration of the two photographs, by SIFT features and a robust homography.

The homography is accurate to a few tenths of a far pixel; `inter_image` refines it on the photographs themselves.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32
from procedures.numerics.warps import homography_jacobian, inverse
from procedures.outcome import Refused

QUICK_PIXELS, MOST_PIXELS = 0.16e6, 4e6
"""Size to which a photograph is reduced for the detection of features, and where these are too few."""
MOST_FEATURES = 3000
CONTRAST = 0.01  # SIFT's threshold: walls are faint
RATIO = 0.85  # of the nearest descriptor's distance to the second nearest's
FEWEST = 12  # matches that must agree on one homography: four determine it, the others confirm it
ENOUGH = 60  # matches from which larger copies are not searched
TOLERANCE_PX = 1.5  # distance of a match from the homography, in pixels of the reduced photograph


@dataclass(frozen=True)
class PairSighting:
    """Registration of two photographs.

    swapped : whether the near photograph is the second one
    H_near_far : (3, 3), pixels (x, y) of the far photograph -> pixels of the near one
    matches : matches consistent with the homography
    rms_far_px : their scatter about it, in pixels of the far photograph
    """

    swapped: bool
    H_near_far: Array
    matches: int
    rms_far_px: float


@dataclass(frozen=True)
class _Features:
    """Points (n, 2), in pixels of the whole photograph, with their descriptors (n, 128)."""

    points: Array
    descriptors: Array32
    reduction: int


def register(a: Array32, b: Array32) -> PairSighting:
    """The order of two photographs and the homography from the far one to the near one.

    Small copies are matched first: a near photograph reduced to about the far one's scale gives more and better
    matches than the whole one, at a tenth of the cost. Where these are too few, either photograph is used whole.

    Raises Refused if there are too few features or matches: no texture, or no common scene.

    Source: Delbracio, Almansa, Muse, IPOL 2013, section 4.1.
    """
    photographs = (grey_levels(a), grey_levels(b))
    small = [_reduction(photograph, QUICK_PIXELS) for photograph in photographs]
    whole = [_reduction(photograph, MOST_PIXELS) for photograph in photographs]

    detected: dict[tuple[int, int], _Features] = {}
    best: PairSighting | None = None

    def features(which: int, reduction: int) -> _Features:
        if (which, reduction) not in detected:
            detected[which, reduction] = find_features(photographs[which], reduction)
        return detected[which, reduction]

    for first, second in dict.fromkeys(((small[0], small[1]), (small[0], whole[1]), (whole[0], small[1]))):
        sighting = _registered(features(0, first), features(1, second))
        if sighting is not None and (best is None or sighting.matches > best.matches):
            best = sighting
        if best is not None and best.matches >= ENOUGH:
            break
    if best is not None:
        return best
    raise _refusal(min(max(len(f.points) for (i, _), f in detected.items() if i == which) for which in (0, 1)))


def _refusal(features: int) -> Refused:
    if features < 5 * FEWEST:
        return Refused(
            f"the wall must have texture to match the photographs by; one shows {features} features",
            "choose a rougher wall, or put a printed texture on it, and focus",
        )
    return Refused(
        f"at least {FEWEST} features of the two photographs must agree on one plane; fewer do",
        "photograph the same flat, textured part of a wall from both distances, in the same light",
    )


def grey_levels(samples: Array32) -> npt.NDArray[np.uint8]:
    """The photograph stretched to 256 levels, without its extremes."""
    low, high = np.percentile(samples[::5, ::5], [0.5, 99.5])
    scaled = (samples - low) * (255 / max(high - low, 1e-6))
    return np.asarray(np.clip(scaled, 0, 255), dtype=np.uint8)


def _reduction(photograph: npt.NDArray[np.uint8], pixels: float) -> int:
    return max(1, int(np.ceil(np.sqrt(photograph.size / pixels) - 0.2)))


def find_features(photograph: npt.NDArray[np.uint8], reduction: int) -> _Features:
    """The strongest SIFT features of a photograph reduced by a whole number."""
    if reduction > 1:
        rows, columns = (n // reduction for n in photograph.shape)
        whole = photograph[: rows * reduction, : columns * reduction]
        photograph = np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    # the precise upscale: without it every point lies a quarter of a pixel off
    sift = cv2.SIFT.create(nfeatures=MOST_FEATURES, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(photograph, np.empty(0, np.uint8))
    points = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64).reshape(-1, 2)
    descriptors = np.zeros((0, 128)) if descriptors is None else descriptors
    return _Features((points + 0.5) * reduction - 0.5, np.asarray(descriptors, dtype=np.float32), reduction)


def _registered(a: _Features, b: _Features) -> PairSighting | None:
    """The registration by two sets of features, if they suffice."""
    p, q = _match(a, b)
    if len(p) < FEWEST:
        return None
    fitted, kept = cv2.findHomography(
        p.reshape(-1, 1, 2), q.reshape(-1, 1, 2), cv2.USAC_MAGSAC, TOLERANCE_PX * b.reduction, None, 5000, 0.9999
    )
    if fitted is None or kept is None or int(kept.sum()) < FEWEST:
        return None
    p, q = p[kept.ravel() > 0], q[kept.ravel() > 0]
    H: Array = np.asarray(fitted, dtype=np.float64)
    zoom = np.linalg.det(homography_jacobian(H, p.mean(axis=0)))
    if zoom <= 0:  # a mirror image: not two views of one wall
        return None
    swapped = bool(zoom > 1)
    H_near_far = H if swapped else inverse(H)
    far, near = (p, q) if swapped else (q, p)
    off = cv2.perspectiveTransform(far.reshape(-1, 1, 2), H_near_far).reshape(-1, 2) - near
    return PairSighting(swapped, H_near_far, len(p), float(np.sqrt(np.mean(off**2) / max(zoom, 1 / zoom))))


def _match(a: _Features, b: _Features) -> tuple[Array, Array]:
    """Points (n, 2) of both photographs that pass the ratio test of their descriptors."""
    if len(a.points) < 2 or len(b.points) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    # from the poorer set to the richer one, which may extend beyond the poorer's frame
    poor, rich = (a, b) if len(a.points) <= len(b.points) else (b, a)
    pairs = cv2.BFMatcher().knnMatch(poor.descriptors, rich.descriptors, k=2)
    good = [best for best, second in pairs if best.distance < RATIO * second.distance]
    p = poor.points[[match.queryIdx for match in good]]
    q = rich.points[[match.trainIdx for match in good]]
    return (p, q) if poor is a else (q, p)
