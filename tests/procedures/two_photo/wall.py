"""A textured wall photographed from two distances through known optics, the ground truth of the estimates."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from procedures import Outcome, Plane
from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf, estimate_psf_of_pair

Array = np.ndarray
Otf = Callable[[Array, Array], Array]

TEXELS = 3.0
"""Texels of the wall per near pixel."""


def gaussian(sigma_x: float, sigma_y: float) -> Otf:
    """The OTF of a Gaussian, in pixels."""
    return lambda fx, fy: np.exp(-2 * np.pi**2 * ((sigma_x * fx) ** 2 + (sigma_y * fy) ** 2))


def samples_of(otf: Otf, s: int, k: int) -> Array:
    """The PSF on the s grid, its band cut to s/2, sum 1."""
    f = np.fft.fftfreq(256) * s
    h = np.fft.fftshift(np.fft.ifft2(np.broadcast_to(otf(f, f[:, None]), (256, 256))).real)
    cut = h[128 - k // 2 : 129 + k // 2, 128 - k // 2 : 129 + k // 2]
    return cut / cut.sum()


def estimate(near: Array, far: Array, parameters: TwoPhotoParameters | None = None) -> Outcome[TwoPhotoPsf]:
    """Estimate from samples of both photographs."""
    a, b = (Plane("Y", np.asarray(samples, np.float32), 1 / 65535) for samples in (near, far))
    return estimate_psf_of_pair(a, b, parameters)


@dataclass(frozen=True)
class Pair:
    """Two photographs, and the true map between them."""

    near: Array
    far: Array
    H_near_far: Array


def leaves(size: int, rng: np.random.Generator) -> Array:
    """A wall of discs whose sizes follow a power law: detail of all sizes."""
    wall = np.full((size, size), 0.4, np.float32)
    count = size * size // 300
    radius = (2.0**-2 - rng.random(count) * (2.0**-2 - 300.0**-2)) ** -0.5
    places, levels = rng.random((count, 2)) * size, rng.uniform(0.05, 0.95, count)
    for (x, y), r, level in zip(places, radius, levels, strict=True):
        cv2.circle(wall, (int(16 * x), int(16 * y)), int(16 * r), float(level), -1, shift=4)
    return cv2.GaussianBlur(wall, (0, 0), 0.6)


def photograph(wall: Array, H: Array, size: int, otf: Otf, texels_per_px: float) -> Array:
    """The wall through H (pixels -> texels) and the optics, (size, size), without noise.

    It is sampled finer than the pixels, after a small known blur by which the optics' OTF is divided.
    """
    fine, rim = max(3, round(1.5 * texels_per_px / TEXELS)), 10
    blur = 0.25 if texels_per_px <= TEXELS else 0.14
    smooth = cv2.GaussianBlur(wall, (0, 0), blur * texels_per_px)
    n = (size + 2 * rim) * fine
    to_px = np.array([[1 / fine, 0, -rim], [0, 1 / fine, -rim], [0, 0, 1]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(smooth, H @ to_px, (n, n), flags=flags, borderMode=cv2.BORDER_REFLECT)
    fx, fy = np.fft.rfftfreq(n) * fine, np.fft.fftfreq(n)[:, None] * fine
    r2 = fx**2 + fy**2
    transfer = np.where(r2 < (fine / 2) ** 2, otf(fx, fy) * np.exp(2 * np.pi**2 * blur**2 * r2), 0).astype(np.float32)
    whole = np.fft.irfft2(np.fft.rfft2(warped) * transfer, (n, n))
    return whole[rim * fine : (rim + size) * fine : fine, rim * fine : (rim + size) * fine : fine]


def photographs(
    otf: Otf,
    *,
    noise: float = 0.002,
    zoom: float = 4.6,
    size: int = 120,
    tilt: float = 0.0,
    roll: float = 0.0,
    seed: int = 1,
    near_otf: Otf | None = None,
) -> Pair:
    """A near and a far photograph, the far one tilted and rolled, with noise of that standard deviation in both."""
    rng = np.random.default_rng(seed)
    near_size = int(size * zoom * 1.04)
    wall = leaves(int(near_size * TEXELS * 1.15), rng)
    middle = len(wall) / 2 + rng.uniform(-3, 3, 2)

    def view(scale: float, n: int, tilted: float, rolled: float) -> Array:
        c, s = np.cos(rolled), np.sin(rolled)
        centred = np.array([[1, 0, -(n - 1) / 2], [0, 1, -(n - 1) / 2], [0, 0, 1]])
        leaning = np.array([[1, 0, 0], [0, 1, 0], [tilted / n, -0.6 * tilted / n, 1]])
        turned = np.array([[scale * c, -scale * s, middle[0]], [scale * s, scale * c, middle[1]], [0, 0, 1]])
        return turned @ leaning @ centred

    H_near, H_far = view(TEXELS, near_size, 0, 0), view(TEXELS * zoom, size, tilt, roll)
    near = photograph(wall, H_near, near_size, near_otf or otf, TEXELS)
    far = photograph(wall, H_far, size, otf, TEXELS * zoom)
    near, far = (image + rng.normal(0, noise, image.shape) for image in (near, far))
    return Pair(near.astype(np.float32), far.astype(np.float32), np.linalg.inv(H_near) @ H_far)
