import numpy as np
import pytest

from procedures.correction.kernel_tiles import gaussian_width, kernel_tiles
from procedures.outcome import BadParameter
from tests.procedures.correction.small_lens import SmallLens

LENS = SmallLens((64, 80), 0.8)


def test_filters_keep_flat_light_with_the_noise_gain_asked_for_and_a_gaussians_width():
    field = LENS.field("Y").field
    tiles = kernel_tiles({"Y": field}, noise_gain=2.0, columns=3, size=9)
    np.testing.assert_allclose(tiles.kernels.sum(axis=(-2, -1)), 1, atol=1e-9)
    assert np.median(tiles.noise_gain) == pytest.approx(2.0, rel=2e-3)  # the root's tolerance
    tiles = kernel_tiles(dict.fromkeys(("R", "G1", "G2", "B"), field), columns=2, size=9)
    assert tiles.shape == (128, 160)
    assert tiles.kernels.shape == (2, 2, 3, 9, 9)
    with pytest.raises(BadParameter, match="fields of red, green and blue, or of a grey plane; got R, B"):
        kernel_tiles({"R": field, "B": field})
    with pytest.raises(BadParameter, match="a noise gain above 1"):
        kernel_tiles({"Y": field}, noise_gain=1.0)
    f = np.fft.fftfreq(64)
    gaussian = np.exp(-2 * (np.pi * 1.3) ** 2 * (f[:, None] ** 2 + f**2))
    assert gaussian_width(gaussian) == pytest.approx(1.3, rel=0.01)  # rings of a sixty-fourth of a cycle per pixel
