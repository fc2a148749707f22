"""Filters on scenes of an independent renderer, Mitsuba 3: relative error, PSNR, coverage of the uncertainty.

python -m tests.benchmarks.ray_truth FOLDER [scene ...] [--converged 2048]; FOLDER keeps the renders. Requires the
packages mitsuba and, for the columns of Open Image Denoise, pyoidn. relMSE is the mean of (x - t)^2 / (t^2 + 0.01),
PSNR is of values clipped to [0, 1]; both less the converged picture's own noise. The bilateral filter is the best by
PSNR of 36 settings, chosen by the truth. With albedo both filter the samples divided by it.
"""

import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from procedures import BadInput, filter_film
from procedures.ray_histogram.blend import blend, divisor, open_image_denoise
from procedures.ray_histogram.comparison import psnr_db
from procedures.ray_histogram.render_files import Halves, halves_of_pictures, halves_of_samples
from procedures.ray_histogram.uncertainty import standard_uncertainty
from tests.benchmarks import options
from tests.benchmarks.ray_histograms import nl_means
from tests.benchmarks.ray_truth_scenes import HELD_OUT, SCENES, Render, render

Picture = npt.NDArray[np.floating]
Result = tuple[str, Picture, npt.NDArray[np.float32] | None]

SAMPLES = (16, 64, 256)
THREADS = os.cpu_count() or 1


def bilateral(picture: Picture, truth: Picture) -> Picture:
    """The best of 36 bilateral filters, half of them of the logarithm."""
    attempts = []
    for colour, space in product((0.02, 0.05, 0.1, 0.2, 0.4, 0.8), (1.5, 3.0, 5.0)):
        attempts.append(cv2.bilateralFilter(picture.astype(np.float32), -1, colour, space))
        scaled = np.log1p(10 * np.maximum(picture, 0)).astype(np.float32)
        attempts.append(np.expm1(cv2.bilateralFilter(scaled, -1, 2 * colour, space)) / 10)
    return max(attempts, key=lambda attempt: psnr_db(attempt, truth)[0])


def results(scene: Render, n: int) -> Iterator[Result]:
    """Name, picture and uncertainty of every filter."""
    samples, features = scene.samples[:, :, :n], scene.features[:, :, :n]
    halves, whole = halves_of_samples(
        {"samples": samples, "albedo": features[..., :3], "normal": features[..., 3:6], "depth": features[..., 6]}
    )
    yield "unfiltered", whole.film.mean, None
    yield "NL-means", nl_means(whole.film), None
    yield "bilateral", bilateral(whole.film.mean, scene.truth), None
    if whole.light is not None and whole.albedo is not None:
        reflected = divisor(whole.albedo)
        yield "NL-means, albedo", nl_means(whole.light) * reflected, None
        yield "bilateral, albedo", bilateral(whole.light.mean, scene.truth / reflected) * reflected, None
    filtered = filter_film(whole.film, threads=THREADS).picture
    yield "default", filtered, standard_uncertainty(whole.film, filtered, threads=THREADS)
    blended = blend(halves, whole, threads=THREADS)[0]
    yield "blend", blended.picture, blended.uncertainty
    if n == SAMPLES[0]:
        pair = blend(*pictures(scene, n), threads=THREADS)[0]
        yield "EXR pair", pair.picture, pair.uncertainty
    try:
        yield "Open Image Denoise", open_image_denoise(whole), None
    except BadInput:
        return
    blended = blend(halves, whole, denoiser=open_image_denoise, threads=THREADS)[0]
    yield "blend, OIDN", blended.picture, blended.uncertainty


def pictures(scene: Render, n: int) -> Halves:
    """Even and odd samples as two renderers' pictures, of which only means are known."""
    layers = []
    for start in range(2):
        colour = scene.samples[:, :, start:n:2].mean(2, dtype=np.float64)
        surface = scene.features[:, :, start:n:2].mean(2, dtype=np.float64)
        layers.append(
            {"image": colour, "albedo": surface[..., :3], "normal": surface[..., 3:6], "depth": surface[..., 6]}
        )
    return halves_of_pictures(*layers)


def relative_error(picture: Picture, scene: Render) -> float:
    """Mean squared error over the squared truth."""
    squares = (picture - scene.truth) ** 2 - scene.truth_variance
    return float(np.mean(squares / (scene.truth**2 + 0.01)))


def decibels(picture: Picture, scene: Render) -> float:
    """PSNR of values clipped to [0, 1]; white pixels of the converged picture are taken as free of noise."""
    squares = (np.clip(picture, 0, 1) - np.clip(scene.truth, 0, 1)) ** 2 - scene.truth_variance * (scene.truth < 1)
    return float(-10 * np.log10(max(float(np.mean(squares)), 1e-12)))


def covered(picture: Picture, uncertainty: npt.NDArray[np.float32] | None, scene: Render) -> str:
    """Share of the noisy values within two standard uncertainties, with those of the converged picture and its sums.

    The converged picture's variance, of a few passes, is averaged over the pixels beside.
    """
    if uncertainty is None:
        return ""
    noise = gaussian_filter(scene.truth_variance, (1, 1, 0))
    combined = np.sqrt(uncertainty**2 + noise + (2.0**-20 * scene.truth) ** 2)
    within = np.abs(picture - scene.truth) <= 2 * combined
    return f"{np.mean(within[scene.samples.min(2) < scene.samples.max(2)]):.1%}"


def main() -> None:
    """Print a table of every scene and number of samples."""
    scenes = [*SCENES, *HELD_OUT]
    given = options(__doc__, "folder", "scenes", folder=Path, scenes=scenes, converged=2048, samples=list(SAMPLES))
    for name in given.scenes:
        scene = render(name, given.folder, given.converged)
        for n in given.samples:
            print(f"\n{name}, {n} samples      relMSE   PSNR, dB   within 2 u")
            for label, picture, uncertainty in results(scene, n):
                error, db = relative_error(picture, scene), decibels(picture, scene)
                print(f"{label:20s} {error:10.5f} {db:10.2f} {covered(picture, uncertainty, scene):>12s}", flush=True)


if __name__ == "__main__":
    main()
