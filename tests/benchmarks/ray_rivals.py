"""Two later filters of the same statistics, from their published descriptions, for comparison with ours.

python -m tests.benchmarks.ray_rivals prints the PSNR of all of them on the Cornell box, and with names of the project's
scenes after it, on small renders of those. Neither rival is given feature buffers (albedo, normals), as ours is not.

- *Welch*: pixels are averaged with those around, by distance, whose means a Welch test does not distinguish (Sakai and
  others, A Statistical Approach to Monte Carlo Denoising, 2024); as it is, and on samples under a Box-Cox transform.
- *Collaborative*: patches of like histograms are a group; each of them is estimated by Bayes' rule from the group's
  mean and covariance and the noise's, twice, over three scales (Boughida and Boubekeur, Bayesian Collaborative
  Denoising for Monte Carlo Rendering, 2017). Every patch has its group: none is skipped to save time.

The published films hold no covariance of the colours. There the second is given the correlation that suits it best.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.ray_histogram.comparison import psnr_db, shown_error
from procedures.ray_histogram.film import BINS, EXPONENT, RANGE, Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import search_block
from procedures.ray_histogram.kernels import Rules, Stack, band_ratios
from procedures.ray_histogram.multiscale import SIGMA, downsample, filter_film, recombine, samples_of
from procedures.ray_histogram.uncertainty import coverage, standard_uncertainty
from procedures.reading.arrays import read_npz
from simulators.rays.path_tracer import cast
from simulators.rays.ray_scenes import SCENES
from tests.benchmarks import options
from tests.benchmarks.ray_histograms import DATA, film_of

Doubles = npt.NDArray[np.float64]
THREADS = os.cpu_count() or 1

CRITICAL = (2.0, 2.8, 3.5)
"""Differences over their standard deviation that the Welch test lets pass; 2.8 is a level of 0.005."""
BOX_COX = (1.0, 0.5)
RADII = (10, 20)
"""Of the Welch filter's window, pixels; its Gaussian has half of it as standard deviation."""
CORRELATIONS = (0.0, 0.8, 0.9, 0.97)
SCALES, SEARCH, PATCH = 3, 6, 1
LEAST_EIGENVALUE = 1e-10


def welch(film: Film, critical: float, power: float, radius: int) -> Doubles:
    """The film's picture, each pixel averaged with those that no Welch test distinguishes from it in a colour."""
    mean, error = _transformed(film, power)
    total, weights = film.mean.copy(), np.ones((*film.count.shape, 1))
    for dy, dx in _half_disc(radius):
        a, b = _pair(film.count.shape, dy, dx)
        alike = ((mean[a] - mean[b]) ** 2 < critical**2 * (error[a] + error[b])).all(-1, keepdims=True)
        weight = alike * np.exp(-2 * (dy * dy + dx * dx) / radius**2)
        for here, there in ((a, b), (b, a)):
            total[here] += weight * film.mean[there]
            weights[here] += weight
    answer: Doubles = total / weights
    return answer


def _transformed(film: Film, power: float) -> tuple[Doubles, Doubles]:
    """Mean of the samples and its variance; under a Box-Cox transform they are read off the histograms."""
    if power == 1.0:
        return film.mean, np.maximum(mean_variance(film), 1e-8)
    nodes = RANGE * np.append(np.linspace(0, 1, BINS - 1), 2.0) ** EXPONENT
    values, votes = (nodes**power - 1) / power, film.histogram.astype(np.float64)
    count = film.count[..., None].astype(np.float64)
    mean = votes @ values / count
    return mean, np.maximum(votes @ values**2 / count - mean**2, 1e-8) / (count - 1)


def _half_disc(radius: int) -> Iterator[tuple[int, int]]:
    for dy in range(radius + 1):
        for dx in range(-radius, radius + 1):
            if (dy, dx) > (0, 0) and dy * dy + dx * dx <= radius * radius:
                yield dy, dx


def _pair(size: tuple[int, ...], dy: int, dx: int) -> tuple[Any, Any]:
    """Two windows on a picture, the second moved by (dy, dx)."""
    rows, columns = size
    first = np.s_[: rows - dy, max(0, -dx) : columns - max(0, dx)]
    return first, np.s_[dy:, max(0, dx) : columns - max(0, -dx)]


