"""Chapter 4 of the thesis, comparisons: numbers of bins, NL-means with an oracle, and its bias over samples. Films with
other numbers of bins are rendered by the program's own path tracer."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from procedures.ray_histogram.film import EXPONENT, RANGE, Film
from procedures.ray_histogram.filter import PAPER, Samples, fuse_scale, search_block
from procedures.ray_histogram.kernels import FAR, Rules, Stack, band_ratios
from procedures.ray_histogram.multiscale import samples_of
from simulators.rays.path_tracer import cast
from simulators.rays.ray_scenes import SCENES
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.rays_rows import FILMS, OCTAVES, decibels, film_and_reference, psnr, shown
from station.demo.reproduce.row import Order, RowValues, Setting, ordered

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]

SIZE = (72, 96)
SAMPLES, REFERENCE_SAMPLES = 64, 512
SCENE = "room"
"""Samples per pixel of the films rendered here, and of what they are compared with."""


@cache
def rendered(scene: str, samples: int, seed: int, threads: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Pixel (n,) and linear colour (n, 3) of each sample of a scene of the program's own."""
    parts: list[tuple[npt.NDArray[np.int64], Array]] = []
    cast(
        *SCENES[scene](*SIZE),
        samples,
        lambda row, column, colour: parts.append((row * SIZE[1] + column, colour)),
        seed=seed,
        threads=threads,
    )
    pixels, colours = zip(*parts, strict=True)
    return np.concatenate(pixels), np.concatenate(colours)


@cache
def rendered_reference(scene: str, threads: int) -> Film:
    """A film of a scene with many samples."""
    film = Film.blank(*SIZE)
    cast(*SCENES[scene](*SIZE), REFERENCE_SAMPLES, film.add, seed=99, threads=threads)
    return film


def histograms(pixels: npt.NDArray[np.int64], colours: Array, bins: int, *, joint: bool) -> Floats:
    """Votes of samples (n, 3), divided between neighbouring nodes as `film.vote` does, (rows, columns, b).

    joint : one histogram over the three colours with bins^3 nodes, instead of three with `bins` nodes each.
    """
    v = (np.maximum(colours, 0) / RANGE) ** (1 / EXPONENT)
    position = np.where(v <= 1, v * (bins - 2), np.minimum(bins - 3 + v, bins - 1))
    low = np.minimum(position.astype(np.int64), bins - 2)
    nodes = [(low, 1 - (position - low)), (low + 1, position - low)]
    count, each = SIZE[0] * SIZE[1], bins**3 if joint else 3 * bins
    votes = np.zeros(count * each)
    if joint:
        for (r, a), (g, b), (u, c) in product(nodes, repeat=3):
            cell = (r[:, 0] * bins + g[:, 1]) * bins + u[:, 2]
            votes += np.bincount(pixels * each + cell, a[:, 0] * b[:, 1] * c[:, 2], votes.size)
    else:
        for (node, weight), colour in product(nodes, range(3)):
            votes += np.bincount(pixels * each + colour * bins + node[:, colour], weight[:, colour], votes.size)
    return votes.reshape(*SIZE, each).astype(np.float32)


NEAREST = replace(PAPER, kappa=1e-6, at_least=14, scales=1)
"""The average of the 15 nearest patches, the patch itself included."""
JOINT, SEPARATE = (3, 4, 5), (5, 10, 15, 20, 25)


@ordered(
    Order(
        "more bins increase the PSNR, and three histograms of 20 bins are better than a joint one",
        lambda v: all(a < b for a, b in pairwise(v[3:8])) and v[8] > 0 and v[9] > 0,
    )
)
def rays_bins(setting: Setting) -> RowValues:
    """PSNR of the average of the 15 nearest patches over the number of bins, joint and separate histograms."""
    pixels, colours = rendered(SCENE, SAMPLES, 1, setting.threads)
    reference = rendered_reference(SCENE, setting.threads)
    count = np.full(SIZE, SAMPLES, np.float32)
    total = [np.bincount(pixels, colours[:, c], SIZE[0] * SIZE[1]).reshape(SIZE) for c in range(3)]
    mean = (np.stack(total, axis=-1) / SAMPLES).astype(np.float32)

    def quality(bins: int, *, joint: bool) -> float:
        frame = Samples(mean, histograms(pixels, colours, bins, joint=joint), count)
        return psnr(fuse_scale(frame, NEAREST, threads=setting.threads).picture, reference)

    together = [quality(bins, joint=True) for bins in JOINT]
    separate = [quality(bins, joint=False) for bins in SEPARATE]
    shown = [
        Curve("three", [3 * n for n in SEPARATE], separate, "o-"),
        Curve("joint", [n**3 for n in JOINT], together, "s-"),
    ]
    figure = curves("bins", shown, x="bins", y="PSNR, dB", log="x")
    return RowValues((*together, *separate, separate[-1] - separate[0], separate[3] - together[-1]), (figure,))


