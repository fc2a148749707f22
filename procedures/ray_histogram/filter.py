"""Algorithm 1: at one scale, every patch is averaged with the patches of similar sample histograms.

Choices where the paper leaves room: pixels with significantly different means (Welch test) are less similar;
similarity falls over a ramp instead of at a threshold; the average is a plane fitted through the similar patches,
evaluated at the patch itself, so that a gradient of light causes no bias; and patch estimates from more samples have a
slightly larger weight. `PAPER` disables all of it.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array32, Indices
from procedures.outcome import BadInput, BadParameter
from procedures.ray_histogram.kernels import Rules, Stack, fuse_band

BAND_ROWS = 32  # rows filtered at once: large enough that the rows computed twice at the rims cost little
BAND_FLOATS = 16_000_000  # maximum number of ratios per thread; bands of wide pictures have fewer rows


@dataclass(frozen=True)
class FilterParameters:
    """Criteria of similarity, and the range of the search.

    kappa : float, chi-square per bin with a weight of one half; 1 suits a path tracer
    scales : int, scales of Algorithm 2; 1 removes no noise wider than the search block
    search, patch : int, half sizes of the search block (6: 13 x 13) and of the patches (1: 3 x 3), pixels of the scale
    at_least : int, number of other patches averaged with every patch at the finest scale, however different
    least_count : float, a bin is used when the two pixels together have more samples than this in it
    welch, welch_sigmas : float, where two means differ by more than `welch_sigmas` standard deviations, the excess of
        the squared difference, in these units, is added to chi-square, times `welch`, for each colour; 0 ignores means
    softness : float, the weight falls from 1 to 0 between kappa (1 - softness) and kappa (1 + softness)
    trend : bool, whether to fit a plane through the similar patches instead of their mean
    trust : float, weight of patch estimates: their number of similar patches to this power
    ease : float, where few patches are similar at the finest scale, kappa is raised by this fraction of it per sample,
        at most to twice itself
    coarse : float, fraction of the low frequencies taken from the next coarser scale
    pixel : float, two patches differ by at least this fraction of the chi-square per bin of their most different pixels
    bound : float, largest change of a pixel in standard deviations of its samples' mean; 0 for no limit
    rims : bool, whether to estimate pixels at rims of lamps from the rim's shape (see `rims`)
    """

    kappa: float = 1.0
    scales: int = 3
    search: int = 6
    patch: int = 1
    at_least: int = 0
    least_count: float = 2.0
    welch: float = 3.0
    welch_sigmas: float = 3.0
    softness: float = 0.3
    trend: bool = True
    trust: float = 0.25
    ease: float = 0.005
    pixel: float = 0.25
    bound: float = 4.0
    rims: bool = True
    coarse: float = 0.8

    def __post_init__(self) -> None:
        if not (self.kappa > 0 and np.isfinite(self.kappa)):
            raise BadParameter(f"kappa must be positive; got {self.kappa}", "choose a value in this range")
        for name, least, most in _LIMITS:
            if not least <= getattr(self, name) <= most:
                limits = f"{least} or more" if most == np.inf else f"between {least} and {most}"
                raise BadParameter(
                    f"{name} must be {limits}; got {getattr(self, name)}", "choose a value in this range"
                )


_LIMITS = (
    *((name, 1, np.inf) for name in ("scales", "search")),
    *((name, 0, np.inf) for name in ("patch", "at_least", "least_count", "welch", "welch_sigmas", "ease", "bound")),
    *((name, 0, 1) for name in ("pixel", "softness", "coarse")),
)
"""Smallest and largest values of parameters."""


PAPER = FilterParameters(
    at_least=2, least_count=1.0, welch=0.0, softness=0.0, trend=False,
    trust=0.0, ease=0.0, coarse=1.0, pixel=0.0, bound=0.0, rims=False,
)  # fmt: skip
"""The filter as in Algorithms 1 and 2, which average every patch with two others, however different."""


@dataclass(frozen=True)
class Samples:
    """One picture with statistics of its samples.

    picture : (rows, columns, channels) float32, means of the samples
    histogram : (rows, columns, bins) float32, votes, colour by colour
    count : (rows, columns) float32, samples per pixel
    means : (rows, columns, 6) float32 or None
        Means of the samples' three colours and the variances of these means; None to compare histograms alone.
    """

    picture: Array32
    histogram: Array32
    count: Array32
    means: Array32 | None = None


@dataclass(frozen=True)
class Fused:
    """A filtered picture.

    picture : (rows, columns, channels) float32, the filtered picture
    similar : (rows, columns) float32, number of patches similar to each pixel's patch, itself included, partly similar
        ones counted in part. Where it is low, more samples are needed.
    """

    picture: Array32
    similar: Array32


def fuse_scale(
    frame: Samples, parameters: FilterParameters, *, neighbours: Sequence[Samples] = (), threads: int = 1
) -> Fused:
    """Filter the picture of one scale by Algorithm 1.

    Raises BadInput if the frames differ in size.

    frame : Samples, what to filter
    parameters : FilterParameters, `scales` and `coarse` are not used here
    neighbours : sequence of Samples
        Frames before and after, of the same size, in which similar patches are searched for too.
    threads : int, bands filtered at once; the result does not depend on it
    """
    frames = (frame, *neighbours)
    sizes = {f.count.shape for f in frames}
    if len(sizes) > 1:
        raise BadInput(f"frames of different sizes: {sorted(sizes)}", "give frames of one sequence")
    stack = Stack(
        np.ascontiguousarray(np.stack([np.moveaxis(f.picture, -1, 0) for f in frames]), np.float32),
        _stacked([f.histogram for f in frames]),
        _stacked([f.count for f in frames]),
        _stacked([_compared(f, parameters) for f in frames]),
    )
    candidates, half = search_block(parameters.search, len(frames))
    rules = Rules(*(getattr(parameters, name) for name in Rules._fields))
    rows, columns = frame.count.shape
    similar = np.empty((rows, columns), np.float32)
    fused = np.empty((rows, columns, stack.planes.shape[1]), np.float32)

    def fuse_rows(top: int, end: int) -> None:
        rows_similar = similar[top:end]
        band = np.empty((stack.planes.shape[1], *rows_similar.shape), np.float32)
        fuse_band(stack, candidates, half, rules, top, band, rows_similar)
        fused[top:end] = np.moveaxis(band, 0, -1)

    height = max(4, min(BAND_ROWS, BAND_FLOATS // (len(candidates) * columns)))
    with ThreadPoolExecutor(threads) as pool:
        rims = np.linspace(0, rows, -(-rows // height) + 1).astype(int).tolist()  # bands of equal size
        for _ in pool.map(fuse_rows, rims[:-1], rims[1:]):
            pass
    return Fused(fused, similar)


def _compared(frame: Samples, parameters: FilterParameters) -> Array32:
    if frame.means is None or parameters.welch == 0:
        return np.empty((*frame.count.shape, 0), np.float32)
    return frame.means


def _stacked(arrays: list[Array32]) -> Array32:
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float32)[None]
    return np.ascontiguousarray(np.stack(arrays), np.float32)


def search_block(half_size: int, frames: int) -> tuple[Indices, int]:
    """Candidates (n, 3) as frame, row offset, column offset in the kernels' order, and the number of forward ones."""
    block = [(y, x) for y in range(-half_size, half_size + 1) for x in range(-half_size, half_size + 1)]
    forward = [offset for offset in block if offset > (0, 0)]
    within = [(0, 0, 0), *((0, y, x) for y, x in forward), *((0, -y, -x) for y, x in forward)]
    others = [(frame, y, x) for frame in range(1, frames) for y, x in block]
    return np.array(within + others, np.int64), len(forward)