def collaborative(film: Film, covariance: Doubles, kappa: float = 1.0) -> Doubles:
    """The film's picture by Bayes' rule in groups of patches; covariance (rows, columns, 3, 3) is of its means."""
    frame, pictures = samples_of(film), []
    for s in range(SCALES):
        level = frame if s == 0 else downsample(frame, s)
        noise = covariance if s == 0 else _coarser(covariance, s, level.count.shape)
        nothing = np.empty((1, *level.count.shape, 0), np.float32)
        stack = Stack(np.moveaxis(level.picture, -1, 0)[None].copy(), level.histogram[None], level.count[None], nothing)
        candidates, half = search_block(SEARCH, 1)
        ratios = np.empty((len(candidates), *level.count.shape), np.float32)
        rules = Rules(PATCH, kappa, 0.0, 0, 1.0, 0.0, 0.0, False, 0.0, 0.0, 0.0)
        band_ratios(stack, candidates, half, rules, 0, ratios)
        total, weight = _groups(level.picture.astype(np.float64), noise, ratios < kappa, candidates, PATCH)
        pictures.append((total.sum(0) / weight.sum(0)[..., None]).astype(np.float32))
    return recombine(pictures, 1.0).astype(np.float64)


def _coarser(covariance: Doubles, s: int, size: tuple[int, ...]) -> Doubles:
    """Of pixels that are weighted means of finer ones: those of the finer, by the weights' squares."""
    sigma = SIGMA * np.sqrt(4.0**s - 1)
    weights = np.exp(-(np.arange(-20, 21) ** 2) / (2 * sigma**2))
    squares = (weights / weights.sum()) ** 2
    along = ndimage.convolve1d(ndimage.convolve1d(covariance, squares, axis=0), squares, axis=1)
    step = 2**s
    return np.ascontiguousarray(along[::step, ::step]).reshape(*size, 3, 3)


