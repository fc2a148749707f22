"""`station restore --reference`: a result compared with a sharp photograph, from files to files."""

import json
import shutil

import cv2
import numpy as np
import pytest

from tests.program import run

SLOW_FIXTURES = {"photographs"}
QUICK = ["--blur", "motion", "--scheme", "4x(6+6)+1x8", "--max-w", "5.2"]
CORNER = (slice(100, 200), slice(180, 300))


@pytest.fixture(scope="module")
def photographs(shared_data, tmp_path_factory):
    """A corner of the vibrating pair as item_1 and item_2, the truth at another brightness, and the shapes."""
    folder, target = shared_data / "synthetic" / "restoration", tmp_path_factory.mktemp("photographs")
    for n in (1, 2):
        image = cv2.imread(str(folder / f"vibration_40dB_{n}.pgm"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(target / f"item_{n}.pgm"), image[CORNER])
        shutil.copy(folder / f"vibration_shape{n}.txt", target)
    sharp = np.load(folder / "sharp.npy")[100:200, 180:300]
    cv2.imwrite(str(target / "truth.png"), np.rint(60000 * 0.8 * sharp).astype(np.uint16))
    return target


def restore(folder, out, *words, **how):
    files, shapes = ([folder / one.format(n) for n in (1, 2)] for one in ("item_{}.pgm", "vibration_shape{}.txt"))
    return run("restore", *files, *QUICK, "--shape", *shapes, *words, "--out", out, **how)


@pytest.mark.slow
def test_record_page_and_picture_show_the_difference_from_the_truth(photographs, tmp_path):
    restore(
        photographs, tmp_path / "out", "--reference", photographs / "truth.png", says="compared with the ground truth"
    )
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    comparison = record["ground_truth"]
    assert comparison["psnr_db"] > max(comparison["before_db"]) + 5
    assert record["parameters"]["reference"].endswith("truth.png")
    assert len(record["parameters"]["reference_sha256"]) == 64
    off = cv2.imread(str(tmp_path / "out" / "difference.tiff"), cv2.IMREAD_UNCHANGED)
    rms = np.sqrt(np.mean(off[off != 0].astype(np.float64) ** 2))
    assert rms == pytest.approx(10 ** (-comparison["psnr_db"] / 20), rel=0.01)
    assert "Comparison with the ground truth" in (tmp_path / "out" / "report.html").read_text()


def test_a_ground_truth_of_another_size_is_refused_before_any_work(photographs, tmp_path):
    cv2.imwrite(str(tmp_path / "small.png"), np.full((40, 50), 30000, np.uint16))
    done = restore(photographs, tmp_path / "out", "--reference", tmp_path / "small.png", code=4)
    assert "120 x 100 pixels, it has Y of 50 x 40" in done.output
    assert "round 0" not in done.output
