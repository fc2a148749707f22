from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.ndimage import gaussian_filter

from drivers.frame_files.dng import Shot, write_dng
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import BlurOperator
from station.__main__ import main

SHAPE, R = (96, 112), 8
LIGHT = np.array([0.6, 1.0, 0.7])
QUICK = ("--blur", "defocus", "--shape", "pillbox", "--ratio", "1.25", "--max-w", "3", "--scheme", "4x(8+8)+1x10")


@pytest.fixture(scope="module")
def light():
    """Two photographs of a grey scene at two depths, and the sharp one (3, 3, H, W), with a contrast of 30 levels."""
    rng, extended = np.random.default_rng(5), (SHAPE[0] + 2 * R, SHAPE[1] + 2 * R)
    grey = 0.5 + 0.13 * np.sign(gaussian_filter(rng.standard_normal(extended), 6))
    grey = gaussian_filter(grey + 0.3 * np.clip(gaussian_filter(rng.standard_normal(extended), 1.5), -0.4, 0), 0.6)
    w = np.where(np.arange(extended[1]) > extended[1] / 2, 4.6, 3.4) * np.ones(extended)
    photographs = []
    for ratio in (1.0, 1.25):
        blur = BlurOperator(mask_stack(pillbox(), 5.6, ratio=ratio, R=R), SHAPE)
        blur.focus(w)
        photographs.append(blur.blur(LIGHT[:, None, None] * grey))
    photographs = np.stack(photographs)
    truth = (LIGHT[:, None, None] * grey)[None, :, R:-R, R:-R]
    return np.concatenate([photographs + 1.2e-3 * rng.standard_normal(photographs.shape), truth])


def restore(files, out, *words):
    return CliRunner().invoke(
        main, ["restore", *map(str, files), *QUICK, *words, "--out", str(out)], prog_name="station"
    )


@pytest.mark.slow
def test_a_grey_scene_in_two_raw_files_stays_grey(light, tmp_path):
    *files, truth = [tmp_path / "a.dng", tmp_path / "b.dng", tmp_path / "truth.dng"]
    for path, z in zip([*files, truth], light, strict=True):
        mosaic = np.zeros(SHAPE, np.uint16)
        for (y, x), c in {(0, 0): 1, (0, 1): 0, (1, 0): 2, (1, 1): 1}.items():
            mosaic[y::2, x::2] = np.rint(500 + 15000 * z[c, y::2, x::2])
        write_dng(path, mosaic, Shot(), cfa="GRBG", black=(500,) * 4, white=15500)
    done = restore(files, tmp_path / "out", "--plane", "all", "--reference", str(truth))
    assert done.exit_code == 0, done.output
    sharp = cv2.imread(str(tmp_path / "out" / "sharp.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert sharp.shape == (*SHAPE, 3)
    balanced = sharp / LIGHT
    # planes stacked without their displacement differed by half the contrast
    assert 255 * np.std(balanced[..., 0] - balanced[..., 2]) < 2
    w = np.load(tmp_path / "out" / "w.npy")
    assert w.shape == SHAPE
    # in pixels of a plane, as --max-w: 1.7 and 2.3
    assert np.median(w[20:-20, 70:]) == pytest.approx(2.3, abs=0.15)
    assert (tmp_path / "out" / "report.html").exists()
    comparison = json.loads((tmp_path / "out" / "result.json").read_text())["ground_truth"]
    # of the planes' samples: those of red and blue are between green's
    off = (sharp - light[2].transpose(1, 2, 0))[12:-12, 12:-12]
    assert comparison["error"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.3)
    middle = [SHAPE[1] / 4, SHAPE[0] / 4]
    np.testing.assert_allclose(np.array(comparison["matrix"]) @ [*middle, 1], middle, atol=0.05)


@pytest.mark.slow
def test_colour_files_are_restored_by_their_encoding(light, tmp_path):
    files = [tmp_path / "a.tiff", tmp_path / "b.tiff"]
    for path, z in zip(files, light[:2], strict=True):
        curve = np.where(z <= 0.0031308, 12.92 * z, 1.055 * np.maximum(z, 0) ** (1 / 2.4) - 0.055)
        cv2.imwrite(str(path), np.rint(65535 * curve).astype(np.uint16).transpose(1, 2, 0)[..., ::-1])
    done = restore(files, tmp_path / "out", "--encoding", "srgb", "--max-w", "6", "--scheme", "1x(4+4)+1x4")
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["parameters"]["encoding"] == "srgb"
    assert record["parameters"]["planes"] == ["R", "G", "B"]
    sharp = cv2.imread(str(tmp_path / "out" / "sharp.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert sharp.mean(axis=(0, 1)) == pytest.approx(light[0].mean(axis=(1, 2)), rel=0.02)


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_colour_pictures_need_an_encoding(tmp_path, suffix):
    files = [tmp_path / f"{name}.{suffix}" for name in "ab"]
    for path in files:
        cv2.imwrite(str(path), np.full((*SHAPE, 3), 9000, np.uint16))
    done = restore(files, tmp_path / "out")
    assert done.exit_code == 4
    assert "--encoding linear or srgb" in done.stderr
