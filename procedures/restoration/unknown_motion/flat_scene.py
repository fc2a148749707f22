"""Kernels of any form from whole photographs of a flat scene, as hand shake follows no smooth curve.

From coarse to fine, a picture of few edges and the kernels that blur it into all photographs are estimated in turn
(`EdgePicture`), from several starts. The probability of the photographs (`sparse_gradients`) selects the best start and
refines its kernels, which include the shifts between the photographs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import fftfreq, irfft2, next_fast_len, rfft2, rfftfreq

from procedures.outcome import BadInput, BadParameter, Refused
from procedures.restoration.joint.kernel_sizes import MEASURED
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.blind import Report, counted
from procedures.restoration.unknown_motion.free_kernels import (
    Kernels,
    about_middle,
    cropped,
    least_squares,
    likeness,
    recentred,
    scaled,
    thin,
)
from procedures.restoration.unknown_motion.path_refinement import MotionShapes
from procedures.restoration.unknown_motion.sparse_gradients import SparseFit, SparseGradients

Spectra = NDArray[np.complex64]
STIFFEST = 1e5
"""Largest coupling between a picture's differences and the sparse ones, which are then equal."""


class EdgePicture:
    """Photographs (P, H, W) of one flat scene, for kernels of half-size R."""

    def __init__(self, z: Pictures, R: int) -> None:
        self.R, self.frame = R, z.shape[1:]
        self.z = periodic(z, R)
        self.size: tuple[int, ...] = self.z.shape[1:]
        self.spectra = rfft2(self.z)
        down = np.exp(2j * np.pi * fftfreq(self.size[0]))[:, None] - 1
        across = np.exp(2j * np.pi * rfftfreq(self.size[1]))[None] - 1
        self.differences = [down.astype(np.complex64), across.astype(np.complex64)]
        self.steepness = (np.abs(down) ** 2 + np.abs(across) ** 2).astype(np.float32)

    def picture(self, kernels: Kernels, weight: float) -> Pictures:
        """The picture of least sum |h * u - z|^2 + weight x number of pixels that differ from a neighbour, by
        half-quadratic splitting (Xu, Lu, Xu, Jia, ACM Trans. Graphics 2011)."""
        H = self._spectra_of(kernels)
        blurred, power = (H.conj() * self.spectra).sum(axis=0), (np.abs(H) ** 2).sum(axis=0)
        u, coupling = self.z.mean(axis=0), 2 * weight
        while coupling < STIFFEST:
            steps = [np.roll(u, -1, axis) - u for axis in (0, 1)]
            large = steps[0] ** 2 + steps[1] ** 2 >= weight / coupling
            edges = sum(d.conj() * rfft2(step * large) for d, step in zip(self.differences, steps, strict=True))
            u = irfft2((blurred + coupling * edges) / (power + coupling * self.steepness), self.size)
            coupling *= 2
        return np.asarray(u, np.float32)

    def kernels(self, u: Pictures, kernels: Kernels, ridge: float, iterations: int) -> Kernels:
        """The kernels that blur the picture's differences into the photographs', from initial ones."""
        R, U = self.R, rfft2(u)
        H = self._spectra_of(kernels)
        gradient, correlation = np.zeros(1, np.float32), np.zeros(1, np.float32)
        for d in self.differences:
            residual = irfft2(d * (self.spectra - U * H), self.size) * self._inside
            gradient = gradient + irfft2((d * U).conj() * rfft2(residual), self.size)
            correlation = correlation + irfft2(np.abs(rfft2(irfft2(d * U, self.size) * self._inside)) ** 2, self.size)
        near, far = np.arange(-R, R + 1), np.arange(-2 * R, 2 * R + 1)
        near_gradient = gradient[:, near[:, None], near]
        return least_squares(kernels, near_gradient, correlation[np.ix_(far, far)], ridge, iterations)

    @property
    def _inside(self) -> Pictures:
        """1 where a photograph's differences are measured and its surroundings have little effect."""
        rim, (height, width) = self.R // 2, self.frame
        inside = np.zeros(self.size, np.float32)
        inside[rim : height - 1 - rim, rim : width - 1 - rim] = 1
        return inside

    def _spectra_of(self, kernels: Kernels) -> Spectra:
        K = kernels.shape[1]
        wide = np.zeros((len(kernels), *self.size), np.float32)
        wide[:, :K, :K] = kernels
        spectra: Spectra = rfft2(np.roll(wide, (-(K // 2), -(K // 2)), (1, 2)))
        return spectra


def periodic(z: Pictures, R: int) -> Pictures:
    """The photographs extended by at least 2 R rows and columns, which make them periodic."""
    for axis in (1, 2):
        n = z.shape[axis]
        more = next_fast_len(n + 2 * R, True) - n
        share = np.expand_dims(np.linspace(0, 1, more + 2, dtype=np.float32)[1:-1], (0, 3 - axis))
        first, last = np.take(z, [0], axis), np.take(z, [-1], axis)
        z = np.concatenate([z, (1 - share) * last + share * first], axis)
    return z


Pictures = NDArray[np.float32]

CONTRAST = 0.17
"""Standard deviation to which photographs are scaled; the weights of edges refer to it."""
REMEDY = "raise --max-w if the motion was larger, lower it if it was surely smaller, or take another photograph"
MIN_PICTURE_WEIGHT = 0.01
"""Smallest weight of the picture's prior for estimated kernels: they share a small blur with the picture, which leaves
no residual, and an oversharpened picture appears to have more contrast."""


@dataclass(frozen=True)
class KernelStart:
    """Parameters of one pass from coarse to fine.

    edges, last_edges : initial weight of an edge between neighbours, which falls by a tenth each round, and its final
    value; least : fraction of a kernel's maximum below which values are set to zero.
    """

    edges: float = 2e-2
    last_edges: float = 1e-3
    least: float = 0.03


SHRINK, SMALLEST = 0.5**0.5, 1.5
"""Factor between scales, and half-size of kernels at the coarsest, pixels."""
RIDGE = 2.0
"""Weight of the kernels' squares."""
LEAST = 0.02
"""Fraction of a kernel's maximum below which values are set to zero by the probability."""
LARGEST = 16
"""Default half-size of the kernels, pixels."""
MOST_LEFT = 0.25
"""Largest fraction of the variance of the photographs' differences that kernels may leave as a residual."""
MIN_AGREEMENT = 0.7
"""Correlation of the kernels of two starts above which each confirms the other."""
COST_TOLERANCE = 0.03
"""Excess of minus log probability per sample up to which another start may be equally right."""
EDGE_FRACTION = 0.01
"""Fraction of a kernel's light in its outermost pixels above which it may be truncated."""


STARTS = (KernelStart(), KernelStart(2e-2, 1e-4, 0.05))


@dataclass(frozen=True)
class KernelEffort:
    """Effort of the search of kernels of any form.

    starts : tried in turn; the most probable is refined. rounds, kernel_iterations : of picture and kernels at each
    scale, and iterations for the kernels. compared, settled, picture_iterations : rounds of the probability before
    starts are compared, and after, and conjugate gradients in each. most_pixels : maximum number of pixels used, from
    the middle of the photographs.
    """

    starts: tuple[KernelStart, ...] = STARTS
    rounds: int = 10
    kernel_iterations: int = 100
    compared: int = 12
    settled: int = 24
    picture_iterations: int = 10
    most_pixels: int = 120_000


@dataclass(frozen=True)
class FreeKernels:
    """Kernels (P, K, K) of the photographs, one sample a pixel, centred on their common extent, sum 1.

    residual : standard deviation of the residual of the photographs' differences, relative to their contrast;
    agreement : correlation of the results of two starts; caveat : why they are unreliable, or None; others : the result
    of another start, of any extent, or None where none agrees and is as probable.
    """

    kernels: Array
    residual: float
    agreement: float
    caveat: str | None = None
    others: Array | None = None

    @property
    def half_width(self) -> float:
        """Half-width of the widest kernel, pixels."""
        return float(self.kernels.shape[1] - 1) / 2

    @property
    def shapes(self) -> MotionShapes:
        """In the form of any estimated motion."""
        return MotionShapes(self.kernels, self.half_width, None, self.caveat, REMEDY, self.others)


def kernels_of_flat_scene(
    photographs: Array, largest: int | None = None, effort: KernelEffort | None = None, report: Report | None = None
) -> FreeKernels:
    """The kernels of photographs (P, H, W), two or more of one flat scene.

    largest : half-size of the kernels, their relative shift included, pixels.

    Raises BadInput if there are fewer than two photographs, or they are smaller than four such kernels; Refused if no
    kernels explain the photographs.
    """
    s = effort or KernelEffort()
    if len(photographs) < 2:
        raise BadInput(f"unknown motion needs two photographs or more, got {len(photographs)}", "take another one")
    R = largest or max(1, min(LARGEST, (min(photographs.shape[1:]) - 1) // 4))
    z = _central_part(photographs, R, s.most_pixels)
    sparse = SparseGradients(z, R)
    searches: list[tuple[SparseFit, FreeKernels]] = []
    # many photographs outweigh the prior of few edges, which alone keeps a common blur out of their kernels: its weight
    # is scaled with their number, but not where that search is doubtful
    factors = dict.fromkeys((len(z) / 2, 1.0))
    step = counted(report, len(factors) * (2 * len(s.starts) + 1))
    for edges in factors:
        searches.append(_searched(sparse, z, edges, s, step))
        if searches[-1][1].caveat is None:
            break
    fit, best = min(searches, key=lambda one: (one[1].caveat is not None, one[0].cost))
    share = fit.residual / float(np.mean(sparse.observed**2))
    if share > MOST_LEFT:
        raise Refused(
            f"no kernels of up to {R} pixels each way explain the photographs: {share:.0%} of their differences remain",
            "raise --max-w if the motion was larger; the scene has to be flat, static, and not rotated in between",
        )
    return best


def _searched(
    sparse: SparseGradients, z: Pictures, edges: float, s: KernelEffort, step: Callable[[], object]
) -> tuple[SparseFit, FreeKernels]:
    """The most probable fit of several starts, refined, and its kernels; edges : factor of the weight of an edge."""

    def refined(kernels: Kernels) -> SparseFit:
        return sparse.fit(about_middle(kernels), s.settled, s.picture_iterations, LEAST)

    scaled_starts = (replace(one, edges=edges * one.edges, last_edges=edges * one.last_edges) for one in s.starts)
    fits = []
    for start in scaled_starts:
        kernels = _initial_kernels(z, sparse.R, start, s)
        step()
        fits.append(sparse.fit(kernels, s.compared, s.picture_iterations, LEAST))
        step()
    fits.sort(key=lambda fit: fit.cost)
    fit = refined(fits[0].kernels)
    step()
    agreement = min([likeness(fit.kernels, one.kernels) for one in fits[1:]], default=1.0)
    # one with another result, or a worse fit, carries no information on the error of this one
    rivals = [fit_ for fit_ in fits[1:] if fit_.cost < fits[0].cost + COST_TOLERANCE and agreement >= MIN_AGREEMENT]
    others = cropped(refined(rivals[0].kernels).kernels) if rivals else None
    residual = float(np.sqrt(fit.residual)) / CONTRAST
    return fit, FreeKernels(cropped(fit.kernels), residual, agreement, _caveat(fit, agreement), others)


def given_kernels(kernels: Sequence[Array], count: int, caveat: str | None = None) -> MotionShapes:
    """`count` kernels (K, K) of one sample a pixel from an earlier restoration, and the caveat about them. Raises
    BadParameter for others."""
    sizes = [len(kernel) for kernel in kernels]
    if len(sizes) != count or max(sizes) >= MEASURED:
        raise BadParameter(
            f"a flat scene's kernels are one for each of {count} photographs, of less than {MEASURED} pixels each way; "
            f"got {', '.join(f'{n} x {n}' for n in sizes)}",
            "give the kernel_N.npy of a result, in the order of the photographs",
        )
    most = max(sizes)
    padded = np.stack([np.pad(kernel / kernel.sum(), (most - len(kernel)) // 2) for kernel in kernels])
    return MotionShapes(padded, (most - 1) / 2, None, caveat, REMEDY)


def _caveat(fit: SparseFit, agreement: float) -> str | None:
    rim = np.ones(fit.kernels.shape[1:], bool)
    rim[1:-1, 1:-1] = False
    if fit.kernels[:, rim].sum(axis=1).max() > EDGE_FRACTION:
        R = fit.kernels.shape[1] // 2
        return f"the estimated motion reaches the end of the search range of {R} pixels each way"
    if agreement < MIN_AGREEMENT:
        return f"two searches of the motion end in kernels with a correlation of only {agreement:.2f}"
    return None


def _initial_kernels(z: Pictures, R: int, start: KernelStart, s: KernelEffort) -> Kernels:
    """Kernels by sharp edges, from the coarsest scale to the finest."""
    scale, finest = SHRINK ** max(0, int(np.floor(np.log(SMALLEST / R) / np.log(SHRINK)))), R
    R = max(1, int(np.ceil(scale * finest)))
    kernels = np.zeros((len(z), 2 * R + 1, 2 * R + 1), np.float32)
    kernels[:, R - 1 : R + 2, R - 1 : R + 2] = 1 / 9
    weight = start.edges
    while True:
        edges = EdgePicture(_shrunk(z, scale), R)
        for _ in range(s.rounds):
            u = edges.picture(kernels, weight)
            kernels = thin(edges.kernels(u, kernels, RIDGE, s.kernel_iterations), start.least)
            weight = max(weight / 1.1, start.last_edges)
        kernels = recentred(kernels)
        if scale == 1:
            return kernels
        finer = 1.0 if scale > SHRINK**1.5 else scale / SHRINK
        R = int(np.ceil(finer * finest))
        kernels, scale = scaled(kernels, finer / scale, R), finer


def _shrunk(z: Pictures, scale: float) -> Pictures:
    if scale == 1:
        return z
    rows, columns = (round(n * scale) for n in z.shape[1:])
    soft = (cv2.GaussianBlur(one, (0, 0), 0.35 / scale) for one in z)
    return np.stack([cv2.resize(one, (columns, rows), interpolation=cv2.INTER_LINEAR) for one in soft])


def _central_part(photographs: Array, R: int, most_pixels: int) -> Pictures:
    """The middle of the photographs, with one mean and contrast, aligned where they are far apart."""
    _check_size(photographs, R)
    z = photographs * (photographs[0].mean() / photographs.mean(axis=(1, 2), keepdims=True))
    z = np.stack([one[part] for one, part in zip(z, _common_parts(z, R), strict=True)])
    _check_size(z, R)
    rows, columns = z.shape[1:]
    height = min(rows, max(int(np.sqrt(most_pixels)), most_pixels // columns))
    width = min(columns, most_pixels // height)
    top, left = (rows - height) // 2, (columns - width) // 2
    z = z[:, top : top + height, left : left + width]
    contrast = float(z[0].std())
    if contrast == 0:
        raise Refused("the photographs have no contrast", "put structure into the scene")
    return np.asarray((z - z.mean()) * (CONTRAST / contrast), np.float32)


def _check_size(z: Array, R: int) -> None:
    rows, columns = z.shape[1:]
    if min(rows, columns) < 4 * R + 1:
        raise BadInput(
            f"kernels of up to {R} pixels each way need photographs that overlap by {4 * R + 1} pixels; "
            f"got {columns} x {rows}",
            "lower --max-w, or give larger photographs",
        )


def _common_parts(z: Array, R: int) -> Iterator[tuple[slice, slice]]:
    """The common part of each photograph, where one is shifted by more than R."""
    window = cv2.createHanningWindow(z.shape[:0:-1], cv2.CV_64F)
    first, *others = (np.ascontiguousarray(image - image.mean(), dtype=np.float64) for image in z)
    moves = [(0, 0)]
    for other in others:
        (dx, dy), response = cv2.phaseCorrelate(first, other, window)
        far = response > 0.05 and max(abs(dx), abs(dy)) > R
        moves.append((round(dy), round(dx)) if far else (0, 0))
    spans = []
    for axis in (0, 1):
        low = min(move[axis] for move in moves)
        high = max(move[axis] for move in moves)
        n = z.shape[1 + axis] - (high - low)
        spans.append([slice(move[axis] - low, move[axis] - low + max(n, 0)) for move in moves])
    return zip(*spans, strict=True)
