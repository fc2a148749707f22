"""Kernels of any form from whole photographs of a flat scene: hands shake along no smooth curve.

Coarse to fine, a picture of few edges and the kernels that blur it into all photographs are found in turn
(`sharp_edges`), from several beginnings; the probability of the photographs (`sparse_gradients`) tells the best of them
and settles its kernels. What shifts the photographs against each other is in the kernels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from procedures.outcome import BadInput, BadParameter, Refused
from procedures.restoration.joint.kernel_sizes import MEASURED
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.unknown_motion.free_kernels import (
    Kernels,
    about_middle,
    cropped,
    likeness,
    recentred,
    scaled,
    thin,
)
from procedures.restoration.unknown_motion.path_refinement import MotionShapes
from procedures.restoration.unknown_motion.sharp_edges import EdgePicture
from procedures.restoration.unknown_motion.sparse_gradients import SparseFit, SparseGradients

Pictures = NDArray[np.float32]

CONTRAST = 0.17
"""Standard deviation that photographs are brought to: weights of edges are told for it."""
REMEDY = "raise --max-w if the motion was larger, lower it if it was surely smaller, or take another photograph"
FOUND_WEIGHT = 0.01
"""Least weight of the picture's prior with such kernels: they share a small blur with the picture, which nothing left
over tells of, and a picture restored too sharp looks as if it had more contrast."""


@dataclass(frozen=True)
class KernelBeginning:
    """One way down from coarse to fine.

    Attributes
    ----------
    edges, last_edges : float
        Weight of a step between neighbours at first, falling by a tenth each round, and where it stays.
    least : float
        Of a kernel's greatest value, below which nothing is kept.
    """

    edges: float = 2e-2
    last_edges: float = 1e-3
    least: float = 0.03

    def weighed(self, times: float) -> KernelBeginning:
        """The same with edges of other weight."""
        return replace(self, edges=times * self.edges, last_edges=times * self.last_edges)


@dataclass(frozen=True)
class FreeKernelSettings:
    """What the search of kernels of any form goes by.

    Attributes
    ----------
    beginnings : tuple of KernelBeginning
        Tried in turn; the most probable is settled.
    shrink, smallest : float
        From one scale to the next coarser one, and half-size of kernels at which they end, pixels.
    rounds, ridge, kernel_iterations : int, float, int
        Picture and kernels in turn at each scale, weight of the kernels' squares, and steps of each of theirs.
    compared, settled, picture_iterations : int
        Rounds of the probability until beginnings are compared, and after, and conjugate gradients in each.
    least : float
        Of a kernel's greatest value, below which nothing is kept in these.
    largest : int
        Half-size of the kernels looked for where nobody says, pixels.
    most_pixels : int
        Of the photographs that are looked at: the middle.
    most_left : float
        Of the variance of the photographs' differences, beyond which kernels explain nothing.
    alike : float
        Correlation of the kernels of two beginnings from which each confirms the other.
    as_probable : float
        Minus log probability a sample by which another beginning may be behind and still be as right.
    at_end : float
        Share of a kernel's light in its outermost pixels beyond which it may go on outside.
    """

    beginnings: tuple[KernelBeginning, ...] = field(
        default_factory=lambda: (KernelBeginning(), KernelBeginning(2e-2, 1e-4, 0.05))
    )
    shrink: float = 0.5**0.5
    smallest: float = 1.5
    rounds: int = 10
    ridge: float = 2.0
    kernel_iterations: int = 100
    compared: int = 12
    settled: int = 24
    picture_iterations: int = 10
    least: float = 0.02
    largest: int = 16
    most_pixels: int = 120_000
    most_left: float = 0.25
    alike: float = 0.7
    as_probable: float = 0.03
    at_end: float = 0.01


@dataclass(frozen=True)
class FreeKernels:
    """Kernels (P, K, K) of the photographs, one sample a pixel, about the middle of their common extent, sum 1.

    left : standard deviation of what they leave of the photographs' differences, of the photographs' contrast;
    agreement : likeness of what two beginnings end in; doubt : why they are not to be trusted, or None; others : what
    another beginning ends in, of any extent, or None where none ends alike and is as probable.
    """

    kernels: Array
    left: float
    agreement: float
    doubt: str | None = None
    others: Array | None = None

    @property
    def half_width(self) -> float:
        """Of the widest, pixels."""
        return float(self.kernels.shape[1] - 1) / 2

    @property
    def shapes(self) -> MotionShapes:
        """As a restoration takes and judges what was found of unknown motion."""
        return MotionShapes(self.kernels, self.half_width, None, self.doubt, REMEDY, self.others)


def kernels_of_flat_scene(
    photographs: Array, largest: int | None = None, settings: FreeKernelSettings | None = None
) -> FreeKernels:
    """The kernels of photographs (P, H, W), two or more of one flat scene.

    largest : half-size of the kernels looked for, their shift against each other included, pixels.

    Raises
    ------
    BadInput
        If there are fewer than two photographs, or they are smaller than four such kernels.
    Refused
        If no kernels explain the photographs.
    """
    s = settings or FreeKernelSettings()
    if len(photographs) < 2:
        raise BadInput(f"unknown motion is told by two photographs or more, got {len(photographs)}", "take another one")
    R = largest or max(1, min(s.largest, (min(photographs.shape[1:]) - 1) // 4))
    z = _looked_at(photographs, R, s)
    sparse = SparseGradients(z, R)
    searches: list[_Search] = []
    # many photographs outweigh the belief in few edges, which alone keeps a common blur out of their kernels: it is
    # made to weigh as they do, but as in two of them where that search ends in doubt
    for edges in dict.fromkeys((len(z) / 2, 1.0)):
        searches.append(_searched(sparse, z, edges, s))
        if searches[-1].doubt is None:
            break
    best = min(searches, key=lambda one: (one.doubt is not None, one.fit.cost))
    share = best.fit.left / float(np.mean(sparse.seen**2))
    if share > s.most_left:
        raise Refused(
            f"no kernels of up to {R} pixels each way explain the photographs: "
            f"{share:.0%} of their differences are left",
            "raise --max-w if the motion was larger; the scene has to be flat, still, and not turned in between",
        )
    return best.told


@dataclass(frozen=True)
class _Search:
    """The most probable of several beginnings, settled; the next one, settled, where it may be right; and the doubt."""

    fit: SparseFit
    other: SparseFit | None
    agreement: float
    doubt: str | None

    @property
    def told(self) -> FreeKernels:
        """As they are given away."""
        others = None if self.other is None else cropped(self.other.kernels)
        left = float(np.sqrt(self.fit.left)) / CONTRAST
        return FreeKernels(cropped(self.fit.kernels), left, self.agreement, self.doubt, others)


def _searched(sparse: SparseGradients, z: Pictures, edges: float, s: FreeKernelSettings) -> _Search:
    """Kernels from all beginnings. edges : what the weight of a step between neighbours is taken times."""

    def settled(kernels: Kernels) -> SparseFit:
        return sparse.fitted(about_middle(kernels), s.settled, s.picture_iterations, s.least)

    begun = [_begun(z, sparse.R, one.weighed(edges), s) for one in s.beginnings]
    fits = sorted(
        (sparse.fitted(one, s.compared, s.picture_iterations, s.least) for one in begun), key=lambda fit: fit.cost
    )
    fit = settled(fits[0].kernels)
    agreement = min([likeness(fit.kernels, one.kernels) for one in fits[1:]], default=1.0)
    # one that went elsewhere, or explains the photographs less well, tells nothing of where this one ended
    rivals = [one for one in fits[1:] if one.cost < fits[0].cost + s.as_probable and agreement >= s.alike]
    return _Search(fit, settled(rivals[0].kernels) if rivals else None, agreement, _doubt(fit, agreement, s))


def kernels_as_found(kernels: Sequence[Array], count: int, doubt: str | None = None) -> MotionShapes:
    """Kernels that were found before, one for each of `count` photographs, (K, K) with one sample a pixel.

    doubt : why they were not to be trusted

    Raises
    ------
    BadParameter
        If they are not as many, or no such kernels.
    """
    sizes = [len(one) for one in kernels]
    if len(sizes) != count or max(sizes) >= MEASURED:
        raise BadParameter(
            f"a flat scene's kernels are one for each of {count} photographs, of less than {MEASURED} pixels each way; "
            f"got {', '.join(f'{n} x {n}' for n in sizes)}",
            "give the kernel_N.npy of a result, in the order of the photographs",
        )
    most = max(sizes)
    padded = np.stack([np.pad(one / one.sum(), (most - len(one)) // 2) for one in kernels])
    return MotionShapes(padded, (most - 1) / 2, None, doubt, REMEDY)


def _doubt(fit: SparseFit, agreement: float, settings: FreeKernelSettings) -> str | None:
    rim = np.ones(fit.kernels.shape[1:], bool)
    rim[1:-1, 1:-1] = False
    if fit.kernels[:, rim].sum(axis=1).max() > settings.at_end:
        R = fit.kernels.shape[1] // 2
        return f"the motion found reaches the end of the {R} pixels each way that were looked at"
    if agreement < settings.alike:
        return f"two ways to find the motion end in kernels that are only {agreement:.2f} alike, where 1 is the same"
    return None


def _begun(z: Pictures, R: int, beginning: KernelBeginning, s: FreeKernelSettings) -> Kernels:
    """Kernels by sharp edges, from the coarsest scale to the finest."""
    scale, finest = _coarsest(R, s), R
    R = max(1, int(np.ceil(scale * finest)))
    kernels = np.zeros((len(z), 2 * R + 1, 2 * R + 1), np.float32)
    kernels[:, R - 1 : R + 2, R - 1 : R + 2] = 1 / 9
    weight = beginning.edges
    while True:
        edges = EdgePicture(_shrunk(z, scale), R)
        for _ in range(s.rounds):
            u = edges.picture(kernels, weight)
            kernels = thin(edges.kernels(u, kernels, s.ridge, s.kernel_iterations), beginning.least)
            weight = max(weight / 1.1, beginning.last_edges)
        kernels = recentred(kernels)
        if scale == 1:
            return kernels
        finer = 1.0 if scale > s.shrink**1.5 else scale / s.shrink
        R = int(np.ceil(finer * finest))
        kernels, scale = scaled(kernels, finer / scale, R), finer


def _coarsest(R: int, settings: FreeKernelSettings) -> float:
    steps = max(0, int(np.floor(np.log(settings.smallest / R) / np.log(settings.shrink))))
    return float(settings.shrink**steps)


def _shrunk(z: Pictures, scale: float) -> Pictures:
    if scale == 1:
        return z
    rows, columns = (round(n * scale) for n in z.shape[1:])
    soft = (cv2.GaussianBlur(one, (0, 0), 0.35 / scale) for one in z)
    return np.stack([cv2.resize(one, (columns, rows), interpolation=cv2.INTER_LINEAR) for one in soft])


# --- what is looked at -------------------------------------------------------------------------------------------


def _looked_at(photographs: Array, R: int, settings: FreeKernelSettings) -> Pictures:
    """The middle of the photographs, in one light and contrast, brought together where they lie far apart."""
    _check_size(photographs, R)
    z = photographs * (photographs[0].mean() / photographs.mean(axis=(1, 2), keepdims=True))
    z = np.stack([one[part] for one, part in zip(z, _together(z, R), strict=True)])
    _check_size(z, R)
    rows, columns = z.shape[1:]
    height = min(rows, max(int(np.sqrt(settings.most_pixels)), settings.most_pixels // columns))
    width = min(columns, settings.most_pixels // height)
    top, left = (rows - height) // 2, (columns - width) // 2
    z = z[:, top : top + height, left : left + width]
    contrast = float(z[0].std())
    if contrast == 0:
        raise Refused("the photographs show nothing", "put structure into the scene")
    return np.asarray((z - z.mean()) * (CONTRAST / contrast), np.float32)


def _check_size(z: Array, R: int) -> None:
    rows, columns = z.shape[1:]
    if min(rows, columns) < 4 * R + 1:
        raise BadInput(
            f"kernels of up to {R} pixels each way need photographs that overlap by {4 * R + 1} pixels; "
            f"got {columns} x {rows}",
            "lower --max-w, or give larger photographs",
        )


def _together(z: Array, R: int) -> Iterator[tuple[slice, slice]]:
    """Of each photograph the part that all show, where one is shifted by more than R."""
    window = cv2.createHanningWindow(z.shape[:0:-1], cv2.CV_64F)
    first, *others = (np.ascontiguousarray(one - one.mean(), dtype=np.float64) for one in z)
    moves = [(0, 0)]
    for one in others:
        (dx, dy), sure = cv2.phaseCorrelate(first, one, window)
        far = sure > 0.05 and max(abs(dx), abs(dy)) > R
        moves.append((round(dy), round(dx)) if far else (0, 0))
    spans = []
    for axis in (0, 1):
        low = min(move[axis] for move in moves)
        high = max(move[axis] for move in moves)
        n = z.shape[1 + axis] - (high - low)
        spans.append([slice(move[axis] - low, move[axis] - low + max(n, 0)) for move in moves])
    return zip(*spans, strict=True)
