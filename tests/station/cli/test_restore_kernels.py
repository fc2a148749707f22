"""`station restore` with kernels measured in pixels, on two photographs of a flat scene as camera files."""

import json

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from tests.program import run

SIZE, RIM, SHIFT = 96, 8, 2


def walk(size, seed):
    """A kernel of camera shake: a smooth random path of uneven speed."""
    rng = np.random.default_rng(seed)
    path = gaussian_filter(rng.standard_normal((2, 600)).cumsum(axis=1), (0, 25))
    path -= (path.max(axis=1, keepdims=True) + path.min(axis=1, keepdims=True)) / 2
    places = np.rint(path / np.abs(path).max() * (size - 1) / 2 + size // 2).astype(int)
    kernel = np.zeros((size, size))
    np.add.at(kernel, (places[1], places[0]), 1)
    return kernel / kernel.sum()


def error(u, truth):
    return float(np.sqrt(np.mean((u - truth)[RIM:-RIM, RIM:-RIM] ** 2)))


@pytest.mark.slow
def test_two_photographs_shifted_against_each_other_are_restored_by_their_kernels(tmp_path):
    rng = np.random.default_rng(11)
    n = SIZE + 40
    truth = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((n, n)), 3)) + 0.04 * rng.standard_normal((n, n))
    z = []
    for k, size in enumerate((9, 11)):
        kernel = walk(size, k)
        clean = fftconvolve(truth, kernel, mode="same")[20:-20, 20 - SHIFT * k : n - 20 - SHIFT * k]
        z.append(np.clip(clean + 0.004 * rng.standard_normal(clean.shape), 0, 1))
        np.savetxt(tmp_path / f"kernel{k}.txt", kernel)
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.rint(255 * z[k]).astype(np.uint8))
    files = [tmp_path / name for name in ("0.png", "1.png", "kernel0.txt", "kernel1.txt")]
    words = ["restore", *files[:2], "--blur", "motion", "--shape", *files[2:]]
    run(*words, "--scheme", "2x(6+8)+1x15", "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["verdict"] == "pass", record["reason"]
    assert record["parameters"]["ratio"] == [pytest.approx(10 / 8)]
    assert record["parameters"]["max_w"] == 8
    sharp = cv2.imread(str(tmp_path / "out" / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    truth, aligned = truth[20:-20, 20:-20], [z[0], np.roll(z[1], -SHIFT, axis=1)]
    assert error(sharp, truth) < min(error(one, truth) for one in aligned) / 10 ** (3 / 20)
    w = np.load(tmp_path / "out" / "w.npy")[RIM:-RIM, RIM:-RIM]
    assert np.median(w) == pytest.approx(4.0, abs=0.1)  # that of the kernels
    assert w.std() < 0.2
    assert record["shift"]["unit"] == "pixel"
    assert record["shift"]["x_y"][1] == pytest.approx((SHIFT, 0), abs=0.1)
    assert "shift of photograph 2 beyond its blur" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    small = ["--ratio", "1.25", "--max-w", "2.5", "--scheme", "1x(2+2)+1x4"]  # less than the kernels
    result = run(*words, *small, "--out", tmp_path / "small", says="warning: Y: doubtful; ")
    assert "what to do: " in result.stderr
