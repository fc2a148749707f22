"""`station refocus`: a restoration's picture with another aperture and focus, and what it cannot work on."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

LENS = {"metres": "behind", "focal_length_mm": 12.0, "f_number": [2.8, 2.0], "focus_m": [0.45, 0.45],
        "pixel_pitch_um": 6.0}  # fmt: skip


def write_restored(folder):
    rng = np.random.default_rng(1)
    sharp = np.kron(rng.uniform(0.1, 0.9, (12, 16)), np.ones((4, 4))).astype(np.float32)
    cv2.imwrite(str(folder / "sharp.tiff"), sharp)
    w = np.full(sharp.shape, 1.0, np.float32)
    w[:, 32:] = 3.0
    np.save(folder / "w.npy", w)
    record = {"schema": "station/restore/1", "procedure": "restore", "input": [], "parameters": LENS, "verdict": "pass"}
    (folder / "result.json").write_text(json.dumps(record))


@pytest.fixture
def restored(tmp_path):
    folder = tmp_path / "restored"
    folder.mkdir()
    write_restored(folder)
    return folder


def test_focus_moves_from_one_half_to_the_other(run, restored, tmp_path):
    sharp = cv2.imread(str(restored / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    # blur radii 1 and 3 px behind 0.45 m at f/2.8 lie at 0.506 and 0.670 m: 1/l = 1/l_s - r / (rho zeta)
    scale = 12 / 5.6 * (1 / (1 / 12 - 1 / 450)) / 0.006
    metres = [1 / (1 / 450 - r / scale) / 1000 for r in (1, 3)]
    for n, (near, far) in enumerate(((np.s_[:, 4:28], np.s_[:, 38:60]), (np.s_[:, 38:60], np.s_[:, 4:28]))):
        out = tmp_path / f"o{n}"
        done = run("refocus", restored, "--f-number", 1.4, "--focus-m", metres[n], "--out", out)
        assert done.exit_code == 0, done.output
        picture = cv2.imread(str(out / "refocused.tiff"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_allclose(picture[near], sharp[near], atol=1e-6)
        assert np.abs(picture[far] - sharp[far]).max() > 0.1
        record = json.loads((out / "result.json").read_text())
        plane = record["planes"]["picture"]
        assert plane["depth_of_field_near"]["value"] < metres[n] < plane["depth_of_field_far"]["value"]
        assert "Pictures" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("change", "words", "code"),
    [
        ({"metres": None}, "--metres front", 4),
        ({"f_number": []}, "no whole restoration", 4),
        ({"pixel_pitch_um": 0.0001}, "blur circles", 2),
    ],
)
def test_what_is_no_restoration_in_metres_is_refused(run, restored, tmp_path, change, words, code):
    record = json.loads((restored / "result.json").read_text())
    record["parameters"] |= change
    (restored / "result.json").write_text(json.dumps(record))
    done = run("refocus", restored, "--f-number", 2, "--focus-m", 0.6, "--out", tmp_path / "o")
    assert (done.exit_code, words in done.output) == (code, True), done.output
    assert not (tmp_path / "o").exists()
