"""Priors of picture and depth: weights on differences of neighbours."""

import numpy as np

from procedures.restoration.masks.array_loops import add_diffusion
from procedures.restoration.masks.blur_operator import Array


def differences(x: Array) -> tuple[Array, Array]:
    """Differences of neighbours down and across, (..., H - 1, W) and (..., H, W - 1)."""
    return np.diff(x, axis=-2), np.diff(x, axis=-1)


def diffuse(x: Array, down: Array | float = 1.0, across: Array | float = 1.0) -> Array:
    """Gradient of half the weighted sum of squared differences: -div(g grad x) of (6.3)."""
    out = np.zeros(x.shape, x.dtype)
    add_diffusion(out, np.ascontiguousarray(x), 1.0, down, across)
    return out


def roughness(x: Array, down: Array | float = 1.0, across: Array | float = 1.0) -> float:
    """Half the weighted sum of squared differences."""
    y, z = differences(x)
    return 0.5 * float(np.sum(down * y**2) + np.sum(across * z**2))


def bending(x: Array, down: Array, across: Array) -> float:
    """Half the weighted sum of squared second differences of x (H, W), see `passes.add_bending`.

    down, across : weights of differences, (H - 1, W) and (H, W - 1).
    """
    y, z = differences(x)
    along_y = np.minimum(down[1:], down[:-1]) * np.diff(y, axis=0) ** 2
    along_x = np.minimum(across[:, 1:], across[:, :-1]) * np.diff(z, axis=1) ** 2
    cell = np.minimum(np.minimum(down[:, 1:], down[:, :-1]), np.minimum(across[1:], across[:-1]))
    return 0.5 * float(np.sum(along_y) + np.sum(along_x) + 2 * np.sum(cell * np.diff(y, axis=1) ** 2))


def total_variation(u: Array, least: float) -> tuple[Array, Array]:
    """Weights 1 / |grad u| of lagged diffusivity (6.10), over all channels jointly (6.11), for gradients of `least` and
    more."""
    dy, dx = differences(u)
    y2, x2 = (dy**2).sum(axis=0), (dx**2).sum(axis=0)
    down = y2 + _centred(x2, down=True)
    across = x2 + _centred(y2, down=False)
    return 1 / np.maximum(np.sqrt(down), least), 1 / np.maximum(np.sqrt(across), least)


def _centred(squares: Array, *, down: bool) -> Array:
    """Squared differences of the other direction, interpolated to the places of this one."""
    if down:
        wide = np.pad(squares, ((0, 0), (1, 1)), mode="edge")
        middle = (wide[:, 1:] + wide[:, :-1]) / 2
        return np.asarray((middle[1:] + middle[:-1]) / 2)
    tall = np.pad(squares, ((1, 1), (0, 0)), mode="edge")
    middle = (tall[1:] + tall[:-1]) / 2
    return np.asarray((middle[:, 1:] + middle[:, :-1]) / 2)


def depth_variation(w: Array, slope: float) -> tuple[Array, Array]:
    """Weights of the total variation of w by lagged diffusivity: 1 up to the typical `slope`, then slope / |grad w|."""
    down, across = total_variation(w[None], slope)
    return down * w.dtype.type(slope), across * w.dtype.type(slope)


def steps_allowed(w: Array, step: float) -> tuple[Array, Array]:
    """Weights 1 / (1 + (d / step)^4) of changes d of w: slopes are smoothed, depth edges preserved."""
    # squared twice: NumPy takes a hundred times as long for fourth powers of negative numbers
    down, across = (np.square(np.square(d / step)) for d in differences(w))
    return 1 / (1 + down), 1 / (1 + across)
