"""Ray-traced lens: vignetted towards the corners and comatic, measured at one defocus, photographed at others."""

from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.field.interpolate import Recipe, rebuild
from procedures.psf import Psf
from procedures.psf_field import Node, PsfField
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import Array

from .conftest import Scene

SHAPE = (96, 128)
WIDE = 3.4
"""Half-width in pixels of the blur at which the lens was measured."""
COMA_PX, SHADE = 0.1, 0.9
BLOCK = 8


def rays(half_width: float, place: tuple[float, float]) -> Array:
    """Arrival points of the rays of one point, (n, 2) x, y in pixels; place: in half diagonals from the centre."""
    t = np.linspace(-1, 1, 121)
    x, y = (one.ravel() for one in np.meshgrid(t, t))
    # the lens' rear opening, seen from the corner, covers a part of the pupil
    open_ = (x**2 + y**2 <= 1) & ((x + SHADE * place[0]) ** 2 + (y + SHADE * place[1]) ** 2 <= 1)
    x, y = x[open_], y[open_]
    r2 = x**2 + y**2
    along = place[0] * x + place[1] * y
    bent = COMA_PX * np.stack([place[0] * r2 + 2 * along * x, place[1] * r2 + 2 * along * y], axis=1)
    return half_width * np.stack([x, y], axis=1) + bent


def spot(half_width: float, place: tuple[float, float], samples: int, k: int) -> Array:
    """The measured PSF, (k, k), `samples` per pixel: the rays that fall on a photosite about each sample."""
    centres = (np.arange(k) - k // 2) / samples
    across, down = (np.abs(one[None, :] - centres[:, None]) <= 0.5 for one in rays(half_width, place).T)
    h = down.astype(np.float64) @ across.T.astype(np.float64)
    return np.asarray(h / h.sum())


@cache
def lens_field() -> PsfField:
    """The lens's field, measured at 4 x 5 positions without noise."""
    s, k = 2, 19
    nodes = []
    for y in np.linspace(0, SHAPE[0] - 1, 4):
        for x in np.linspace(0, SHAPE[1] - 1, 5):
            h = spot(WIDE, at(x, y), s, k)
            where = np.array([x, y])
            nodes.append(Node(where, 1e-4 * np.eye(2), where, Psf(h, s, 1e-10 * np.eye(k * k)), "", len(nodes)))
    return rebuild("Y", SHAPE, nodes, Recipe("polynomial", 3.0), 12)


def at(x: float, y: float) -> tuple[float, float]:
    half = np.hypot(*SHAPE) / 2
    return (x - (SHAPE[1] - 1) / 2) / half, (y - (SHAPE[0] - 1) / 2) / half


@cache
def photographs(noise_db: float = 40.0) -> Scene:
    """Two apertures of 1 : 1.25: every block of the scene is spread by its own rays."""
    rng, R = np.random.default_rng(8), 7
    H, W = SHAPE[0] + 2 * R, SHAPE[1] + 2 * R
    sharp = 0.55 + 0.25 * np.sign(gaussian_filter(rng.standard_normal((H, W)), 3))
    sharp = np.clip(sharp + 0.35 * np.clip(gaussian_filter(rng.standard_normal((H, W)), 1.5) * 3, -1, 0), 0.03, 0.95)
    w = np.where(np.arange(W) // BLOCK < W // BLOCK // 2, 2.2, 3.2) * np.ones((H, 1))
    z = []
    for ratio in (1.0, 1.25):
        light = np.zeros((H + 2 * R, W + 2 * R))
        for i in range(0, H, BLOCK):
            for j in range(0, W, BLOCK):
                points = rays(ratio * w[i, j], at(j + BLOCK / 2 - R, i + BLOCK / 2 - R))
                part = fftconvolve(sharp[i : i + BLOCK, j : j + BLOCK], pixels(points, R))
                light[i : i + part.shape[0], j : j + part.shape[1]] += part
        inside = light[2 * R : 2 * R + SHAPE[0], 2 * R : 2 * R + SHAPE[1]]
        z.append(inside + rng.standard_normal(SHAPE) * inside.std() * 10 ** (-noise_db / 20))
    return Scene(sharp[None], w, np.stack(z)[:, None], [mask_stack(pillbox(), 4.4, R=R)])


def pixels(points: Array, R: int) -> Array:
    """Rays from a uniform pixel onto photosites: each is distributed over four pixels."""
    mask = np.zeros((2 * R + 1, 2 * R + 1))
    column, row = points.T + R
    i, j = np.floor(row).astype(int), np.floor(column).astype(int)
    for di, down in ((0, 1 - (row - i)), (1, row - i)):
        for dj, across in ((0, 1 - (column - j)), (1, column - j)):
            np.add.at(mask, (i + di, j + dj), down * across)
    return mask / mask.sum()