def patch_distances(film: Film, patch: int, *, by_means: bool) -> tuple[npt.NDArray[np.int64], Floats]:
    """Candidates (n, 3) of the search block, and the distance of each patch from them, (n, rows, columns).

    by_means : NL-means', squared differences of the pixels' means over the variance of their noise, instead of the
        distance of histograms.
    """
    frame = samples_of(film)
    assert frame.means is not None
    empty = np.empty((*frame.count.shape, 0), np.float32)
    compared = (empty, frame.means) if by_means else (frame.histogram, empty)
    planes = np.ascontiguousarray(np.moveaxis(frame.picture, -1, 0))
    candidates, half = search_block(PAPER.search, 1)
    distances = np.empty((len(candidates), *frame.count.shape), np.float32)
    rules = Rules(*(getattr(replace(PAPER, patch=patch), name) for name in Rules._fields))
    band_ratios(
        Stack(planes[None], compared[0][None], frame.count[None], compared[1][None]),
        candidates,
        half,
        rules,
        0,
        distances,
    )
    return candidates, distances


def oracle(film: Film, truth: Array, patch: int, *, by_means: bool) -> Array:
    """The picture from patches averaged with as many of the nearest ones as bring them closest to the truth."""
    candidates, distances = patch_distances(film, patch, by_means=by_means)
    rows, columns = film.count.shape
    reach = PAPER.search + patch
    noisy, true = (
        np.lib.stride_tricks.sliding_window_view(np.pad(a, ((n, n), (n, n), (0, 0)), mode="edge"), (side, side), (0, 1))
        for side in (2 * patch + 1,)
        for a, n in ((film.mean.astype(np.float32), reach), (truth.astype(np.float32), patch))
    )
    total, weights = (np.zeros((rows + 2 * patch, columns + 2 * patch, n)) for n in (3, 1))
    across = np.arange(columns)
    for r in range(rows):
        order = np.argsort(distances[:, r], axis=0)
        near = np.take_along_axis(distances[:, r], order, 0)
        dy, dx = candidates[order, 1], candidates[order, 2]
        means = np.cumsum(noisy[r + PAPER.search + dy, across + PAPER.search + dx], axis=0)
        means /= np.arange(1, len(order) + 1, dtype=np.float32).reshape(-1, 1, 1, 1, 1)
        error = ((means - true[r]) ** 2).sum((-3, -2, -1))
        best = np.where(near < FAR, error, np.inf).argmin(axis=0)
        patches = means[best, across]
        for y, x in np.ndindex(patches.shape[-2:]):
            total[r + y, x : x + columns] += patches[..., y, x]
            weights[r + y, x : x + columns] += 1
    inside = np.s_[patch : patch + rows, patch : patch + columns]
    return np.asarray(total[inside] / weights[inside])


SIDES = ("1 × 1", "3 × 3", "5 × 5")


def _oracle_order(v: tuple[float, ...]) -> bool:
    by_means, by_histograms = v[:3], v[3:6]
    return all(a < b for a, b in zip(by_means, by_histograms, strict=True)) and by_histograms[1] > by_means[2]


@ordered(
    Order(
        "histograms are better than means with each patch, and with 3 × 3 better than means with 5 × 5", _oracle_order
    )
)
def rays_oracle(setting: Setting) -> RowValues:
    """PSNR with the ideal number of nearest patches at each pixel: NL-means and histograms, three sizes of patch."""
    film, truth = film_and_reference(setting, 256)
    estimates = [oracle(film, truth.mean, patch, by_means=by_means) for by_means in (True, False) for patch in range(3)]
    names = [f"{name}, {side}" for name in ("NL-means", "histograms") for side in SIDES]
    figure = pictures("oracle", [(name, shown(one)) for name, one in zip(names, estimates, strict=True)], columns=3)
    return RowValues(tuple(psnr(estimate, truth) for estimate in estimates), (figure,))


def nl_means(film: Film) -> Array:
    """NL-means whose patch distances know the noise: weights exp(-max(0, d - 1) / 0.7^2)."""
    candidates, distances = patch_distances(film, 1, by_means=True)
    weights = np.where(distances < FAR, np.exp(-np.maximum(distances - 1, 0) / 0.7**2), 0)
    n = PAPER.search
    padded = np.pad(film.mean, ((n, n), (n, n), (0, 0)), mode="edge")
    rows, columns = film.count.shape
    total = np.zeros((rows, columns, 3))
    for (_, dy, dx), weight in zip(candidates, weights, strict=True):
        total += weight[..., None] * padded[n + dy : n + dy + rows, n + dx : n + dx + columns]
    return np.asarray(total / weights.sum(axis=0)[..., None])


@ordered(Order("the bias of NL-means is larger than the filter's", lambda v: v[2] > 1 and v[1] > v[0]))
def rays_bias(setting: Setting) -> RowValues:
    """Gain of PSNR per octave of samples: below 3 dB by a bias, NL-means' three times the filter's."""
    films = {samples: film_and_reference(setting, samples) for samples in FILMS}
    by_method = {
        "path tracing": [psnr(film.mean, truth) for film, truth in films.values()],
        "histograms": [decibels(setting, samples, 1.0, 3) for samples in films],
        "NL-means": [psnr(nl_means(film), truth) for film, truth in films.values()],
    }
    figure = curves(
        "bias", [Curve(name, list(FILMS), one, "o-") for name, one in by_method.items()],
        x="samples per pixel", y="PSNR, dB", log="x",
    )  # fmt: skip
    bias = {name: IDEAL - (one[1] - one[0]) / OCTAVES for name, one in by_method.items()}
    measured = (bias["histograms"], bias["NL-means"], bias["NL-means"] / bias["histograms"])
    return RowValues(measured, (figure,))


IDEAL = 3.0
"""Gain of the mean of independent samples, dB per octave."""
