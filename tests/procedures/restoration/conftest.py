from dataclasses import dataclass

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures.restoration.masks.blur_models import mask_stack, path_shape, pillbox
from procedures.restoration.masks.blur_operator import Array, MaskStack
from procedures.restoration.masks.mask_fields import MaskField, Masks


def vibration(seed: int) -> Array:
    """A smooth closed random path of the rig."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, 400)
    a = rng.standard_normal((2, 3, 2)) / np.arange(1, 4)[None, :, None]
    terms = np.stack([np.cos(k * t) for k in (1, 2, 3)]), np.stack([np.sin(k * t) for k in (1, 2, 3)])
    path = np.stack([sum(a[d, :, s] @ terms[s] for s in (0, 1)) for d in (0, 1)], axis=1)
    middle = (path.max(axis=0) + path.min(axis=0)) / 2
    return path_shape(path - middle)


@dataclass(frozen=True)
class Scene:
    """Truth and photographs: picture and depth on the extended grid, photographs (2, 1, H, W), masks."""

    sharp: Array
    w: Array
    z: Array
    stacks: list[Masks]

    @property
    def R(self) -> int:
        return self.stacks[0].R

    def picture_error(self, sharp: Array, rim: int = 12) -> float:
        R = self.R
        d = (sharp[0] - self.sharp[0, R:-R, R:-R])[rim:-rim, rim:-rim]
        return float(255 * np.sqrt(np.mean(d**2)))

    def depth_error(self, w: Array, rim: int = 12) -> float:
        R = self.R
        return float(np.sqrt(np.mean((w - self.w[R:-R, R:-R])[rim:-rim, rim:-rim] ** 2)))


def scene(stacks: list[Masks], shape: tuple[int, int], noise_db: float, seed: int = 3) -> Scene:
    """Dots, lines and grain in front of a slope and a near square; noise in dB below the photographs' variance."""
    rng = np.random.default_rng(seed)
    R = stacks[0].R
    H, W = shape[0] + 2 * R, shape[1] + 2 * R
    sharp = 0.55 + 0.25 * np.sign(gaussian_filter(rng.standard_normal((H, W)), 4))
    sharp += 0.35 * np.clip(gaussian_filter(rng.standard_normal((H, W)), 1) * 2, -1, 0)
    sharp = np.clip(sharp + 0.02 * rng.standard_normal((H, W)), 0.03, 0.95)[None]
    y, x = np.mgrid[0:H, 0:W]
    w = 3.4 - 1.6 * x / W
    w = np.where((y > H * 0.55) & (x > W * 0.5), w + 1.0, w)
    z = []
    for stack in stacks:
        blur = MaskField.of(stack).blur(shape, np.float64)
        blur.focus(w)
        clean = blur.blur(sharp)
        z.append(clean + rng.standard_normal(clean.shape) * clean.std() * 10 ** (-noise_db / 20))
    return Scene(sharp, w, np.stack(z), stacks)


@pytest.fixture(scope="session")
def defocus_stacks() -> list[MaskStack]:
    return [mask_stack(pillbox(), 4.4, ratio=ratio, R=7) for ratio in (1.0, 1.25)]


@pytest.fixture(scope="session")
def vibration_shapes() -> list[Array]:
    return [vibration(seed) for seed in (1, 2)]


@pytest.fixture(scope="session")
def vibration_stacks(vibration_shapes: list[Array]) -> list[MaskStack]:
    return [mask_stack(shape, 4.6, R=6) for shape in vibration_shapes]


@pytest.fixture(scope="session")
def vibrating(vibration_stacks: list[MaskStack]) -> Scene:
    return scene(vibration_stacks, (96, 112), 40.0)
