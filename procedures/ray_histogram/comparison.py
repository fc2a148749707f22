"""Difference of a picture from the converged one: PSNR as in the literature, 10 log10(1 / mean squared error)."""

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput
from procedures.ray_histogram.film import Film

Linear = npt.NDArray[np.floating]


def psnr_db(picture: Linear, reference: Linear) -> tuple[float, float]:
    """PSNR with values clipped to [0, 1], and PSNR without clipping."""
    clipped = np.mean((np.clip(picture, 0, 1) - np.clip(reference, 0, 1)) ** 2, dtype=np.float64)
    return decibels(float(clipped)), decibels(float(np.mean((picture - reference) ** 2, dtype=np.float64)))


def shown_error(picture: Linear, reference: Film) -> float:
    """Mean squared error of values clipped to [0, 1], corrected for the reference's own noise.

    The two must come from different samples. White pixels of the reference are taken as free of noise.

    Raises BadInput if the reference has no variance.
    """
    if reference.variance is None:
        raise BadInput("the reference has no variance", "render it into a film")
    noise = reference.variance / reference.count[..., None] * (reference.mean < 1.0)
    squares = (np.clip(picture, 0, 1) - np.clip(reference.mean, 0, 1)) ** 2
    return float((squares - noise).mean())


def decibels(squared: float) -> float:
    """PSNR of a mean squared error; infinite at 0."""
    return float(-10 * np.log10(squared)) if squared > 0 else np.inf
