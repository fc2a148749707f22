"""Algorithm 1: at one scale, every patch becomes the average of the patches whose sample histograms resemble its own.

Where the paper leaves room: pixels whose means differ beyond doubt, by a Welch test, are less alike; similarity fades
over a ramp instead of ending at a threshold; what is averaged is the plane fitted through the similar patches, taken at
the patch itself, so that a slope of light is no bias; and patch estimates with more samples behind them weigh a little
more. `PAPER` switches all of it off.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, BadParameter
from procedures.ray_histogram.kernels import Rules, Stack, fuse_band

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]

BAND_ROWS = 32
"""Rows filtered at once: enough that the rows computed twice at its rims cost little."""
BAND_FLOATS = 16_000_000
"""Ratios one thread may hold; bands of wide pictures have fewer rows."""


@dataclass(frozen=True)
class FilterParameters:
    """How alike is alike, and how far to look.

    Attributes
    ----------
    kappa : float
        Chi-square per bin that counts as half similar; 1 suits a path tracer.
    scales : int
        Scales of Algorithm 2; 1 removes no noise wider than the search block.
    search, patch : int
        Half sizes of the search block (6: 13 x 13) and of the patches (1: 3 x 3), pixels of the scale.
    at_least : int
        Patches beside its own that every patch is averaged with at the finest scale, however different.
    least_count : float
        A bin speaks when the two pixels have more samples than this in it.
    welch, doubt : float
        Where two means differ by more than `doubt` standard deviations, the square of the difference in these, less
        that of the doubt, is added to chi-square, `welch` times for each colour; 0 leaves means alone.
    softness : float
        Similarity fades from 1 to 0 between kappa (1 - softness) and kappa (1 + softness).
    trend : bool
        Fit a plane through the similar patches instead of their mean.
    trust : float
        Patch estimates weigh as their number of similar patches to this power.
    ease : float
        Where few patches are similar at the finest scale, kappa is raised by this share of it per sample, at most to
        twice itself.
    coarse : float
        Share of the low frequencies taken from the next coarser scale; the rest is the finer scale's own.
    """

    kappa: float = 1.0
    scales: int = 3
    search: int = 6
    patch: int = 1
    at_least: int = 2
    least_count: float = 2.0
    welch: float = 3.0
    doubt: float = 3.0
    softness: float = 0.3
    trend: bool = True
    trust: float = 0.25
    ease: float = 0.005
    coarse: float = 0.8

    def __post_init__(self) -> None:
        _require(self.kappa > 0 and np.isfinite(self.kappa), f"kappa = {self.kappa}", "choose a kappa above 0")
        _require(self.scales >= 1, f"{self.scales} scales", "choose at least one scale")
        _require(self.search >= 1, f"a search block of half size {self.search}", "choose at least 1")
        _require(self.patch >= 0, f"a patch of half size {self.patch}", "choose 0 or more")
        _require(self.at_least >= 0, f"at least {self.at_least} similar patches", "choose 0 or more")
        _require(self.least_count >= 0, f"a least count of {self.least_count}", "choose 0 or more")
        _require(self.welch >= 0, f"welch = {self.welch}", "choose 0 or more")
        _require(self.doubt >= 0, f"doubt = {self.doubt}", "choose 0 or more")
        _require(self.ease >= 0, f"ease = {self.ease}", "choose 0 or more")
        _require(0 <= self.softness <= 1, f"softness = {self.softness}", "choose it between 0 and 1")
        _require(0 <= self.coarse <= 1, f"coarse = {self.coarse}", "choose it between 0 and 1")


def _require(holds: bool, came: str, remedy: str) -> None:
    if not holds:
        raise BadParameter(came, remedy)


PAPER = FilterParameters(least_count=1.0, welch=0.0, softness=0.0, trend=False, trust=0.0, ease=0.0, coarse=1.0)
"""The filter as Algorithms 1 and 2 state it."""


@dataclass(frozen=True)
class Samples:
    """One picture with what is known of its samples.

    Attributes
    ----------
    picture : (rows, columns, channels) float32
        Means of the samples.
    histogram : (rows, columns, bins) float32
        Votes, the colours one after another.
    count : (rows, columns) float32
        Samples per pixel.
    means : (rows, columns, 6) float32 or None
        Means of the samples' three colours, and the variances of these means; None where they are not to be compared.
    """

    picture: Floats
    histogram: Floats
    count: Floats
    means: Floats | None = None


@dataclass(frozen=True)
class Fused:
    """A filtered picture.

    Attributes
    ----------
    picture : (rows, columns, channels) float32
        The filtered picture.
    similar : (rows, columns) float32
        Similar patches found for each pixel's patch, its own included, partly similar ones counted in part: where
        this is low, more samples are needed.
    """

    picture: Floats
    similar: Floats


def fuse_scale(
    frame: Samples, parameters: FilterParameters, *, neighbours: Sequence[Samples] = (), threads: int = 1
) -> Fused:
    """The picture of one scale, filtered by Algorithm 1.

    Parameters
    ----------
    frame : Samples
        What to filter.
    parameters : FilterParameters
        Its `scales` and `coarse` do not matter here.
    neighbours : sequence of Samples
        Frames before and after, of the same size: similar patches are sought in them too.
    threads : int
        Bands filtered at once; the result does not depend on it.

    Raises
    ------
    BadInput
        If the frames differ in size.
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
    p = parameters
    rules = Rules(p.patch, p.kappa, p.softness, p.at_least, p.least_count, p.welch, p.doubt, p.trend, p.trust, p.ease)
    rows, columns = frame.count.shape
    similar = np.empty((rows, columns), np.float32)
    fused = np.empty((rows, columns, stack.planes.shape[1]), np.float32)

    def fuse_rows(top: int, end: int) -> None:
        found = similar[top:end]
        band = np.empty((stack.planes.shape[1], *found.shape), np.float32)
        fuse_band(stack, candidates, half, rules, top, band, found)
        fused[top:end] = np.moveaxis(band, 0, -1)

    height = max(4, min(BAND_ROWS, BAND_FLOATS // (len(candidates) * columns)))
    with ThreadPoolExecutor(threads) as pool:
        rims = np.linspace(0, rows, -(-rows // height) + 1).astype(int).tolist()  # bands of one size for all threads
        for _ in pool.map(fuse_rows, rims[:-1], rims[1:]):
            pass
    return Fused(fused, similar)


def _compared(frame: Samples, parameters: FilterParameters) -> Floats:
    """Its means, or none if they do not count."""
    if frame.means is None or parameters.welch == 0:
        return np.empty((*frame.count.shape, 0), np.float32)
    return frame.means


def _stacked(arrays: list[Floats]) -> Floats:
    """One array more dimension; without a copy where there is but one array."""
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float32)[None]
    return np.ascontiguousarray(np.stack(arrays), np.float32)


def search_block(half_size: int, frames: int) -> tuple[Ints, int]:
    """Candidates (n, 3) as frame, row offset, column offset, in the kernels' order; and how many are forward."""
    block = [(y, x) for y in range(-half_size, half_size + 1) for x in range(-half_size, half_size + 1)]
    forward = [offset for offset in block if offset > (0, 0)]
    own = [(0, 0, 0), *((0, y, x) for y, x in forward), *((0, -y, -x) for y, x in forward)]
    others = [(frame, y, x) for frame in range(1, frames) for y, x in block]
    return np.array(own + others, np.int64), len(forward)
