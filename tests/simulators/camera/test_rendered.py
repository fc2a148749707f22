import numpy as np
import pytest

from procedures.raw import read_frame
from simulators.camera.optics import GaussianBlur, Optics, PixelAperture
from simulators.camera.render import blur_and_sample, photograph_render
from simulators.camera.sensor import SENSITIVITY, Sensor

SENSOR = Sensor(rows=40, columns=60)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_blur_adds_its_variance_and_moves_nothing(n):
    # a Gaussian of 2 pixels about pixel (18, 25): its cells are means over cells; a blur of 1.5 pixels, then photosites
    y, x = (np.arange(n * size) / n + (1 - n) / (2 * n) for size in (40, 60))
    blob = np.exp(-((y[:, None] - 18) ** 2 + (x - 25) ** 2) / (2 * 4))
    seen = blur_and_sample(blob, Optics((GaussianBlur(1.5), PixelAperture()), 3.76), "G", n)
    rows, columns = np.indices(seen.shape)
    light = seen / seen.sum()
    centre = (light * rows).sum(), (light * columns).sum()
    np.testing.assert_allclose(centre, (18, 25), atol=1e-6)
    # `blob` samples what should be means over cells, so that the cells' own transfer function is divided away in excess
    expected = 4 + 1.5**2 + 1 / 12 - 1 / (12 * n**2)
    assert (light * (rows - centre[0]) ** 2).sum() == pytest.approx(expected, rel=1e-4)


def test_an_even_light_gives_every_photosite_its_electrons(rng):
    picture = np.broadcast_to((0.5, 0.4, 0.3), (80, 120, 3))
    mosaic = photograph_render(picture, Optics.typical(), SENSOR, rng, white_e=20e3)
    for colour, level in zip("RGB", (0.5, 0.4, 0.3), strict=True):
        for (x, y), name in SENSOR.tile.items():
            if name == colour:
                mean_e = 20e3 * level * SENSITIVITY[colour]
                numbers = mosaic[y::2, x::2].astype(float)
                # photon and read noise of 600 photosites
                error = np.hypot(np.sqrt(mean_e), 3) / SENSOR.gain_e_per_dn / np.sqrt(numbers.size)
                assert numbers.mean() == pytest.approx(mean_e / SENSOR.gain_e_per_dn + 512, abs=4 * error)


def test_the_dng_is_read_back(rng, tmp_path):
    picture = np.broadcast_to(np.linspace(0.1, 0.9, 60)[None, :, None], (40, 60, 3))
    mosaic = photograph_render(picture, Optics.typical(), SENSOR, rng, tmp_path / "render.dng")
    plane = read_frame(tmp_path / "render.dng", ["G1"]).planes["G1"]
    np.testing.assert_allclose(plane.samples, SENSOR.linear(mosaic)[0::2, 1::2], atol=1e-6)


def test_a_monochrome_sensor_sees_luminance_of_a_picture_that_fits(rng):
    red = np.zeros((40, 60, 3))
    red[..., 0] = 1.0
    grey = Sensor(rows=40, columns=60, cfa=None, read_noise_e=0.0)
    mosaic = photograph_render(red, Optics.typical(), grey, rng, white_e=20e3)
    assert mosaic.mean() - 512 == pytest.approx(0.2126 * 20e3 / 2.4, rel=0.01)
    with pytest.raises(ValueError, match="some times as large; got"):
        photograph_render(np.ones((41, 60, 3)), Optics.typical(), SENSOR, rng)
