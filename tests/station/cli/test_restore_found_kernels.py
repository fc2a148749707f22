"""`station restore` writes the kernels of a flat scene's motions, and accepts them as input."""

import json

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from station.calibration.restoration.inputs import read_blur_shape, read_kernels
from tests.program import run

SLOW_FIXTURES = {"found"}
SIZE = 72
KERNELS = [np.array(rows, float) / 8 for rows in (
    [[0, 1, 2], [0, 0, 3], [0, 0, 2]],
    [[0, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 2, 2, 1, 0], [0, 0, 0, 2, 0], [0, 0, 0, 0, 0]],
)]  # fmt: skip
QUICK = ("--blur", "motion", "--prototype-region", "whole", "--scheme", "1x(2+2)+1x6")


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("flat"), np.random.default_rng(2)
    scene = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 4, SIZE + 4)), 2))
    for n, kernel in enumerate(KERNELS):
        z = fftconvolve(scene, kernel, mode="same")[2:-2, 2:-2] + 0.002 * rng.standard_normal((SIZE, SIZE))
        cv2.imwrite(str(folder / f"{n}.png"), np.rint(65535 * z).astype(np.uint16))
        np.savetxt(folder / f"kernel{n}.txt", kernel)
    return folder


@pytest.fixture(scope="module")
def result(photographs):
    """The result with the true kernels given, without a search."""
    out = photographs / "out"
    return again(photographs, out, *(photographs / f"kernel{n}.txt" for n in (0, 1))), out


def again(photographs, out, *kernels, **how):
    images = [photographs / f"{n}.png" for n in (0, 1)]
    return run("restore", *images, *QUICK, "--shape", *kernels, "--out", out, **how)


def test_kernels_are_written_like_other_psfs(result):
    _, out = result
    first = np.load(out / "kernel_1.npy")
    np.testing.assert_allclose(first, np.pad(KERNELS[0], 1), atol=1e-12)
    np.testing.assert_allclose(np.load(out / "kernel_2.npy"), KERNELS[1], atol=1e-12)
    assert cv2.imread(str(out / "kernel_1.tiff"), cv2.IMREAD_UNCHANGED) == pytest.approx(first, abs=1e-7)
    fits = (out / "kernel_1.fits").read_bytes()
    np.testing.assert_array_equal(np.frombuffer(fits[2880 : 2880 + 200], ">f8").reshape(5, 5), first)
    assert b"SAMPLING=" in fits[:2880]
    assert json.loads((out / "result.json").read_text())["kernels"] == {"count": 2, "samples_per_pixel": 1}
    assert "kernel_2.npy" in (out / "report.html").read_text(encoding="utf-8")


def test_as_input_they_reproduce_the_picture(photographs, result, tmp_path):
    again(photographs, tmp_path / "o", *(result[1] / f"kernel_{n}.npy" for n in (1, 2)))
    assert (tmp_path / "o" / "sharp.tiff").read_bytes() == (result[1] / "sharp.tiff").read_bytes()


def test_found_kernels_have_an_uncertain_picture_and_serve_as_shapes(result):
    std = cv2.imread(str(result[1] / "sharp_std.tiff"), cv2.IMREAD_UNCHANGED)
    assert std.shape == (SIZE, SIZE)
    assert 0 < std.max() < 0.2
    shape = read_blur_shape(str(result[1] / "kernel_2.npy"), "G1", (SIZE, SIZE))
    np.testing.assert_allclose(shape, KERNELS[1], atol=1e-12)


def test_their_doubt_is_inherited(result, tmp_path):
    record = json.loads((result[1] / "result.json").read_text())
    record["parameters"]["motion"]["caveat"] = "two ways end unlike"
    (tmp_path / "result.json").write_text(json.dumps(record))
    (tmp_path / "kernel_1.npy").write_bytes((result[1] / "kernel_1.npy").read_bytes())
    assert read_kernels([tmp_path / "kernel_1.npy"])[1] == "two ways end unlike"
    assert read_kernels([result[1] / "kernel_1.npy"])[1] is None


def test_kernels_are_one_for_each_photograph_and_no_finer_than_pixels(photographs, tmp_path):
    np.savetxt(tmp_path / "fine.txt", np.ones((41, 41)))
    for kernels, says in (
        ([photographs / "kernel0.txt"], "one kernel for each of 2 images"),
        ([tmp_path / "fine.txt"] * 2, "less than 40 pixels each way; got 41 x 41, 41 x 41"),
    ):
        assert again(photographs, tmp_path / "o", *kernels, code=None, says=says).exit_code != 0
