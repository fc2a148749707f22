import numpy as np
import pytest

from procedures.pattern import CELLS
from procedures.pattern_psf.observation import count_inside, noise_window, observe
from procedures.pattern_psf.radiometry import measure_light
from procedures.pattern_psf.registration import Registration

from .conftest import Bench


@pytest.mark.parametrize("margin_px", [0.0, 3.0])
def test_samples_are_those_whose_neighbourhood_is_in_the_noise_region(bench: Bench, margin_px: float) -> None:
    samples, registration = bench.clean.astype(np.float32), bench.marks()[1]
    light, window = measure_light(samples, registration, 1 / 65535), noise_window(registration, samples.shape)
    observation = observe(samples, registration, light, window, margin_px=margin_px)
    # the margin is that of the chart's middle and of its steeper side: with this tilt a tenth more or less elsewhere
    assert is_inside(registration, observation.points, 0.9 * margin_px).all()
    pixels = window.pixels().astype(float)
    surely = pixels[is_inside(registration, pixels, 1.2 * margin_px)]
    assert len(surely) > 5000
    assert {*map(tuple, surely)} <= {*map(tuple, observation.points)}
    assert count_inside(registration, window) == is_inside(registration, pixels, 0.0).sum()


def is_inside(registration: Registration, points: np.ndarray, margin_px: float) -> np.ndarray:
    """Whether squares of twice the margin's side about the points are in the noise region."""
    corners = points[:, None] + margin_px * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    cells = registration.to_pattern(corners.reshape(-1, 2))
    return ((cells >= 0) & (cells <= CELLS)).all(axis=1).reshape(-1, 4).all(axis=1)
