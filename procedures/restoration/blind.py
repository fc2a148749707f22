"""Prototype masks of unknown rig motion, from a flat part of the scene: multichannel blind deconvolution.

Two photographs of one picture through two masks satisfy z1 * h2 = z2 * h1 whatever the picture, which gives the masks
a first time; then picture and masks are fitted in turn, the picture with a total-variation prior, the masks
non-negative (after Sroubek and Milanfar 2012). The masks contain the shift between the photographs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import eigh
from scipy.ndimage import map_coordinates
from scipy.optimize import nnls
from scipy.signal import fftconvolve

from procedures.outcome import BadInput, Refused
from procedures.restoration.cost import conjugate_gradients
from procedures.restoration.forward import Array
from procedures.restoration.priors import diffuse, total_variation


@dataclass(frozen=True)
class Prototypes:
    """Masks of both photographs (2, K, K), sum 1, about their common centre, and shapes on [-1, 1] scaled to them.

    half_width : of the masks, pixels: the w of the flat part; residual : of the last fit, white = 1.
    """

    masks: Array
    shapes: Array
    half_width: float
    residual: float


def prototype_shapes(parts: Array, largest: int, rounds: int = 12) -> Prototypes:
    """Masks of a flat part (2, H, W) seen in both photographs, support found up to half-size `largest`.

    Raises
    ------
    BadInput
        If the part is smaller than eight masks.
    Refused
        If no masks explain the two parts: they are not of one depth, or the rig turned.
    """
    if len(parts) != 2:
        raise BadInput(f"unknown motion is estimated from two photographs, got {len(parts)}", "give the first two")
    if min(parts.shape[1:]) < 8 * largest:
        raise BadInput(
            f"the flat part must be at least {8 * largest} pixels each way, got {parts.shape[2]} x {parts.shape[1]}",
            "mark a larger one, or lower --max-w",
        )
    R = support(parts, largest)
    masks = _first_masks(parts, R)
    u = np.pad(parts.mean(axis=0), R, mode="edge")
    for n in range(rounds):
        weight = 1e-3 * 0.6**n
        u = _picture(parts, masks, u, max(weight, 2e-5))
        masks = _masks(parts, u, R)
    residual = np.sqrt(np.mean([(fftconvolve(u, h, mode="valid") - z) ** 2 for h, z in zip(masks, parts, strict=True)]))
    if residual > 0.2 * parts.std():
        raise Refused("no pair of masks explains the marked part in both photographs", "mark a part of one distance")
    masks = centred(masks)
    half = reach(masks)
    return Prototypes(masks, np.stack([as_shape(h, half) for h in masks]), half, float(residual))


def _patches(z: Array, size: int) -> Array:
    """Rows: the neighbourhoods (size x size) of z, flipped so that a row times a mask is a convolution's sample."""
    views = np.lib.stride_tricks.sliding_window_view(z, (size, size))[..., ::-1, ::-1]
    return views.reshape(-1, size * size)


def cross_relation(parts: Array, R: int) -> Array:
    """Matrix M of |z1 * h2 - z2 * h1|^2 = (h1, h2)' M (h1, h2) per sample, over both masks' entries."""
    size = 2 * R + 1
    z1, z2 = (_patches(z - z.mean(), size) for z in parts)
    both = np.concatenate([-z2, z1], axis=1)
    return np.asarray(both.T @ both / len(both))


def support(parts: Array, largest: int) -> int:
    """Least half-size of masks that satisfies the cross relation nearly as well as the largest does.

    Too small a support leaves a residual far above the noise; beyond the true one nothing more is gained.
    """
    sizes = list(range(2, largest + 1))
    left = np.array([float(np.linalg.eigvalsh(cross_relation(parts, R))[0]) for R in sizes])
    left = np.maximum(left, left[-1])
    within = np.log(left) < np.log(left[-1]) + 0.25 * (np.log(left[0]) - np.log(left[-1]))
    return min(largest, sizes[int(np.argmax(within))] + 1)


