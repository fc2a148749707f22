"""Local planes fitted to a depth map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.restoration.masks.array_loops import gaussian
from procedures.restoration.masks.blur_operator import Array

TRUNCATE = 3.5
"""Extent of the windows in sigma, where a Gaussian has 0.2 % of its height."""


@dataclass(frozen=True)
class Planes:
    """The plane about every pixel (H, W): its value, slopes down and across per pixel, and the known mass in its
    window."""

    value: Array
    down: Array
    across: Array
    mass: Array


def fit_planes(w: Array, known: Array, sigma: float) -> Planes:
    """Least-squares planes of w (H, W) under a Gaussian window of `sigma` pixels, weighted by `known`.

    Slopes are regularised, so that far from any known depth a plane is a mean.
    """

    def mean(a: Array) -> Array:
        return gaussian(a, sigma, TRUNCATE)

    y, x = np.indices(w.shape).astype(w.dtype)
    mass = mean(known)
    m = mass + 1e-12
    mx, my, mw = mean(known * x) / m, mean(known * y) / m, mean(known * w) / m
    xx = mean(known * x * x) / m - mx**2 + sigma / 4
    yy = mean(known * y * y) / m - my**2 + sigma / 4
    xy = mean(known * x * y) / m - mx * my
    xw, yw = mean(known * x * w) / m - mx * mw, mean(known * y * w) / m - my * mw
    det = xx * yy - xy**2
    across, down = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
    return Planes(mw + across * (x - mx) + down * (y - my), down, across, mass)
