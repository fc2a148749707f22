"""`station restore --metres`: required camera data, and the distances."""

import json

import numpy as np
import pytest

from procedures.restoration.masks.blur_models import mask_stack, named, pillbox, spread_of
from procedures.restoration.masks.blur_operator import BlurOperator
from procedures.restoration.masks.thin_lens import CameraSetting
from tests.program import run

from .test_restore_shapes import BOTH, FAR, NEAR, SIZE, R, depth, write

FOCAL_MM, FOCUS_M, PITCH_UM = 12.0, 0.45, 6.0
CAMERA = [
    "--focal-length-mm", "12", "--focus-m", "0.45", "--pixel-pitch-um", "6", "--f-number", "2.8", "--f-number", "2",
]  # fmt: skip


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    return photographed(pillbox(), tmp_path_factory.mktemp("metres"))


def photographed(shape, folder):
    rng = np.random.default_rng(4)
    picture = np.kron(rng.uniform(0.1, 0.9, (40, 48)), np.ones((3, 3)))[: BOTH[0], : BOTH[1]]
    images = []
    for stack in [mask_stack(shape, 4.0, ratio=ratio, R=R) for ratio in (1.0, 1.4)]:
        blur = BlurOperator(stack, SIZE)
        blur.focus(depth())
        images.append(blur.blur(picture))
    return write(folder, images)


@pytest.mark.parametrize(
    "shape", [pytest.param("pillbox", marks=pytest.mark.slow), pytest.param("gaussian:0.5", marks=pytest.mark.nightly)]
)
def test_distances_of_two_halves_follow_from_their_blur(shape, tmp_path):
    images = photographed(named(shape), tmp_path)
    words = ("--blur", "defocus", "--max-w", "4", "--metres", "behind", *CAMERA, "--shape", shape)
    run("restore", *images, *words, "--scheme", "6x(8+8)+2x10", "--out", tmp_path / "o")
    setting = CameraSetting(FOCAL_MM, 2.8, 1000 * FOCUS_M, PITCH_UM, spread_of(shape))
    metres, std = (np.load(tmp_path / "o" / f"{name}.npy") for name in ("distance", "distance_std"))
    for w, half in ((FAR, np.s_[20:-20, 20:48]), (NEAR, np.s_[20:-20, 76:-20])):
        expected = setting.distance_mm(-w) / 1000
        determined = np.isfinite(metres[half])
        assert determined.mean() > 0.5
        assert np.mean(np.abs(metres[half][determined] - expected) < 2 * std[half][determined]) > 0.9
        assert np.nanmedian(std[half]) < 0.03 * expected
    w, determined = np.load(tmp_path / "o" / "w.npy"), np.isfinite(metres)
    np.testing.assert_allclose(metres[determined], setting.distance_mm(-w[determined]) / 1000, rtol=1e-5)  # float32
    record = json.loads((tmp_path / "o" / "result.json").read_text())
    assert record["distance"]["unit"] == "m"
    assert record["parameters"]["ratio"] == [pytest.approx(1.4)]
    assert "Distance in metres" in (tmp_path / "o" / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "code", "complaint"),
    [
        (["--metres", "behind", *CAMERA[:4], *CAMERA[6:]], 2, "--pixel-pitch-um"),
        (["--metres", "behind", *CAMERA[:6]], 2, "--f-number"),
        (["--metres", "behind", *CAMERA, "--ratio", "1.4"], 2, "from the camera's data"),
        (["--metres", "front", *CAMERA, "--shape", "polygon:7"], 2, "--shape pillbox"),
        (["--metres", "front", *CAMERA, "--shape", "gaussian:0"], 2, "k > 0"),
        (["--shape", "pillbox", "--focus-m", "0.45"], 2, "go with --metres"),
        (["--metres", "front", *CAMERA, "--focus-m", "1", "--focus-m", "2"], 2, "one for each of 2 images"),
    ],
)
def test_missing_and_contradictory_data_are_named(images, tmp_path, words, code, complaint):
    run("restore", *images, "--blur", "defocus", *words, "--out", tmp_path / "o", code=code, says=complaint)
    assert not (tmp_path / "o" / "result.json").exists()
