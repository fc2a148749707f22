"""The film: statistics of each pixel's samples, in memory that does not grow with their number.

Histograms follow section 4.4.1 of Delbracio's thesis: 20 bins per colour, triangular votes, and bins that widen with
the sample's value L: in v = (L / 7.5)^(1 / 2.2) the first 19 nodes are i/18, the last is 2, and larger values fall into
the last bin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.display import summary
from procedures.numerics.arrays import Array, Array32, Indices
from procedures.numerics.compiled import compiled
from procedures.outcome import BadInput

Counts = npt.NDArray[np.uint32]

BINS = 20  # bins per colour
EXPONENT = 2.2  # exponent of the sample's value by which bins widen
RANGE = 7.5  # value of a sample at which the evenly spaced nodes end
LARGEST = 1e30  # upper limit of a pixel's value: filtering in single precision must hold sums of a million of them
SUM_TOLERANCE = 0.005
"""Relative difference allowed between a histogram's sum and its count: votes may have been stored in half precision."""


@dataclass(frozen=True)
class Film:
    """Samples gathered per pixel; the arrays grow in place as samples are added.

    histogram : (rows, columns, 3, 20) float32
        Votes; each colour's sum is the count. No bins, (rows, columns, 3, 0), where only mean and variance are known.
    mean : (rows, columns, 3) float64, the picture: linear, 1 = white
    moment2 : (rows, columns, 3) float64 or None
        Sum of squared differences from the mean; None if the film was made without it.
    count : (rows, columns) uint32, valid samples
    dropped : (rows, columns) uint32, samples dropped because they are not finite
    """

    histogram: Array32
    mean: Array
    moment2: Array | None
    count: Counts
    dropped: Counts

    __repr__ = summary

    @classmethod
    def blank(cls, rows: int, columns: int) -> Film:
        """A film without samples."""
        return cls(
            np.zeros((rows, columns, 3, BINS), np.float32),
            np.zeros((rows, columns, 3)),
            np.zeros((rows, columns, 3)),
            np.zeros((rows, columns), np.uint32),
            np.zeros((rows, columns), np.uint32),
        )

    @property
    def variance(self) -> Array | None:
        """Unbiased variance of single samples, (rows, columns, 3); 0 for a single sample; None if not recorded."""
        if self.moment2 is None:
            return None
        variance: Array = self.moment2 / np.maximum(self.count.astype(np.float64) - 1.0, 1.0)[..., None]
        return variance

    def add(self, row: npt.ArrayLike, column: npt.ArrayLike, colour: npt.ArrayLike) -> None:
        """Add samples in place: rows (n,), columns (n,), linear colours (n, 3) in any order.

        Samples that are not finite are dropped and counted; negative ones vote in the first bin.

        Raises BadInput if a sample lies outside the film, or the film has no variance.
        """
        rows = np.asarray(row, np.int64).ravel()
        columns = np.asarray(column, np.int64).ravel()
        colours = np.ascontiguousarray(colour, np.float64).reshape(-1, 3)
        if not rows.size == columns.size == len(colours):
            raise BadInput(
                f"samples need one row, column and colour each; got {rows.size} rows, {columns.size} columns and "
                f"{len(colours)} colours",
                "give arrays of the same length",
            )
        height, width = self.count.shape
        if rows.size and (rows.min() < 0 or rows.max() >= height or columns.min() < 0 or columns.max() >= width):
            raise BadInput(
                f"samples must lie in the film of {height} x {width}; got rows {rows.min()} to {rows.max()}, columns "
                f"{columns.min()} to {columns.max()}",
                "give rows and columns counted from 0",
            )
        if self.moment2 is None:
            raise BadInput("the film has no variance", "add the samples to a blank film and merge the two")
        _expose(rows, columns, colours, self.histogram, self.mean, self.moment2, self.count, self.dropped)

    def merge(self, other: Film) -> Film:
        """The film of the samples of both films.

        Raises BadInput if the films differ in size.
        """
        if self.count.shape != other.count.shape:
            raise BadInput(
                f"films to merge need one size; got {self.count.shape} and {other.count.shape} pixels",
                "merge films of the same picture",
            )
        n0, n1 = (count.astype(np.float64)[..., None] for count in (self.count, other.count))
        share = n1 / np.maximum(n0 + n1, 1.0)
        step = other.mean - self.mean
        moment2 = None
        if self.moment2 is not None and other.moment2 is not None:
            moment2 = self.moment2 + other.moment2 + step**2 * n0 * share
        return Film(
            self.histogram + other.histogram,
            self.mean + step * share,
            moment2,
            self.count + other.count,
            self.dropped + other.dropped,
        )

    def checked(self) -> Film:
        """The film itself, if it can be filtered.

        Raises BadInput if sizes differ, a count is negative or zero, a value is not finite or too large, a variance is
        impossible, or histograms and counts disagree.
        """
        size = self.count.shape
        bins = 0 if self.histogram.shape[-1] == 0 and self.moment2 is not None else BINS
        if self.mean.shape != (*size, 3) or self.histogram.shape != (*size, 3, bins):
            raise BadInput(
                f"picture, histograms and counts need one size; got {self.mean.shape}, {self.histogram.shape} and "
                f"{size}",
                f"give (rows, columns, 3), (rows, columns, 3, {BINS}) and (rows, columns)",
            )
        _refuse_where(~np.isfinite(self.mean).all(-1), "pixels are NaN or infinite", "render them again")
        _refuse_where((np.abs(self.mean) > LARGEST).any(-1), f"pixels are beyond {LARGEST:g}", "render them again")
        _refuse_where(self.count == 0, "pixels are empty", "cast at least one sample in each")
        if self.moment2 is not None:
            bad = ~((self.moment2 >= 0) & (self.moment2 < np.inf)).all(-1)
            _refuse_where(bad, "pixels have a variance that is negative, NaN or infinite", "write the variance again")
        if self.histogram.shape[-1] == 0:
            return self
        votes = self.histogram @ np.ones(BINS, np.float32)
        if not self.histogram.min() >= 0:  # false for NaN too
            bad = ~(self.histogram >= 0).all((-2, -1))
            _refuse_where(bad, "pixels have negative or NaN votes in their histograms", "write the histograms again")
        counts = self.count.astype(np.float32)[..., None]
        excess = np.abs(votes - counts) > SUM_TOLERANCE * (counts + 1)
        _refuse_where(
            excess.any(-1),
            "pixels have histograms that do not sum to their count",
            "give the histograms of this picture",
        )
        return self


