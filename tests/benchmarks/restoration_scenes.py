"""Scenes for restoration beside the shared pairs: discs, lines, dots, grain; slopes, bumps and steps."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.blur_models import mask_stack, path_shape, pillbox, uniform_motion
from procedures.restoration.masks.blur_operator import BlurOperator, MaskStack

Array = NDArray[np.float64]
RIM = 16
MAX_W = 5.6


@dataclass(frozen=True)
class Scene:
    """Photographs (P, 1, H, W), their masks, and the truth on the photographs' grid."""

    name: str
    z: Array
    stacks: list[MaskStack]
    sharp: Array
    w: Array

    def error(self, u: Array) -> float:
        """RMSE of a picture (H, W), grey levels of 255, rim left out."""
        return float(255 * np.sqrt(np.mean((u - self.sharp)[RIM:-RIM, RIM:-RIM] ** 2)))

    def w_error(self, w: Array) -> float:
        """RMSE of a depth map, pixels, rim left out."""
        return float(np.sqrt(np.mean((w - self.w)[RIM:-RIM, RIM:-RIM] ** 2)))


def picture(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Discs over a cloudy ground, thin dark curves, dots and grain, white = 1."""
    H, W = shape
    ground = gaussian_filter(rng.standard_normal(shape), 25)
    u = 0.6 + 0.15 * ground / ground.std()
    for _ in range(H * W // 3500):
        x, y, r = rng.integers(0, W), rng.integers(0, H), rng.integers(9, 27)
        cv2.circle(u, (int(x), int(y)), int(r), float(rng.uniform(0.4, 0.9)), -1, cv2.LINE_8)
    for _ in range(H * W // 1500):
        start, turn = rng.uniform(0, (W, H)), rng.uniform(0, 2 * np.pi)
        angle = turn + np.cumsum(rng.normal(0, 0.05, 70)) + rng.normal(0, 0.01) * np.arange(70)
        line = start + np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0)
        cv2.polylines(u, [line.round().astype(np.int32)], False, float(rng.uniform(0.05, 0.3)), int(rng.integers(1, 3)))
    for _ in range(H * W // 220):
        x, y = rng.integers(0, W), rng.integers(0, H)
        cv2.circle(u, (int(x), int(y)), int(rng.integers(0, 3)), float(rng.uniform(0.05, 0.35)), -1)
    return np.clip(u + rng.normal(0, 0.02, shape), 0.04, 0.98)


def depths(shape: tuple[int, int], kind: str) -> Array:
    """w in pixels: "square" (a near square before a slope with a bump), "leaf" (a slanted leaf and a disc), "wall".

    The wall is flat but for its right third, where it bends away and a near square stands before it.
    """
    H, W = shape
    y, x = np.mgrid[0:H, 0:W]
    y, x = y / (H - 1.0), x / (W - 1.0)
    if kind == "wall":
        return 3.0 - 2.4 * np.clip(x - 0.7, 0, 1) + 0.9 * ((x > 0.8) & (y > 0.5))
    if kind == "square":
        w = 1.6 + 3.2 * np.clip((x - 0.1) / 0.75, 0, 1)
        bump = 1 - ((x - 0.55) * W / H) ** 2 / 0.04 - (y - 0.3) ** 2 / 0.04
        w = w - 0.8 * np.sqrt(np.clip(bump, 0, None))
        return np.where((x < 0.4) & (y > 0.45), w + 1.1, w)
    w = 4.4 - 2.2 * y
    leaf = np.abs((x - 0.3) * W / H - 0.5 * (y - 0.5)) < 0.22
    disc = ((x - 0.75) * W / H) ** 2 + (y - 0.55) ** 2 < 0.05
    return np.where(leaf, w + 0.9, np.where(disc, w - 1.0, w))


def wandering(seed: int) -> Array:
    """A closed path of the rig, (600, 2), about its middle."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, 600)
    path = np.zeros((600, 2))
    for k in (1, 2, 3, 4):
        path += (rng.standard_normal((2, 2)) @ np.stack([np.cos(k * t), np.sin(k * t)])).T / k
    return path - (path.max(axis=0) + path.min(axis=0)) / 2


def vibration(seed: int) -> Array:
    """Shape of such a wandering."""
    return path_shape(wandering(seed))


def with_errors(path: Array, rng: np.random.Generator, share: float = 0.03) -> Array:
    """A path as a unit with slow errors records it, of this share of its half-width at most."""
    t = np.linspace(0, np.pi, len(path))[:, None]
    drift = sum(rng.standard_normal(2) * np.cos(k * t) / k for k in (1, 2, 3))
    return np.asarray(path + share * np.abs(path).max() * drift / np.abs(drift).max())


def coma() -> Array:
    """A comatic shape: circles that grow away from a bright point, in an opening of 60 degrees."""
    t = np.linspace(-1, 1, 257)
    x, y = np.meshgrid(t, t)
    shape = np.zeros_like(x)
    for r in np.linspace(0.02, 0.6, 60):
        shape += np.exp(-(((np.hypot(x, y + 0.9 - 1.9 * r) - r) / 0.04) ** 2)) * 0.6 / r**0.5
    shape[np.abs(shape) < 1e-3 * shape.max()] = 0
    return shape


def stacks_of(kind: str, seeds: tuple[int, int] = (21, 22)) -> list[MaskStack]:
    """Masks of both photographs for a kind of blur; seeds : of the two vibrations."""
    shapes, ratio = {
        "pillbox": ([pillbox()] * 2, 1.2),
        "coma": ([coma()] * 2, 1.2),
        "uniform": ([uniform_motion(0.3)] * 2, 1.2),
        "vibration": ([vibration(seed) for seed in seeds], 1.0),
    }[kind]
    return [mask_stack(s, MAX_W, ratio=r, R=8) for s, r in zip(shapes, (1.0, ratio), strict=True)]


def scene(
    blur: str, depth: str, noise_db: float | None, seed: int = 1, shape: tuple[int, int] = (200, 240),
    motions: tuple[int, int] = (21, 22),
) -> Scene:  # fmt: skip
    """One pair. noise_db : noise below the photographs' standard deviation; None is clean but for 16 bits."""
    rng = np.random.default_rng(seed)
    stacks = stacks_of(blur, motions)
    R = stacks[0].R
    extended = (shape[0] + 2 * R, shape[1] + 2 * R)
    u, w = picture(extended, rng), depths(extended, depth)
    z = []
    for stack in stacks:
        photograph = BlurOperator(stack, shape)
        photograph.focus(w)
        clean = photograph.blur(u)
        noise = 0.0 if noise_db is None else clean.std() * 10 ** (-noise_db / 20)
        z.append(np.round((clean + noise * rng.standard_normal(shape)) * 60000) / 60000)
    name = f"{blur} {depth} " + ("clean" if noise_db is None else f"{noise_db:g} dB")
    inside = (slice(R, -R), slice(R, -R))
    return Scene(name, np.stack(z)[:, None], stacks, u[inside], w[inside])
