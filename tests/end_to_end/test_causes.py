"""Photographs that a camera processed: the most likely cause first, then the others, in terminal, record and page."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.dng import Shot, write_dng
from station.results.reader import read_result
from tests.procedures.pattern_psf.conftest import photograph
from tests.procedures.pattern_psf.damage import picture
from tests.program import run

pytestmark = pytest.mark.slow

WHITE = 65535


@pytest.fixture(scope="module")
def processed() -> np.ndarray:
    """A photograph of the chart as a camera makes a JPEG: tone curve, sharpening, compression."""
    rng = np.random.default_rng(3)
    clean = photograph().clean
    noisy = clean + np.sqrt(1e-5 + 1e-4 * np.clip(clean, 0, 1)) * rng.standard_normal(clean.shape)
    return np.round(WHITE * np.clip(picture(92, 0.3)(0.9 * noisy), 0, 1)).astype(np.uint16)


def estimated(file: Path) -> tuple[str, dict[str, Any], str, Path]:
    """Output in terminal, record and page."""
    out = file.parent / "out"
    words = ["psf", "pattern", str(file), "--plane", "Y", "--report", "--out", str(out)]
    done = run(*words)
    plane = json.loads((out / "result.json").read_text())["planes"]["Y"]
    assert plane["verdict"] == "doubtful"
    return done.stderr, plane, (out / "report.html").read_text(), out


def test_the_tone_curve_of_a_processed_picture_comes_first(processed: np.ndarray, tmp_path: Path) -> None:
    file = tmp_path / "processed.png"
    cv2.imwrite(str(file), processed)
    said, plane, page, out = estimated(file)
    assert plane["reason"].startswith("the response is not linear")
    assert plane["remedy"] == "use the RAW file, or a linear picture"
    others = plane["other_causes"]
    assert others
    assert all(one.keys() == {"reason", "remedy"} for one in others)
    assert said.index(plane["reason"]) < said.index("other possible causes:") < said.index(others[0]["reason"])
    plain = re.sub(r"<[^>]*>", "", page)
    assert plain.index("The response is not linear") < plain.index("Other possible causes:")
    assert [(one.reason, one.remedy) for one in read_result(out).by_name["Y"].other_causes] == [
        (one["reason"], one["remedy"]) for one in others
    ]


def test_the_same_image_in_a_raw_file_is_not_called_processed(processed: np.ndarray, tmp_path: Path) -> None:
    file = tmp_path / "processed.dng"
    write_dng(file, processed, Shot(), cfa=None, black=(0,) * 4, white=WHITE)
    said, plane, page, _ = estimated(file)
    for text in (said, plane["remedy"], *(one["remedy"] for one in plane.get("other_causes", ())), page):
        assert "use the RAW file" not in text
