"""Chapter 4 of the thesis, Ray Histogram Fusion: threshold, scales and samples, on films of the Cornell box.

The films come from the path tracer that the method's authors published, at 250 x 250 pixels. The thesis's own films,
256 x 256, are not published.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from procedures.ray_histogram.comparison import decibels as to_decibels
from procedures.ray_histogram.comparison import psnr_db, shown_error
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import read_film
from procedures.ray_histogram.filter import PAPER
from procedures.ray_histogram.multiscale import filter_film
from procedures.reading.arrays import checked_array, read_npz
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.row import Order, RowValues, Setting, ordered

Array = npt.NDArray[np.float64]

FILMS = {n: f"rays/cornell_{n:05d}_f16.npz|rays/room_{n:05d}.npz" for n in (64, 256)}
REFERENCE = "rays/cornell_reference.npz|rays/room_reference.npz"
GAMMA = 2.2
WIDE_PX = 6.0
"""Standard deviation of the low-pass filter that separates noise of low frequency, pixels: beyond the search block."""


@cache
def _film(path: Path) -> Film:
    return read_film(path).checked()


@cache
def _reference(path: Path) -> Film:
    arrays, names = read_npz(path, ("reference",))
    if "reference" not in names:
        return _film(path)
    picture = checked_array(arrays["reference"], f"the reference {path}", (None, None, 3))
    return replace(Film.blank(*picture.shape[:2]), mean=picture, moment2=None)


def film_and_reference(setting: Setting, samples: int) -> tuple[Film, Film]:
    """The film of the Cornell box, or else of the program's room, with that many samples, and the converged picture."""
    return _film(setting.path(FILMS[samples])), _reference(setting.path(REFERENCE))


def psnr(picture: npt.NDArray[np.floating], reference: Film) -> float:
    """PSNR, corrected for the noise of a reference rendered here; the published one is a picture alone."""
    if reference.variance is None:
        return psnr_db(picture, reference.mean)[0]
    return to_decibels(shown_error(picture, reference))


def _filtered(setting: Setting, samples: int, kappa: float, scales: int) -> Array:
    film, _ = film_and_reference(setting, samples)
    picture = filter_film(film, replace(PAPER, kappa=kappa, scales=scales), threads=setting.threads).picture
    return np.asarray(picture, dtype=np.float64)


def decibels(setting: Setting, samples: int, kappa: float, scales: int) -> float:
    """PSNR of a film filtered by the paper's algorithms."""
    return psnr(_filtered(setting, samples, kappa, scales), film_and_reference(setting, samples)[1])


def shown(picture: npt.NDArray[np.floating]) -> Array:
    """The picture as displayed."""
    return np.asarray(np.clip(picture, 0, 1) ** (1 / GAMMA), dtype=np.float64)


CASES = (
    (256, 1.0, 1), (256, 1.0, 2), (256, 1.0, 3), (256, 0.8, 2), (256, 0.8, 3),
    (64, 1.0, 2), (64, 1.0, 3), (64, 0.8, 2), (64, 0.8, 3),
)  # fmt: skip
"""Samples, kappa and scales of the published program's answers."""


@ordered(
    Order(
        "the filter gains 10 dB or more, each further scale increases the PSNR, and so do more samples",
        lambda v: v[1] - v[0] > 10 and v[1] < v[2] < v[3] and v[4] < v[5] and v[6] < v[7] < v[3] and v[8] < v[9] < v[5],
    )
)
def rays_cornell(setting: Setting) -> RowValues:
    """PSNR of the Cornell box as rendered with 256 samples, and filtered as the published program does."""
    film, truth = film_and_reference(setting, 256)
    ours = [decibels(setting, *case) for case in CASES]
    figure = pictures(
        "rays",
        [("256 samples", shown(film.mean)), ("filtered", shown(_filtered(setting, 256, 1.0, 3))),
         ("converged", shown(truth.mean))],
        columns=3,
    )  # fmt: skip
    return RowValues((psnr(film.mean, truth), *ours), (figure,))


