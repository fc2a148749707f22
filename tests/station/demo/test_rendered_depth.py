"""A rendered scene in depth, from its light to the restored depth, on a small picture."""

import json

import numpy as np
import pytest

from station.demo.rendered import RenderPlan, rendered_demo, steps
from station.demo.rendered_depth import NAME, RATIO
from tests.program import run

pytestmark = pytest.mark.nightly

SMALL = RenderPlan(columns=144, samples=32, converged=32, scenes=())


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("rendered")
    sentences = []
    _, depth, text = rendered_demo(out, SMALL, threads=2, progress=lambda done, steps=1: sentences.append(done))
    return out, depth, json.loads(text), sentences


def test_depth_is_found_from_the_light_of_a_scene_and_kept(done):
    # true w spans 0.7 samples on a picture this small: half of all pixels are right to a quarter of that, where
    # a plane of any one depth would not follow it at all
    _, depth, _, _ = done
    inside = np.s_[depth.rim : -depth.rim, depth.rim : -depth.rim]
    figures = depth.figures
    assert figures["w_px"]["median_error"] < 0.25 * np.ptp(depth.w[inside])
    assert np.corrcoef(depth.restoration.w[inside].ravel(), depth.w[inside].ravel())[0, 1] > 0.5
    levels = figures["rms_error_of_picture"]
    assert levels["restored"][0] < min(levels["photographs"])
    out, depth, record, sentences = done
    assert len(sentences) == steps(SMALL)
    assert record["restored"]["w_px"]["rms_error"] == pytest.approx(depth.figures["w_px"]["rms_error"])
    assert {one["path"] for one in record["restored"]["photographs"]} == {path.name for path in out.glob("*.dng")}
    page = (out / "rays.html").read_text()
    assert "restored from two apertures" in page
    assert page.count("data:image/png;base64,") == 2 + 2 + 3


def test_the_command_finds_the_same_from_the_files(done, tmp_path):
    out, depth, record, _ = done
    files = [str(out / one["path"]) for one in record["restored"]["photographs"]]
    options = ["--blur", "defocus", "--shape", "pillbox", "--ratio", str(RATIO), "--max-w", str(depth.plan.max_w)]
    run("restore", *files, *options, "--out", tmp_path / "restored")
    np.testing.assert_array_equal(np.load(tmp_path / "restored" / "w.npy"), np.load(out / f"{NAME}-w.npy"))


def test_true_blur_grows_towards_that_of_infinity_at_one_mean(done):
    plan, w = done[1].plan, done[1].w
    assert w.shape == (plan.rows // 2, plan.columns // 2)
    assert 0 < w.min() < w.max() < plan.max_w
    # the scene is closed: a distance d in front of infinity blurs by 1 - focus / d of it
    distance = 1000 / (1 - w / plan.max_w)
    assert 1290 < distance.min() < 1360
    assert distance.max() < 2401
    _, depth, _, _ = done
    first, second = depth.photographs
    assert first.mean() == pytest.approx(second.mean(), rel=0.02)
    assert first.std() > second.std()  # the wider aperture blurs more
