from __future__ import annotations

import numpy as np
import pytest

from procedures.restoration.forward import Blur
from procedures.restoration.sharpness import PART, sharpness_of


def picture_of(sharpness, shape, rng):
    """A picture of the prior itself: power sharpness / L(f)."""
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :]
    laplacian = 4 - 2 * np.cos(2 * np.pi * fy) - 2 * np.cos(2 * np.pi * fx)
    laplacian[0, 0] = np.inf
    white = np.fft.fft2(rng.standard_normal(shape))
    return 0.5 + np.sqrt(sharpness) * np.fft.ifft2(white / np.sqrt(laplacian)).real


@pytest.mark.parametrize("sharpness", [2e-4, 5e-3])
@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_the_priors_own_variance_is_found_through_the_blur(vibration_stacks, sharpness, noise):
    rng = np.random.default_rng(8)
    R, shape = vibration_stacks[0].R, (150, 170)
    u = picture_of(sharpness, (shape[0] + 2 * R, shape[1] + 2 * R), rng)
    z = []
    for stack in vibration_stacks:
        blur = Blur(stack, shape)
        blur.focus(np.full(u.shape, 3.0))
        z.append(blur.blur(u[None]) + noise * rng.standard_normal(shape))
    # a noise taken 20 % too small must not become sharpness
    found = sharpness_of(np.stack(z), vibration_stacks, np.full(shape, 3.0), 0.8 * noise)
    assert found == pytest.approx(PART * sharpness, rel=0.35)


def test_the_difference_of_neighbours_is_what_is_meant():
    rng = np.random.default_rng(9)
    u = picture_of(4e-3, (256, 256), rng)
    assert (np.diff(u, axis=0) ** 2).mean() + (np.diff(u, axis=1) ** 2).mean() == pytest.approx(4e-3, rel=0.02)