def _first_masks(parts: Array, R: int) -> Array:
    """Non-negative masks of sum 1 that satisfy the cross relation best, its noise subtracted."""
    size = 2 * R + 1
    M = cross_relation(parts, R)
    values, vectors = eigh(M)
    # noise lifts every eigenvalue by its variance; the masks live where nothing but noise is left
    root = np.sqrt(np.maximum(values - values[0], 0) + 1e-3 * values[0] + 1e-12)[:, None] * vectors.T
    tie = np.sqrt(values[-1]) * np.repeat(np.eye(2), size * size, axis=1)
    target = np.concatenate([np.zeros(len(root)), np.sqrt(values[-1]) * np.ones(2)])
    h, _ = nnls(np.concatenate([root, tie]), target)
    return _normalised(h.reshape(2, size, size))


def _normalised(masks: Array) -> Array:
    return np.asarray(masks / np.maximum(masks.sum(axis=(1, 2), keepdims=True), 1e-12))


def _picture(parts: Array, masks: Array, u: Array, weight: float) -> Array:
    """The picture of the part and what surrounds it, by total variation with one relinearisation."""
    flipped = masks[:, ::-1, ::-1]

    def adjoint(e: Array) -> Array:
        return np.asarray(sum(fftconvolve(a, h) for a, h in zip(e, flipped, strict=True)))

    def forward(x: Array) -> Array:
        return np.stack([fftconvolve(x, h, mode="valid") for h in masks])

    for _ in range(2):
        diffusion = total_variation(u[None], 0.01)
        gradient = adjoint(parts - forward(u)) - weight * diffuse(u, *diffusion)
        apply = partial(_normal, lambda x: adjoint(forward(x)), weight, diffusion)
        u = u + conjugate_gradients(apply, gradient, 20)
    return u


def _normal(blurred_twice: Callable[[Array], Array], weight: float, diffusion: tuple[Array, Array], x: Array) -> Array:
    """The normal equations' left side: blur and its adjoint, and the picture's prior."""
    return blurred_twice(x) + weight * diffuse(x, *diffusion)


def _masks(parts: Array, u: Array, R: int) -> Array:
    """Non-negative masks that blur the picture into each photograph, least squares."""
    size = 2 * R + 1
    A = _patches(u - u.mean(), size)
    gram = A.T @ A
    gram[np.diag_indices_from(gram)] += 1e-6 * np.trace(gram) / len(gram)
    factor = np.linalg.cholesky(gram).T
    found = [nnls(factor, np.linalg.solve(factor.T, A.T @ (z - z.mean()).ravel()))[0] for z in parts]
    masks = np.stack(found).reshape(2, size, size)
    masks[masks < 0.01 * masks.max()] = 0
    return _normalised(masks)


def centred(masks: Array) -> Array:
    """The same masks about the middle of their common extent: a common shift moves only the picture."""
    rows, columns = (np.flatnonzero(masks.sum(axis=axes)) for axes in ((0, 2), (0, 1)))
    R = masks.shape[1] // 2
    shift = (round(R - (rows[0] + rows[-1]) / 2), round(R - (columns[0] + columns[-1]) / 2))
    return np.asarray(np.roll(masks, shift, axis=(1, 2)))


def reach(masks: Array) -> float:
    """Half-width of the masks' common support, pixels."""
    R = masks.shape[1] // 2
    rows, columns = np.nonzero(masks.sum(axis=0))
    return float(max(np.abs(rows - R).max(), np.abs(columns - R).max())) + 0.5


def as_shape(mask: Array, half_width: float, size: int = 257) -> Array:
    """The mask as a shape on [-1, 1], its half-width at 1: what (5.3) stretches to every other depth."""
    R = mask.shape[0] // 2
    at = np.linspace(-1, 1, size) * half_width + R
    shape = map_coordinates(mask, np.meshgrid(at, at, indexing="ij"), order=1)
    return np.asarray(np.clip(shape, 0, None))