@numba.njit(parallel=True)  # type: ignore[untyped-decorator]
def _groups(
    picture: Doubles, noise: Doubles, alike: npt.NDArray[np.bool_], candidates: npt.NDArray[np.int64], w: int
) -> tuple[Doubles, Doubles]:
    rows, columns = picture.shape[:2]
    size, bands = 3 * (2 * w + 1) ** 2, 16
    total, weight = np.zeros((bands, rows, columns, 3)), np.zeros((bands, rows, columns))
    for band in numba.prange(bands):
        patches = np.empty((len(candidates), size))
        places = np.empty((len(candidates), 2), np.int64)
        for r in range(w + band * (rows - 2 * w) // bands, w + (band + 1) * (rows - 2 * w) // bands):
            for c in range(w, columns - w):
                n = 0
                own = np.zeros((size, size))
                for j in range(len(candidates)):
                    y, x = r + candidates[j, 1], c + candidates[j, 2]
                    if not alike[j, r, c] or y < w or y >= rows - w or x < w or x >= columns - w:
                        continue
                    places[n] = y, x
                    for i in range(size):
                        yy, xx, b = y - w + i // 3 // (2 * w + 1), x - w + i // 3 % (2 * w + 1), i % 3
                        patches[n, i] = picture[yy, xx, b]
                        for k in range(3):
                            own[i, i - b + k] += noise[yy, xx, b, k]
                    n += 1
                own /= n
                found = _estimate(patches[:n], own)
                for g in range(n if n > size else 1):  # the own patch is the first
                    y, x = places[g]
                    for i in range(size):
                        total[band, y - w + i // 3 // (2 * w + 1), x - w + i // 3 % (2 * w + 1), i % 3] += found[g, i]
                    weight[band, y - w : y + w + 1, x - w : x + w + 1] += 1.0
    return total, weight


@numba.njit  # type: ignore[untyped-decorator]
def _estimate(patches: Doubles, noise: Doubles) -> Doubles:
    """Patches (n, size) of one group without their noise; their mean where they are too few for a covariance."""
    n, size = patches.shape
    if n <= size:
        return np.zeros_like(patches) + patches.sum(0) / n
    known = patches
    mean = patches.sum(0) / n
    prior = np.zeros((size, size))
    for step in range(2):
        spread = known - known.sum(0) / n
        prior = np.ascontiguousarray(spread.T) @ spread / (n - 1)
        if step == 0:  # the noise is still in it
            values, vectors = np.linalg.eigh(prior - noise)
            prior = np.ascontiguousarray(vectors * np.maximum(values, 0.0)) @ np.ascontiguousarray(vectors.T)
        gain = np.linalg.solve(prior + noise + LEAST_EIGENVALUE * np.eye(size), prior)
        known = mean + (patches - mean) @ gain
    return known


@dataclass(frozen=True)
class Judge:
    """How far a picture is from the converged one, as it is printed."""

    truth: Doubles | Film

    def best(self, pictures: dict[str, Doubles]) -> str:
        """Of several attempts the best, what it was, and how many there were."""
        name = max(pictures, key=lambda one: self.decibels(pictures[one])[0])
        values = " / ".join(f"{value:.2f}" for value in self.decibels(pictures[name]))
        return f"{values:16s} {name}, best of {len(pictures)}" if len(pictures) > 1 else values

    def decibels(self, picture: Doubles) -> tuple[float, ...]:
        """PSNR, clipped and unclipped; against a film clipped only, less what the film's own noise adds."""
        if isinstance(self.truth, Film):
            return (float(-10 * np.log10(shown_error(picture, self.truth))),)
        return psnr_db(picture, self.truth)


def compare(film: Film, covariances: dict[str, Doubles], judge: Judge) -> None:
    """Print all filters' errors, and the coverage of our uncertainty."""
    found = filter_film(film, threads=THREADS)
    stated = standard_uncertainty(film, found.picture, threads=THREADS)
    attempts = {
        f"test at {critical} sigma, power {power}, radius {radius}": welch(film, critical, power, radius)
        for critical in CRITICAL for power in BOX_COX for radius in RADII
    }  # fmt: skip
    print(f"  input          {judge.best({'': film.mean})}")
    print(f"  Welch          {judge.best(attempts)}")
    print(f"  collaborative  {judge.best({name: collaborative(film, one) for name, one in covariances.items()})}")
    print(f"  ours           {judge.best({'': found.picture.astype(np.float64)})}")
    truth = judge.truth.mean if isinstance(judge.truth, Film) else judge.truth
    if isinstance(judge.truth, Film):  # the converged render errs too
        stated = np.sqrt(stated**2 + mean_variance(judge.truth)).astype(np.float32)
    print(
        f"  ours: {coverage(found.picture, stated, truth):.1%} of values within two standard uncertainties", flush=True
    )


def correlated(film: Film, correlation: float) -> Doubles:
    """Covariance of the pixels' means where the colours have one correlation."""
    deviation = np.sqrt(mean_variance(film))
    mixed = np.full((3, 3), correlation) + (1 - correlation) * np.eye(3)
    answer: Doubles = deviation[..., :, None] * deviation[..., None, :] * mixed
    return answer


class CovarianceFilm:
    """A film that keeps the colours' covariance too."""

    def __init__(self, rows: int, columns: int) -> None:
        self.film, self.products = Film.blank(rows, columns), np.zeros((rows, columns, 3, 3))

    def add(self, row: npt.NDArray[np.int64], column: npt.NDArray[np.int64], colour: Doubles) -> None:
        """Take samples in."""
        self.film.add(row, column, colour)
        np.add.at(self.products, (row, column), colour[:, :, None] * colour[:, None, :])

    @property
    def covariance(self) -> Doubles:
        """Of the pixels' means."""
        n, mean = self.film.count[..., None, None].astype(np.float64), self.film.mean
        answer: Doubles = (self.products / n - mean[..., :, None] * mean[..., None, :]) / (n - 1)
        return answer


def render(name: str, columns: int, samples: int, converged: int) -> None:
    """One of the project's scenes, against a render of other samples."""
    scene, camera = SCENES[name](3 * columns // 4, columns)
    taken, reference = (CovarianceFilm(camera.rows, camera.columns) for _ in range(2))
    shoot = partial(cast, scene, camera, threads=THREADS)
    shoot(samples, taken.add, seed=1)
    shoot(converged, reference.film.add, seed=2)
    print(f"\n{name}: {camera.columns} x {camera.rows}, {samples} samples, converged with {converged}")
    compare(taken.film, {"measured covariance": taken.covariance}, Judge(reference.film))


def main() -> None:
    """Print the Cornell box, then the scenes that were named."""
    given = options(__doc__, "scenes", scenes=list(SCENES), columns=80, samples=64, converged=1024)
    numba.set_num_threads(THREADS)
    truth = read_npz(DATA / "cornell_reference.npz", ("reference",))[0]["reference"].astype(np.float64)
    for samples in (64, 256):
        film = film_of(samples)
        print(f"\nCornell box, {samples} samples, PSNR in dB clipped / unclipped")
        compare(film, {f"correlation {rho}": correlated(film, rho) for rho in CORRELATIONS}, Judge(truth))
    for name in given.scenes:
        render(name, given.columns, given.samples, given.converged)


if __name__ == "__main__":
    main()