KAPPAS = (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0)


@ordered(Order("the error has a minimum between", lambda v: min(v[1:]) > 1))
def rays_kappa(setting: Setting) -> RowValues:
    """A small threshold κ leaves noise, a large one blurs; the error is least at 0.7 to 1.0 (256 samples)."""
    _, truth = film_and_reference(setting, 256)
    estimates = [np.clip(_filtered(setting, 256, kappa, 3), 0, 1) for kappa in KAPPAS]
    error = np.array([10 ** (-psnr(estimate, truth) / 10) for estimate in estimates])
    best = int(np.argmin(error))
    rows, columns = truth.mean.shape[:2]
    detail = np.s_[rows // 2 : rows * 3 // 4, columns // 8 : columns * 3 // 8]
    figures = (
        curves("kappa", [Curve("3 scales, 256 samples", KAPPAS, error, "o-")], x="κ", y="MSE", log="y"),
        pictures(
            "kappa-details",
            [(f"κ = {KAPPAS[i]:g}", shown(estimates[i])[detail]) for i in (0, best, len(KAPPAS) - 1)],
            columns=3,
        ),
    )
    return RowValues((KAPPAS[best], float(error[0] / error[best]), float(error[-1] / error[best])), figures)


@ordered(Order("three scales leave less noise of low frequency than one", lambda v: v[0] < 1 and v[1] > 0))
def rays_scales(setting: Setting) -> RowValues:
    """Filtering at one scale leaves noise of low frequency that three scales remove (256 samples)."""
    _, truth = film_and_reference(setting, 256)
    estimates = {scales: _filtered(setting, 256, 1.0, scales) for scales in (1, 3)}
    wide = {}
    for scales, estimate in estimates.items():
        error = np.clip(estimate, 0, 1) - np.clip(truth.mean, 0, 1)
        wide[scales] = float(np.sqrt(np.mean(gaussian_filter(error, (WIDE_PX, WIDE_PX, 0)) ** 2)))
    middle, across = len(truth.mean) // 2, np.arange(truth.mean.shape[1])
    line = {f"scales: {scales}": estimate[middle].mean(axis=-1) for scales, estimate in estimates.items()}
    figures = (
        pictures("scales", [(f"scales: {n}", shown(estimate)) for n, estimate in estimates.items()], columns=2),
        curves(
            "scales-line",
            [Curve(name, across, one) for name, one in line.items()],
            x="column of the middle row",
            y="mean of the colours",
            published=Curve("converged", across, truth.mean[middle].mean(axis=-1)),
        ),
    )
    gain = psnr(estimates[3], truth) - psnr(estimates[1], truth)
    return RowValues((wide[3] / wide[1], gain), figures)


OCTAVES = 2.0


@ordered(Order("the filter's slope is smaller, its level far higher", lambda v: 0 < v[1] < v[0] and v[2] > 10))
def rays_samples(setting: Setting) -> RowValues:
    """PSNR over samples: path tracing gains 3 dB per octave, the filter nearly as much at a far higher level."""
    films = {n: film_and_reference(setting, n) for n in FILMS}
    rendered = {n: psnr(film.mean, truth) for n, (film, truth) in films.items()}
    filtered = {n: decibels(setting, n, 1.0, 3) for n in FILMS}
    shown = [
        Curve("path tracing", list(rendered), list(rendered.values()), "o-"),
        Curve("filtered", list(filtered), list(filtered.values()), "s-"),
    ]
    figure = curves("samples", shown, x="samples per pixel", y="PSNR, dB", log="x")
    slopes = [(one[256] - one[64]) / OCTAVES for one in (rendered, filtered)]
    gain = filtered[256] - rendered[256]
    remark = f"{gain:.1f} dB are the quality of {10 ** (gain / 10):.0f} times as many samples."
    return RowValues((*slopes, gain), (figure,), remark)