def film_of_samples(samples: npt.NDArray[np.floating]) -> Film:
    """The film of an array of samples, (rows, columns, n, 3)."""
    if samples.ndim != 4 or samples.shape[3] != 3 or 0 in samples.shape:
        raise BadInput(f"samples of shape {samples.shape}", "give an array (rows, columns, samples, 3)")
    rows, columns, n, _ = samples.shape
    film = Film.blank(rows, columns)
    for r in range(rows):
        film.add(np.full(columns * n, r), np.repeat(np.arange(columns), n), samples[r])
    return film


def _refuse_where(condition: npt.ArrayLike, what: str, remedy: str) -> None:
    bad = np.asarray(condition)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise BadInput(f"{int(bad.sum())} of {bad.size} {what}, the first at row {row}, column {column}", remedy)


@compiled
def _expose(
    rows: Indices, columns: Indices, colours: Array,
    histogram: Array32, mean: Array, moment2: Array, count: Counts, dropped: Counts,
) -> None:  # fmt: skip
    for i in range(rows.size):
        r, c = rows[i], columns[i]
        if not (np.isfinite(colours[i, 0]) and np.isfinite(colours[i, 1]) and np.isfinite(colours[i, 2])):
            dropped[r, c] += 1
            continue
        count[r, c] += 1
        for b in range(3):
            value = colours[i, b]
            step = value - mean[r, c, b]
            mean[r, c, b] += step / count[r, c]
            moment2[r, c, b] += step * (value - mean[r, c, b])
            vote(value, histogram[r, c, b])


@compiled
def vote(value: float, histogram: Array32) -> None:
    """Divide one vote between the two nodes next to the value."""
    last = histogram.size - 1
    v = (max(value, 0.0) / RANGE) ** (1.0 / EXPONENT)
    position = v * (last - 1) if v <= 1.0 else min(last - 2.0 + v, float(last))
    low = min(int(position), last - 1)
    histogram[low + 1] += np.float32(position - low)
    histogram[low] += np.float32(1.0 - (position - low))
