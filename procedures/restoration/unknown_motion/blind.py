"""Prototype masks of unknown rig motion, from a flat part of the scene: multichannel blind deconvolution.

Two photographs of one picture through two masks satisfy z1 * h2 = z2 * h1 for any picture, which gives initial masks.
Then picture and masks are fitted in turn, the picture with a total-variation prior, the masks non-negative (after
Sroubek and Milanfar 2012). The masks contain the shift between the photographs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.linalg import eigh
from scipy.optimize import nnls
from scipy.signal import fftconvolve

from procedures.outcome import BadInput, Refused
from procedures.restoration.joint.data_term import conjugate_gradients
from procedures.restoration.joint.priors import diffuse, total_variation
from procedures.restoration.masks.blur_models import as_shape
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.free_kernels import about_middle, unit

CROSS = 100.0
"""Weight of the cross relation relative to the fit to the picture, both in squared gradients."""
MOST_RESIDUAL = 0.2
"""Largest residual relative to the part's contrast."""
NO_MASKS = "no pair of masks explains the marked part of both photographs", "mark a part of one distance"
GAIN = 1.12
"""A larger support lowers the least eigenvalue by some per cent through its additional unknowns; a missing rim doubles
it."""


@dataclass(frozen=True)
class Prototypes:
    """Masks (2, K, K), sum 1, about their common centre, and shapes on [-1, 1]; half_width : the flat part's w;
    residual : of the last fit."""

    masks: Array
    shapes: Array
    half_width: float
    residual: float


@dataclass(frozen=True)
class SearchRound:
    """A finished round of the search of unknown motion, of at most so many: it ends early where nothing improves."""

    n: int
    most: int


Report = Callable[[SearchRound], object]


def counted(report: Report | None, most: int) -> Callable[[], object]:
    """A function that reports the next round of a search at each call."""
    rounds = count(1)
    return lambda: report and report(SearchRound(next(rounds), most))


