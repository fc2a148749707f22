"""Depth in metres from two apertures: how far the distances err, and how many lie within the stated uncertainty.

    python -m tests.benchmarks.restoration_metres [--seeds 1 2 3 4] [--noise 40]     odd: floor, box; even: wall, ball

Scenes of 0.5 to 3 m before a lens of 12 mm at f/2.8 and f/3.5, 6 um pixels, noise in dB below the photographs. Light
from a third of a pixel each is spread by the lens's own blur circles, drawn at a 27th of a pixel, and summed over
pixels; the restoration's code is not used. The camera's settings are known exactly, or with errors of their stated
uncertainty.
"""

import time
from dataclasses import replace

import numpy as np
from scipy.ndimage import zoom
from scipy.signal import fftconvolve

from procedures import pillbox, stacks_of
from procedures.restoration.joint.estimate import RestorationParameters, restoration_of
from procedures.restoration.masks.thin_lens import CameraSetting, relation
from procedures.restoration.metres import (
    BEHIND,
    FRONT,
    CameraUncertainty,
    Distances,
    depth_spread,
    distances_of,
)
from tests.benchmarks import options
from tests.benchmarks.restoration_scenes import picture

Array = np.ndarray
SHAPE, PAD, RIM = (140, 180), 12, 12
FOCUS_MM = {FRONT: 3600.0, BEHIND: 430.0}
SCENE, FINE, LEVELS = 3, 9, 160
"""Points of light along a pixel, and samples of a blur circle along their spacing. Light from the pixels' centres alone
would suit the masks, which are sums over pixels, better than light of real scenes does."""
CAMERAS = 60
"""Random cameras for each scene."""
SIDES, KINDS = (FRONT, BEHIND), ("wall", "floor")


def settings(focus_mm: float) -> tuple[CameraSetting, CameraSetting]:
    """Both photographs'."""
    first, second = (CameraSetting(12.0, number, focus_mm, 6.0) for number in (2.8, 3.5))
    return first, second


def disc(radius: float) -> Array:
    """A blur circle over pixels."""
    n = int(np.ceil(radius)) + 1
    at = (np.arange((2 * n + 1) * FINE) + 0.5) / FINE - n - 0.5
    inside = np.hypot(at[:, None], at) <= max(radius, 1e-9)
    light = inside.reshape(2 * n + 1, FINE, 2 * n + 1, FINE).sum(axis=(1, 3)).astype(float)
    return light / light.sum() if light.sum() else np.eye(1)


def photograph(sharp: Array, radius_px: Array) -> Array:
    """Every point's light over the circle of its own radius."""
    out, radius = np.zeros_like(sharp), SCENE * radius_px
    low, high = radius.min(), radius.max()
    level = np.rint((radius - low) / max(high - low, 1e-9) * (LEVELS - 1)).astype(int)
    for k in np.unique(level):
        circle = disc(low + (high - low) * k / (LEVELS - 1))
        out += fftconvolve(np.where(level == k, sharp, 0.0), circle, mode="same")
    return pixels(out)


def pixels(scene: Array) -> Array:
    """Means over the photograph's pixels, without the scene's margin."""
    height, width = (n // SCENE for n in scene.shape)
    return scene.reshape(height, SCENE, width, SCENE).mean(axis=(1, 3))[PAD:-PAD, PAD:-PAD]


def distances_mm(shape: tuple[int, int], kind: str) -> Array:
    """A floor that recedes with a near box on it, or a slanted wall with a ball before it."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / np.array([shape[0] - 1.0, shape[1] - 1.0])[:, None, None]
    if kind == "floor":
        d = 1 / (1 / 3000 + y * (1 / 700 - 1 / 3000))
        return np.where((np.abs(x - 0.65) < 0.18) & (np.abs(y - 0.55) < 0.25), 620.0, d)
    d = 900 + 1900 * x
    ball = 1 - ((x - 0.35) ** 2 + (y - 0.5) ** 2) / 0.05
    return np.where(ball > 0, 700 - 150 * np.sqrt(np.clip(ball, 0, None)), d)


def random_camera(setting: CameraSetting, known: CameraUncertainty, rng: np.random.Generator) -> CameraSetting:
    """Camera settings with random errors."""
    focus, scale = 1 + known.focus * rng.standard_normal(), 1 + known.scale * rng.standard_normal()
    return replace(setting, focus_mm=setting.focus_mm * focus, f_number=setting.f_number / scale)


def within(found: Distances, truth: Array) -> Array:
    """Whether each determined distance is within 2 sigma, (n,)."""
    off = ((found.metres - truth) / found.std)[RIM:-RIM, RIM:-RIM]
    return np.abs(off[np.isfinite(off)]) < 2


def trial(side: str, kind: str, seed: int, noise_db: float) -> tuple[Array, Array]:
    """Which of the distances are within 2 sigma: for an exactly known camera, and for random ones."""
    rng, known = np.random.default_rng(seed), CameraUncertainty()
    camera = settings(FOCUS_MM[side])
    extended = (SHAPE[0] + 2 * PAD, SHAPE[1] + 2 * PAD)
    sharp = zoom(picture(extended, rng), SCENE, order=1, mode="nearest", grid_mode=True)
    truth = distances_mm(sharp.shape, kind)
    clean = [photograph(sharp, np.abs(one.blur_radius_px(truth))) for one in camera]
    z = [(one + one.std() * 10 ** (-noise_db / 20) * rng.standard_normal(SHAPE))[None] for one in clean]
    truth = 1e-3 / pixels(1 / truth)
    ratio, offset = relation(*camera)
    widest = float(np.abs(camera[0].blur_radius_px(np.array([480.0, 3200.0]))).max())
    start = time.process_time()
    masks = stacks_of([pillbox()] * 2, (1.0, ratio), widest, SHAPE, (0.0, offset))
    found = restoration_of(z, masks, RestorationParameters())
    of_w = depth_spread(found, z, masks, pillbox(), [(1.0, 0.0), (ratio, offset)])
    exact_distances = distances_of(*of_w, camera[0], side, CameraUncertainty(0.0, 0.0))
    exact = within(exact_distances, truth)
    cameras = [random_camera(camera[0], known, rng) for _ in range(CAMERAS)]
    random = np.concatenate([within(distances_of(*of_w, one, side, known), truth) for one in cameras])
    print(
        f"{side:7} {kind:6} {seed}: determined {exact_distances.determined:.0%}, error "
        f"{np.nanmedian(np.abs(exact_distances.metres - truth)):.3f} m "
        f"(median), within 2 sigma {exact.mean():.1%}, of random cameras {random.mean():.1%}; "
        f"{time.process_time() - start:.0f} s",
        flush=True,
    )
    return exact, random


def main() -> None:
    """Print each scene's figures."""
    asked = options(__doc__, seeds=[1, 2, 3, 4], noise=40.0)
    cases = [(side, KINDS[n % 2], n, asked.noise) for side in SIDES for n in asked.seeds]
    exact, random = (np.concatenate(one) for one in zip(*(trial(*case) for case in cases), strict=True))
    print(f"{exact.mean():.1%} of all distances are within 2 sigma, {random.mean():.1%} with random cameras")


if __name__ == "__main__":
    main()
