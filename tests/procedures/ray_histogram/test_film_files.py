import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.ray_histogram.film_files import read_film, write_film


def test_a_film_is_read_back_from_its_file_or_from_raw_samples(flat_film, tmp_path, rng):
    write_film(flat_film, tmp_path / "film.npz")
    back = read_film(tmp_path / "film.npz").checked()
    np.testing.assert_array_equal(back.mean, flat_film.mean)
    np.testing.assert_array_equal(back.histogram, flat_film.histogram)
    np.testing.assert_array_equal(back.count, flat_film.count)
    np.testing.assert_allclose(back.variance, flat_film.variance, rtol=1e-15)
    assert [path.name for path in tmp_path.iterdir()] == ["film.npz"]
    samples = rng.random((4, 5, 6, 3))
    samples[1, 2, 3] = np.nan
    np.savez(tmp_path / "samples.npz", samples=samples)
    film = read_film(tmp_path / "samples.npz")
    np.testing.assert_allclose(film.mean, np.nanmean(samples, axis=2), rtol=1e-12)
    assert film.dropped.sum() == 1


@pytest.fixture
def rendered(flat_film, tmp_path):
    """The two files of the published renderer: 61 float channels, and the picture in half precision with alpha."""
    openexr = pytest.importorskip("OpenEXR", reason="reading OpenEXR is an extra")
    rows, columns = flat_film.count.shape
    bins = np.dstack([flat_film.histogram.reshape(rows, columns, 60), flat_film.count]).astype(np.float32)
    histograms = {f"Bin_{i:04d}": np.ascontiguousarray(bins[..., i]) for i in range(61)}
    picture = {name: np.ascontiguousarray(flat_film.mean[..., i], np.float16) for i, name in enumerate("RGB")}
    picture["A"] = np.ones((rows, columns), np.float16)
    frame = {"type": openexr.scanlineimage, "compression": openexr.ZIP_COMPRESSION}
    part = {  # the renderer's picture may be a part of its frame
        "dataWindow": (np.array([40, 30], np.int32), np.array([39 + columns, 29 + rows], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([639, 479], np.int32)),
    }

    def write(name, channels, header):
        with openexr.File(dict(header), dict(channels)) as file:  # before 3.5 it changes what it is given
            file.write(str(tmp_path / name))
        return tmp_path / name

    write("h.exr", histograms, frame)
    write("p.exr", picture, frame | part)
    write("more.exr", histograms | {"Bin_0061": np.zeros((rows, columns), np.float32)}, frame)
    return tmp_path


def test_the_published_renderers_openexr_is_read(flat_film, rendered):
    film = read_film(rendered / "h.exr", rendered / "p.exr").checked()
    np.testing.assert_array_equal(film.histogram, flat_film.histogram)
    np.testing.assert_array_equal(film.count, flat_film.count)
    np.testing.assert_allclose(film.mean, flat_film.mean, rtol=2**-10)  # half precision


@pytest.mark.parametrize(
    ("name", "says"),
    [("h.exr", "no channels R, G and B"), ("p.exr", "no channel Bin_0000"), ("more.exr", "up to Bin_0061")],
)
def test_openexr_of_another_layout_is_refused(rendered, name, says):
    with pytest.raises(BadInput, match=says):
        read_film(rendered / name)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"image": np.zeros((23, 21, 3))}, r"`image` must be an array \(24, 21, 3\); got an array \(23, 21, 3\)"),
        ({"hist": np.zeros((24, 21, 3, 19))}, r"`hist` must be an array \(24, 21, 3, 20\)"),
        ({"nsamples": np.full((24, 21), -3)}, "`nsamples` must be finite, from -0.5 to .*; got -3"),
        ({"nsamples": np.zeros((24, 21))}, "504 of 504 pixels are empty"),
        ({"nsamples": np.full((24, 21), 90)}, "do not sum to their count"),
        ({"image": np.full((24, 21, 3), np.nan)}, "504 of 504 pixels are NaN"),
        ({"hist": np.full((24, 21, 3, 20), np.nan)}, "negative or NaN votes"),
        ({"hist": np.full((24, 21, 3, 20), -1.0)}, "negative or NaN votes"),
        ({"variance": np.full((24, 21, 3), -1.0)}, "variance that is negative"),
        ({"image": np.zeros((24, 21, 3), complex)}, "`image` must be real numbers"),
        ({"variance": np.zeros((2, 2, 3))}, r"`variance` must be an array \(24, 21, 3\)"),
        (
            {"samples": np.zeros((2, 2, 3))},
            r"`samples` must be an array \(any, any, any, 3\); got an array \(2, 2, 3\)",
        ),
    ],
)
def test_invalid_films_are_refused_with_a_reason(flat_film, tmp_path, change, says):
    arrays = {"image": flat_film.mean, "hist": flat_film.histogram, "nsamples": flat_film.count}
    np.savez(tmp_path / "film.npz", **(arrays | change))
    with pytest.raises(BadInput, match=says):
        read_film(tmp_path / "film.npz").checked()


def test_a_missing_array_is_named(flat_film, tmp_path):
    np.savez(tmp_path / "film.npz", image=flat_film.mean)
    with pytest.raises(BadInput, match="hist, nsamples missing among"):
        read_film(tmp_path / "film.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"not an archive", b"\x93NUMPY"])
def test_a_file_that_is_no_archive_is_refused(tmp_path, content):
    (tmp_path / "film.npz").write_bytes(content)
    with pytest.raises(BadInput, match=r"film\.npz"):
        read_film(tmp_path / "film.npz")


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(BadInput, match="there is no file"):
        read_film(tmp_path / "none.npz")
