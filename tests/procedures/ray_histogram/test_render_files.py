import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.render_files import halves_of_samples, read_halves, read_layers
from procedures.reading.exr import read_exr, write_exr

LAYOUTS = {  # names of the picture, the albedo, the normal and the depth
    "Blender": (
        [f"ViewLayer.Combined.{c}" for c in "RGBA"],
        [f"ViewLayer.Denoising Albedo.{c}" for c in "RGB"],
        [f"ViewLayer.Denoising Normal.{c}" for c in "XYZ"],
        ["ViewLayer.Depth.Z"],
    ),
    "Mitsuba": (list("RGB"), [f"albedo.{c}" for c in "RGB"], [f"nn.{c}" for c in "XYZ"], ["dd.T"]),
    "Arnold": (list("RGBA"), [f"albedo.{c}" for c in "RGB"], [f"N.{c}" for c in "XYZ"], ["Z"]),
}


@pytest.fixture
def openexr():
    return pytest.importorskip("OpenEXR", reason="OpenEXR is an extra")


@pytest.mark.parametrize("renderer", LAYOUTS)
def test_layers_of_renderers_are_read(rng, openexr, tmp_path, renderer):
    values = {}
    for names in LAYOUTS[renderer]:
        values |= {name: rng.random((6, 5)).astype(np.float32) for name in names}
    with openexr.File({"type": openexr.scanlineimage, "compression": openexr.ZIP_COMPRESSION}, dict(values)) as file:
        file.write(str(tmp_path / "render.exr"))
    layers = read_layers(tmp_path / "render.exr")
    colours, albedo, normal, (depth,) = LAYOUTS[renderer]
    for name, channels in (("image", colours[:3]), ("albedo", albedo), ("normal", normal)):
        np.testing.assert_array_equal(layers[name], np.stack([values[one] for one in channels], axis=-1))
    np.testing.assert_array_equal(layers["depth"], values[depth])


def test_pictures_are_written_read_and_split_into_halves(rng, openexr, tmp_path):
    picture, spread = rng.random((2, 4, 7, 3)).astype(np.float32)
    write_exr(tmp_path / "filtered.exr", {"": picture, "uncertainty": spread})
    np.testing.assert_array_equal(read_layers(tmp_path / "filtered.exr")["image"], picture)
    channels, names = read_exr(tmp_path / "filtered.exr", ["uncertainty.G"])
    np.testing.assert_array_equal(channels["uncertainty.G"], spread[..., 1])
    assert names == ["B", "G", "R", "uncertainty.B", "uncertainty.G", "uncertainty.R"]
    write_exr(tmp_path / "albedo.exr", {"albedo": rng.random((4, 7, 3))})
    with pytest.raises(BadInput, match=r"needs a picture of channels R, G and B; it has albedo\.B"):
        read_layers(tmp_path / "albedo.exr")
    for i in range(2):
        write_exr(tmp_path / f"{i}.exr", {"": 1 + rng.random((8, 9, 3)), "albedo": np.full((8, 9, 3), 0.5)})
    (first, second), whole = read_halves([tmp_path / "0.exr", tmp_path / "1.exr"])
    np.testing.assert_allclose(whole.film.mean, (first.film.mean + second.film.mean) / 2)
    np.testing.assert_allclose(whole.light.mean, 2 * whole.film.mean)
    write_exr(tmp_path / "small.exr", {"": np.ones((7, 9, 3))})
    with pytest.raises(BadInput, match="two halves need one size"):
        read_halves([tmp_path / "0.exr", tmp_path / "small.exr"])
    true = rng.uniform(0.001, 0.1, (40, 50, 1)).repeat(3, 2)  # of each picture's 16 samples' mean
    for i in range(2):
        picture = 1 + np.sqrt(true) * rng.standard_normal(true.shape)
        write_exr(tmp_path / f"{i}.exr", {"": picture, "Denoising Image Variance": 16 * true})
    (first, _), whole = read_halves([tmp_path / "0.exr", tmp_path / "1.exr"])
    np.testing.assert_allclose(mean_variance(first.film), true, rtol=0.1)
    np.testing.assert_allclose(mean_variance(whole.film), true / 2, rtol=0.1)


def test_halves_are_even_and_odd_samples_and_others_are_refused(rng, tmp_path):
    samples, albedo, depth = rng.random((6, 5, 8, 3)), rng.uniform(0.2, 0.9, (6, 5, 8, 3)), rng.uniform(1, 9, (6, 5))
    (first, second), whole = halves_of_samples({"samples": samples, "albedo": albedo, "depth": depth})
    np.testing.assert_allclose(first.film.mean, samples[:, :, ::2].mean(2))
    np.testing.assert_allclose(second.albedo, albedo[:, :, 1::2].mean(2))
    np.testing.assert_allclose(whole.light.mean, samples.mean(2) / albedo.mean(2))
    np.testing.assert_allclose(first.guides, second.guides)  # one depth per pixel has no noise
    np.testing.assert_allclose(first.film.merge(second.film).moment2, film_of_samples(samples).moment2)
    np.savez(tmp_path / "few.npz", samples=rng.random((6, 5, 3, 3)))
    np.savez(tmp_path / "film.npz", image=rng.random((6, 5, 3)))
    with pytest.raises(BadInput, match="needs 4 samples per pixel or more; got 3"):
        read_halves([tmp_path / "few.npz"])
    with pytest.raises(BadInput, match=r"a blend needs the samples; .*film.npz has the arrays \['image'\]"):
        read_halves([tmp_path / "film.npz"])
    with pytest.raises(BadInput, match=r"an npz of samples, or two OpenEXR pictures; got few\.npz, film\.npz"):
        read_halves([tmp_path / "few.npz", tmp_path / "film.npz"])
