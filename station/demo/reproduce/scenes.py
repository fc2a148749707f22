"""The scene of Sorel's simulated experiments: a drawing like a map over a depth with slope, sphere and steep edge."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import center_of_mass, gaussian_filter, maximum_filter, shift

from procedures.restoration.masks.blur_models import gaussian, mask_stack
from procedures.restoration.masks.blur_operator import BlurOperator, MaskStack

Array = npt.NDArray[np.float64]

SHAPE = (245, 356)
RATIO = 1.2
"""Blur of the second photograph over the first's: alpha_2."""
LARGEST_W = 5.5
"""Half the largest PSF of the first photograph, pixels: about 11 x 11."""
RIM = 16
"""Rim excluded from errors, pixels: it was blurred from beyond the frame."""
REACH = 8
GREY_LEVELS = 255
STEP, NEAR_STEP = 0.5, 12
"""Change of w from pixel to pixel at a step, and distance within which windows contain both sides, pixels."""
CONTRAST = 0.122
"""Standard deviation of the texture, white = 1: blurred, it has the error of the thesis's map."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two photographs (2, 1, H, W), white = 1, and their true picture and w, (H, W)."""

    z: Array
    sharp: Array
    w: Array

    def error(self, u: npt.NDArray[np.floating]) -> float:
        """Root mean square error of a picture (H, W), grey levels of 256."""
        return float(GREY_LEVELS * np.sqrt(np.mean(_inside(u - self.sharp) ** 2)))

    def w_error(self, w: npt.NDArray[np.floating]) -> float:
        """Root mean square error of a depth map, pixels."""
        return float(np.sqrt(np.mean(_inside(w - self.w) ** 2)))

    def away_from_steps(self, w: npt.NDArray[np.floating]) -> float:
        """The error where no step of the depth lies within `NEAR_STEP` pixels."""
        steps = np.hypot(*np.gradient(self.w)) > STEP
        away = np.logical_not(_inside(maximum_filter(steps, 2 * NEAR_STEP + 1)))
        return float(np.sqrt(np.mean(_inside(w - self.w)[away] ** 2)))


def _inside(a: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    return a[RIM:-RIM, RIM:-RIM]


def map_drawing(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Thin lines, dots and houses on paper, of varying density, white = 1."""
    rows, columns = shape
    density = gaussian_filter(rng.standard_normal(shape), 30)
    density = np.clip(0.6 + 0.5 * density / density.std(), 0.25, 1)
    paper = gaussian_filter(rng.standard_normal(shape), 12)
    u = 0.82 + 0.05 * paper / paper.std()
    for _ in range(rows * columns // 60):
        x, y = int(rng.integers(0, columns)), int(rng.integers(0, rows))
        if rng.random() > density[y, x]:
            continue
        ink, kind = float(rng.uniform(0.38, 0.66)), rng.integers(0, 3)
        if kind == 0:
            turn = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.15, 14))
            line = (x, y) + 2 * np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)
            cv2.polylines(u, [np.rint(line).astype(np.int32)], False, ink, 1, cv2.LINE_8)
        elif kind == 1:
            cv2.circle(u, (x, y), int(rng.integers(1, 4)), ink, int(rng.choice([1, -1])))
        else:
            wide, high = (int(n) for n in rng.integers(2, 9, 2))
            cv2.rectangle(u, (x, y), (x + wide, y + high), ink, int(rng.choice([1, -1])))
    return np.asarray(np.clip(u + rng.normal(0, 0.01, shape), 0.03, 0.98), dtype=np.float64)


def texture(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Detail everywhere with amplitude 1/f, like a scanned map's hatching and paper, white = 1."""
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    frequency[0, 0] = np.inf
    u = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) / frequency, shape)
    return np.asarray(0.5 + CONTRAST * u / u.std(), dtype=np.float64)


def depth(shape: tuple[int, int]) -> Array:
    """Half the PSF's size, pixels: flat above and below, a slope between, and a quarter of a sphere."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    y, x = y / (shape[0] - 1), x / (shape[1] - 1)
    slope = 1.5 + (LARGEST_W - 1.5) * np.clip((y - 0.2) / 0.6, 0, 1)
    ball = 1 - ((x - 0.5) / 0.3) ** 2 - ((y - 0.5) / 0.42) ** 2
    sphere = np.where(y < 0.5, 1.5 + 3.6 * np.sqrt(np.clip(ball, 0, None)), 0)
    return np.asarray(np.maximum(slope, sphere), dtype=np.float64)


def comatic() -> Array:
    """Prototype with coma and spherical aberration: a bright point that opens into a fan, with a halo."""
    t = np.linspace(-1, 1, 129)
    x, y = np.meshgrid(t, t)
    shape = 0.15 * ((x**2 + y**2) < 0.9).astype(np.float64)
    for r in np.linspace(0.03, 0.55, 40):
        shape += np.exp(-(((np.hypot(x, y + 0.85 - 1.9 * r) - r) / 0.05) ** 2)) * 0.7 / r**0.5
    return np.where(shape > 1e-3 * shape.max(), shape, 0)


def stacks(shape: Array) -> list[MaskStack]:
    """The masks of both photographs for one shape of blur."""
    return [mask_stack(shape, LARGEST_W + 0.3, ratio=ratio, R=REACH) for ratio in (1.0, RATIO)]


def gaussian_stacks(shape: Array) -> list[MaskStack]:
    """Masks of Gaussian shape, of the right size and about the centroid of the right ones."""
    wrong = gaussian()
    centroid = 2 * np.array(center_of_mass(shape)) / (np.array(shape.shape) - 1) - 1
    return stacks(np.asarray(shift(wrong, centroid * (len(wrong) // 2), order=1)))


def pair(
    shape: Array, noise_db: float | None, size: tuple[int, int] = SHAPE, seed: int = 1,
    picture: Callable[[tuple[int, int], np.random.Generator], Array] = texture, picture_seed: int = 0,
) -> Pair:  # fmt: skip
    """Both photographs; noise in decibels below their contrast, None for none."""
    rng = np.random.default_rng(seed)
    wide = (size[0] + 2 * REACH, size[1] + 2 * REACH)
    u, w = picture(wide, np.random.default_rng(picture_seed)), depth(wide)
    photographs = []
    for stack in stacks(shape):
        blur = BlurOperator(stack, size)
        blur.focus(w)
        clean = blur.blur(u)
        noise = 0.0 if noise_db is None else float(clean.std()) * 10 ** (-noise_db / 20)
        photographs.append(clean + noise * rng.standard_normal(size))
    inside = (slice(REACH, -REACH), slice(REACH, -REACH))
    return Pair(np.stack(photographs)[:, None], u[inside], w[inside])
