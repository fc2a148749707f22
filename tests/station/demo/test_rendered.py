import json

import numpy as np
import pytest

from procedures import BadParameter, read_film, read_frame
from simulators.rays.ray_scenes import SCENES
from station.demo.rendered import RenderPlan, rendered_demo, steps
from station.demo.rendered_depth import PASS, render_film

SMALL = RenderPlan(columns=32, samples=40, converged=70, scenes=("chart-in-depth",), restored=False)


def test_a_scene_is_rendered_filtered_photographed_and_shown(tmp_path):
    sentences = []
    (one,), _, text = rendered_demo(tmp_path, SMALL, progress=lambda done, steps=1: sentences.append(done))
    names = ["chart-in-depth.dng", "chart-in-depth.png", "films", "rays.html", "result.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    record = json.loads(text)
    assert record["scenes"]["chart-in-depth"]["psnr_db"] == pytest.approx(one.psnr_db)
    assert len(sentences) == steps(SMALL)
    # G1 of the photograph is the green of the filtered picture, blurred by lens and photosites: same mean
    plane = read_frame(tmp_path / "chart-in-depth.dng", ["G1"]).planes["G1"].samples
    white = 25e3 / (16383 - 512) / 2.4  # electrons of white over those that saturate the converter
    assert plane.mean() == pytest.approx(white * one.filtered.picture[..., 1].mean(), rel=0.02)


def test_an_interrupted_render_goes_on_where_it_stopped(tmp_path):
    scene, camera = SCENES["room"](12, 16)

    class Stopped(Exception):
        pass

    def stop(done, steps=1):
        raise Stopped

    with pytest.raises(Stopped):
        render_film(scene, camera, 3 * PASS, 1, tmp_path / "film.npz", progress=stop)
    assert (read_film(tmp_path / "film.npz").count == PASS).all()
    sentences = []
    resumed = render_film(
        scene, camera, 3 * PASS, 1, tmp_path / "film.npz", progress=lambda done, steps=1: sentences.append(done)
    )
    whole = render_film(scene, camera, 3 * PASS, 1, tmp_path / "other.npz")
    assert len(sentences) == 2
    np.testing.assert_array_equal(resumed.histogram, whole.histogram)
    np.testing.assert_allclose(resumed.mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(resumed.moment2, whole.moment2, rtol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"scenes": ("attic",)}, "no scene 'attic'"),
        ({"columns": 100}, "pictures of 100 columns"),
        ({"samples": 1}, "1 samples per pixel"),
    ],
)
def test_plans_that_cannot_be_meant_are_refused(wrong, says):
    with pytest.raises(BadParameter, match=says):
        RenderPlan(**wrong)
