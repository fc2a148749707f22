"""Damaged copies of a good pair, as by changes between two photographs or inside a camera, and rotated light."""

import cv2
import numpy as np
import scipy.fft

from ..pattern_psf.damage import Array, Change, denoised, halved, rounded, sharpened, soft
from .endless import RIM_PX, TEXELS, photographs, pink
from .wall import Otf, Pair


def half_softened(sigma_px: float) -> Change:
    def change(x: Array) -> Array:
        half = soft(x, sigma_px)
        half[:, : x.shape[1] // 2] = x[:, : x.shape[1] // 2]
        return half

    return change


def with_gradient(share: float) -> Change:
    """Add the picture's gradient along x, relative to its contrast, like light from the side on relief."""

    def change(x: Array) -> Array:
        gradient = np.gradient(soft(x, 0.5), axis=1)
        return x + share * gradient * x.std() / gradient.std()

    return change


def compressed(quality: int, gamma: float = 2.2) -> Change:
    """JPEG of eight bits, with a tone curve."""

    def change(x: Array) -> Array:
        white = 1.02 * float(x.max())
        levels = np.round(255 * np.clip(x / white, 0, 1) ** (1 / gamma)).astype(np.uint8)
        _, coded = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, quality])
        return (cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE) / 255.0) ** gamma * white

    return change


def moved(length_px: float) -> Change:
    """Uniform motion along x during the exposure."""

    def change(x: Array) -> Array:
        kernel = np.zeros((1, 7), np.float32)
        for t in 3 + np.linspace(-length_px / 2, length_px / 2, 41):
            first = int(t)
            kernel[0, first] += 1 - (t - first)
            kernel[0, first + 1] += t - first
        return cv2.filter2D(x, -1, kernel / kernel.sum())

    return change


BOTH, NEAR, FAR = (True, True), (True, False), (False, True)
CHANGES: dict[str, tuple[Change, tuple[tuple[bool, bool], ...]]] = {
    "softened 0.3": (lambda x: soft(x, 0.3), (NEAR, FAR)),
    "softened 0.45": (lambda x: soft(x, 0.45), (NEAR, FAR)),
    "softened 0.6": (lambda x: soft(x, 0.6), (NEAR, FAR)),
    "half softened 0.7": (half_softened(0.7), (NEAR, FAR)),
    "sharpened 0.3": (sharpened(0.3, 1.0), (NEAR, FAR, BOTH)),
    "sharpened 1": (sharpened(1.0, 1.0), (NEAR, FAR, BOTH)),
    "gradient 0.1": (with_gradient(0.1), (NEAR, FAR)),
    "gradient 0.3": (with_gradient(0.3), (NEAR, FAR)),
    "JPEG 70": (compressed(70), (NEAR, FAR, BOTH)),
    "JPEG 85": (compressed(85), (NEAR, FAR, BOTH)),
    "JPEG 95": (compressed(95), (NEAR, FAR, BOTH)),
    "linear JPEG 85": (compressed(85, 1.0), (NEAR, FAR, BOTH)),
    "moved 1": (moved(1.0), (NEAR, FAR)),
    "moved 2": (moved(2.0), (NEAR, FAR)),
    "gamma 0.8": (lambda x: (np.maximum(x, 0) / x.max()) ** 0.8 * x.max(), (NEAR, FAR, BOTH)),
    "gamma 1.25": (lambda x: (np.maximum(x, 0) / x.max()) ** 1.25 * x.max(), (NEAR, FAR, BOTH)),
    "black crushed": (lambda x: np.maximum(x - np.percentile(x, 10), 0), (NEAR, FAR, BOTH)),
    "noisy 0.02": (lambda x: x + np.random.default_rng(0).normal(0, 0.02, x.shape), (NEAR, FAR, BOTH)),
    "halved": (halved, (NEAR,)),
    "median": (denoised("median"), (NEAR, FAR)),
    "smoothed": (denoised("bilateral"), (NEAR, FAR)),
    "shaded": (lambda x: x * (1 - 0.3 * np.linspace(0, 1, x.shape[1])), (NEAR, FAR)),
    "six bits": (rounded(63), (NEAR, FAR, BOTH)),
}
"""The change, and the photographs (near, far) it is applied to."""


def names() -> list[str]:
    """Names of all damaged pairs."""
    where = {NEAR: "near", FAR: "far", BOTH: "both"}
    return [f"{where[which]} {name}" for name, (_, places) in CHANGES.items() for which in places]


def damaged(pair: Pair, name: str) -> tuple[Array, Array]:
    """The near and the far photograph, float32 from black 0 to white 1."""
    where, name = name.split(" ", 1)
    change = CHANGES[name][0]
    photographs = []
    for place, photograph in (("near", pair.near), ("far", pair.far)):
        changed = change(photograph) if where in (place, "both") else photograph
        photographs.append(np.clip(changed, 0, 1).astype(np.float32))
    return photographs[0], photographs[1]


def relief(otf: Otf, turned_deg: float, *, zoom: float = 4.3, size: int = 150, seed: int = 1) -> Pair:
    """A rough wall with little paint, light 40 degrees above it, rotated about its normal for the far photograph."""
    whole = scipy.fft.next_fast_len((int(size * zoom) + 2 * RIM_PX) * TEXELS, real=True)
    rng = np.random.default_rng(seed)
    slopes = np.gradient(pink(whole, rng, power=1.7))
    paint = (pink(whole, rng) - 0.4) / 0.12
    y, x = (-0.18 * slope / slopes[1].std() for slope in slopes)

    def lit(direction: float) -> Array:
        e = np.radians(40)
        light = np.cos(e) * (np.cos(direction) * x + np.sin(direction) * y) + np.sin(e)
        shading = np.maximum(light, 0) / np.sqrt(1 + x * x + y * y) / np.sin(e)
        return (0.4 * shading * (1 + 0.075 * paint)).astype(np.float32)

    near, far = lit(0.5), lit(0.5 + np.radians(turned_deg))
    return photographs(otf, wall=near, far_wall=far, zoom=zoom, size=size, seed=seed)