def prototype_shapes(parts: Array, largest: int, rounds: int = 24, first: Array | None = None) -> Prototypes:
    """Masks of a flat part (2, H, W) of both photographs, with supports up to half-size `largest`.

    first : initial masks (2, K, K), as from `recorded_paths.recorded_masks`, whose support is kept.

    Raises BadInput if there are not two parts, or they are smaller than eight masks; Refused if no masks explain the
    two parts: they are not of one depth, or the rig rotated.
    """
    if len(parts) != 2:
        raise BadInput(f"unknown motion is estimated from two photographs, got {len(parts)}", "give the first two")
    R = support(parts, largest) if first is None else int(first.shape[1] // 2)
    if min(parts.shape[1:]) < 16 * R:
        raise BadInput(
            f"masks of half-size {R} need a flat part of {16 * R} pixels each way, "
            f"got {parts.shape[2]} x {parts.shape[1]}",
            "mark a larger one",
        )
    relation = cross_relation(parts, R)
    masks = _first_masks(parts, R) if first is None else first
    u, single = np.pad(parts.mean(axis=0), R, mode="edge"), parts.astype(np.float32)
    for n in range(rounds):
        # strong edges only at first, so that the masks become sharp before the picture is detailed
        u = _picture(single, masks.astype(np.float32), u.astype(np.float32), 1e-2 * 0.02 ** (n / rounds))
        u = u.astype(np.float64)
        masks = _masks(parts, u, CROSS * relation, R)
    residual = np.sqrt(np.mean([(fftconvolve(u, h, mode="valid") - z) ** 2 for h, z in zip(masks, parts, strict=True)]))
    if residual > MOST_RESIDUAL * parts.std():
        raise Refused(*NO_MASKS)
    masks = about_middle(masks)
    half = reach(masks)
    return Prototypes(masks, np.stack([as_shape(h, half) for h in masks]), half, float(residual))


def _patches(z: Array, size: int) -> Array:
    """Rows: the neighbourhoods (size x size) of z, flipped so that a row times a mask is a convolution's sample."""
    views = np.lib.stride_tricks.sliding_window_view(z, (size, size))[..., ::-1, ::-1]
    return views.reshape(-1, size * size)


def _gradients(z: Array) -> tuple[Array, Array]:
    """Differences down and across, as the information on masks is in the edges."""
    return np.diff(z, axis=0)[:, :-1], np.diff(z, axis=1)[:-1]


def cross_relation(parts: Array, R: int) -> Array:
    """Matrix M of |z1 * h2 - z2 * h1|^2 = (h1, h2)' M (h1, h2), over both masks' entries, in gradients.

    The least eigenvalue, due to noise, is subtracted.
    """
    size = 2 * R + 1
    M = np.zeros((2 * size * size, 2 * size * size))
    for g1, g2 in zip(_gradients(parts[0]), _gradients(parts[1]), strict=True):
        relation = np.concatenate([-_patches(g2, size), _patches(g1, size)], axis=1)
        M += relation.T @ relation
    return np.asarray(M - np.linalg.eigvalsh(M)[0] * np.eye(len(M)))


def _least_relation(parts: Array, R: int) -> float:
    """Least mean square of z1 * h2 - z2 * h1 over masks of unit norm."""
    z1, z2 = (_patches(z - z.mean(), 2 * R + 1) for z in parts)
    relation = np.concatenate([-z2, z1], axis=1)
    return float(np.linalg.eigvalsh(relation.T @ relation / len(relation))[0])


def support(parts: Array, largest: int) -> int:
    """Half-size of masks beyond which the cross relation improves only by its additional unknowns."""
    residual = _least_relation(parts, 1)
    for R in range(1, largest):
        more = _least_relation(parts, R + 1)
        if residual < GAIN * more:
            return R
        residual = more
    return largest


def _first_masks(parts: Array, R: int) -> Array:
    """Non-negative masks of sum 1 that best satisfy the cross relation without noise."""
    size = 2 * R + 1
    z1, z2 = (_patches(z - z.mean(), size) for z in parts)
    relation = np.concatenate([-z2, z1], axis=1)
    values, vectors = eigh(relation.T @ relation / len(relation))
    # noise raises every eigenvalue by its variance; the masks are in the subspace of noise alone
    root = np.sqrt(np.maximum(values - values[0], 0) + 1e-3 * values[0] + 1e-12)[:, None] * vectors.T
    tie = np.sqrt(values[-1]) * np.repeat(np.eye(2), size * size, axis=1)
    target = np.concatenate([np.zeros(len(root)), np.sqrt(values[-1]) * np.ones(2)])
    return unit(_non_negative(np.concatenate([root, tie]), target).reshape(2, size, size))


def _non_negative(A: Array, b: Array) -> Array:
    """The x >= 0 of the least |A x - b|."""
    try:
        return np.asarray(nnls(A, b)[0])
    except RuntimeError as error:  # it does not converge where the photographs do not determine the masks
        raise Refused(*NO_MASKS) from error


def _picture(parts: Array, masks: Array, u: Array, weight: float) -> Array:
    n, first = [next_fast_len(size, True) for size in u.shape], masks.shape[1] - 1
    visible = (..., slice(first, u.shape[0]), slice(first, u.shape[1]))
    spectra, wide = rfft2(masks, n), np.zeros((2, *n), u.dtype)

    def adjoint(e: Array) -> Array:
        wide[visible] = e
        return np.asarray(irfft2((spectra.conj() * rfft2(wide)).sum(axis=0), n)[: u.shape[0], : u.shape[1]])

    def forward(x: Array) -> Array:
        # light that wraps around falls outside the part
        return np.asarray(irfft2(spectra * rfft2(x, n), n)[visible])

    for _ in range(2):
        diffusion = total_variation(u[None], 0.01)
        gradient = adjoint(parts - forward(u)) - weight * diffuse(u, *diffusion)
        u = u + conjugate_gradients(lambda x: adjoint(forward(x)) + weight * diffuse(x, *diffusion), gradient, 20)  # noqa: B023
    return u


def _masks(parts: Array, u: Array, relation: Array, R: int) -> Array:
    """Non-negative masks that blur the picture into each photograph and satisfy the cross relation, least squares."""
    size = 2 * R + 1
    n = size * size
    gram, right = np.zeros((n, n)), np.zeros((2, n))
    for k, g in enumerate(_gradients(u)):
        A = _patches(g, size)
        gram += A.T @ A
        right += np.stack([A.T @ _gradients(z)[k].ravel() for z in parts])
    normal = relation.copy()
    normal[:n, :n] += gram
    normal[n:, n:] += gram
    normal[np.diag_indices(2 * n)] += 1e-5 * np.trace(gram) / n
    factor = np.linalg.cholesky(normal).T
    masks = _non_negative(factor, np.linalg.solve(factor.T, right.ravel())).reshape(2, size, size)
    masks[masks < 0.02 * masks.max()] = 0
    return unit(masks)


def reach(masks: Array) -> float:
    """Half-width of the masks' common support, pixels."""
    R = masks.shape[1] // 2
    rows, columns = np.nonzero(masks.sum(axis=0))
    return float(max(np.abs(rows - R).max(), np.abs(columns - R).max())) + 0.5
